//! The walk through a tree that all queries along a ray share.

use super::stack::{Stack, entry, parts};
use super::wide::{LEAF, Node, WIDTH};
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
    pub(super) near_origin: [f32; 3],
    pub(super) far_origin: [f32; 3],
    pub(super) inverse: [f32; 3],
    pub(super) negative: [bool; 3],
    pub(super) t_min: f32,
}

impl Slabs {
    /// `d` is finite and not zero; the slabs are widened by `pad` on both sides.
    #[inline(always)]
    pub(super) fn new(o: Vec3A, d: Vec3A, pad: f32, t_min: f32) -> Self {
        let floor = Vec3A::splat(d.abs().max_element() * 1e-12);
        // A finite inverse: 0 * inf would be NaN. The pad times 1e12 exceeds every distance in question.
        let inverse = Vec3A::select(d.abs().cmpgt(floor), d, floor.copysign(d)).recip();
        let shift = Vec3A::splat(pad).copysign(inverse);
        Self {
            near_origin: (o + shift).to_array(),
            far_origin: (o - shift).to_array(),
            inverse: inverse.to_array(),
            negative: inverse.cmplt(Vec3A::ZERO).into(),
            t_min,
        }
    }
}

/// See [`super::width::Width::walk`]; `test` returns the children whose boxes the ray passes before the limit, one bit
/// each, and where it enters them.
#[inline(always)]
pub(super) fn walk_with<const ORDERED: bool>(
    nodes: &[Node],
    mut limit: f32,
    test: impl Fn(&Node, f32) -> (u32, [f32; WIDTH]),
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
                    (entry(node.child[lane], near[lane]), mask != 0)
                };
                let (a, more) = next();
                if !more {
                    at = parts(a).0;
                    continue;
                }
                len = stack.reserve(len);
                if ORDERED {
                    (at, len) = push_ordered(&mut stack, len, a, next);
                    continue;
                }
                at = parts(a).0;
                loop {
                    let (b, more) = next();
                    stack.set(len, b);
                    len += 1;
                    if !more {
                        break;
                    }
                }
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

/// Pushes the entry `a` and those of `next`, which also tells whether there are more, but for the nearest one, which is
/// returned with the new length of the stack.
#[inline(always)]
fn push_ordered(
    stack: &mut Stack,
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
