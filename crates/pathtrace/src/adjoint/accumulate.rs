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

/// Sums of neighbouring cells of `N` channels: those of one channel fill a line of the cache.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Page<const N: usize>([[f64; N]; PAGE]);

/// Sums of cells of `N` channels, most of which a task does not touch.
#[derive(Debug, Default)]
struct Pages<const N: usize> {
    /// Number of the first cell.
    first: usize,
    /// The pages, and the number of each, in the order of their first touch.
    pages: Vec<Page<N>>,
    touched: Vec<u32>,
    /// One more than the place of each page in `pages`; 0 where it was not touched.
    places: Vec<u32>,
    /// Where [`Self::take`] gathers what it returns.
    gathered: Vec<(u32, [f64; N])>,
}

impl<const N: usize> Pages<N> {
    fn of(cells: std::ops::Range<usize>) -> Self {
        Self { first: cells.start, places: vec![0; cells.len().div_ceil(PAGE)], ..Self::default() }
    }

    /// The sum of a cell.
    #[inline]
    fn sum(&mut self, cell: usize) -> &mut [f64; N] {
        let at = cell - self.first;
        let place = &mut self.places[at / PAGE];
        if *place == 0 {
            self.pages.push(Page([[0.0; N]; PAGE]));
            self.touched.push((at / PAGE) as u32);
            *place = self.pages.len() as u32;
        }
        &mut self.pages[*place as usize - 1].0[at % PAGE]
    }

    /// The cells that are not 0, in order; all are afterwards.
    fn take(&mut self) -> Box<[(u32, [f64; N])]> {
        self.touched.sort_unstable();
        for page in self.touched.drain(..) {
            let place = std::mem::take(&mut self.places[page as usize]) as usize - 1;
            let first = self.first + page as usize * PAGE;
            let sums = self.pages[place].0.iter().enumerate().filter(|(_, g)| **g != [0.0; N]);
            self.gathered.extend(sums.map(|(k, g)| ((first + k) as u32, *g)));
        }
        self.pages.clear();
        let taken = self.gathered.as_slice().into();
        self.gathered.clear();
        taken
    }
}

/// Where a task sums the cells that are not summed densely; used again by the next one.
#[derive(Debug, Default)]
pub(super) struct Sparse {
    single: Pages<1>,
    triple: Pages<3>,
}

impl Sparse {
    /// Of these cells of one channel, and of those of three, which follow.
    pub(super) fn new(single: std::ops::Range<usize>, triple: std::ops::Range<usize>) -> Self {
        Self { single: Pages::of(single), triple: Pages::of(triple) }
    }
}

/// The gradients of one task.
#[derive(Debug)]
pub(super) struct Accumulator {
    dense: Vec<[f64; 3]>,
    sparse: Sparse,
    /// The sparse cells that are not 0, of one channel and of three, in order, when the task is finished.
    single: Box<[(u32, [f64; 1])]>,
    triple: Box<[(u32, [f64; 3])]>,
    /// Largest remainder of light at the end of a path, relative to the light of the path.
    pub(super) residual: f64,
    /// Contributions that were left out because they were not finite.
    pub(super) not_finite: u64,
}

impl Accumulator {
    /// Sums of so many dense cells and of sparse ones, all of which are 0.
    pub(super) fn new(dense: usize, sparse: Sparse) -> Self {
        Self {
            dense: vec![[0.0; 3]; dense],
            sparse,
            single: Box::default(),
            triple: Box::default(),
            residual: 0.0,
            not_finite: 0,
        }
    }

    /// Adds to a cell, if it is one; to those of one channel the first number.
    #[inline]
    pub(super) fn add(&mut self, cell: u32, g: Vec3f) {
        if cell == NONE {
            return;
        }
        if !g.is_finite() {
            self.not_finite += 1;
            return;
        }
        let (g, cell) = (g.to_array().map(f64::from), cell as usize);
        let sum = if let Some(sum) = self.dense.get_mut(cell) {
            sum
        } else if cell < self.sparse.triple.first {
            self.sparse.single.sum(cell)[0] += g[0];
            return;
        } else {
            self.sparse.triple.sum(cell)
        };
        (0..3).for_each(|c| sum[c] += g[c]);
    }

    /// Notes what is left of a path's light where nothing should be.
    pub(super) fn note_residual(&mut self, left: &[f64; 3], whole: &[f64; 3]) {
        for (left, whole) in left.iter().zip(whole) {
            let left = left.abs() / whole.abs().max(f64::from(f32::MIN_POSITIVE));
            self.residual = larger(self.residual, left);
        }
    }

    /// Ends the task: keeps the sparse cells that are not 0, and returns what they were summed in for the next one.
    pub(super) fn finish(&mut self) -> Sparse {
        let mut sparse = std::mem::take(&mut self.sparse);
        (self.single, self.triple) = (sparse.single.take(), sparse.triple.take());
        sparse
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

    /// Adds to the sums of so many channels of the cells from `from` on; all of them are dense, of one channel, or neither.
    fn add_to(&self, from: usize, sums: &mut [f64], channels: usize) {
        let cells = from..from + sums.len() / channels;
        match self.dense.get(cells.clone()) {
            Some(dense) => sums.chunks_exact_mut(channels).zip(dense).for_each(|(sum, g)| add_all(sum, g)),
            None => {
                // The cells lie in one of the two.
                add_sparse(&self.single, cells.clone(), sums, channels);
                add_sparse(&self.triple, cells, sums, channels);
            }
        }
    }
}

/// Adds each channel that there is.
fn add_all(sum: &mut [f64], g: &[f64]) {
    sum.iter_mut().zip(g).for_each(|(s, g)| *s += g);
}

/// Adds those of the sparse cells that lie among `cells` to the sums of these.
fn add_sparse<const N: usize>(
    sparse: &[(u32, [f64; N])],
    cells: std::ops::Range<usize>,
    sums: &mut [f64],
    channels: usize,
) {
    let begin = sparse.partition_point(|e| (e.0 as usize) < cells.start);
    for (cell, g) in sparse[begin..].iter().take_while(|e| cells.contains(&(e.0 as usize))) {
        add_all(&mut sums[(*cell as usize - cells.start) * channels..][..channels], g);
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
            // More than two bands of cells of one channel.
            let whole = DENSE + 10_000;
            let range = |start, cells, channels| Range { start, cells, channels };
            let ranges =
                [range(0, DENSE, 3), range(DENSE, whole - DENSE, 1), range(whole, (1 << 22) - whole, 3)];
            let mut totals = ranges.map(|r| vec![0.0; r.cells * r.channels]);
            let mut expected = vec![[0.0; 3]; 1 << 22];
            let mut sparse = Sparse::new(DENSE..whole, whole..1 << 22);
            let tasks: Vec<Accumulator> = (0..3)
                .map(|task| {
                    let mut out = Accumulator::new(DENSE, std::mem::take(&mut sparse));
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
                    sparse = out.finish();
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
