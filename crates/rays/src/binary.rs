//! The binary tree: boxes split from the top by the surface area heuristic over bins.
//!
//! Wald 2007, "On fast Construction of SAH-based Bounding Volume Hierarchies": the centres of a set are counted into a
//! few bins along each axis, and the cheapest plane between bins splits it. A packet test costs the same for one
//! triangle as for four, hence sets count in packets. Large sets are split in parallel; every choice depends on the set
//! alone, hence the tree does not depend on the number of threads.

use super::buffer::Buffer;
use bytemuck::{Pod, Zeroable};
use glam::{Vec3A, Vec4};
use rayon::prelude::*;

/// Largest set that is not split.
pub(super) const LEAF_SIZE: usize = 4;
/// Most bins along an axis.
const BINS: usize = 32;
/// From this depth on sets are halved: no input makes the tree deep or the time quadratic.
const DEEPEST: usize = 56;
/// Sets of at least this size are shared between threads.
const SHARED: usize = 4096;
/// Sets of at least this size are counted in parallel.
const COUNTED: usize = 1 << 17;

/// Keeps the bits of small numbers from meaning subnormal values, which are slow to calculate with.
const NORMAL: u32 = 1 << 30;

/// A box with a number below 2^30.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Item {
    /// Lower corner; the bits of the last component are the number with [`NORMAL`] set.
    lo: Vec4,
    /// Upper corner.
    hi: Vec4,
}

impl Item {
    pub(super) fn new(lo: Vec3A, hi: Vec3A, number: u32) -> Self {
        Self { lo: lo.extend(f32::from_bits(number | NORMAL)), hi: hi.extend(0.0) }
    }

    /// Its number.
    #[inline(always)]
    pub(super) fn number(&self) -> u32 {
        self.lo.w.to_bits() & !NORMAL
    }

    /// Lower and upper corner.
    #[inline(always)]
    pub(super) fn bounds(&self) -> [Vec3A; 2] {
        [Vec3A::from_vec4(self.lo), Vec3A::from_vec4(self.hi)]
    }

    /// Twice the centre.
    #[inline(always)]
    fn center(&self) -> Vec4 {
        self.lo + self.hi
    }
}

/// A set of items that follow one another.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Set {
    /// The box: lower and upper corner.
    pub(super) lo: [f32; 3],
    pub(super) hi: [f32; 3],
    /// Where the items start, if there are at most [`LEAF_SIZE`]; otherwise where the second half starts, and also the
    /// index of the pair of halves.
    pub(super) first: u32,
    /// Number of items.
    pub(super) count: u32,
}

impl Set {
    pub(super) fn is_leaf(&self) -> bool {
        self.count as usize <= LEAF_SIZE
    }

    /// Half the surface.
    pub(super) fn area(&self) -> f32 {
        let [x, y, z] = std::array::from_fn(|k| self.hi[k] - self.lo[k]);
        x * y + y * z + z * x
    }
}

/// The binary tree over items, which it has sorted.
pub(super) struct Binary {
    pub(super) root: Set,
    /// The halves of a set, at the index where the second one starts.
    pub(super) halves: Buffer<[Set; 2]>,
}

/// Splits all sets of more than [`LEAF_SIZE`] items.
pub(super) fn build(items: &mut [Item]) -> Binary {
    let mut halves = Buffer::zeroed(items.len());
    let extent = if items.len() < COUNTED {
        Extent::of(items)
    } else {
        items.par_chunks(SHARED).map(Extent::of).reduce(Extent::default, Extent::union)
    };
    let root = split(items, 0, &extent, halves.get_mut(1..).unwrap_or_default(), 0, &mut Bins::new());
    Binary { root, halves }
}

