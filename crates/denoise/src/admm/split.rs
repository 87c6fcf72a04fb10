//! The splits of one row, as both linear steps need them.
//!
//! A split keeps one value per component: with `z = w + b` the shrinkage gives `w = S(z)` and `b = z - w`, and the
//! next `z` is `b + (1 - a) w + a K u = (z - a S(z)) + a K u`. So `z - a S(z)` is all that is stored, and the
//! right-hand side takes `w - b = 2 S(z) - z`. Where the linear step relaxes the estimate itself, `a K u` is
//! `K u' - (1 - a) K u'_before` of the relaxed estimate `u'`; the second term is taken off what is stored (`carry`).

use std::ops::Range;

use super::Coupling;
use super::problem::{DataTerm, Weight};
use super::rows::{
    DataRow, add_square, data_row, forward_x, forward_y, mixed, pass, second_x, second_y, shares, shrink,
};
use crate::Shape;
use crate::transform::Sample;

/// What all bands read.
pub(crate) struct Frame<'a, T: Sample> {
    pub(crate) shape: Shape,
    /// Columns with padding.
    pub(crate) width: usize,
    /// Rows wrap around; otherwise nothing crosses their ends.
    pub(crate) periodic: bool,
    /// For each solved channel its place in the problem.
    pub(crate) channels: &'a [usize],
    /// Solved channels that have converged.
    pub(crate) frozen: &'a [bool],
    pub(crate) coupling: Coupling,
    /// The estimate before the first step, if it is not the target: planes of all channels.
    pub(crate) start: Option<&'a [T]>,
    pub(crate) offsets: &'a [T],
    /// Target of the solved channels less their offset.
    pub(crate) target: &'a [T],
    pub(crate) data: &'a DataTerm<T>,
    pub(crate) t0: T,
    pub(crate) terms: [Option<TermFrame<'a, T>>; 3],
    /// Factor of the operators in this step.
    pub(crate) gain: T,
    /// `a`.
    pub(crate) relaxation: T,
    /// `1 - a` where the estimate is relaxed, else 0.
    pub(crate) carry: T,
    /// The stopping rule wants its sums.
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
pub(crate) enum Term {
    Gradient,
    Hessian,
    Guide,
}

pub(crate) const TERMS: [Term; 3] = [Term::Gradient, Term::Hessian, Term::Guide];

impl Term {
    /// Components per channel; the two equal mixed derivatives are one, counted twice.
    pub(crate) const fn components(self) -> usize {
        match self {
            Self::Gradient | Self::Guide => 2,
            Self::Hessian => 3,
        }
    }
}

/// Rows of an estimate, each of all solved channels; row `i` is kept at `i` modulo `kept`.
#[derive(Clone, Copy)]
pub(crate) struct Rows<'a, T> {
    pub(crate) values: &'a [T],
    pub(crate) kept: usize,
}

impl<'a, T: Sample> Rows<'a, T> {
    #[inline(always)]
    pub(crate) fn row(self, frame: &Frame<'_, T>, c: usize, i: usize) -> &'a [T] {
        &self.values[((i % self.kept) * frame.channels.len() + c) * frame.width..][..frame.width]
    }
}

impl<T: Sample> Frame<'_, T> {
    /// Row `i` of solved channel `c` of the estimate before the first step.
    pub(crate) fn start_row(&self, c: usize, i: usize, row: &mut [T]) {
        let (shape, n, plane) = (self.shape, self.shape.width, self.channels[c]);
        match self.start {
            Some(start) => {
                for (v, s) in row.iter_mut().zip(&start[(plane * shape.height + i) * n..][..n]) {
                    *v = *s - self.offsets[plane];
                }
            }
            None => {
                row[..n].copy_from_slice(&self.target[(c * shape.height + i) * n..][..n]);
                let holes = !super::survey::full(self.data);
                for (j, v) in row[..n].iter_mut().enumerate().filter(|_| holes) {
                    if self.data.hole((plane * shape.height + i) * n + j, shape) {
                        *v = T::zero();
                    }
                }
            }
        }
        // The padding continues the row back to its beginning, without a jump.
        let (first, step) = (row[n - 1], (row[0] - row[n - 1]) / T::of((self.width - n + 1) as f64));
        for (k, v) in row[n..].iter_mut().enumerate() {
            *v = first + step * T::of((k + 1) as f64);
        }
    }
}

/// Rows for norms and for weights that are the same everywhere.
#[derive(Debug)]
pub(crate) struct SplitScratch<T> {
    pub(crate) share: Vec<T>,
    uniform: [Vec<T>; 5],
}

impl<T: Sample> SplitScratch<T> {
    pub(crate) fn new(frame: &Frame<'_, T>) -> Self {
        let row = || vec![T::zero(); frame.width];
        Self { share: row(), uniform: std::array::from_fn(|_| row()) }
    }

    /// Fills the rows that stand for uniform weights.
    pub(crate) fn set_uniform(&mut self, frame: &Frame<'_, T>) {
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
#[inline(always)]
fn weight_row<'a, T: Sample>(
    weight: &'a Weight<T>,
    uniform: &'a [T],
    shape: Shape,
    c: usize,
    i: usize,
) -> &'a [T] {
    match weight {
        Weight::Uniform(_) => &uniform[..shape.width],
        Weight::Map(values) => {
            let plane = if values.len() == shape.len() { c * shape.pixels() } else { 0 };
            &values[plane + i * shape.width..][..shape.width]
        }
    }
}

