//! What every machine has: vectors of four numbers.

use super::Width;
use crate::stack::Stack;
use crate::walk::{Distances, Slabs, any_order, near_first};
use crate::wide::{Lanes, Node, WIDTH};
use glam::{Vec3A, Vec4};

/// What every machine has.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Portable;

impl Width for Portable {
    #[inline(always)]
    fn walk_near<L>(
        self,
        nodes: &[Node],
        _: &[L],
        ray: &Slabs,
        limit: f32,
        leaf: impl FnMut(u32, f32) -> Option<f32>,
    ) {
        let boxes = Boxes::new(ray);
        let test = |node: &Node, limit: f32| {
            let (mask, nears) = boxes.test(node, limit);
            (mask, Distances(Lanes(nears).to_array()))
        };
        near_first(nodes, limit, test, |_| (), leaf);
    }

    #[inline(always)]
    fn walk_any<L>(self, nodes: &[Node], _: &[L], ray: &Slabs, limit: f32, leaf: impl FnMut(u32) -> bool) {
        let boxes = Boxes::new(ray);
        let push = |stack: &mut Stack<u32>, mut len: usize, child: &[u32; WIDTH], mut mask: u32| {
            while mask != 0 {
                stack.set(len, child[mask.trailing_zeros() as usize % WIDTH]);
                mask &= mask - 1;
                len += 1;
            }
            len
        };
        any_order(nodes, |node| boxes.test(node, limit).0, push, |_| (), leaf);
    }
}

/// A ray against the boxes of a node.
struct Boxes {
    near: [Vec4; 3],
    far: [Vec4; 3],
    inverse: [Vec4; 3],
    t_min: Vec4,
    sides: [usize; 3],
}

impl Boxes {
    #[inline(always)]
    fn new(ray: &Slabs) -> Self {
        let splat = |v: Vec3A| v.to_array().map(Vec4::splat);
        let (near, far, inverse) = (splat(ray.near_origin), splat(ray.far_origin), splat(ray.inverse));
        Self { near, far, inverse, t_min: Vec4::splat(ray.t_min), sides: ray.sides() }
    }

    /// The children whose boxes the ray passes up to the limit, one bit each, and where it enters them.
    #[inline(always)]
    fn test(&self, node: &Node, limit: f32) -> (u32, [Vec4; 2]) {
        let mut nears = [Vec4::ZERO; 2];
        let mut mask = 0;
        for half in 0..2 {
            let plane = |k: usize, side: usize| node.planes[k][side].0[half];
            let enter = |k: usize| (plane(k, self.sides[k]) - self.near[k]) * self.inverse[k];
            let leave = |k: usize| (plane(k, 1 - self.sides[k]) - self.far[k]) * self.inverse[k];
            nears[half] = self.t_min.max(enter(0)).max(enter(1).max(enter(2)));
            let fars = Vec4::splat(limit).min(leave(0)).min(leave(1).min(leave(2)));
            mask |= nears[half].cmple(fars).bitmask() << (4 * half);
        }
        (mask, nears)
    }
}
