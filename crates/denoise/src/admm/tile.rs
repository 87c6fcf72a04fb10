//! The fused pass over a band of rows: update of all splits, then the right-hand side of the linear step.
//!
//! A split keeps one value per component: with `z = w + b` the shrinkage gives `w = S(z)` and `b = z - w`, and the
//! next `z` is `b + (1 - a) w + a K u = (z - a S(z)) + a K u`. So `z - a S(z)` is all that is stored, and the
//! right-hand side takes `w - b = 2 S(z) - z`. Bands also keep the splits of the rows just outside that they read, and
//! update them with the same arithmetic as their owners: bands need no exchange.

use std::ops::Range;

use realfft::num_complex::Complex;

use super::Coupling;
use super::problem::{DataTerm, Weight};
use super::rows::{
    DataRow, add_hessian_adjoint, add_square, data_row, forward_x, forward_y, mixed, pass, second_x,
    second_y, shares, shrink, subtract_divergence,
};
use crate::Shape;
use crate::transform::{RowScratch, Sample, StripSolver};

/// What all bands read.
pub(crate) struct Frame<'a, T: Sample> {
    pub(crate) shape: Shape,
    /// Columns with padding.
    pub(crate) cols: usize,
    /// For each solved channel its place in the problem.
    pub(crate) channels: &'a [usize],
    /// Solved channels that have converged.
    pub(crate) frozen: &'a [bool],
    pub(crate) coupling: Coupling,
    /// The estimate: rows, each of all solved channels, padded.
    pub(crate) u: &'a [T],
    /// Target less its offset.
    pub(crate) target: &'a [T],
    pub(crate) data: &'a DataTerm<T>,
    pub(crate) t0: T,
    pub(crate) terms: [Option<TermFrame<'a, T>>; 3],
    /// Factor of the operators in this step, and the relaxation.
    pub(crate) relaxation: [T; 2],
    pub(crate) solver: &'a StripSolver<T>,
    pub(crate) measure: bool,
}

/// What a regulariser needs besides its operator.
#[derive(Clone, Copy)]
pub(crate) struct TermFrame<'a, T> {
    pub(crate) weight: &'a Weight<T>,
    /// The reciprocal penalty, times the factor of merged channels: threshold = weight * scale.
    pub(crate) scale: T,
    pub(crate) penalty: T,
    pub(crate) guide: &'a [T],
}

/// The regularisers, in the order of [`Frame::terms`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Term {
    Gradient,
    Hessian,
    Guide,
}

const TERMS: [Term; 3] = [Term::Gradient, Term::Hessian, Term::Guide];

impl Term {
    /// Components per channel; the two equal mixed derivatives are one, counted twice.
    const fn components(self) -> usize {
        match self {
            Self::Gradient | Self::Guide => 2,
            Self::Hessian => 3,
        }
    }
}

/// A band of rows with its splits.
#[derive(Debug)]
pub(crate) struct Tile<T> {
    pub(crate) rows: Range<usize>,
    /// Data split of own rows.
    data: Vec<T>,
    /// Splits of the regularisers from one row above; the Hessian's to one row below.
    terms: [Vec<T>; 3],
    previous: Vec<T>,
    /// Right-hand side after the transform along rows.
    pub(crate) spectrum: Vec<Complex<T>>,
    /// Sums of `(u-p)^2`, `(p - previous p)^2` and `u^2` of each solved channel.
    pub(crate) sums: Vec<[f64; 3]>,
}

/// Row buffers of one task.
#[derive(Debug)]
pub(crate) struct Scratch<T> {
    /// Three rows of reflections for each regulariser.
    ring: [Vec<T>; 3],
    share: Vec<T>,
    line: Vec<T>,
    uniform: [Vec<T>; 5],
    pub(crate) transform: RowScratch<T>,
}

impl<T: Sample> Scratch<T> {
    pub(crate) fn new(frame: &Frame<'_, T>) -> Self {
        let stride = frame.channels.len() * frame.cols;
        let ring = std::array::from_fn(|k| {
            let used = frame.terms[k].is_some();
            vec![T::zero(); if used { 3 * TERMS[k].components() * stride } else { 0 }]
        });
        let row = || vec![T::zero(); frame.cols];
        Self {
            ring,
            share: row(),
            line: row(),
            uniform: std::array::from_fn(|_| row()),
            transform: frame.solver.scratch(),
        }
    }