/// Sorts the items of a set, which start at `start`, into halves and these further; `halves` has the places of all
/// items but the first.
fn split(
    items: &mut [Item],
    start: usize,
    extent: &Extent,
    halves: &mut [[Set; 2]],
    depth: usize,
    bins: &mut Bins,
) -> Set {
    let count = items.len();
    let (lo, hi) = (extent.lo.truncate().to_array(), extent.hi.truncate().to_array());
    if count <= LEAF_SIZE {
        return Set { lo, hi, first: start as u32, count: count as u32 };
    }
    let plane = if depth < DEEPEST { divide(items, extent, bins) } else { None };
    let at = plane.unwrap_or_else(|| halve(items, extent));
    let (a, b) = items.split_at_mut(at);
    let (before, after) = halves.split_at_mut(at - 1);
    let (own, after) = after.split_at_mut(1);
    let mut left = |bins: &mut Bins| {
        let extent = Extent::of(a);
        split(a, start, &extent, before, depth + 1, bins)
    };
    let mut right = |bins: &mut Bins| {
        let extent = Extent::of(b);
        split(b, start + at, &extent, after, depth + 1, bins)
    };
    let (left, right) = if count >= SHARED {
        rayon::join(|| left(bins), || right(&mut Bins::new()))
    } else {
        (left(bins), right(bins))
    };
    own[0] = [left, right];
    Set { lo, hi, first: (start + at) as u32, count: count as u32 }
}

/// The box around items and the box around their doubled centres.
#[derive(Clone, Copy)]
struct Extent {
    lo: Vec4,
    hi: Vec4,
    center_lo: Vec4,
    center_hi: Vec4,
}

impl Default for Extent {
    fn default() -> Self {
        let (lo, hi) = (Vec4::INFINITY, Vec4::NEG_INFINITY);
        Self { lo, hi, center_lo: lo, center_hi: hi }
    }
}

impl Extent {
    fn of(items: &[Item]) -> Self {
        let mut out = Self::default();
        items.iter().for_each(|item| out.add(item));
        out
    }

    #[inline(always)]
    fn add(&mut self, item: &Item) {
        let center = item.center();
        self.lo = self.lo.min(item.lo);
        self.hi = self.hi.max(item.hi);
        self.center_lo = self.center_lo.min(center);
        self.center_hi = self.center_hi.max(center);
    }

    fn union(self, other: Self) -> Self {
        Self {
            lo: self.lo.min(other.lo),
            hi: self.hi.max(other.hi),
            center_lo: self.center_lo.min(other.center_lo),
            center_hi: self.center_hi.max(other.center_hi),
        }
    }
}

/// From centres to bins.
#[derive(Clone, Copy)]
struct Grid {
    origin: Vec4,
    scale: Vec4,
    bins: usize,
}

impl Grid {
    fn new(extent: &Extent, count: usize) -> Self {
        let bins = (4 + count / 4).min(BINS);
        let size = extent.center_hi - extent.center_lo;
        // An axis without extent, or one whose inverse overflows, has all items in its first bin.
        let scale = size.to_array().map(|s| if s > 1e-30 { bins as f32 / s } else { 0.0 });
        Self { origin: extent.center_lo, scale: Vec4::from_array(scale), bins }
    }

    /// The bin along each axis: `floor`, by the bits of a number so large that its last bit counts ones.
    #[inline(always)]
    fn bin(&self, item: &Item) -> [usize; 3] {
        let top = Vec4::splat(self.bins as f32 - 1.0);
        let at = ((item.center() - self.origin) * self.scale - 0.5).max(Vec4::ZERO).min(top);
        let [x, y, z, _] = (at + 8_388_608.0).to_array().map(|s| s.to_bits() as usize % BINS);
        [x, y, z]
    }
}

/// What the bins of each axis hold.
struct Bins([[Bin; BINS]; 3]);

/// The box around the items of a bin and their number.
#[derive(Clone, Copy)]
struct Bin {
    lo: Vec4,
    hi: Vec4,
    count: u32,
}

