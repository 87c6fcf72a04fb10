//! The four-wide tree, collapsed from the binary one.

use glam::Vec4;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;

/// Marks a child as a leaf: the other bits index the packets.
pub(super) const LEAF: u32 = 1 << 31;
/// A child that is not there; its box is empty, so that no test lets it through.
const NONE: u32 = u32::MAX;

/// Four children with their boxes side by side.
#[derive(Clone, Debug)]
pub(super) struct Node {
    /// Lower corners, one vector per axis.
    pub(super) lo: [Vec4; 3],
    /// Upper corners, one vector per axis.
    pub(super) hi: [Vec4; 3],
    /// Node index, or packet index with [`LEAF`] set.
    pub(super) child: [u32; 4],
}

impl Node {
    fn empty() -> Self {
        Self { lo: [Vec4::INFINITY; 3], hi: [Vec4::NEG_INFINITY; 3], child: [NONE; 4] }
    }

    fn set_box(&mut self, lane: usize, node: &Bvh2Node) {
        let (lo, hi) = (node.aabb().min.to_array(), node.aabb().max.to_array());
        for axis in 0..3 {
            self.lo[axis][lane] = lo[axis];
            self.hi[axis][lane] = hi[axis];
        }
    }
}

/// Collapses a binary tree; `leaf` turns the primitives of a leaf into an index below [`LEAF`].
pub(super) fn collapse(tree: &Bvh2, mut leaf: impl FnMut(&[u32]) -> u32) -> Vec<Node> {
    let mut nodes = vec![Node::empty()];
    let Some(root) = tree.nodes.first() else {
        return Vec::new();
    };
    // Pairs of a wide node and the binary nodes that become its children.
    let mut work = vec![(0_usize, open(tree, root))];
    while let Some((at, children)) = work.pop() {
        for (lane, child) in children.into_iter().flatten().enumerate() {
            nodes[at].set_box(lane, child);
            nodes[at].child[lane] = if child.is_leaf() {
                let range = child.first_index as usize..(child.first_index + child.prim_count) as usize;
                LEAF | leaf(&tree.primitive_indices[range])
            } else {
                nodes.push(Node::empty());
                work.push((nodes.len() - 1, open(tree, child)));
                (nodes.len() - 1) as u32
            };
        }
    }
    nodes
}

/// Up to four descendants of `node` that cover it: the largest inner ones are opened first.
fn open<'a>(tree: &'a Bvh2, node: &'a Bvh2Node) -> [Option<&'a Bvh2Node>; 4] {
    let mut children = [Some(node), None, None, None];
    let mut count = 1;
    while count < 4 {
        let mut widest: Option<(usize, f32)> = None;
        for (i, child) in children.iter().enumerate() {
            let Some(child) = child.filter(|c| !c.is_leaf()) else { continue };
            let area = child.aabb().half_area();
            if widest.is_none_or(|(_, a)| area > a) {
                widest = Some((i, area));
            }
        }
        let Some((i, _)) = widest else { break };
        let Some(opened) = children[i] else { break };
        let first = opened.first_index as usize;
        children[i] = Some(&tree.nodes[first]);
        children[count] = Some(&tree.nodes[first + 1]);
        count += 1;
    }
    children
}