    /// Fills the rows that stand for uniform weights.
    fn set_uniform(&mut self, frame: &Frame<'_, T>) {
        let [first, second] = frame.data.weights();
        let regularisers = frame.terms.map(|t| t.map(|t| t.weight));
        let all = [first, second, regularisers[0], regularisers[1], regularisers[2]];
        for (row, weight) in self.uniform.iter_mut().zip(all) {
            if let Some(Weight::Uniform(value)) = weight {
                row.fill(*value);
            }
        }
    }
}

/// One row of a weight.
fn weight_row<'a, T: Sample>(
    weight: &'a Weight<T>,
    uniform: &'a [T],
    shape: Shape,
    c: usize,
    i: usize,
) -> &'a [T] {
    match weight {
        Weight::Uniform(_) => &uniform[..shape.cols],
        Weight::Map(values) => {
            let plane = if values.len() == shape.len() { c * shape.pixels() } else { 0 };
            &values[plane + i * shape.cols..][..shape.cols]
        }
    }
}

impl<T: Sample> Tile<T> {
    /// The band `rows`; `measure` makes room for the previous `p` of the stopping rule.
    pub(crate) fn new(rows: Range<usize>, frame: &Frame<'_, T>) -> Self {
        let (n, stride) = (rows.len(), frame.channels.len() * frame.cols);
        let terms = std::array::from_fn(|k| {
            let count = if frame.terms[k].is_some() {
                Self::held(&rows, TERMS[k], frame.shape.rows).len() * TERMS[k].components()
            } else {
                0
            };
            vec![T::zero(); count * stride]
        });
        let zero = Complex::new(T::zero(), T::zero());
        Self {
            data: vec![T::zero(); n * stride],
            terms,
            previous: Vec::new(),
            spectrum: vec![zero; n * frame.channels.len() * frame.solver.frequencies()],
            sums: vec![[0.0; 3]; frame.channels.len()],
            rows,
        }
    }

    /// Rows whose split of a term the band holds.
    fn held(rows: &Range<usize>, term: Term, all: usize) -> Range<usize> {
        let end = if term == Term::Hessian { (rows.end + 1).min(all) } else { rows.end };
        rows.start.saturating_sub(1)..end
    }