/// The split of one regulariser in row `i`: `zh` is advanced, `z` becomes the reflection.
#[inline(always)]
pub(crate) fn update_term<T: Sample>(
    frame: &Frame<'_, T>,
    term: Term,
    t: TermFrame<'_, T>,
    i: usize,
    u: Rows<'_, T>,
    zh: &mut [T],
    z: &mut [T],
    scratch: &mut SplitScratch<T>,
) {
    let (p, components) = (frame.width, term.components());
    let (gain, maps) = (frame.gain, [frame.relaxation, frame.carry]);
    let channels = frame.channels.len();
    let (share, uniform) =
        (&mut scratch.share, &scratch.uniform[2 + TERMS.iter().position(|k| *k == term).unwrap_or(0)]);
    for c in (0..channels).filter(|&c| !frame.frozen[c]) {
        let lanes = c * components * p..(c + 1) * components * p;
        differences(frame, term, i, u, c, &zh[lanes.clone()], &mut z[lanes.clone()]);
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
        let share = &mut share[..frame.shape.width];
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
            pass(&z[..range.start], &mut zh[..range.start], maps);
            pass(&z[range.end..], &mut zh[range.end..], maps);
            shrink(&mut z[range.clone()], &mut zh[range.clone()], &share[range.clone()], maps);
            if term == Term::Guide {
                let g = guide_row(frame, t, first + k / components, component, i);
                for (z, g) in z[range.clone()].iter_mut().zip(&g[range]) {
                    *z += *g;
                }
            }
        }
    }
}

/// The data split of row `i` of solved channel `c`: `qh` is advanced, `f` becomes its part of the right-hand side.
/// `measure` holds the row of the previous `p` and the sums of `(u-p)^2`, `(p - previous p)^2` and `u^2`.
#[inline(always)]
pub(crate) fn update_data<T: Sample>(
    frame: &Frame<'_, T>,
    scratch: &SplitScratch<T>,
    [c, i]: [usize; 2],
    u: &[T],
    qh: &mut [T],
    f: &mut [T],
    measure: Option<(&mut [T], &mut [f64; 3])>,
) {
    let (shape, plane) = (frame.shape, frame.channels[c]);
    let row = |k: usize| {
        let weight = frame.data.weights()[k];
        weight.map_or(&scratch.uniform[k][..], |w| weight_row(w, &scratch.uniform[k], shape, plane, i))
    };
    let target = &frame.target[(c * shape.height + i) * shape.width..][..shape.width];
    let data = match frame.data {
        DataTerm::L2 { .. } => DataRow::Hybrid(row(1), row(0)),
        DataTerm::L1 { .. } | DataTerm::Hybrid { .. } => DataRow::Hybrid(row(0), row(1)),
        DataTerm::Huber { .. } => DataRow::Huber(row(0), row(1)),
    };
    data_row(data, target, u, qh, f, frame.t0, [frame.gain, frame.relaxation, frame.carry]);
    if let Some((previous, sums)) = measure {
        let n = shape.width;
        let scales =
            [T::one() / frame.t0, T::one() / (T::of(2.0) - frame.relaxation), frame.carry * frame.gain];
        let found = measure_row(&u[..n], &qh[..n], &f[..n], &mut previous[..n], scales);
        for (total, sum) in sums.iter_mut().zip(found) {
            *total += sum;
        }
    }
}

/// Columns in which a component of row `i` counts.
#[inline(always)]
fn active(term: Term, component: usize, i: usize, shape: Shape) -> Range<usize> {
    let (m, n) = (shape.height, shape.width);
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
    &t.guide[((2 * frame.channels[c] + k) * shape.height + i) * shape.width..][..shape.width]
}

/// `z = zh + gain K u` for the components of one channel in row `i`.
#[inline(always)]
fn differences<T: Sample>(
    frame: &Frame<'_, T>,
    term: Term,
    i: usize,
    u: Rows<'_, T>,
    c: usize,
    zh: &[T],
    z: &mut [T],
) {
    let (p, gain) = (frame.width, frame.gain);
    let row = |i| u.row(frame, c, i);
    let below = (i + 1 < frame.shape.height).then(|| row(i + 1));
    let above = i.checked_sub(1).map(row);
    let u = row(i);
    if term == Term::Hessian {
        second_x(u, &zh[..p], gain, &mut z[..p]);
        mixed(u, below, &zh[p..2 * p], gain, &mut z[p..2 * p]);
        second_y(above, u, below, &zh[2 * p..], gain, &mut z[2 * p..]);
    } else {
        forward_x(u, frame.periodic, &zh[..p], gain, &mut z[..p]);
        forward_y(u, below, &zh[p..], gain, &mut z[p..]);
    }
}

/// Sums of `(u-p)^2`, `(p - previous)^2` and `u^2`, where `p = (f/t0 + qh + carry u) / (2-a)`; keeps `p`.
#[inline(always)]
fn measure_row<T: Sample>(
    u: &[T],
    qh: &[T],
    f: &[T],
    previous: &mut [T],
    [f_scale, scale, carry]: [T; 3],
) -> [f64; 3] {
    const LANES: usize = 8;
    let mut sums = [[T::zero(); LANES]; 3];
    let n = u.len();
    for from in (0..n).step_by(LANES) {
        for (lane, j) in (from..(from + LANES).min(n)).enumerate() {
            let p = (f[j] * f_scale + qh[j] + carry * u[j]) * scale;
            let (r, d) = (u[j] - p, p - previous[j]);
            sums[0][lane] += r * r;
            sums[1][lane] += d * d;
            sums[2][lane] += u[j] * u[j];
            previous[j] = p;
        }
    }
    sums.map(|lanes| lanes.iter().map(|v| v.f64()).sum())
}
