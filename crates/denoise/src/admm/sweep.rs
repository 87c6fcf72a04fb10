//! The inexact linear step: one symmetric red-black Gauss-Seidel sweep, fused with the splits into one pass over memory.
//!
//! As a preconditioner `M >= A` of the system `A = t0 + (t1+t3) L` the sweep turns the exact step into a proximal one,
//! and the splitting converges to the same optimum (Bredies and Sun 2015), for `A` that is not too stiff in about as
//! many iterations. It needs neighbours only: a band reads a few rows beyond its own, whose splits it keeps and
//! updates with the same arithmetic as their owners, so that bands need no exchange.
//!
//! Over-relaxation acts on the estimate too, `u' += a (u - u')`; see [`super::split`].

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::{
    IndexedParallelIterator, IntoParallelRefIterator, IntoParallelRefMutIterator, ParallelIterator,
    ParallelSliceMut,
};

use super::rows::{half_sweep, subtract_divergence};
use super::split::{Frame, Rows, SplitScratch, TERMS, Term, update_data, update_term};
use crate::transform::Sample;
use crate::wide::run_widest;

/// Rows of a band.
const BAND: usize = 48;
/// Rows of the sweep that a task keeps.
const KEPT: usize = 4;

/// State of the inexact step.
#[derive(Debug)]
pub(crate) struct Sweep<T> {
    bands: Vec<Band<T>>,
    /// The estimate: rows, each of all solved channels.
    u: Vec<T>,
    next: Vec<T>,
    pool: Mutex<Vec<Scratch<T>>>,
}

/// A band of rows with its splits and those of the rows around that it reads.
#[derive(Debug)]
struct Band<T> {
    rows: Range<usize>,
    data: Vec<T>,
    terms: [Vec<T>; 3],
    /// The previous `p` of own rows, for the stopping rule.
    previous: Vec<T>,
    sums: Vec<[f64; 3]>,
}

/// Row buffers of one task.
#[derive(Debug)]
struct Scratch<T> {
    /// Two rows of reflections for each regulariser.
    ring: [Vec<T>; 3],
    /// Right-hand sides and values under the sweep.
    f: Vec<T>,
    v: Vec<T>,
    line: Vec<T>,
    split: SplitScratch<T>,
    /// 1 in the even and in the odd columns.
    masks: [Vec<T>; 2],
}

impl<T: Sample> Sweep<T> {
    pub(crate) fn new(frame: &Frame<'_, T>) -> Self {
        let (rows, stride) = (frame.shape.height, frame.channels.len() * frame.width);
        let bands: Vec<Band<T>> =
            (0..rows).step_by(BAND).map(|i| Band::new(i..(i + BAND).min(rows), frame)).collect();
        let mut u = vec![T::zero(); rows * stride];
        u.par_chunks_mut(stride).enumerate().for_each(|(i, row)| {
            for (c, lane) in row.chunks_exact_mut(frame.width).enumerate() {
                frame.start_row(c, i, lane);
            }
        });
        Self { bands, next: vec![T::zero(); u.len()], u, pool: Mutex::new(Vec::new()) }
    }

    /// Bytes of the state.
    pub(crate) fn bytes(&self) -> usize {
        let bands = self.bands.iter().map(|band| {
            size_of_val(band.data.as_slice())
                + band.terms.iter().map(|t| size_of_val(t.as_slice())).sum::<usize>()
                + size_of_val(band.previous.as_slice())
        });
        2 * size_of_val(self.u.as_slice()) + bands.sum::<usize>()
    }

    /// Sums of the stopping rule.
    pub(crate) fn sums(&self) -> impl Iterator<Item = &[[f64; 3]]> {
        self.bands.iter().map(|band| &band.sums[..])
    }

    /// Frees all but the estimate.
    pub(crate) fn forget_splits(&mut self) {
        (self.bands, self.next) = (Vec::new(), Vec::new());
    }

    /// The estimate: rows of all solved channels.
    pub(crate) fn rows(&self) -> &[T] {
        &self.u
    }

    /// One iteration.
    pub(crate) fn advance(&mut self, frame: &Frame<'_, T>) {
        let stride = BAND * frame.channels.len() * frame.width;
        let (u, pool) = (&self.u, &self.pool);
        self.bands.par_iter_mut().zip(self.next.par_chunks_mut(stride)).for_each(|(band, out)| {
            let kept = pool.lock().unwrap_or_else(PoisonError::into_inner).pop();
            let mut scratch = kept.unwrap_or_else(|| Scratch::new(frame));
            run_widest(
                #[inline(always)]
                || band.update(frame, u, out, &mut scratch),
            );
            pool.lock().unwrap_or_else(PoisonError::into_inner).push(scratch);
        });
        std::mem::swap(&mut self.u, &mut self.next);
    }