    /// Bytes of the state.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.data.as_slice())
            + self.terms.iter().map(|t| size_of_val(t.as_slice())).sum::<usize>()
            + size_of_val(self.previous.as_slice())
            + size_of_val(self.spectrum.as_slice())
    }

    /// One pass: all splits, then the transformed right-hand side.
    pub(crate) fn update(&mut self, frame: &Frame<'_, T>, scratch: &mut Scratch<T>) {
        scratch.set_uniform(frame);
        self.sums.fill([0.0; 3]);
        if frame.measure && self.previous.is_empty() {
            self.previous = vec![T::zero(); self.data.len()];
        }
        // Rows whose differences reach one row below are finished one row later.
        let lag = usize::from(frame.terms[1].is_some());
        let first = self.rows.start.saturating_sub(1);
        for i in first..self.rows.end + lag {
            for (k, term) in TERMS.into_iter().enumerate() {
                let held = Self::held(&self.rows, term, frame.shape.rows);
                if let (Some(t), true) = (frame.terms[k], held.contains(&i)) {
                    let block = term.components() * frame.channels.len() * frame.cols;
                    let zh = &mut self.terms[k][(i - held.start) * block..][..block];
                    let z = &mut scratch.ring[k][(i % 3) * block..][..block];
                    Self::update_term(
                        frame,
                        term,
                        t,
                        i,
                        zh,
                        z,
                        (&mut scratch.share, &scratch.uniform[2 + k]),
                    );
                }
            }
            if i >= lag && self.rows.contains(&(i - lag)) {
                self.finish_row(frame, scratch, i - lag);
            }
        }
    }

    /// The split of one regulariser in row `i`: `zh` is advanced, `z` becomes the reflection.
    #[inline(always)]
    fn update_term(
        frame: &Frame<'_, T>,
        term: Term,
        t: TermFrame<'_, T>,
        i: usize,
        zh: &mut [T],
        z: &mut [T],
        (share, uniform): (&mut [T], &[T]),
    ) {
        let (p, components) = (frame.cols, term.components());
        let [gain, a] = frame.relaxation;
        let channels = frame.channels.len();
        for c in (0..channels).filter(|&c| !frame.frozen[c]) {
            let lanes = c * components * p..(c + 1) * components * p;
            differences(frame, term, i, c, &zh[lanes.clone()], &mut z[lanes.clone()]);
            if term == Term::Guide {
                for (k, z) in z[lanes].chunks_exact_mut(p).enumerate() {
                    let range = active(term, k, i, frame.shape);
                    let g = guide_row(frame, t, c, k, i);
                    for (z, g) in z[range.clone()].iter_mut().zip(&g[range]) {
                        *z -= gain * *g;
                    }
                }
            }
        }
        let group = if frame.coupling == Coupling::Vectorial { channels } else { 1 };
        for first in (0..channels).step_by(group).filter(|&c| !frame.frozen[c]) {
            let lanes = first * components * p..(first + group) * components * p;
            let share = &mut share[..frame.shape.cols];
            share.fill(T::zero());
            for (k, z) in z[lanes.clone()].chunks_exact(p).enumerate() {
                let range = active(term, k % components, i, frame.shape);
                let weight = if term == Term::Hessian && k % components == 1 { T::of(2.0) } else { T::one() };
                add_square(&z[range.clone()], weight, &mut share[range]);
            }
            shares(share, weight_row(t.weight, uniform, frame.shape, frame.channels[first], i), t.scale);
            for (k, (z, zh)) in
                z[lanes.clone()].chunks_exact_mut(p).zip(zh[lanes].chunks_exact_mut(p)).enumerate()
            {
                let component = k % components;
                let range = active(term, component, i, frame.shape);
                pass(&z[..range.start], &mut zh[..range.start], a);
                pass(&z[range.end..], &mut zh[range.end..], a);
                shrink(&mut z[range.clone()], &mut zh[range.clone()], &share[range.clone()], a);
                if term == Term::Guide {
                    let g = guide_row(frame, t, first + k / components, component, i);
                    for (z, g) in z[range.clone()].iter_mut().zip(&g[range]) {
                        *z += *g;
                    }
                }
            }
        }
    }

    /// The data split of own row `i`, and its right-hand side from all reflections, transformed.
    #[inline(always)]
    fn finish_row(&mut self, frame: &Frame<'_, T>, scratch: &mut Scratch<T>, i: usize) {
        let (p, channels, shape) = (frame.cols, frame.channels.len(), frame.shape);
        let (own, frequencies) = (i - self.rows.start, frame.solver.frequencies());
        for c in (0..channels).filter(|&c| !frame.frozen[c]) {
            let f = &mut scratch.line[..];
            let u = u_row(frame, c, i);
            let qh = &mut self.data[(own * channels + c) * p..][..p];
            let plane = frame.channels[c];
            let row = |k: usize| {
                let weight = frame.data.weights()[k];
                weight
                    .map_or(&scratch.uniform[k][..], |w| weight_row(w, &scratch.uniform[k], shape, plane, i))
            };
            let target = &frame.target[(c * shape.rows + i) * shape.cols..][..shape.cols];
            let data = match frame.data {
                DataTerm::L2 { .. } => DataRow::Hybrid(row(1), row(0)),
                DataTerm::L1 { .. } | DataTerm::Hybrid { .. } => DataRow::Hybrid(row(0), row(1)),
                DataTerm::Huber { .. } => DataRow::Huber(row(0), row(1)),
            };
            data_row(data, target, u, qh, f, frame.t0, frame.relaxation);
            if frame.measure {
                let previous = &mut self.previous[(own * channels + c) * p..][..p];
                let scale = [T::one() / frame.t0, T::one() / (T::of(2.0) - frame.relaxation[1])];
                let n = shape.cols;
                let sums = measure_row(&u[..n], &qh[..n], &f[..n], &mut previous[..n], scale);
                for (total, sum) in self.sums[c].iter_mut().zip(sums) {
                    *total += sum;
                }
            }
            for (k, term) in TERMS.into_iter().enumerate() {
                let Some(t) = frame.terms[k] else { continue };
                let lane = |i: usize, component: usize| {
                    let index = ((i % 3) * channels + c) * term.components() + component;
                    &scratch.ring[k][index * p..][..p]
                };
                let above = i.checked_sub(1);
                if term == Term::Hessian {
                    let below = (i + 1 < shape.rows).then_some(i + 1);
                    let mixed = [above.map(|i| lane(i, 1)), Some(lane(i, 1))];
                    let yy = [above.map(|i| lane(i, 2)), Some(lane(i, 2)), below.map(|i| lane(i, 2))];
                    add_hessian_adjoint(f, t.penalty, lane(i, 0), mixed, yy, &mut scratch.share);
                } else {
                    let above = above.map(|i| lane(i, 1));
                    subtract_divergence(f, t.penalty, lane(i, 0), lane(i, 1), above);
                }
            }
            let out = &mut self.spectrum[(own * channels + c) * frequencies..][..frequencies];
            frame.solver.forward_row(f, out, &mut scratch.transform);
        }
    }
}

