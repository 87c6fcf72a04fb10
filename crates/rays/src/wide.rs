//! The eight-wide tree, collapsed from the binary one, and the test of a ray against the boxes of a node.

use super::binary::{Binary, Set};
use bytemuck::{Pod, Zeroable};
use glam::Vec4;
use rayon::prelude::*;

/// Marks a child as a leaf: the other bits index the packets.
pub(super) const LEAF: u32 = 1 << 31;
/// A child that is not there; its box is empty, so that no test lets it through.
const NONE: u32 = u32::MAX;
/// Children of a node.
pub(super) const WIDTH: usize = 8;

/// One number for each child.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub(super) struct Lanes(pub(super) [Vec4; 2]);

impl Lanes {
    #[inline(always)]
    pub(super) fn to_array(self) -> [f32; WIDTH] {
        let ([a, b, c, d], [e, f, g, h]) = (self.0[0].to_array(), self.0[1].to_array());
        [a, b, c, d, e, f, g, h]
    }
}

/// Eight children with their boxes side by side.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Node {
    /// Lower and upper corners, one pair for each axis.
    pub(super) planes: [[Lanes; 2]; 3],
    /// Node index, or packet index with [`LEAF`] set.
    pub(super) child: [u32; WIDTH],
}

impl Node {
    pub(super) fn empty() -> Self {
        let (lo, hi) = (Lanes([Vec4::INFINITY; 2]), Lanes([Vec4::NEG_INFINITY; 2]));
        Self { planes: [[lo, hi]; 3], child: [NONE; WIDTH] }
    }

    pub(super) fn set_box(&mut self, lane: usize, lo: [f32; 3], hi: [f32; 3]) {
        for axis in 0..3 {
            self.planes[axis][0].0[lane / 4][lane % 4] = lo[axis];
            self.planes[axis][1].0[lane / 4][lane % 4] = hi[axis];
        }
    }

    /// The children that are there, each with half the surface of its box.
    pub(super) fn children(&self) -> impl Iterator<Item = (u32, f32)> {
        let planes = self.planes.map(|p| p.map(Lanes::to_array));
        (0..WIDTH).filter(|i| self.child[*i] != NONE).map(move |i| {
            let [x, y, z] = planes.map(|[lo, hi]| hi[i] - lo[i]);
            (self.child[i], x * y + y * z + z * x)
        })
    }

    /// The same node with indices of nodes and leaves moved.
    fn moved(mut self, node: u32, leaf: u32) -> Self {
        for child in self.child.iter_mut().filter(|c| **c != NONE) {
            *child += if *child & LEAF == 0 { node } else { leaf };
        }
        self
    }

    /// The same node with other indices of leaves.
    pub(super) fn with_leaves(mut self, index: impl Fn(usize) -> u32) -> Self {
        for child in self.child.iter_mut().filter(|c| **c != NONE && **c & LEAF != 0) {
            *child = LEAF | index((*child & !LEAF) as usize);
        }
        self
    }

    /// Least lower and largest upper plane of the children.
    pub(super) fn range(&self, axis: usize) -> [f32; 2] {
        let [Lanes([a, b]), Lanes([c, d])] = self.planes[axis];
        [a.min(b).min_element(), c.max(d).max_element()]
    }
}

/// The wide tree and the sets that are its leaves.
#[derive(Default)]
pub(super) struct Wide {
    pub(super) nodes: Vec<Node>,
    /// Children with [`LEAF`] set point here.
    pub(super) leaves: Vec<Set>,
}

/// Collapses a binary tree, large ones in parallel.
pub(super) fn collapse(tree: &Binary) -> Wide {
    if tree.root.count == 0 {
        return Wide::default();
    }
    // Subtrees of at most this size wait for a thread.
    let alone = tree.root.count / 64;
    let mut out = Wide::for_items(0);
    let mut waiting = Vec::new();
    out.fill(tree, 0, &tree.root, &mut |place, set| {
        let waits = set.count > 1024 && set.count <= alone;
        if waits {
            waiting.push((place, *set));
        }
        waits
    });
    let subtree = |(_, set): &(_, Set)| {
        let mut part = Wide::for_items(set.count);
        part.fill(tree, 0, set, &mut |_, _| false);
        part
    };
    let parts: Vec<Wide> = waiting.par_iter().map(subtree).collect();
    out.nodes.reserve(parts.iter().map(|p| p.nodes.len()).sum());
    out.leaves.reserve(parts.iter().map(|p| p.leaves.len()).sum());
    for (((at, lane), _), part) in waiting.into_iter().zip(parts) {
        let (node, leaf) = (out.nodes.len() as u32, out.leaves.len() as u32);
        out.nodes[at].child[lane] = node;
        out.leaves.extend(part.leaves);
        out.nodes.extend(part.nodes.into_iter().map(|n| n.moved(node, leaf)));
    }
    out
}

impl Wide {
    /// An empty root, with room for the nodes and leaves of so many items in a usual tree.
    fn for_items(count: u32) -> Self {
        let count = count as usize;
        let mut nodes = Vec::with_capacity(1 + count / 16);
        nodes.push(Node::empty());
        Self { nodes, leaves: Vec::with_capacity(count / 3) }
    }

    /// Fills the node `at` and all below it from a set; `waits` takes what is left to others, with its place.
    fn fill(
        &mut self,
        tree: &Binary,
        at: usize,
        set: &Set,
        waits: &mut impl FnMut((usize, usize), &Set) -> bool,
    ) {
        let (children, count) = open(tree, set);
        let first = self.nodes.len();
        for (lane, child) in children[..count].iter().enumerate() {
            self.nodes[at].set_box(lane, child.lo, child.hi);
            if child.is_leaf() {
                self.nodes[at].child[lane] = LEAF | self.leaves.len() as u32;
                self.leaves.push(*child);
            } else if !waits((at, lane), child) {
                self.nodes[at].child[lane] = self.nodes.len() as u32;
                self.nodes.push(Node::empty());
            }
        }
        // Siblings lie side by side.
        let mut next = first;
        for (lane, child) in children[..count].iter().enumerate() {
            if self.nodes[at].child[lane] == next as u32 {
                self.fill(tree, next, child, waits);
                next += 1;
            }
        }
    }
}

/// Up to eight descendants of a set that cover it, and their number: the largest are opened first.
fn open(tree: &Binary, set: &Set) -> ([Set; WIDTH], usize) {
    let mut children = [*set; WIDTH];
    // Negative: not to be opened.
    let area = |set: &Set| if set.is_leaf() { -1.0 } else { set.area() };
    let mut areas = [-1.0; WIDTH];
    areas[0] = area(set);
    let mut count = 1;
    while count < WIDTH {
        let mut widest = 0;
        for i in 1..count {
            if areas[i] > areas[widest] {
                widest = i;
            }
        }
        if areas[widest] < 0.0 {
            break;
        }
        let [a, b] = tree.halves[children[widest].first as usize];
        (children[widest], children[count]) = (a, b);
        (areas[widest], areas[count]) = (area(&a), area(&b));
        count += 1;
    }
    (children, count)
}
