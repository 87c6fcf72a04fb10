//! The k nearest neighbours of points: a balanced k-d tree.
//!
//! The tree is implicit: a node owns a range of the reordered points, its children own the two halves. Ties are
//! broken by index, so that the answer does not depend on threads.

use photofit_scalar::Vec3f;

/// Most points of a leaf.
const LEAF: usize = 16;
/// Most neighbours that are asked for.
pub(super) const MOST: usize = 32;
/// Ranges above this size are split on two threads.
const PARALLEL: usize = 1 << 13;

/// A tree over points.
#[derive(Debug)]
pub(super) struct KdTree {
    /// Points in the order of the tree.
    points: Vec<Vec3f>,
    /// Their indices in the caller's order.
    order: Vec<u32>,
    /// Axis and coordinate of the split of each node, in heap order.
    splits: Vec<(u8, f32)>,
}

/// The nearest neighbours of a query, nearest first.
#[derive(Debug)]
pub(super) struct Nearest {
    items: [(f32, u32); MOST],
    len: usize,
    k: usize,
}

impl Nearest {
    pub(super) fn new(k: usize) -> Self {
        Self { items: [(f32::INFINITY, u32::MAX); MOST], len: 0, k: k.min(MOST) }
    }

    /// Squared distances and positions within the tree's order.
    pub(super) fn items(&self) -> &[(f32, u32)] {
        &self.items[..self.len]
    }

    fn worst(&self) -> f32 {
        if self.len < self.k { f32::INFINITY } else { self.items[self.len - 1].0 }
    }

    #[inline]
    fn offer(&mut self, distance: f32, at: u32) {
        let item = (distance, at);
        if self.len == self.k {
            if item >= self.items[self.len - 1] {
                return;
            }
        } else {
            self.len += 1;
        }
        let mut i = self.len - 1;
        while i > 0 && self.items[i - 1] > item {
            self.items[i] = self.items[i - 1];
            i -= 1;
        }
        self.items[i] = item;
    }
}

impl KdTree {
    /// Builds the tree over finite points, fewer than 2^32.
    pub(super) fn new(positions: &[Vec3f]) -> Self {
        let mut order: Vec<u32> = (0..positions.len() as u32).collect();
        let mut leaves = 1;
        while positions.len().div_ceil(leaves) > LEAF {
            leaves *= 2;
        }
        let mut splits = vec![(0, 0.0); leaves];
        let levels: Vec<&mut [(u8, f32)]> = levels_of(&mut splits);
        split(positions, &mut order, levels);
        let points = order.iter().map(|&i| positions[i as usize]).collect();
        Self { points, order, splits }
    }

    /// Positions in the order of the tree: neighbours in it are near each other.
    pub(super) fn order(&self) -> &[u32] {
        &self.order
    }

    /// A point by its place in the tree's order.
    #[inline]
    pub(super) fn point(&self, at: u32) -> Vec3f {
        self.points[at as usize]
    }

    /// Finds the nearest points of `q`, itself included where it is in the tree.
    pub(super) fn nearest(&self, q: Vec3f, out: &mut Nearest) {
        out.len = 0;
        if out.k > 0 {
            self.visit(1, 0, self.points.len(), q, [0.0; 3], out);
        }
    }

    fn visit(&self, node: usize, lo: usize, hi: usize, q: Vec3f, offset: [f32; 3], out: &mut Nearest) {
        if node >= self.splits.len() {
            for (i, p) in self.points[lo..hi].iter().enumerate() {
                out.offer((*p - q).length_squared(), (lo + i) as u32);
            }
            return;
        }
        let (axis, value) = self.splits[node];
        let axis = usize::from(axis);
        let mid = lo + (hi - lo) / 2;
        let distance = q.to_array()[axis] - value;
        let left_first = distance < 0.0;
        let ranges = [(2 * node, lo, mid), (2 * node + 1, mid, hi)];
        let (near, far) = if left_first { (ranges[0], ranges[1]) } else { (ranges[1], ranges[0]) };
        self.visit(near.0, near.1, near.2, q, offset, out);
        // Distance to the box on the other side, axis by axis.
        let mut across = offset;
        across[axis] = distance;
        let bound: f32 = across.iter().map(|d| d * d).sum();
        if bound <= out.worst() {
            self.visit(far.0, far.1, far.2, q, across, out);
        }
    }
}

