//! Sums of gradients that do not depend on the number of threads.
//!
//! Every task sums the small parameters densely, and large images in a table of the cells that it touches, in the order
//! in which gradients arrive. Tasks are reduced in their order, bands of cells in parallel.

use super::layout::{NONE, Range};
use photofit_scalar::Vec3f;
use rayon::prelude::*;

/// Cells that one thread reduces at a time: a band.
const BAND: usize = 4096;
/// Slots of a table at first: a power of two.
const SLOTS: usize = 1 << 10;

/// The gradients of one task.
#[derive(Debug)]
pub(super) struct Accumulator {
    dense: Vec<[f64; 3]>,
    /// The cells of large images that were touched, each once: by their first touch, in the end by bands.
    sparse: Vec<(u32, [f64; 3])>,
    /// Where the cells of each band begin, from the first one that was touched, and where those of the last end.
    bands: Vec<u32>,
    first_band: usize,
    /// A hash table of them by linear probing, at most half full: cell and place in `sparse`.
    slots: Vec<(u32, u32)>,
    /// Largest remainder of light at the end of a path, relative to the light of the path.
    pub(super) residual: f64,
    /// Contributions that were left out because they were not finite.
    pub(super) not_finite: u64,
}

impl Accumulator {
    pub(super) fn new(dense: usize) -> Self {
        Self {
            dense: vec![[0.0; 3]; dense],
            sparse: Vec::new(),
            bands: Vec::new(),
            first_band: 0,
            slots: Vec::new(),
            residual: 0.0,
            not_finite: 0,
        }
    }

    /// Adds to a cell, if it is one.
    #[inline]
    pub(super) fn add(&mut self, cell: u32, g: Vec3f) {
        if cell == NONE {
            return;
        }
        if !g.is_finite() {
            self.not_finite += 1;
            return;
        }
        let g = g.to_array().map(f64::from);
        let sum = match self.dense.get_mut(cell as usize) {
            Some(sum) => sum,
            None => self.touch(cell),
        };
        (0..3).for_each(|c| sum[c] += g[c]);
    }

    /// The sum of a cell of a large image.
    #[inline]
    fn touch(&mut self, cell: u32) -> &mut [f64; 3] {
        if 2 * self.sparse.len() >= self.slots.len() {
            self.grow();
        }
        let slot = free_or_own(&self.slots, cell);
        let (owner, place) = self.slots[slot];
        if owner == cell {
            return &mut self.sparse[place as usize].1;
        }
        let place = self.sparse.len();
        self.slots[slot] = (cell, place as u32);
        self.sparse.push((cell, [0.0; 3]));
        &mut self.sparse[place].1
    }

    #[cold]
    fn grow(&mut self) {
        self.slots = vec![(NONE, 0); SLOTS.max(2 * self.slots.len())];
        for (place, (cell, _)) in self.sparse.iter().enumerate() {
            let slot = free_or_own(&self.slots, *cell);
            self.slots[slot] = (*cell, place as u32);
        }
    }

    /// Notes what is left of a path's light where nothing should be.
    pub(super) fn note_residual(&mut self, left: &[f64; 3], whole: &[f64; 3]) {
        for (left, whole) in left.iter().zip(whole) {
            let left = left.abs() / whole.abs().max(f64::from(f32::MIN_POSITIVE));
            self.residual = larger(self.residual, left);
        }
    }

    /// Ends the task: cells by bands, without the table.
    pub(super) fn finish(&mut self) {
        self.slots = Vec::new();
        let bands = || self.sparse.iter().map(|e| band(e.0));
        let (Some(first), Some(last)) = (bands().min(), bands().max()) else { return };
        // A counting sort.
        let mut ends = vec![0_u32; last - first + 2];
        self.sparse.iter().for_each(|e| ends[band(e.0) - first + 1] += 1);
        (1..ends.len()).for_each(|b| ends[b] += ends[b - 1]);
        (self.bands, self.first_band) = (ends.clone(), first);
        let mut sorted = vec![(0, [0.0; 3]); self.sparse.len()];
        for e in &self.sparse {
            let place = &mut ends[band(e.0) - first];
            sorted[*place as usize] = *e;
            *place += 1;
        }
        self.sparse = sorted;
    }

