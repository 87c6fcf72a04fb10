//! Adam without filters in one pass over parameters, moments and gradients, dense and by rows.

use super::{Optimizer, Temporal};
use crate::scan::Rows;
use crate::state::State;
use photofit_scalar::Real;
use rayon::prelude::*;

/// Below this (in units of the gradients' root mean square) moments count as zero, and the denominator ends: keeps
/// subnormal numbers, which are slow, out of parameters that get no gradient any more.
pub(super) const TINY: f64 = 1e-18;

/// Steps whose bias corrections are tabulated for rows that step apart.
const TABLE: usize = 1 << 16;

/// Constants of one step.
#[derive(Clone, Copy)]
pub(super) struct Constants<T> {
    pub(super) beta: [T; 2],
    pub(super) rest: [T; 2],
    pub(super) inverse_scale: T,
    pub(super) epsilon: T,
    pub(super) tiny: [T; 2],
}

impl<T: Real> Constants<T> {
    pub(super) fn new(temporal: &Temporal, state: &State<T>) -> Self {
        let Temporal { beta1, beta2, relative_epsilon, .. } = *temporal;
        let inverse_scale = state.inverse_scale();
        let rms = (state.mean_square * temporal.corrections(state.step)[1]).sqrt();
        Self {
            beta: [T::of(beta1), T::of(beta2)],
            rest: [T::of(1.0 - beta1), T::of(1.0 - beta2)],
            inverse_scale,
            epsilon: T::of(relative_epsilon * rms * inverse_scale.f64() + TINY),
            tiny: [T::of(TINY), T::of(TINY * TINY)],
        }
    }

    /// Moves one sample.
    #[inline(always)]
    fn apply(self, p: &mut T, m: &mut T, v: &mut T, g: T, rate: T, correction: [T; 2]) {
        self.scaled(p, m, v, g * self.inverse_scale, rate, correction);
    }

    /// Moves one sample by a gradient in the moments' unit.
    #[inline(always)]
    fn scaled(self, p: &mut T, m: &mut T, v: &mut T, g: T, rate: T, correction: [T; 2]) {
        let first = self.beta[0] * *m + self.rest[0] * g;
        let second = self.beta[1] * *v + self.rest[1] * (g * g);
        let first = if first.abs() < self.tiny[0] { T::zero() } else { first };
        let second = if second < self.tiny[1] { T::zero() } else { second };
        *m = first;
        *v = second;
        *p -= rate * (first * correction[0]) / ((second * correction[1]).sqrt() + self.epsilon);
    }

    /// Moves whole rows. Takes the constants by value: loads through a reference could alias the stores.
    #[inline(never)]
    fn dense(self, p: &mut [T], m: &mut [T], v: &mut [T], g: &[T], rates: &[T], correction: [T; 2]) {
        match rates.len() {
            1 => {
                for (((p, m), v), g) in p.iter_mut().zip(m).zip(v).zip(g) {
                    self.apply(p, m, v, *g, rates[0], correction);
                }
            }
            4 => self.fixed::<4>(p, m, v, g, rates, correction),
            8 => self.fixed::<8>(p, m, v, g, rates, correction),
            16 => self.fixed::<16>(p, m, v, g, rates, correction),
            width => {
                let rows = p.chunks_exact_mut(width).zip(m.chunks_exact_mut(width));
                for (((p, m), v), g) in rows.zip(v.chunks_exact_mut(width)).zip(g.chunks_exact(width)) {
                    self.row(p, m, v, g, rates, correction);
                }
            }
        }
    }

    /// [`Self::dense`] for rows of a length known to the compiler.
    #[inline(always)]
    fn fixed<const W: usize>(
        self,
        p: &mut [T],
        m: &mut [T],
        v: &mut [T],
        g: &[T],
        rates: &[T],
        correction: [T; 2],
    ) {
        let Some(rates) = rates.first_chunk::<W>().copied() else { return };
        let live = rates.map(|r| if r > T::zero() { self.inverse_scale } else { T::zero() });
        let rows = p.as_chunks_mut::<W>().0.iter_mut().zip(m.as_chunks_mut::<W>().0);
        let rest = v.as_chunks_mut::<W>().0.iter_mut().zip(g.as_chunks::<W>().0);
        for ((p, m), (v, g)) in rows.zip(rest) {
            for k in 0..W {
                self.scaled(&mut p[k], &mut m[k], &mut v[k], g[k] * live[k], rates[k], correction);
            }
        }
    }

