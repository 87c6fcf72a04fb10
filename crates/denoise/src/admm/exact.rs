//! The exact linear step: one pass over bands of rows that makes and transforms the right-hand side, then banded solves
//! down the columns.
//!
//! Bands also keep the splits of the rows just outside that they read, and update them with the same arithmetic as
//! their owners: bands need no exchange. Rows of the estimate are transformed back where the pass needs them, which
//! is cheaper than to keep them.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use photofit_fft::Complex;
use rayon::prelude::{
    IndexedParallelIterator, IntoParallelRefIterator, IntoParallelRefMutIterator, ParallelIterator,
    ParallelSliceMut,
};

use super::rows::{add_hessian_adjoint, subtract_divergence};
use super::split::{Frame, Rows, SplitScratch, TERMS, Term, update_data, update_term};
use crate::transform::{Block, RowScratch, Sample, StripSolver};
use crate::wide::run_widest;

/// Rows of a band.
const BAND: usize = 32;
/// Rows of the estimate that a task keeps.
const KEPT: usize = 4;

/// State of the exact step.
#[derive(Debug)]
pub(crate) struct Exact<T: Sample> {
    solver: StripSolver<T>,
    bands: Vec<Band<T>>,
    blocks: Vec<Block<T>>,
    pool: Mutex<Vec<Scratch<T>>>,
    /// False until the blocks hold an estimate.
    begun: bool,
}

/// A band of rows with its splits.
#[derive(Debug)]
struct Band<T> {
    rows: Range<usize>,
    /// Data split of own rows.
    data: Vec<T>,
    /// Splits of the regularisers from one row above; the Hessian's to one row below.
    terms: [Vec<T>; 3],
    /// The previous `p`, for the stopping rule.
    previous: Vec<T>,
    /// Right-hand side after the transform along rows.
    spectrum: Vec<Complex<T>>,
    sums: Vec<[f64; 3]>,
}

/// Row buffers of one task.
#[derive(Debug)]
struct Scratch<T> {
    u: Vec<T>,
    /// Three rows of reflections for each regulariser.
    ring: [Vec<T>; 3],
    line: Vec<T>,
    split: SplitScratch<T>,
    transform: RowScratch<T>,
}

/// Where rows of the estimate come from.
struct Source<'a, T: Sample> {
    solver: &'a StripSolver<T>,
    /// Solutions of the last step, if there was one.
    blocks: Option<&'a [Block<T>]>,
}

impl<T: Sample> Source<'_, T> {
    fn row(&self, frame: &Frame<'_, T>, c: usize, i: usize, row: &mut [T], transform: &mut RowScratch<T>) {
        match self.blocks {
            Some(blocks) => {
                let count = self.solver.blocks_per_channel();
                self.solver.inverse_row(&blocks[c * count..(c + 1) * count], i, row, transform);
            }
            None => frame.start_row(c, i, row),
        }
    }
}

impl<T: Sample> Exact<T> {
    pub(crate) fn new(frame: &Frame<'_, T>, solver: StripSolver<T>) -> Self {
        let starts = (0..frame.shape.height).step_by(BAND);
        let bands = starts
            .map(|i| Band::new(i..(i + BAND).min(frame.shape.height), frame, solver.frequencies()))
            .collect();
        let blocks = solver.blocks(frame.channels.len());
        Self { solver, bands, blocks, pool: Mutex::new(Vec::new()), begun: false }
    }

    /// Bytes of the state.
    pub(crate) fn bytes(&self) -> usize {
        self.solver.bytes()
            + self.bands.iter().map(Band::bytes).sum::<usize>()
            + self.blocks.iter().map(Block::bytes).sum::<usize>()
    }

    /// Sums of the stopping rule.
    pub(crate) fn sums(&self) -> impl Iterator<Item = &[[f64; 3]]> {
        self.bands.iter().map(|band| &band.sums[..])
    }

    /// One iteration.
    pub(crate) fn advance(&mut self, frame: &Frame<'_, T>) {
        let source = Source { solver: &self.solver, blocks: self.begun.then_some(&self.blocks[..]) };
        let pool = &self.pool;
        self.bands.par_iter_mut().for_each(|band| {
            with_scratch(pool, frame, &self.solver, |scratch| {
                run_widest(
                    #[inline(always)]
                    || band.update(frame, &source, scratch),
                );
            });
        });
        let (channels, n) = (frame.channels.len(), self.solver.frequencies());
        let (bands, solver) = (&self.bands, &self.solver);
        self.blocks.par_iter_mut().filter(|b| !frame.frozen[b.channel]).for_each(|block| {
            let c = block.channel;
            solver.solve_block(block, |i| {
                let band = &bands[i / BAND];
                &band.spectrum[((i - band.rows.start) * channels + c) * n..][..n]
            });
        });
        self.begun = true;
    }