    /// The dual of the gradient as the next update will leave it: rows of two lanes per solved channel.
    pub(crate) fn gradient_dual(&self, frame: &Frame<'_, T>) -> Vec<T> {
        let bands = self.bands.par_iter().map(|band| band.gradient_dual(frame, &self.u));
        bands.collect::<Vec<_>>().concat()
    }
}

impl<T: Sample> Scratch<T> {
    fn new(frame: &Frame<'_, T>) -> Self {
        let stride = frame.channels.len() * frame.width;
        let rows = |count: usize| vec![T::zero(); count * stride];
        let mask = |parity| {
            (0..frame.width).map(|j| if j % 2 == parity { T::one() } else { T::zero() }).collect::<Vec<T>>()
        };
        Self {
            ring: std::array::from_fn(|k| {
                rows(if frame.terms[k].is_some() { 2 * TERMS[k].components() } else { 0 })
            }),
            f: rows(KEPT),
            v: rows(KEPT),
            line: vec![T::zero(); frame.width],
            split: SplitScratch::new(frame),
            masks: [mask(0), mask(1)],
        }
    }
}

impl<T: Sample> Band<T> {
    fn new(rows: Range<usize>, frame: &Frame<'_, T>) -> Self {
        let stride = frame.channels.len() * frame.width;
        let all = frame.shape.height;
        let held = Self::held(&rows, all).len();
        let terms = std::array::from_fn(|k| {
            let used = frame.terms[k].is_some();
            vec![T::zero(); if used { held * TERMS[k].components() * stride } else { 0 }]
        });
        Self {
            data: vec![T::zero(); held * stride],
            terms,
            previous: Vec::new(),
            sums: vec![[0.0; 3]; frame.channels.len()],
            rows,
        }
    }

    /// Rows whose splits the band holds: the sweep reaches two rows beyond its own, the divergence one more above.
    fn held(rows: &Range<usize>, all: usize) -> Range<usize> {
        rows.start.saturating_sub(3)..(rows.end + 2).min(all)
    }

    /// One pass: all splits, right-hand sides, and the three half sweeps, each one row behind the other.
    #[inline(always)]
    fn update(&mut self, frame: &Frame<'_, T>, u: &[T], out: &mut [T], scratch: &mut Scratch<T>) {
        scratch.split.set_uniform(frame);
        self.sums.fill([0.0; 3]);
        let (channels, p, all) = (frame.channels.len(), frame.width, frame.shape.height);
        if frame.measure && self.previous.is_empty() {
            self.previous = vec![T::zero(); self.rows.len() * channels * p];
        }
        let u = Rows { values: u, kept: usize::MAX };
        let held = Self::held(&self.rows, all);
        let stiff = TERMS.into_iter().zip(frame.terms).filter(|(t, _)| *t != Term::Hessian);
        let coefficients =
            [frame.t0, stiff.filter_map(|(_, t)| t.map(|t| t.penalty)).fold(T::zero(), |a, b| a + b)];
        // The first row whose right-hand side is complete.
        let complete = if held.start == 0 { 0 } else { held.start + 1 };
        let black = self.rows.start.saturating_sub(1)..(self.rows.end + 1).min(all);
        for i in held.start..held.end + 2 {
            if i < held.end {
                self.update_row(frame, u, scratch, i, i - held.start, i >= complete);
                if i >= complete {
                    first_reds(frame, u, scratch, i, coefficients);
                }
            }
            if i >= 1 && black.contains(&(i - 1)) {
                half(frame, scratch, i - 1, 1, coefficients);
            }
            if i >= 2 && self.rows.contains(&(i - 2)) {
                half(frame, scratch, i - 2, 0, coefficients);
                let out = &mut out[(i - 2 - self.rows.start) * channels * p..][..channels * p];
                relax(frame, u, scratch, i - 2, out);
            }
        }
    }

