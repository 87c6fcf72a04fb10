//! Steps in stages: prefilter, moments, postfilter, move.

use super::fused::Constants;
use super::{Optimizer, Placed, SecondMoment};
use crate::error::OptimError;
use crate::scan::{Rows, mean_square};
use crate::spatial::Guidance;
use photofit_scalar::Real;
use rayon::prelude::*;
use std::mem::swap;

/// Buffers kept from step to step.
#[derive(Debug, Default)]
pub(super) struct Scratch<T> {
    /// Filtered gradient, and the input of a second filter.
    g: [Vec<T>; 2],
    /// Moments of the memoryless filter.
    memoryless: [Vec<T>; 2],
    /// Filtered first moment, and the input of a second filter.
    m: [Vec<T>; 2],
    /// Filtered second moment, and the input of a second filter.
    v: [Vec<T>; 2],
    /// The variable in which the step is made.
    u: Vec<T>,
}

/// Runs the chosen filters one after the other; the result lies in `buffers[0]`. `false` where there are none.
fn chain<T: Real>(
    filters: &mut [Placed<T>],
    chosen: impl Fn(&Placed<T>) -> bool,
    input: &[T],
    buffers: &mut [Vec<T>; 2],
) -> bool {
    let mut filtered = false;
    let [out, before] = buffers;
    for placed in filters.iter_mut().filter(|p| chosen(p)) {
        swap(out, before);
        out.resize(input.len(), T::zero());
        placed.filter.apply(&[if filtered { before } else { input }], &mut [out]);
        filtered = true;
    }
    filtered
}

/// The filters of the moments; both moments in one call where a filter takes both.
fn postfilter<T: Real>(
    filters: &mut [Placed<T>],
    moments: [&[T]; 2],
    m: &mut [Vec<T>; 2],
    v: &mut [Vec<T>; 2],
) -> [bool; 2] {
    let mut filtered = [false; 2];
    let ([m_out, m_before], [v_out, v_before]) = (m, v);
    for Placed { placement, filter } in filters.iter_mut() {
        let chosen = [placement.first, placement.second && !moments[1].is_empty()];
        let (mut fields, mut out): (Vec<&[T]>, Vec<&mut [T]>) = (Vec::new(), Vec::new());
        if chosen[0] {
            swap(m_out, m_before);
            m_out.resize(moments[0].len(), T::zero());
            fields.push(if filtered[0] { m_before } else { moments[0] });
            out.push(m_out);
        }
        if chosen[1] {
            swap(v_out, v_before);
            v_out.resize(moments[1].len(), T::zero());
            fields.push(if filtered[1] { v_before } else { moments[1] });
            out.push(v_out);
        }
        if !fields.is_empty() {
            filter.apply(&fields, &mut out);
        }
        filtered = [filtered[0] || chosen[0], filtered[1] || chosen[1]];
    }
    filtered
}

