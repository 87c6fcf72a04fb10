//! Means over wide windows, from sums over blocks of 4 x 4 pixels that are interpolated.
//!
//! A block and the interpolation between its neighbours are a window of a deviation of two pixels already; what a wider one
//! needs more is a Gaussian over the blocks. What is smooth is cheap that way: a few additions a pixel.

use super::window::{blur_columns, blur_rows, gaussian_taps};
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};

/// Pixels of a block's side.
pub(crate) const SIDE: usize = 4;
/// Variance in squared pixels of a block, `(4^2 - 1) / 12`, and of the interpolation, `4^2 / 6`.
const BLOCK: f32 = 1.25;
const BETWEEN: f32 = 2.667;

/// Sums of `K` planes over blocks: `[row of blocks][plane][block]`.
#[derive(Clone, Debug)]
pub(crate) struct Pooled<const K: usize> {
    width: usize,
    height: usize,
    pub(crate) columns: usize,
    pub(crate) sums: Vec<f32>,
}

impl<const K: usize> Pooled<K> {
    /// Of a picture, all 0.
    pub(crate) fn new(width: usize, height: usize) -> Self {
        let columns = width.div_ceil(SIDE);
        Self { width, height, columns, sums: vec![0.0; K * columns * height.div_ceil(SIDE)] }
    }

    /// The sums of rows `SIDE * index` and on, for each index.
    pub(crate) fn rows(&mut self) -> impl IndexedParallelIterator<Item = &mut [f32]> {
        self.sums.par_chunks_mut(K * self.columns)
    }

    /// The sums of what `fill` writes for each row: `K` runs of one row.
    pub(crate) fn of(width: usize, height: usize, fill: impl Fn(usize, &mut [f32]) + Sync) -> Self {
        let mut pooled = Self::new(width, height);
        let scratch = || vec![0.0; K * width];
        pooled.rows().enumerate().for_each_init(scratch, |row, (block, sums)| {
            for y in SIDE * block..(SIDE * (block + 1)).min(height) {
                fill(y, row);
                add_row(sums, row, width);
            }
        });
        pooled
    }

    /// Smooths each plane so that what is interpolated between the blocks has a window of `sigma` pixels.
    pub(crate) fn smooth(&mut self, sigma: f32) {
        self.widen(sigma * sigma - BLOCK - BETWEEN);
    }

    /// Smooths each plane so that the values of the blocks have a window of `sigma` pixels, for what is no sum of them.
    pub(crate) fn smooth_blocks(&mut self, sigma: f32) {
        self.widen(sigma * sigma - BLOCK);
    }

    /// Adds a variance, in squared pixels, to the window of each block.
    fn widen(&mut self, variance: f32) {
        let variance = variance / (SIDE * SIDE) as f32;
        if variance <= 0.0 {
            return;
        }
        // A sampled Gaussian is too narrow below half a block: three taps of that variance.
        let taps = match variance < 0.5 {
            true => vec![1.0, 0.5 * variance / (1.0 - variance)],
            false => gaussian_taps(variance.sqrt()),
        };
        self.sums = blur_columns(&blur_rows(&self.sums, self.columns, &taps), K * self.columns, &taps);
    }

    /// The value of one plane at a block.
    #[inline(always)]
    pub(crate) fn at(&self, plane: usize, block: usize) -> f32 {
        self.sums[(block / self.columns * K + plane) * self.columns + block % self.columns]
    }

    /// Number of blocks.
    pub(crate) fn blocks(&self) -> usize {
        self.sums.len() / K
    }

    /// New planes, from the values of each block.
    pub(crate) fn map<const L: usize>(&self, of: impl Fn([f32; K]) -> [f32; L]) -> Pooled<L> {
        let mut out = Pooled::new(self.width, self.height);
        for (out, sums) in out.sums.chunks_mut(L * self.columns).zip(self.sums.chunks(K * self.columns)) {
            for x in 0..self.columns {
                let values = of(std::array::from_fn(|k| sums[k * self.columns + x]));
                values.iter().enumerate().for_each(|(k, v)| out[k * self.columns + x] = *v);
            }
        }
        out
    }