/// Columns in which a component of row `i` counts.
#[inline(always)]
fn active(term: Term, component: usize, i: usize, shape: Shape) -> Range<usize> {
    let (m, n) = (shape.rows, shape.cols);
    match (term, component) {
        (Term::Hessian, 0) if n > 2 => 1..n - 1,
        (Term::Hessian, 1) if i + 1 < m => 0..n - 1,
        (Term::Hessian, 2) if i > 0 && i + 1 < m => 0..n,
        (Term::Hessian, _) => 0..0,
        (_, 0) => 0..n - 1,
        _ if i + 1 < m => 0..n,
        _ => 0..0,
    }
}

#[inline(always)]
fn u_row<'a, T: Sample>(frame: &Frame<'a, T>, c: usize, i: usize) -> &'a [T] {
    &frame.u[(i * frame.channels.len() + c) * frame.cols..][..frame.cols]
}

/// Row `i` of component `k` of the target gradient of solved channel `c`.
#[inline(always)]
fn guide_row<'a, T: Sample>(
    frame: &Frame<'_, T>,
    t: TermFrame<'a, T>,
    c: usize,
    k: usize,
    i: usize,
) -> &'a [T] {
    let shape = frame.shape;
    &t.guide[((2 * frame.channels[c] + k) * shape.rows + i) * shape.cols..][..shape.cols]
}

/// `z = zh + gain K u` for the components of one channel in row `i`.
#[inline(always)]
fn differences<T: Sample>(frame: &Frame<'_, T>, term: Term, i: usize, c: usize, zh: &[T], z: &mut [T]) {
    let (p, gain) = (frame.cols, frame.relaxation[0]);
    let u = u_row(frame, c, i);
    let below = (i + 1 < frame.shape.rows).then(|| u_row(frame, c, i + 1));
    if term == Term::Hessian {
        let above = i.checked_sub(1).map(|i| u_row(frame, c, i));
        second_x(u, &zh[..p], gain, &mut z[..p]);
        mixed(u, below, &zh[p..2 * p], gain, &mut z[p..2 * p]);
        second_y(above, u, below, &zh[2 * p..], gain, &mut z[2 * p..]);
    } else {
        forward_x(u, &zh[..p], gain, &mut z[..p]);
        forward_y(u, below, &zh[p..], gain, &mut z[p..]);
    }
}

/// Sums of `(u-p)^2`, `(p - previous)^2` and `u^2`, where `p = (f/t0 + qh) / (2-a)`; keeps `p`.
fn measure_row<T: Sample>(
    u: &[T],
    qh: &[T],
    f: &[T],
    previous: &mut [T],
    [f_scale, scale]: [T; 2],
) -> [f64; 3] {
    const LANES: usize = 8;
    let mut sums = [[T::zero(); LANES]; 3];
    let n = u.len();
    for from in (0..n).step_by(LANES) {
        for (lane, j) in (from..(from + LANES).min(n)).enumerate() {
            let p = (f[j] * f_scale + qh[j]) * scale;
            let (r, d) = (u[j] - p, p - previous[j]);
            sums[0][lane] += r * r;
            sums[1][lane] += d * d;
            sums[2][lane] += u[j] * u[j];
            previous[j] = p;
        }
    }
    sums.map(|lanes| lanes.iter().map(|v| v.f64()).sum())
}