impl<T: Real> Optimizer<T> {
    /// One step, given the mean square of the gradients as they came.
    pub(super) fn staged(
        &mut self,
        params: &mut [T],
        grads: &[T],
        rows: &Rows<'_, T>,
        mean: f64,
        guide: &[T],
    ) -> Result<(), OptimError> {
        let rate = rows.rates.iter().copied().fold(T::zero(), T::max);
        let guidance = Guidance { group: &self.group, params, grads, rate, guide };
        for placed in &mut self.filters {
            placed.filter.prepare(&guidance)?;
        }
        let mut scratch = std::mem::take(&mut self.scratch);
        let before = |p: &Placed<T>| p.placement.gradient || p.placement.variable;
        let prefiltered = chain(&mut self.filters, before, grads, &mut scratch.g);
        let g = if prefiltered { &scratch.g[0] } else { grads };
        let mean = if prefiltered { mean_square(&self.group, g, rows)?.unwrap_or(0.0) } else { mean };
        let variable = self.filters.iter_mut().find(|p| p.placement.variable);
        if let Some(placed) = variable {
            scratch.u.resize(params.len(), T::zero());
            if !placed.filter.unapply(params, &mut scratch.u) {
                return Err(OptimError::Combination {
                    group: self.group.clone(),
                    what: "a change of variables",
                    with: "a filter without inverse",
                });
            }
        }
        self.state.observe(mean, self.temporal.beta2);
        self.state.step += 1;
        let constants = Constants::new(&self.temporal, &self.state);
        let [m_len, v_len] = self.temporal.memory(self.len);
        let [m, v] = if m_len > 0 || v_len > 0 {
            [&mut self.state.m, &mut self.state.v]
        } else {
            let [m, v] = &mut scratch.memoryless;
            m.resize(self.len, T::zero());
            v.resize(self.temporal.second_len(self.len), T::zero());
            [m, v]
        };
        accumulate(self.temporal.second, constants, m, v, g, rows);
        let done = postfilter(&mut self.filters, [m, v], &mut scratch.m, &mut scratch.v);
        let m = if done[0] { &scratch.m[0] } else { &*m };
        let v = if done[1] { &scratch.v[0] } else { &*v };
        let corrections = self.temporal.corrections(self.state.step);
        let scale = f64::from(self.state.scale_exponent).exp2();
        let moving = Moving { second: self.temporal.second, constants, corrections, scale };
        match self.filters.iter_mut().find(|p| p.placement.variable) {
            Some(placed) => {
                moving.run(&mut scratch.u, m, v, rows);
                placed.filter.apply(&[&scratch.u], &mut [params]);
            }
            None => moving.run(params, m, v, rows),
        }
        self.scratch = scratch;
        Ok(())
    }
}

/// Takes the gradients into the moments; frozen channels count as zero.
fn accumulate<T: Real>(
    second: SecondMoment,
    constants: Constants<T>,
    m: &mut [T],
    v: &mut [T],
    g: &[T],
    rows: &Rows<'_, T>,
) {
    let Constants { beta: [b1, b2], rest: [r1, r2], inverse_scale, tiny, .. } = constants;
    let (chunk, width) = (rows.chunk(), rows.rates.len());
    let live: Vec<T> =
        rows.rates.iter().map(|r| if *r > T::zero() { inverse_scale } else { T::zero() }).collect();
    let flush = |x: T, tiny: T| if x.abs() < tiny { T::zero() } else { x };
    let first = |m: &mut T, g: T| *m = flush(b1 * *m + r1 * g, tiny[0]);
    let squares = |m: &mut [T], v: &mut [T], g: &[T], live: &[T], tiny: [T; 2]| {
        for (((m, v), g), live) in m.iter_mut().zip(v).zip(g).zip(live) {
            let g = *g * *live;
            *m = flush(b1 * *m + r1 * g, tiny[0]);
            *v = flush(b2 * *v + r2 * (g * g), tiny[1]);
        }
    };
    match second {
        SecondMoment::None => {
            m.par_chunks_mut(chunk).zip(g.par_chunks(chunk)).for_each(|(m, g)| {
                for (m, g) in m.chunks_exact_mut(width).zip(g.chunks_exact(width)) {
                    m.iter_mut().zip(g).zip(&live).for_each(|((m, g), live)| first(m, *g * *live));
                }
            });
        }
        SecondMoment::PerEntry | SecondMoment::GlobalMax => {
            // The maximum needs no flush: small entries do not matter to it.
            let tiny = if second == SecondMoment::GlobalMax { [T::zero(); 2] } else { tiny };
            let moments = m.par_chunks_mut(chunk).zip(v.par_chunks_mut(chunk));
            moments.zip(g.par_chunks(chunk)).for_each(|((m, v), g)| match live[..] {
                [live] => m.iter_mut().zip(v).zip(g).for_each(|((m, v), g)| {
                    let g = *g * live;
                    *m = flush(b1 * *m + r1 * g, tiny[0]);
                    *v = flush(b2 * *v + r2 * (g * g), tiny[1]);
                }),
                _ => {
                    let rows = m.chunks_exact_mut(width).zip(v.chunks_exact_mut(width));
                    rows.zip(g.chunks_exact(width)).for_each(|((m, v), g)| squares(m, v, g, &live, tiny));
                }
            });
        }
        SecondMoment::PerVector(size) => {
            let rows_of = (1 << 12) * size;
            let chunks = m.par_chunks_mut(rows_of).zip(g.par_chunks(rows_of)).zip(v.par_chunks_mut(1 << 12));
            chunks.enumerate().for_each(|(c, ((m, g), v))| {
                let mut channel = c * rows_of % width;
                for ((m, g), v) in m.chunks_exact_mut(size).zip(g.chunks_exact(size)).zip(v) {
                    let mut square = T::zero();
                    for (m, g) in m.iter_mut().zip(g) {
                        let g = *g * live[channel];
                        channel = if channel + 1 == width { 0 } else { channel + 1 };
                        square += g * g;
                        first(m, g);
                    }
                    *v = flush(b2 * *v + r2 * square, tiny[1]);
                }
            });
        }
    }
}