    /// One plane at the pixels of row `y`, interpolated between the centres of blocks; `line` is scratch.
    pub(crate) fn row(&self, plane: usize, y: usize, line: &mut Vec<f32>, out: &mut [f32]) {
        let blocks = self.sums.len() / (K * self.columns);
        let at = ((y as f32 + 0.5) / SIDE as f32 - 0.5).clamp(0.0, (blocks - 1) as f32);
        let (upper, f) = (at as usize, at.fract());
        let run = |b: usize| &self.sums[(b * K + plane) * self.columns..][..self.columns];
        let (a, b) = (run(upper), run((upper + 1).min(blocks - 1)));
        line.clear();
        line.extend(a.iter().zip(b).map(|(a, b)| a + f * (b - a)));
        let (head, rest) = out.split_at_mut(out.len().min(SIDE / 2));
        head.fill(line[0]);
        line.push(line[self.columns - 1]);
        let between = |g: usize, out: &mut [f32]| {
            let (a, d) = (line[g], line[g + 1] - line[g]);
            for (o, f) in out.iter_mut().zip([0.125, 0.375, 0.625, 0.875]) {
                *o = a + f * d;
            }
        };
        let mut whole = rest.chunks_exact_mut(SIDE);
        let count = whole.len();
        (&mut whole).enumerate().for_each(|(g, out)| between(g, out));
        between(count, whole.into_remainder());
    }

    /// One plane over another at the pixels of row `y`: a mean where the other holds weights; 0 where they are 0.
    pub(crate) fn mean_row(
        &self,
        plane: usize,
        weight: usize,
        y: usize,
        scratch: &mut Scratch,
        out: &mut [f32],
    ) {
        let Scratch { line, total } = scratch;
        total.resize(out.len(), 0.0);
        self.row(plane, y, line, out);
        self.row(weight, y, line, total);
        for (o, t) in out.iter_mut().zip(&*total) {
            *o = if *t > 1e-6 { *o / t } else { 0.0 };
        }
    }
}

/// What the rows of a pooled mean need.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    pub(crate) line: Vec<f32>,
    total: Vec<f32>,
}

/// Adds runs of one row of pixels to the sums of their blocks.
#[inline]
pub(crate) fn add_row(sums: &mut [f32], row: &[f32], width: usize) {
    for (sums, row) in sums.chunks_mut(width.div_ceil(SIDE)).zip(row.chunks(width)) {
        let blocks = row.chunks_exact(SIDE);
        let rest: f32 = blocks.remainder().iter().sum();
        for (s, b) in sums.iter_mut().zip(blocks) {
            *s += (b[0] + b[1]) + (b[2] + b[3]);
        }
        if !width.is_multiple_of(SIDE) {
            sums[width / SIDE] += rest;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_keep_constants_and_ramps_and_have_the_width_asked_for() {
        for (width, height) in [(1, 1), (3, 2), (5, 9), (64, 48), (63, 45), (65, 47), (66, 46)] {
            let mut pooled = Pooled::<3>::of(width, height, |y, row| {
                for x in 0..width {
                    row[x] = 3.0 + 0.5 * x as f32 + 0.25 * y as f32;
                    (row[width + x], row[2 * width + x]) = (3.0, 1.0);
                }
            });
            pooled.smooth(3.0);
            let (mut scratch, mut out) = (Scratch::default(), vec![0.0; width]);
            for y in 0..height {
                pooled.mean_row(1, 2, y, &mut scratch, &mut out);
                let constant = out.iter().all(|v| (v - 3.0).abs() < 1e-5);
                assert!(constant, "{width} x {height}, row {y}: {out:?}");
                // Ramps away from the border, beyond which nothing counts.
                pooled.mean_row(0, 2, y, &mut scratch, &mut out);
                let inner = |x: &usize| x.min(&(width - 1 - x)).min(&y).min(&(height - 1 - y)) >= &12;
                for x in (0..width).filter(inner) {
                    let wanted = 3.0 + 0.5 * x as f32 + 0.25 * y as f32;
                    assert!((out[x] - wanted).abs() < 1e-3, "{width} x {height}: {} at {x}, {y}", out[x]);
                }
            }
        }
        // The mean of x^2 around x is x^2 and the variance of the window.
        let (width, height) = (96, 64);
        for sigma in [2.0_f32, 3.0, 4.0] {
            let mut pooled = Pooled::<2>::of(width, height, |_, row| {
                for x in 0..width {
                    (row[x], row[width + x]) = ((x as f32 - 48.0).powi(2), 1.0);
                }
            });
            pooled.smooth(sigma);
            let (mut scratch, mut out) = (Scratch::default(), vec![0.0; width]);
            pooled.mean_row(0, 1, 32, &mut scratch, &mut out);
            let wide: f32 = (44..52).map(|x| out[x] - (x as f32 - 48.0).powi(2)).sum::<f32>() / 8.0;
            assert!((wide.sqrt() / sigma - 1.0).abs() < 0.08, "{} for {sigma}", wide.sqrt());
        }
    }
}