    /// Frees all but the estimate.
    pub(crate) fn forget_splits(&mut self) {
        self.bands = Vec::new();
    }

    /// Writes the estimate as rows of all solved channels.
    pub(crate) fn write_rows(&self, frame: &Frame<'_, T>, out: &mut [T]) {
        let (n, channels) = (frame.shape.width, frame.channels.len());
        let source = Source { solver: &self.solver, blocks: self.begun.then_some(&self.blocks[..]) };
        out.par_chunks_mut(BAND * channels * n).enumerate().for_each(|(band, rows)| {
            with_scratch(&self.pool, frame, &self.solver, |scratch| {
                for (k, out) in rows.chunks_mut(n).enumerate() {
                    let row = &mut scratch.line[..];
                    source.row(frame, k % channels, band * BAND + k / channels, row, &mut scratch.transform);
                    out.copy_from_slice(&row[..n]);
                }
            });
        });
    }

    /// The dual of the gradient as the next update will leave it: rows of two lanes per solved channel.
    pub(crate) fn gradient_dual(&self, frame: &Frame<'_, T>) -> Vec<T> {
        let source = Source { solver: &self.solver, blocks: self.begun.then_some(&self.blocks[..]) };
        let bands = self.bands.par_iter().map(|band| {
            with_scratch(&self.pool, frame, &self.solver, |scratch| {
                band.gradient_dual(frame, &source, scratch)
            })
        });
        bands.collect::<Vec<_>>().concat()
    }
}

/// Lends row buffers to a task.
fn with_scratch<T: Sample, R>(
    pool: &Mutex<Vec<Scratch<T>>>,
    frame: &Frame<'_, T>,
    solver: &StripSolver<T>,
    work: impl FnOnce(&mut Scratch<T>) -> R,
) -> R {
    let kept = pool.lock().unwrap_or_else(PoisonError::into_inner).pop();
    let mut scratch = kept.unwrap_or_else(|| Scratch::new(frame, solver));
    let result = work(&mut scratch);
    pool.lock().unwrap_or_else(PoisonError::into_inner).push(scratch);
    result
}

impl<T: Sample> Scratch<T> {
    fn new(frame: &Frame<'_, T>, solver: &StripSolver<T>) -> Self {
        let stride = frame.channels.len() * frame.width;
        let ring = std::array::from_fn(|k| {
            let used = frame.terms[k].is_some();
            vec![T::zero(); if used { 3 * TERMS[k].components() * stride } else { 0 }]
        });
        Self {
            u: vec![T::zero(); KEPT * stride],
            ring,
            line: vec![T::zero(); frame.width],
            split: SplitScratch::new(frame),
            transform: solver.scratch(),
        }
    }

    /// Fetches row `i` of the estimate, all channels.
    #[inline(always)]
    fn fetch(&mut self, frame: &Frame<'_, T>, source: &Source<'_, T>, i: usize) {
        for c in (0..frame.channels.len()).filter(|&c| !frame.frozen[c]) {
            let row = &mut self.u[((i % KEPT) * frame.channels.len() + c) * frame.width..][..frame.width];
            source.row(frame, c, i, row, &mut self.transform);
        }
    }
}

impl<T: Sample> Band<T> {
    fn new(rows: Range<usize>, frame: &Frame<'_, T>, frequencies: usize) -> Self {
        let (n, stride) = (rows.len(), frame.channels.len() * frame.width);
        let terms = std::array::from_fn(|k| {
            let held = Self::held(&rows, TERMS[k], frame.shape.height).len();
            let used = frame.terms[k].is_some();
            vec![T::zero(); if used { held * TERMS[k].components() * stride } else { 0 }]
        });
        let zero = Complex::new(T::zero(), T::zero());
        Self {
            data: vec![T::zero(); n * stride],
            terms,
            previous: Vec::new(),
            spectrum: vec![zero; n * frame.channels.len() * frequencies],
            sums: vec![[0.0; 3]; frame.channels.len()],
            rows,
        }
    }

    /// Rows whose split of a term the band holds.
    fn held(rows: &Range<usize>, term: Term, all: usize) -> Range<usize> {
        let end = if term == Term::Hessian { (rows.end + 1).min(all) } else { rows.end };
        rows.start.saturating_sub(1)..end
    }

    fn bytes(&self) -> usize {
        size_of_val(self.data.as_slice())
            + self.terms.iter().map(|t| size_of_val(t.as_slice())).sum::<usize>()
            + size_of_val(self.previous.as_slice())
            + size_of_val(self.spectrum.as_slice())
    }