    #[inline(always)]
    fn row(self, p: &mut [T], m: &mut [T], v: &mut [T], g: &[T], rates: &[T], correction: [T; 2]) {
        for ((((p, m), v), g), rate) in p.iter_mut().zip(m).zip(v).zip(g).zip(rates) {
            let g = if *rate > T::zero() { *g } else { T::zero() };
            self.apply(p, m, v, g, *rate, correction);
        }
    }

    /// `p -= rate g / (|g| + eps)`.
    #[inline(always)]
    fn memoryless(self, p: &mut [T], g: &[T], rates: &[T]) {
        for ((p, g), rate) in p.iter_mut().zip(g).zip(rates) {
            let g = *g * self.inverse_scale;
            *p -= *rate * g / (g.abs() + self.epsilon);
        }
    }
}

impl<T: Real> Optimizer<T> {
    /// One step, given the mean square of the gradients that move.
    pub(super) fn fused(&mut self, params: &mut [T], grads: &[T], rows: &Rows<'_, T>, mean: f64) {
        self.state.observe(mean, self.temporal.beta2);
        if rows.touched.is_some() && self.state.row_steps.is_empty() {
            let taken = u32::try_from(self.state.step).unwrap_or(u32::MAX);
            self.state.row_steps = vec![taken; self.len / rows.rates.len()];
        }
        self.state.step += 1;
        let step = Constants::new(&self.temporal, &self.state);
        if self.state.m.is_empty() {
            memoryless(step, params, grads, rows);
        } else if self.state.row_steps.is_empty() {
            let correction = self.temporal.corrections(self.state.step).map(T::of);
            let chunk = rows.chunk();
            let state = self.state.m.par_chunks_mut(chunk).zip(self.state.v.par_chunks_mut(chunk));
            let chunks = params.par_chunks_mut(chunk).zip(grads.par_chunks(chunk)).zip(state);
            chunks.for_each(|((p, g), (m, v))| step.dense(p, m, v, g, rows.rates, correction));
        } else {
            self.apart(step, params, grads, rows);
        }
    }

    /// A step in which rows have their own counts.
    fn apart(&mut self, step: Constants<T>, params: &mut [T], grads: &[T], rows: &Rows<'_, T>) {
        let wanted = (self.state.step as usize + 1).min(TABLE);
        for t in self.table.len()..wanted {
            self.table.push(self.temporal.corrections(t as u64).map(T::of));
        }
        let (chunk, width) = (rows.chunk(), rows.rates.len());
        let (table, temporal) = (&self.table, &self.temporal);
        let correction = |t: u32| {
            table.get(t as usize).copied().unwrap_or_else(|| temporal.corrections(u64::from(t)).map(T::of))
        };
        let state = self.state.m.par_chunks_mut(chunk).zip(self.state.v.par_chunks_mut(chunk));
        let counts = self.state.row_steps.par_chunks_mut(chunk / width);
        let chunks = params.par_chunks_mut(chunk).zip(grads.par_chunks(chunk)).zip(state).zip(counts);
        chunks.enumerate().for_each(|(c, (((p, g), (m, v)), counts))| {
            let touched = rows.touched_in(c);
            for (r, count) in counts.iter_mut().enumerate() {
                if touched.is_some_and(|t| !t[r]) {
                    continue;
                }
                *count = count.saturating_add(1);
                let at = r * width..(r + 1) * width;
                let (p, m, v) = (&mut p[at.clone()], &mut m[at.clone()], &mut v[at.clone()]);
                step.dense(p, m, v, &g[at], rows.rates, correction(*count));
            }
        });
    }
}

fn memoryless<T: Real>(step: Constants<T>, params: &mut [T], grads: &[T], rows: &Rows<'_, T>) {
    let (chunk, width) = (rows.chunk(), rows.rates.len());
    let chunks = params.par_chunks_mut(chunk).zip(grads.par_chunks(chunk)).enumerate();
    chunks.for_each(|(c, (p, g))| {
        let touched = rows.touched_in(c);
        for (r, (p, g)) in p.chunks_exact_mut(width).zip(g.chunks_exact(width)).enumerate() {
            if touched.is_none_or(|t| t[r]) {
                step.memoryless(p, g, rows.rates);
            }
        }
    });
}