    /// Adds finished tasks in order to the sums of each parameter, channel by channel of every cell.
    pub(super) fn reduce(tasks: &[Self], ranges: &[Range], totals: &mut [Vec<f64>]) {
        for (range, total) in ranges.iter().zip(totals) {
            // Its part of each band.
            let (mut parts, mut rest, mut from) = (Vec::new(), &mut total[..], range.start);
            while !rest.is_empty() {
                let cells = (BAND - from % BAND).min(rest.len() / range.channels);
                let (part, left) = rest.split_at_mut(cells * range.channels);
                parts.push((from, part));
                (rest, from) = (left, from + cells);
            }
            parts.into_par_iter().for_each(|(from, sums)| {
                tasks.iter().for_each(|task| task.add_to(from, sums, range.channels));
            });
        }
    }

    /// Adds to the sums of so many channels of the cells from `from` on, which are in one band, and all dense or none of them is.
    fn add_to(&self, from: usize, sums: &mut [f64], channels: usize) {
        let add = |sum: &mut [f64], g: &[f64; 3]| sum.iter_mut().zip(g).for_each(|(s, g)| *s += g);
        let cells = sums.len() / channels;
        if let Some(dense) = self.dense.get(from..from + cells) {
            return sums.chunks_exact_mut(channels).zip(dense).for_each(|(sum, g)| add(sum, g));
        }
        let Some(number) = band(from as u32).checked_sub(self.first_band) else { return };
        let Some(&[begin, end]) = self.bands.get(number..number + 2) else { return };
        for (cell, g) in &self.sparse[begin as usize..end as usize] {
            // Another parameter may have a part of the band.
            if let Some(place) = (*cell as usize).checked_sub(from).filter(|place| *place < cells) {
                add(&mut sums[place * channels..][..channels], g);
            }
        }
    }
}

/// The band of a cell.
#[inline]
fn band(cell: u32) -> usize {
    cell as usize / BAND
}

/// The larger one; not a number where one of them is not.
pub(super) fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

/// The slot of a cell, or the one where it belongs; there are free ones, and their number is a power of two.
#[inline]
fn free_or_own(slots: &[(u32, u32)], cell: u32) -> usize {
    let mask = slots.len() - 1;
    // Fibonacci hashing: the upper bits of the product are mixed best.
    let mut slot = ((u64::from(cell.wrapping_mul(0x9e37_79b9)) * slots.len() as u64) >> 32) as usize;
    while slots[slot].0 != NONE && slots[slot].0 != cell {
        slot = (slot + 1) & mask;
    }
    slot
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::Rng;
    use std::collections::BTreeMap;

    const DENSE: usize = 7;

    /// Gradients of a task, some on dense cells, few or many on others.
    fn gradients(seed: u64, count: usize, cells: u32) -> Vec<(u32, Vec3f)> {
        let mut rng = Rng::new(seed, 0);
        let mut number = || rng.uniform(-1.0, 1.0);
        let cell = |u: f32| ((0.5 + 0.5 * u) * cells as f32) as u32;
        (0..count).map(|_| (cell(number()), Vec3f { x: number(), y: number(), z: number() })).collect()
    }

    #[test]
    fn sums_are_those_of_the_order_of_arrival() {
        for (count, cells) in [(0, 1), (5000, 40), (5000, 300), (40_000, 1 << 22)] {
            let whole = DENSE + 150;
            let range = |start, cells, channels| Range { start, cells, channels };
            let ranges =
                [range(0, DENSE, 3), range(DENSE, whole - DENSE, 1), range(whole, (1 << 22) - whole, 3)];
            let mut totals = ranges.map(|r| vec![0.0; r.cells * r.channels]);
            let mut expected = vec![[0.0; 3]; 1 << 22];
            let tasks: Vec<Accumulator> = (0..3)
                .map(|task| {
                    let mut out = Accumulator::new(DENSE);
                    let mut sums = BTreeMap::<u32, [f64; 3]>::new();
                    // The last one does not touch the first bands.
                    let first = if task == 2 { 50_000 } else { 0 };
                    for (cell, g) in gradients(task, count, cells) {
                        let cell = (cell + first).min((1 << 22) - 1);
                        out.add(cell, g);
                        let sum = sums.entry(cell).or_default();
                        (0..3).for_each(|c| sum[c] += f64::from(g[c]));
                    }
                    for (cell, sum) in sums {
                        (0..3).for_each(|c| expected[cell as usize][c] += sum[c]);
                    }
                    out.finish();
                    out
                })
                .collect();
            Accumulator::reduce(&tasks, &ranges, &mut totals);
            let of = |r: &Range| -> Vec<f64> {
                expected[r.start..][..r.cells].iter().flat_map(|g| &g[..r.channels]).copied().collect()
            };
            assert!(totals == ranges.each_ref().map(of), "{count} gradients on {cells} cells");
            assert_eq!(totals.iter().flatten().any(|t| *t != 0.0), count > 0);
        }
    }
}
