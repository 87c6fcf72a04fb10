//! Adam, dense and by rows, with an epsilon relative to the gradients' size.

use crate::error::OptimError;
use crate::scan::{Rows, mean_square};
use crate::state::{Optimizer, State};
use photofit_scalar::Real;
use rayon::prelude::*;

/// Below this (in units of the gradients' root mean square) moments count as zero, and the denominator ends: keeps
/// subnormal numbers, which are slow, out of parameters that get no gradient any more.
const TINY: f64 = 1e-18;

/// Steps whose bias corrections are tabulated for rows that step apart.
const TABLE: usize = 1 << 16;

/// Settings of [`Adam`] and [`UniformAdam`](crate::UniformAdam).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdamConfig {
    /// Decay of the first moment, in `[0, 1)`.
    pub beta1: f64,
    /// Decay of the second moment, in `[0, 1)`.
    pub beta2: f64,
    /// Epsilon over the root mean square of `sqrt(v^)` of the group, not negative: scale-free, unlike the customary
    /// absolute 1e-8, which stalls where gradients are about 1e-10. [`UniformAdam`](crate::UniformAdam) needs none.
    pub relative_epsilon: f64,
    /// Whether moments are divided by `1 - beta^t`.
    pub bias_correction: bool,
}

impl Default for AdamConfig {
    fn default() -> Self {
        Self { beta1: 0.9, beta2: 0.999, relative_epsilon: 1e-6, bias_correction: true }
    }
}

impl AdamConfig {
    pub(crate) fn check(&self, group: &str) -> Result<(), OptimError> {
        for (name, beta) in [("beta1", self.beta1), ("beta2", self.beta2)] {
            OptimError::setting(group, name, beta, "in [0, 1)", (0.0..1.0).contains(&beta))?;
        }
        let epsilon = self.relative_epsilon;
        let good = epsilon >= 0.0 && epsilon.is_finite();
        OptimError::setting(group, "relative epsilon", epsilon, "finite and not negative", good)
    }

    /// `[1 / (1 - beta1^t), 1 / (1 - beta2^t)]`, or ones.
    pub(crate) fn corrections(&self, step: u64) -> [f64; 2] {
        if !self.bias_correction {
            return [1.0; 2];
        }
        let t = i32::try_from(step).unwrap_or(i32::MAX);
        [self.beta1, self.beta2].map(|beta| 1.0 / (1.0 - beta.powi(t)))
    }
}

/// Adam (Kingma and Ba 2015): `m = b1 m + (1 - b1) g`, `v = b2 v + (1 - b2) g^2`,
/// `p -= rate m^ / (sqrt(v^) + eps)`.
///
/// `eps = relative_epsilon sqrt(mean g^2)`, the mean running over steps like `v` and over the samples that moved, so a
/// step does not depend on the gradients' scale. Results are bitwise the same for any number of threads. With
/// `beta1 = beta2 = 0` no moments are stored and the step is `rate g / (|g| + eps)`.
///
/// ```
/// use photofit_optim::{Adam, AdamConfig, Optimizer};
/// let mut x = [4.0_f32, -3.0];
/// let mut adam = Adam::new("x", x.len(), AdamConfig::default())?;
/// for _ in 0..400 {
///     let gradient = x.map(|x| 2e-10 * x);
///     adam.step(&mut x, &gradient, 0.05)?;
/// }
/// assert!(x.iter().all(|x| x.abs() < 0.01));
/// # Ok::<(), photofit_optim::OptimError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Adam<T> {
    group: String,
    len: usize,
    config: AdamConfig,
    state: State<T>,
    /// Bias corrections by the number of steps a row has taken.
    table: Vec<[T; 2]>,
}

/// Constants of one step.
#[derive(Clone, Copy)]
struct Step<T> {
    beta: [T; 2],
    rest: [T; 2],
    inverse_scale: T,
    epsilon: T,
    tiny: [T; 2],
}

impl<T: Real> Step<T> {
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

impl<T: Real> Adam<T> {
    /// For a group of `len` parameters, named for messages.
    ///
    /// # Errors
    /// [`OptimError::Setting`] for settings outside their ranges.
    pub fn new(group: &str, len: usize, config: AdamConfig) -> Result<Self, OptimError> {
        config.check(group)?;
        let memory = if config.beta1 == 0.0 && config.beta2 == 0.0 { 0 } else { len };
        let state = State::new(memory, memory);
        Ok(Self { group: group.to_owned(), len, config, state, table: Vec::new() })
    }

    /// The settings.
    pub fn config(&self) -> &AdamConfig {
        &self.config
    }