    /// One pass: all splits, then the transformed right-hand side.
    #[inline(always)]
    fn update(&mut self, frame: &Frame<'_, T>, source: &Source<'_, T>, scratch: &mut Scratch<T>) {
        scratch.split.set_uniform(frame);
        self.sums.fill([0.0; 3]);
        if frame.measure && self.previous.is_empty() {
            self.previous = vec![T::zero(); self.data.len()];
        }
        // Rows whose differences reach one row below are finished one row later.
        let lag = usize::from(frame.terms[1].is_some());
        let first = self.rows.start.saturating_sub(1);
        let all = frame.shape.height;
        let mut next = first.saturating_sub(lag);
        for i in first..self.rows.end + lag {
            while next < (i + 2).min(all) {
                scratch.fetch(frame, source, next);
                next += 1;
            }
            for (k, term) in TERMS.into_iter().enumerate() {
                let held = Self::held(&self.rows, term, all);
                if let (Some(t), true) = (frame.terms[k], held.contains(&i)) {
                    let block = term.components() * frame.channels.len() * frame.width;
                    let zh = &mut self.terms[k][(i - held.start) * block..][..block];
                    let z = &mut scratch.ring[k][(i % 3) * block..][..block];
                    let u = Rows { values: &scratch.u, kept: KEPT };
                    update_term(frame, term, t, i, u, zh, z, &mut scratch.split);
                }
            }
            if i >= lag && self.rows.contains(&(i - lag)) {
                self.finish_row(frame, source.solver, scratch, i - lag);
            }
        }
    }

    /// The data split of own row `i`, and its right-hand side from all reflections, transformed.
    #[inline(always)]
    fn finish_row(
        &mut self,
        frame: &Frame<'_, T>,
        solver: &StripSolver<T>,
        scratch: &mut Scratch<T>,
        i: usize,
    ) {
        let (p, channels, all) = (frame.width, frame.channels.len(), frame.shape.height);
        let (own, frequencies) = (i - self.rows.start, solver.frequencies());
        for c in (0..channels).filter(|&c| !frame.frozen[c]) {
            let f = &mut scratch.line[..];
            let u = Rows { values: &scratch.u, kept: KEPT }.row(frame, c, i);
            let place = (own * channels + c) * p;
            let qh = &mut self.data[place..][..p];
            let measure = if frame.measure {
                Some((&mut self.previous[place..][..p], &mut self.sums[c]))
            } else {
                None
            };
            update_data(frame, &scratch.split, [c, i], u, qh, f, measure);
            for (k, term) in TERMS.into_iter().enumerate() {
                let Some(t) = frame.terms[k] else { continue };
                let lane = |i: usize, component: usize| {
                    let index = ((i % 3) * channels + c) * term.components() + component;
                    &scratch.ring[k][index * p..][..p]
                };
                let above = i.checked_sub(1);
                if term == Term::Hessian {
                    let below = (i + 1 < all).then_some(i + 1);
                    let mixed = [above.map(|i| lane(i, 1)), Some(lane(i, 1))];
                    let yy = [above.map(|i| lane(i, 2)), Some(lane(i, 2)), below.map(|i| lane(i, 2))];
                    add_hessian_adjoint(f, t.penalty, lane(i, 0), mixed, yy, &mut scratch.split.share);
                } else {
                    let above = above.map(|i| lane(i, 1));
                    subtract_divergence(f, t.penalty, lane(i, 0), lane(i, 1), above);
                }
            }
            let out = &mut self.spectrum[(own * channels + c) * frequencies..][..frequencies];
            solver.forward_row(f, out, &mut scratch.transform);
        }
    }

    fn gradient_dual(
        &self,
        frame: &Frame<'_, T>,
        source: &Source<'_, T>,
        scratch: &mut Scratch<T>,
    ) -> Vec<T> {
        let Some(t) = frame.terms[0] else { return Vec::new() };
        let (p, n) = (frame.width, frame.shape.width);
        let block = 2 * frame.channels.len() * p;
        let held = Self::held(&self.rows, Term::Gradient, frame.shape.height);
        let mut out = Vec::with_capacity(self.rows.len() * 2 * frame.channels.len() * n);
        scratch.split.set_uniform(frame);
        for i in self.rows.clone() {
            for row in i..(i + 2).min(frame.shape.height) {
                scratch.fetch(frame, source, row);
            }
            let mut zh = self.terms[0][(i - held.start) * block..][..block].to_vec();
            let z = &mut scratch.ring[0][..block];
            let u = Rows { values: &scratch.u, kept: KEPT };
            update_term(frame, Term::Gradient, t, i, u, &mut zh, z, &mut scratch.split);
            // z holds 2w - (w + b), zh holds b + (1-a) w.
            let scale = T::one() / (T::of(2.0) - frame.relaxation);
            for (z, zh) in z.chunks_exact(p).zip(zh.chunks_exact(p)) {
                out.extend(z.iter().zip(zh).take(n).map(|(z, zh)| t.penalty * ((*z + *zh) * scale - *z)));
            }
        }
        out
    }
}