/// The last stage of a step.
struct Moving<T> {
    second: SecondMoment,
    constants: Constants<T>,
    corrections: [f64; 2],
    /// Unit of the first moments.
    scale: f64,
}

impl<T: Real> Moving<T> {
    fn run(&self, params: &mut [T], m: &[T], v: &[T], rows: &Rows<'_, T>) {
        let [c1, c2] = self.corrections;
        let epsilon = self.constants.epsilon;
        let (chunk, width) = (rows.chunk(), rows.rates.len());
        let uniform = |params: &mut [T], factor: T| {
            let scales: Vec<T> = rows.rates.iter().map(|r| *r * factor).collect();
            params.par_chunks_mut(chunk).zip(m.par_chunks(chunk)).for_each(|(p, m)| match scales[..] {
                [scale] => p.iter_mut().zip(m).for_each(|(p, m)| *p -= scale * *m),
                _ => {
                    for (p, m) in p.chunks_exact_mut(width).zip(m.chunks_exact(width)) {
                        p.iter_mut().zip(m).zip(&scales).for_each(|((p, m), scale)| *p -= *scale * *m);
                    }
                }
            });
        };
        match self.second {
            SecondMoment::None => uniform(params, T::of(c1 * self.scale)),
            SecondMoment::GlobalMax => {
                let maxima: Vec<T> =
                    v.par_chunks(chunk).map(|v| v.iter().fold(T::zero(), |a, b| a.max(*b))).collect();
                let largest = maxima.into_iter().fold(T::zero(), T::max).f64();
                uniform(params, T::of(if largest > 0.0 { c1 / (largest * c2).sqrt() } else { 0.0 }));
            }
            SecondMoment::PerEntry => {
                let [c1, c2] = [c1, c2].map(T::of);
                let one =
                    |p: &mut T, m: T, v: T, rate: T| *p -= rate * (m * c1) / ((v * c2).sqrt() + epsilon);
                let chunks = params.par_chunks_mut(chunk).zip(m.par_chunks(chunk)).zip(v.par_chunks(chunk));
                chunks.for_each(|((p, m), v)| match rows.rates[..] {
                    [rate] => p.iter_mut().zip(m).zip(v).for_each(|((p, m), v)| one(p, *m, *v, rate)),
                    _ => {
                        let rows_of = p.chunks_exact_mut(width).zip(m.chunks_exact(width));
                        for ((p, m), v) in rows_of.zip(v.chunks_exact(width)) {
                            let entries = p.iter_mut().zip(m).zip(v).zip(rows.rates);
                            entries.for_each(|(((p, m), v), rate)| one(p, *m, *v, *rate));
                        }
                    }
                });
            }
            SecondMoment::PerVector(size) => {
                let [c1, c2] = [c1, c2].map(T::of);
                // The mean is that of entries, `v` that of vectors.
                let epsilon = epsilon * T::of(size as f64).sqrt();
                let rows_of = (1 << 12) * size;
                let chunks = params.par_chunks_mut(rows_of).zip(m.par_chunks(rows_of));
                chunks.zip(v.par_chunks(1 << 12)).enumerate().for_each(|(c, ((p, m), v))| {
                    let mut channel = c * rows_of % width;
                    for ((p, m), v) in p.chunks_exact_mut(size).zip(m.chunks_exact(size)).zip(v) {
                        let factor = c1 / ((*v * c2).sqrt() + epsilon);
                        for (p, m) in p.iter_mut().zip(m) {
                            *p -= rows.rates[channel] * factor * *m;
                            channel = if channel + 1 == width { 0 } else { channel + 1 };
                        }
                    }
                });
            }
        }
    }
}
