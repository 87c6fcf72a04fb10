//! The walk through a tree that all queries along a ray share.

use super::stack::{Stack, entry, parts};
use super::wide::{LEAF, Node, WIDTH};
use bytemuck::{Pod, Zeroable};
use glam::Vec3A;

/// By how much boxes are widened, of the largest coordinate involved.
///
/// In units of rounding (2^-24) of that coordinate: the sheared corners of a triangle are off by at most 7 (1 for the
/// difference to the origin, 4 for the product with the shear, 2 for the difference of the two), the distances of a
/// slab by at most 4. The signs of the edge functions are exact, so a ray that hits passes the triangle within 7, and its
/// box, tested with an error of 4, within 11.
pub(super) const PAD: f32 = 16.0 * 0.5 * f32::EPSILON;

/// What the box tests need of a ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slabs {
    /// Origins for the near and the far planes; apart by the rounding of the tests.
    pub(super) near_origin: Vec3A,
    pub(super) far_origin: Vec3A,
    pub(super) inverse: Vec3A,
    /// A bit for each axis: the ray goes downwards.
    pub(super) negative: u32,
    pub(super) t_min: f32,
}

impl Slabs {
    /// `d` is finite and not zero, `largest` its largest absolute component; the slabs are widened by `pad`
    /// on both sides.
    #[inline(always)]
    pub(super) fn new(o: Vec3A, d: Vec3A, largest: f32, pad: f32, t_min: f32) -> Self {
        let floor = Vec3A::splat(largest * 1e-12);
        // A finite inverse: 0 * inf would be NaN. The pad times 1e12 exceeds every distance in question.
        let inverse = Vec3A::select(d.abs().cmpgt(floor), d, floor.copysign(d)).recip();
        let shift = Vec3A::splat(pad).copysign(inverse);
        let negative = inverse.cmplt(Vec3A::ZERO).bitmask();
        Self { near_origin: o + shift, far_origin: o - shift, inverse, negative, t_min }
    }

    /// Which planes of each axis the ray meets first.
    #[inline(always)]
    pub(super) fn sides(&self) -> [usize; 3] {
        [0, 1, 2].map(|k| (self.negative >> k & 1) as usize)
    }
}

/// A distance for each child; vectors are stored and loaded faster where they cross no line of the cache.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, align(32))]
pub(super) struct Distances(pub(super) [f32; WIDTH]);

/// See [`super::width::Width::walk_near`]; `test` returns the children whose boxes the ray passes before the
/// limit, one bit each, and where it enters them; `fetch` is told which two children wait at the top of the
/// stack.
#[inline(always)]
pub(super) fn near_first(
    nodes: &[Node],
    mut limit: f32,
    test: impl Fn(&Node, f32) -> (u32, Distances),
    fetch: impl Fn(u32),
    mut leaf: impl FnMut(u32, f32) -> Option<f32>,
) {
    let mut stack = Stack::new();
    let mut len = 0;
    let mut at = 0_u32;
    loop {
        if at & LEAF == 0 {
            let node = &nodes[at as usize];
            let (mut mask, near) = test(node, limit);
            if mask != 0 {
                let mut next = || {
                    let lane = mask.trailing_zeros() as usize % WIDTH;
                    mask &= mask - 1;
                    (entry(node.child[lane], near.0[lane]), mask != 0)
                };
                let (a, more) = next();
                if !more {
                    at = parts(a).0;
                    continue;
                }
                len = stack.reserve(len);
                (at, len) = push_ordered(&mut stack, len, a, next);
                fetch(parts(stack.get(len - 1)).0);
                fetch(parts(stack.get(len.max(2) - 2)).0);
                continue;
            }
        } else {
            match leaf(at & !LEAF, limit) {
                Some(new) => limit = new,
                None => return,
            }
        }
        at = loop {
            let Some((top, below)) = stack.pop(len) else { return };
            len = below;
            let (node, near) = parts(top);
            if near <= limit {
                break node;
            }
        };
    }
}

/// See [`super::width::Width::walk_any`]; `test` returns the children whose boxes the ray passes, one bit
/// each, `push` adds some of eight to a stack that has room for them and returns its new length, `fetch` is
/// told which two children wait at the top of the stack.
#[inline(always)]
pub(super) fn any_order(
    nodes: &[Node],
    test: impl Fn(&Node) -> u32,
    push: impl Fn(&mut Stack<u32>, usize, &[u32; WIDTH], u32) -> usize,
    fetch: impl Fn(u32),
    mut leaf: impl FnMut(u32) -> bool,
) {
    let mut stack = Stack::new();
    let mut len = 0;
    let mut at = 0_u32;
    loop {
        if at & LEAF == 0 {
            let node = &nodes[at as usize];
            let mask = test(node);
            if mask != 0 {
                at = node.child[mask.trailing_zeros() as usize % WIDTH];
                let rest = mask & (mask - 1);
                if rest != 0 {
                    len = stack.reserve(len);
                    len = push(&mut stack, len, &node.child, rest);
                    fetch(stack.get(len - 1));
                    fetch(stack.get(len.max(2) - 2));
                }
                continue;
            }
        } else if !leaf(at & !LEAF) {
            return;
        }
        let Some((top, below)) = stack.pop(len) else { return };
        (at, len) = (top, below);
    }
}

/// Pushes the entry `a` and those of `next`, which also tells whether there are more, but for the nearest one, which is
/// returned with the new length of the stack.
#[inline(always)]
fn push_ordered(
    stack: &mut Stack<u64>,
    len: usize,
    a: u64,
    mut next: impl FnMut() -> (u64, bool),
) -> (u32, usize) {
    let (b, more) = next();
    let (near, far) = (a.min(b), a.max(b));
    if !more {
        stack.set(len, far);
        return (parts(near).0, len + 1);
    }
    let (c, more) = next();
    // The least, the middle and the largest of three.
    let (near, other) = (near.min(c), near.max(c));
    let (middle, far) = (other.min(far), other.max(far));
    stack.set(len, far);
    stack.set(len + 1, middle);
    if !more {
        return (parts(near).0, len + 2);
    }
    stack.set(len + 2, near);
    let mut top = len + 3;
    loop {
        let (d, more) = next();
        stack.insert(len, top, d);
        if !more {
            let nearest = stack.get(top);
            return (parts(nearest).0, top);
        }
        top += 1;
    }
}