/// Splits a heap of nodes into its levels, each a slice; entry 0 is unused.
fn levels_of(splits: &mut [(u8, f32)]) -> Vec<&mut [(u8, f32)]> {
    let mut levels = Vec::new();
    let Some((_, mut rest)) = splits.split_first_mut() else { return levels };
    let mut width = 1;
    while !rest.is_empty() {
        let (level, below) = rest.split_at_mut(width);
        levels.push(level);
        rest = below;
        width *= 2;
    }
    levels
}

fn split(positions: &[Vec3f], order: &mut [u32], mut levels: Vec<&mut [(u8, f32)]>) {
    if levels.is_empty() || order.is_empty() {
        return;
    }
    let first = positions[order[0] as usize];
    let (lo, hi) = order.iter().fold((first, first), |(lo, hi), &i| {
        let p = positions[i as usize];
        (lo.min(p), hi.max(p))
    });
    let extent = (hi - lo).to_array();
    let axis = (0..3).fold(0, |best, k| if extent[k] > extent[best] { k } else { best });
    // Both zeros are one.
    let at = |i: u32| positions[i as usize].to_array()[axis] + 0.0;
    let mid = order.len() / 2;
    order.select_nth_unstable_by(mid, |&a, &b| at(a).total_cmp(&at(b)).then(a.cmp(&b)));
    levels[0][0] = (axis as u8, at(order[mid]));
    levels.remove(0);
    let (mut left, mut right) = (Vec::with_capacity(levels.len()), Vec::with_capacity(levels.len()));
    for level in levels {
        let (a, b) = level.split_at_mut(level.len() / 2);
        left.push(a);
        right.push(b);
    }
    let parallel = order.len() > PARALLEL;
    let (a, b) = order.split_at_mut(mid);
    if parallel {
        rayon::join(|| split(positions, a, left), || split(positions, b, right));
    } else {
        split(positions, a, left);
        split(positions, b, right);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::Rng;
    use photofit_scalar::vec3;

    #[test]
    fn finds_what_an_exhaustive_search_finds() {
        let mut rng = Rng::new(3, 0);
        for n in [1, 2, 16, 17, 33, 500, 20_000] {
            let mut points: Vec<Vec3f> = (0..n)
                .map(|_| vec3(rng.next_f32(), rng.next_f32() * 3.0, (rng.next_f32() * 4.0).floor() * 0.1))
                .collect();
            if n > 40 {
                points[30] = points[31];
            }
            let tree = KdTree::new(&points);
            let mut found = Nearest::new(9);
            for q in (0..n).step_by(1 + n / 40) {
                let q = points[q];
                tree.nearest(q, &mut found);
                let mut all: Vec<f32> = points.iter().map(|p| (*p - q).length_squared()).collect();
                all.sort_by(f32::total_cmp);
                let got: Vec<f32> = found.items().iter().map(|i| i.0).collect();
                assert_eq!(got, all[..9.min(n)], "{n} points");
            }
        }
    }

    #[test]
    fn no_points_and_equal_points() {
        let mut found = Nearest::new(4);
        KdTree::new(&[]).nearest(Vec3f::zero(), &mut found);
        assert!(found.items().is_empty());
        let tree = KdTree::new(&[Vec3f::splat(2.0); 100]);
        tree.nearest(Vec3f::splat(2.0), &mut found);
        assert_eq!(found.items().len(), 4);
        assert_eq!(found.items()[3].0, 0.0);
    }
}