    /// One step with a learning rate per channel, skipping rows that were not touched (lazy rows).
    ///
    /// Parameters are rows of `rows.rates.len()` consecutive samples (the 16 channels of a texel, say). What happens:
    /// - An untouched row is left alone: its parameters, both moments and its own step count keep their bits, its
    ///   gradients are not read. For it, time stands still: moments do not decay while it is not seen, and its bias
    ///   correction counts its own steps, so a row seen for the first time at step 1000 moves by `rate` as it would
    ///   have at step 1. (Dense Adam would go on moving it by momentum and then move it by a fraction of `rate`.)
    /// - A channel with rate 0 is frozen: its parameter keeps its bits, its gradient counts as zero in the moments
    ///   and is left out of epsilon's mean; it must be finite all the same.
    /// - When no row is touched nothing changes, the step count included.
    ///
    /// Row counts come into being at the first call with `touched`; until then all rows count as stepped together.
    ///
    /// # Errors
    /// As [`Optimizer::step`]; parameters and state are then unchanged.
    pub fn step_rows(&mut self, params: &mut [T], grads: &[T], rows: &Rows<'_, T>) -> Result<(), OptimError> {
        rows.check(&self.group, params, grads, self.len)?;
        let width = rows.rates.len();
        if !self.state.row_steps.is_empty() {
            OptimError::length(&self.group, "row counts", self.state.row_steps.len(), self.len / width)?;
        }
        let Some(mean) = mean_square(&self.group, grads, rows)? else { return Ok(()) };
        self.state.observe(mean, self.config.beta2);
        if rows.touched.is_some() && self.state.row_steps.is_empty() {
            let taken = u32::try_from(self.state.step).unwrap_or(u32::MAX);
            self.state.row_steps = vec![taken; self.len / width];
        }
        self.state.step += 1;
        let step = self.constants();
        if self.state.m.is_empty() {
            self.memoryless(step, params, grads, rows);
        } else if self.state.row_steps.is_empty() {
            let correction = self.config.corrections(self.state.step).map(T::of);
            let chunk = rows.chunk();
            let state = self.state.m.par_chunks_mut(chunk).zip(self.state.v.par_chunks_mut(chunk));
            let chunks = params.par_chunks_mut(chunk).zip(grads.par_chunks(chunk)).zip(state);
            chunks.for_each(|((p, g), (m, v))| step.dense(p, m, v, g, rows.rates, correction));
        } else {
            self.apart(step, params, grads, rows);
        }
        Ok(())
    }

    fn constants(&self) -> Step<T> {
        let AdamConfig { beta1, beta2, relative_epsilon, .. } = self.config;
        let inverse_scale = self.state.inverse_scale();
        let rms = (self.state.mean_square * self.config.corrections(self.state.step)[1]).sqrt();
        Step {
            beta: [T::of(beta1), T::of(beta2)],
            rest: [T::of(1.0 - beta1), T::of(1.0 - beta2)],
            inverse_scale,
            epsilon: T::of(relative_epsilon * rms * inverse_scale.f64() + TINY),
            tiny: [T::of(TINY), T::of(TINY * TINY)],
        }
    }

    /// A step in which rows have their own counts.
    fn apart(&mut self, step: Step<T>, params: &mut [T], grads: &[T], rows: &Rows<'_, T>) {
        let wanted = (self.state.step as usize + 1).min(TABLE);
        for t in self.table.len()..wanted {
            self.table.push(self.config.corrections(t as u64).map(T::of));
        }
        let (chunk, width) = (rows.chunk(), rows.rates.len());
        let (table, config) = (&self.table, &self.config);
        let correction = |t: u32| {
            table.get(t as usize).copied().unwrap_or_else(|| config.corrections(u64::from(t)).map(T::of))
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

    fn memoryless(&self, step: Step<T>, params: &mut [T], grads: &[T], rows: &Rows<'_, T>) {
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
}

impl<T: Real> Optimizer<T> for Adam<T> {
    fn group(&self) -> &str {
        &self.group
    }

    fn step(&mut self, params: &mut [T], grads: &[T], rate: T) -> Result<(), OptimError> {
        let width = match self.state.row_steps.len() {
            0 => 1,
            rows => self.len / rows,
        };
        if width == 1 {
            return self.step_rows(params, grads, &Rows { rates: &[rate], touched: None });
        }
        self.step_rows(params, grads, &Rows { rates: &vec![rate; width], touched: None })
    }

    fn state(&self) -> &State<T> {
        &self.state
    }

    fn restore(&mut self, state: State<T>) -> Result<(), OptimError> {
        state.check(&self.group, &self.state)?;
        let rows = state.row_steps.len();
        if rows > 0 && !self.len.is_multiple_of(rows) {
            return OptimError::length(&self.group, "row counts", rows, self.len);
        }
        self.state = state;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