    /// The splits of row `i`, and its right-hand side if `complete`.
    #[inline(always)]
    fn update_row(
        &mut self,
        frame: &Frame<'_, T>,
        u: Rows<'_, T>,
        scratch: &mut Scratch<T>,
        i: usize,
        at: usize,
        complete: bool,
    ) {
        let (channels, p) = (frame.channels.len(), frame.width);
        for (k, term) in TERMS.into_iter().enumerate() {
            if let Some(t) = frame.terms[k] {
                let block = term.components() * channels * p;
                let zh = &mut self.terms[k][at * block..][..block];
                let z = &mut scratch.ring[k][(i % 2) * block..][..block];
                update_term(frame, term, t, i, u, zh, z, &mut scratch.split);
            }
        }
        if !complete {
            return;
        }
        for c in (0..channels).filter(|&c| !frame.frozen[c]) {
            let f = &mut scratch.f[((i % KEPT) * channels + c) * p..][..p];
            let qh = &mut self.data[(at * channels + c) * p..][..p];
            let measure = if frame.measure && self.rows.contains(&i) {
                let own = ((i - self.rows.start) * channels + c) * p;
                Some((&mut self.previous[own..][..p], &mut self.sums[c]))
            } else {
                None
            };
            update_data(frame, &scratch.split, [c, i], u.row(frame, c, i), qh, f, measure);
            for (k, term) in TERMS.into_iter().enumerate() {
                let Some(t) = frame.terms[k] else { continue };
                let lane = |i: usize, component: usize| {
                    let index = ((i % 2) * channels + c) * term.components() + component;
                    &scratch.ring[k][index * p..][..p]
                };
                let above = i.checked_sub(1).map(|i| lane(i, 1));
                subtract_divergence(f, t.penalty, lane(i, 0), lane(i, 1), above);
            }
        }
    }

    fn gradient_dual(&self, frame: &Frame<'_, T>, u: &[T]) -> Vec<T> {
        let Some(t) = frame.terms[0] else { return Vec::new() };
        let mut scratch = Scratch::new(frame);
        scratch.split.set_uniform(frame);
        let block = 2 * frame.channels.len() * frame.width;
        let held = Self::held(&self.rows, frame.shape.height);
        // Without relaxation of what is stored the dual is left in it.
        let plain = Frame { relaxation: T::one(), carry: T::zero(), ..*frame };
        let mut out = Vec::with_capacity(self.rows.len() * block);
        for i in self.rows.clone() {
            let mut zh = self.terms[0][(i - held.start) * block..][..block].to_vec();
            let z = &mut scratch.ring[0][..block];
            let u = Rows { values: u, kept: usize::MAX };
            update_term(&plain, Term::Gradient, t, i, u, &mut zh, z, &mut scratch.split);
            out.extend(zh.iter().map(|b| t.penalty * *b));
        }
        out
    }
}

/// The first half sweep of row `i`: reds from the estimate, blacks copied.
#[inline(always)]
fn first_reds<T: Sample>(
    frame: &Frame<'_, T>,
    u: Rows<'_, T>,
    scratch: &mut Scratch<T>,
    i: usize,
    coefficients: [T; 2],
) {
    let (channels, p, all) = (frame.channels.len(), frame.width, frame.shape.height);
    for c in (0..channels).filter(|&c| !frame.frozen[c]) {
        let lane = ((i % KEPT) * channels + c) * p;
        let (above, below) =
            (i.checked_sub(1).map(|i| u.row(frame, c, i)), (i + 1 < all).then(|| u.row(frame, c, i + 1)));
        let (f, out) = (&scratch.f[lane..][..p], &mut scratch.v[lane..][..p]);
        half_sweep(u.row(frame, c, i), above, below, f, &scratch.masks[i % 2], coefficients, out);
    }
}

/// A later half sweep of row `i`; `color` 0 is red, 1 is black.
#[inline(always)]
fn half<T: Sample>(
    frame: &Frame<'_, T>,
    scratch: &mut Scratch<T>,
    i: usize,
    color: usize,
    coefficients: [T; 2],
) {
    let (channels, p, all) = (frame.channels.len(), frame.width, frame.shape.height);
    for c in (0..channels).filter(|&c| !frame.frozen[c]) {
        let lane = |i: usize| ((i % KEPT) * channels + c) * p;
        let row = |i: usize| &scratch.v[lane(i)..][..p];
        let (above, below) = (i.checked_sub(1).map(row), (i + 1 < all).then(|| row(i + 1)));
        let (f, mask) = (&scratch.f[lane(i)..][..p], &scratch.masks[(i + color) % 2]);
        half_sweep(row(i), above, below, f, mask, coefficients, &mut scratch.line);
        scratch.v[lane(i)..][..p].copy_from_slice(&scratch.line);
    }
}

/// `u' + a (v - u')` of row `i`; channels that rest are copied.
#[inline(always)]
fn relax<T: Sample>(frame: &Frame<'_, T>, u: Rows<'_, T>, scratch: &Scratch<T>, i: usize, out: &mut [T]) {
    let (channels, p) = (frame.channels.len(), frame.width);
    for (c, out) in out.chunks_exact_mut(p).enumerate() {
        let u = u.row(frame, c, i);
        if frame.frozen[c] {
            out.copy_from_slice(u);
            continue;
        }
        let v = &scratch.v[((i % KEPT) * channels + c) * p..][..p];
        for ((o, u), v) in out.iter_mut().zip(u).zip(v) {
            *o = *u + frame.relaxation * (*v - *u);
        }
    }
}
