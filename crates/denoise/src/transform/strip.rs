//! The production solver: real FFT along rows, banded Cholesky solve down the columns.

use std::fmt;

use photofit_fft::{Complex, RealFft, laplacian_eigenvalue};
use rayon::prelude::{
    IndexedParallelIterator, IntoParallelRefMutIterator, ParallelIterator, ParallelSliceMut,
};

use super::banded::BandedFactors;
use super::{Sample, Symbol};
use crate::wide::run_widest;

/// Frequencies solved by one task.
const WIDTH: usize = 64;
/// Rows transformed by one task.
const ROWS: usize = 16;

/// Solves `(c0 + c1 L + c2 L^2) u = f`, periodic along rows and Neumann along columns.
///
/// After a real FFT of each row the system falls apart into one banded system per frequency, positive definite with
/// one subdiagonal (two with `c2`), the same for all channels (Hockney 1965). The sweeps down and up run over
/// 64 frequencies at once and vectorise.
pub struct StripSolver<T: Sample> {
    fft: RealFft<T>,
    factors: BandedFactors<T>,
    height: usize,
}

/// Buffers of one task for the transforms of rows.
#[derive(Debug)]
pub(crate) struct RowScratch<T> {
    spectrum: Vec<Complex<T>>,
    fft: Vec<Complex<T>>,
}

/// A range of frequencies of one channel: all rows, of each the real parts, then the imaginary parts.
#[derive(Clone, Debug)]
pub(crate) struct Block<T> {
    pub(crate) channel: usize,
    from: usize,
    to: usize,
    values: Vec<T>,
}

impl<T> Block<T> {
    /// Bytes of the values.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.values.as_slice())
    }
}

impl<T: Sample> fmt::Debug for StripSolver<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "StripSolver({} x {})", self.fft.len(), self.height)
    }
}

impl<T: Sample> StripSolver<T> {
    /// Plans for planes of `width x height`; fastest where `width` is a [`super::fast_length`].
    ///
    /// # Panics
    /// If there are no pixels, or the symbol is not positive definite and finite.
    pub fn new(width: usize, height: usize, symbol: Symbol) -> Self {
        symbol.check();
        assert!(width > 0 && height > 0, "an image of {width} x {height} has no pixels");
        let frequencies: Vec<f64> = (0..=width / 2)
            .map(|k| laplacian_eigenvalue(std::f64::consts::TAU * k as f64 / width as f64))
            .collect();
        Self {
            fft: T::real_fft(width),
            factors: BandedFactors::new(symbol, height, &frequencies, 1.0 / width as f64),
            height,
        }
    }

    /// Number of frequencies of a row.
    pub(crate) fn frequencies(&self) -> usize {
        self.fft.frequencies()
    }

    /// Bytes of the factors.
    pub(crate) fn bytes(&self) -> usize {
        self.factors.bytes()
    }

    pub(crate) fn scratch(&self) -> RowScratch<T> {
        let zero = Complex::new(T::zero(), T::zero());
        RowScratch { spectrum: vec![zero; self.frequencies()], fft: self.fft.scratch() }
    }

    /// The blocks of all channels, in the order in which [`Self::inverse_row`] wants them.
    pub(crate) fn blocks(&self, channels: usize) -> Vec<Block<T>> {
        let n = self.frequencies();
        let make = |channel: usize, from: usize| {
            let to = (from + WIDTH).min(n);
            Block { channel, from, to, values: vec![T::zero(); 2 * (to - from) * self.height] }
        };
        (0..channels).flat_map(|c| (0..n).step_by(WIDTH).map(move |f| make(c, f))).collect()
    }

    /// Number of blocks of one channel.
    pub(crate) fn blocks_per_channel(&self) -> usize {
        self.frequencies().div_ceil(WIDTH)
    }

    /// Transforms one row; its samples are lost.
    pub(crate) fn forward_row(&self, row: &mut [T], out: &mut [Complex<T>], s: &mut RowScratch<T>) {
        self.fft.forward(row, out, &mut s.fft);
    }

