//! Binary trees of obvhs: parallel locally-ordered clustering, optionally improved by reinsertion.
//!
//! Meister and Bittner 2018, "Parallel Locally-Ordered Clustering for Bounding Volume Hierarchy Construction", and 2018,
//! "Parallel Reinsertion for Bounding Volume Hierarchy Optimization". Clusters of at most [`LEAF_SIZE`] items become
//! leaves; the rest of the tree is taken over as it is.

use super::binary::{Binary, Item, LEAF_SIZE, Set};
use super::buffer::Buffer;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

/// Deepest binary tree that is taken over: the traversal and the collapse bound their work by it.
const DEEPEST: u32 = 120;
/// Share of the nodes that the first round of reinsertion moves.
const REINSERTED: f32 = 0.15;

/// The tree over items, which it sorts; `None` where clustering makes it too deep.
pub(super) fn build(items: &mut Buffer<Item>, reinsert: bool) -> Option<Binary> {
    let boxes: Vec<Aabb> = items.iter().map(|i| i.bounds()).map(|[lo, hi]| Aabb::new(lo, hi)).collect();
    let numbers = (0..items.len() as u32).collect();
    let mut builder = PlocBuilder::with_capacity(boxes.len());
    let mut tree = builder.build(PlocSearchDistance::Medium, &boxes, numbers, SortPrecision::U64, 3);
    if reinsert {
        // What shares a packet moves as one: fewer nodes to search, and no packet is torn up.
        collapse(&mut tree, LEAF_SIZE as u32, f32::MAX);
        ReinsertionOptimizer::default().run(&mut tree, REINSERTED, None);
    }
    take_over(&tree, items)
}

/// Sorts items by the leaves of a tree.
fn take_over(tree: &Bvh2, items: &mut Buffer<Item>) -> Option<Binary> {
    let nodes = &tree.nodes;
    // Parents before children.
    let mut order = Vec::with_capacity(nodes.len());
    let mut work = vec![(0_u32, 0_u32)];
    while let Some((at, depth)) = work.pop() {
        if depth > DEEPEST {
            return None;
        }
        order.push(at);
        let node = &nodes[at as usize];
        if !node.is_leaf() {
            work.push((node.first_index + 1, depth + 1));
            work.push((node.first_index, depth + 1));
        }
    }
    let mut counts = vec![0_u32; nodes.len()];
    for &at in order.iter().rev() {
        let node = &nodes[at as usize];
        let child = node.first_index as usize;
        counts[at as usize] =
            if node.is_leaf() { node.prim_count } else { counts[child] + counts[child + 1] };
    }
    let mut starts = vec![0_u32; nodes.len()];
    let mut halves: Buffer<[Set; 2]> = Buffer::zeroed(items.len());
    let mut sorted = vec![0_u32; items.len()];
    let set = |at: usize, start: u32, counts: &[u32]| {
        let (node, count) = (&nodes[at], counts[at]);
        let inner = count as usize > LEAF_SIZE;
        let first = if inner { start + counts[node.first_index as usize] } else { start };
        let bounds = node.aabb();
        Set { lo: bounds.min.to_array(), hi: bounds.max.to_array(), first, count }
    };
    for &at in &order {
        let (node, start) = (&nodes[at as usize], starts[at as usize]);
        let child = node.first_index as usize;
        if node.is_leaf() {
            let numbers = &tree.primitive_indices[child..][..node.prim_count as usize];
            sorted[start as usize..][..numbers.len()].copy_from_slice(numbers);
            continue;
        }
        let second = start + counts[child];
        (starts[child], starts[child + 1]) = (start, second);
        if counts[at as usize] as usize > LEAF_SIZE {
            halves[second as usize] = [set(child, start, &counts), set(child + 1, second, &counts)];
        }
    }
    let root = set(0, 0, &counts);
    *items = Buffer::from_fn(items.len(), |i| items[sorted[i] as usize]);
    Some(Binary { root, halves })
}