impl Bin {
    const EMPTY: Self = Self { lo: Vec4::INFINITY, hi: Vec4::NEG_INFINITY, count: 0 };

    #[inline(always)]
    fn union(&self, other: &Self) -> Self {
        Self { lo: self.lo.min(other.lo), hi: self.hi.max(other.hi), count: self.count + other.count }
    }

    /// Half the surface times the number of packets; infinite without items.
    #[inline(always)]
    fn cost(&self) -> f32 {
        let d = self.hi - self.lo;
        let area = d.dot(Vec4::new(d.y, d.z, d.x, 0.0));
        if self.count == 0 { f32::INFINITY } else { area * self.count.div_ceil(LEAF_SIZE as u32) as f32 }
    }
}

impl Bins {
    fn new() -> Self {
        Self([[Bin::EMPTY; BINS]; 3])
    }

    /// Fills the bins of a grid.
    fn count(&mut self, items: &[Item], grid: &Grid) {
        self.0.iter_mut().for_each(|bins| bins[..grid.bins].fill(Bin::EMPTY));
        for item in items {
            for (axis, at) in grid.bin(item).into_iter().enumerate() {
                let bin = &mut self.0[axis][at];
                bin.lo = bin.lo.min(item.lo);
                bin.hi = bin.hi.max(item.hi);
                bin.count += 1;
            }
        }
    }

    /// The same for a large set.
    fn count_shared(&mut self, items: &[Item], grid: &Grid) {
        let count = |items: &[Item]| {
            let mut bins = Box::new(Self::new());
            bins.count(items, grid);
            bins
        };
        let union = |mut a: Box<Self>, b: Box<Self>| {
            a.0.as_flattened_mut().iter_mut().zip(b.0.as_flattened()).for_each(|(a, b)| *a = a.union(b));
            a
        };
        let sum = items.par_chunks(COUNTED / 8).map(count).reduce_with(union);
        sum.into_iter().for_each(|bins| *self = *bins);
    }

    /// The cheapest plane: its axis and the first bin behind it.
    #[inline(always)]
    fn cheapest(&self, bins: usize) -> Option<(usize, usize)> {
        let mut best = None;
        let mut least = f32::INFINITY;
        for (axis, all) in self.0.iter().enumerate() {
            let all = &all[..bins];
            // Cost of all bins from one on.
            let mut behind = [0.0; BINS];
            let mut sum = Bin::EMPTY;
            for (behind, bin) in behind[..bins].iter_mut().zip(all).rev() {
                sum = sum.union(bin);
                *behind = sum.cost();
            }
            let mut sum = Bin::EMPTY;
            for (plane, bin) in (1..bins).zip(all) {
                sum = sum.union(bin);
                let cost = sum.cost() + behind[plane];
                if cost < least {
                    (least, best) = (cost, Some((axis, plane)));
                }
            }
        }
        best
    }
}

/// Splits by the cheapest plane; the size of the first half, or `None` if there is no such plane.
fn divide(items: &mut [Item], extent: &Extent, bins: &mut Bins) -> Option<usize> {
    let grid = Grid::new(extent, items.len());
    if items.len() < COUNTED {
        bins.count(items, &grid);
    } else {
        bins.count_shared(items, &grid);
    }
    let (axis, plane) = bins.cheapest(grid.bins)?;
    // No branch depends on the items.
    let mut at = 0;
    for i in 0..items.len() {
        let before = grid.bin(&items[i])[axis] < plane;
        items.swap(i, at);
        at += usize::from(before);
    }
    Some(at)
}

/// Splits in the middle along the longest axis of the centres.
fn halve(items: &mut [Item], extent: &Extent) -> usize {
    let axis = (extent.center_hi - extent.center_lo).truncate().max_position();
    let at = items.len() / 2;
    items.select_nth_unstable_by(at, |a, b| {
        a.center()[axis].total_cmp(&b.center()[axis]).then(a.number().cmp(&b.number()))
    });
    at
}