    /// Solves the systems of one block; `source(i)` is the spectrum of row `i` of its channel.
    pub(crate) fn solve_block<'a>(&self, block: &mut Block<T>, source: impl Fn(usize) -> &'a [Complex<T>])
    where
        T: 'a,
    {
        run_widest(
            #[inline(always)]
            || self.sweep(block, &source),
        );
    }

    #[inline(always)]
    fn sweep<'a>(&self, block: &mut Block<T>, source: impl Fn(usize) -> &'a [Complex<T>])
    where
        T: 'a,
    {
        let (from, to) = (block.from, block.to);
        let span = to - from;
        for i in 0..self.height {
            let (before, rest) = block.values.split_at_mut(2 * span * i);
            let (re, im) = rest[..2 * span].split_at_mut(span);
            for ((re, im), z) in re.iter_mut().zip(im).zip(&source(i)[from..to]) {
                (*re, *im) = (z.re, z.im);
            }
            let l = self.factors.row(i, from, to);
            let row = &mut rest[..2 * span];
            if i > 0 {
                add_scaled(row, l.first, &before[2 * span * (i - 1)..]);
            }
            if i > 1 && self.factors.wide() {
                add_scaled(row, l.second, &before[2 * span * (i - 2)..]);
            }
        }
        for i in (0..self.height).rev() {
            let (row, after) = block.values[2 * span * i..].split_at_mut(2 * span);
            let pivot = self.factors.row(i, from, to).pivot;
            for half in row.chunks_exact_mut(span) {
                for (v, p) in half.iter_mut().zip(pivot) {
                    *v *= *p;
                }
            }
            if i + 1 < self.height {
                add_scaled(row, self.factors.row(i + 1, from, to).first, after);
            }
            if i + 2 < self.height && self.factors.wide() {
                add_scaled(row, self.factors.row(i + 2, from, to).second, &after[2 * span..]);
            }
        }
    }

    /// Gathers row `i` from the blocks of one channel and transforms it back.
    pub(crate) fn inverse_row(&self, blocks: &[Block<T>], i: usize, out: &mut [T], s: &mut RowScratch<T>) {
        let spectrum = &mut s.spectrum[..];
        run_widest(
            #[inline(always)]
            || gather(blocks, i, spectrum),
        );
        self.fft.inverse(&mut s.spectrum, out, &mut s.fft);
    }

    /// Replaces the right-hand side `f` by the solution `u`.
    ///
    /// # Panics
    /// If `plane` does not have `width * height` samples.
    pub fn solve(&self, plane: &mut [T]) {
        let (height, width, n) = (self.height, self.fft.len(), self.frequencies());
        assert_eq!(plane.len(), width * height, "a plane of {width} x {height}");
        let mut spectrum = vec![Complex::new(T::zero(), T::zero()); height * n];
        spectrum.par_chunks_mut(ROWS * n).zip(plane.par_chunks_mut(ROWS * width)).for_each(|(out, rows)| {
            let mut scratch = self.scratch();
            for (out, row) in out.chunks_mut(n).zip(rows.chunks_mut(width)) {
                self.forward_row(row, out, &mut scratch);
            }
        });
        let mut blocks = self.blocks(1);
        blocks.par_iter_mut().for_each(|b| self.solve_block(b, |i| &spectrum[i * n..(i + 1) * n]));
        plane.par_chunks_mut(ROWS * width).enumerate().for_each(|(chunk, out)| {
            let mut scratch = self.scratch();
            for (k, row) in out.chunks_mut(width).enumerate() {
                self.inverse_row(&blocks, chunk * ROWS + k, row, &mut scratch);
            }
        });
    }
}

/// Adds `factor * other` to both halves of `row`.
#[inline(always)]
fn add_scaled<T: Sample>(row: &mut [T], factor: &[T], other: &[T]) {
    let span = factor.len();
    let (re, im) = row.split_at_mut(span);
    for ((v, o), f) in re.iter_mut().zip(&other[..span]).zip(factor) {
        *v += *f * *o;
    }
    for ((v, o), f) in im.iter_mut().zip(&other[span..2 * span]).zip(factor) {
        *v += *f * *o;
    }
}

/// Row `i` of all blocks.
#[inline(always)]
fn gather<T: Sample>(blocks: &[Block<T>], i: usize, spectrum: &mut [Complex<T>]) {
    for block in blocks {
        let span = block.to - block.from;
        let (re, im) = block.values[2 * span * i..2 * span * (i + 1)].split_at(span);
        for ((z, &re), &im) in spectrum[block.from..block.to].iter_mut().zip(re).zip(im) {
            *z = Complex::new(re, im);
        }
    }
}
