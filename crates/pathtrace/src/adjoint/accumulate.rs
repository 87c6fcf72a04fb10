//! Sums of gradients that do not depend on the number of threads.
//!
//! Every task sums the small parameters densely, and those of large images and grids in pages that it makes where it touches
//! them, in the order in which gradients arrive. Tasks are reduced in their order, bands of cells in parallel.

use super::layout::{NONE, Range};
use photofit_scalar::Vec3f;
use rayon::prelude::*;

/// Cells that one thread reduces at a time: a band.
const BAND: usize = 4096;
/// Cells of a page.
const PAGE: usize = 8;

/// The gradients of one task.
#[derive(Debug)]
pub(super) struct Accumulator {
    dense: Vec<[f64; 3]>,
    /// The sums of pages of sparse cells, and the number of each page, in the order of their first touch.
    pages: Vec<[[f64; 3]; PAGE]>,
    touched: Vec<u32>,
    /// One more than the place of each page in `pages`; 0 where it was not touched.
    places: Vec<u32>,
    /// The sparse cells that were touched, in order, when the task is finished.
    sparse: Vec<(u32, [f64; 3])>,
    /// Largest remainder of light at the end of a path, relative to the light of the path.
    pub(super) residual: f64,
    /// Contributions that were left out because they were not finite.
    pub(super) not_finite: u64,
}

impl Accumulator {
    /// Places of the pages of so many cells, the first `dense` of which have none.
    pub(super) fn places(dense: usize, cells: usize) -> Vec<u32> {
        vec![0; cells.saturating_sub(dense).div_ceil(PAGE)]
    }

    /// Sums of so many dense cells and of those that have these places.
    pub(super) fn new(dense: usize, places: Vec<u32>) -> Self {
        Self {
            dense: vec![[0.0; 3]; dense],
            pages: Vec::new(),
            touched: Vec::new(),
            places,
            sparse: Vec::new(),
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
        let dense = self.dense.len();
        let sum = match self.dense.get_mut(cell as usize) {
            Some(sum) => sum,
            None => self.touch(cell as usize - dense),
        };
        (0..3).for_each(|c| sum[c] += g[c]);
    }

    /// The sum of a sparse cell, counted from the first of them.
    #[inline]
    fn touch(&mut self, at: usize) -> &mut [f64; 3] {
        let place = &mut self.places[at / PAGE];
        if *place == 0 {
            self.pages.push([[0.0; 3]; PAGE]);
            self.touched.push((at / PAGE) as u32);
            *place = self.pages.len() as u32;
        }
        &mut self.pages[*place as usize - 1][at % PAGE]
    }

    /// Notes what is left of a path's light where nothing should be.
    pub(super) fn note_residual(&mut self, left: &[f64; 3], whole: &[f64; 3]) {
        for (left, whole) in left.iter().zip(whole) {
            let left = left.abs() / whole.abs().max(f64::from(f32::MIN_POSITIVE));
            self.residual = larger(self.residual, left);
        }
    }

    /// Ends the task: keeps the cells that are not 0, in order, without the pages, and returns the places for the next one.
    pub(super) fn finish(&mut self) -> Vec<u32> {
        let (mut places, pages) = (std::mem::take(&mut self.places), std::mem::take(&mut self.pages));
        let mut touched = std::mem::take(&mut self.touched);
        touched.sort_unstable();
        self.sparse.reserve_exact(pages.as_flattened().iter().filter(|g| **g != [0.0; 3]).count());
        for page in touched {
            let place = std::mem::take(&mut places[page as usize]) as usize - 1;
            let first = self.dense.len() + page as usize * PAGE;
            let sums = pages[place].iter().enumerate().filter(|(_, g)| **g != [0.0; 3]);
            self.sparse.extend(sums.map(|(k, g)| ((first + k) as u32, *g)));
        }
        places
    }

    /// Adds finished tasks in order to the sums of each parameter, channel by channel of every cell.
    pub(super) fn reduce(tasks: &[Self], ranges: &[Range], totals: &mut [Vec<f64>]) {
        for (range, total) in ranges.iter().zip(totals) {
            let bands = total.par_chunks_mut(BAND * range.channels).enumerate();
            bands.for_each(|(band, sums)| {
                let from = range.start + band * BAND;
                tasks.iter().for_each(|task| task.add_to(from, sums, range.channels));
            });
        }
    }

    /// Adds to the sums of so many channels of the cells from `from` on; all dense or none of them is.
    fn add_to(&self, from: usize, sums: &mut [f64], channels: usize) {
        let add = |sum: &mut [f64], g: &[f64; 3]| sum.iter_mut().zip(g).for_each(|(s, g)| *s += g);
        let cells = sums.len() / channels;
        if let Some(dense) = self.dense.get(from..from + cells) {
            return sums.chunks_exact_mut(channels).zip(dense).for_each(|(sum, g)| add(sum, g));
        }
        let begin = self.sparse.partition_point(|e| (e.0 as usize) < from);
        for (cell, g) in self.sparse[begin..].iter().take_while(|e| (e.0 as usize) < from + cells) {
            add(&mut sums[(*cell as usize - from) * channels..][..channels], g);
        }
    }
}

/// The larger one; not a number where one of them is not.
pub(super) fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
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
            let mut places = Accumulator::places(DENSE, 1 << 22);
            let tasks: Vec<Accumulator> = (0..3)
                .map(|task| {
                    let mut out = Accumulator::new(DENSE, std::mem::take(&mut places));
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
                    places = out.finish();
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
