//! Adam with one step length for the whole group.

use crate::adam::AdamConfig;
use crate::error::OptimError;
use crate::scan::{Rows, mean_square};
use crate::state::{Optimizer, State};
use photofit_scalar::Real;
use rayon::prelude::*;

/// Adam whose second moment is replaced by its largest entry over the group: `p -= rate m^ / max sqrt(v^)` (Nicolet et
/// al. 2021, "Large Steps in Inverse Rendering of Geometry").
///
/// Directions are kept, so it suits coordinates that belong together (vertex positions, above all behind
/// [`LargeSteps`](crate::LargeSteps)). No epsilon is needed: the denominator is zero only while all gradients have
/// been zero. Deterministic for any number of threads.
#[derive(Clone, Debug)]
pub struct UniformAdam<T> {
    group: String,
    config: AdamConfig,
    state: State<T>,
}

impl<T: Real> UniformAdam<T> {
    /// For a group of `len` parameters; `config.relative_epsilon` is not used.
    ///
    /// # Errors
    /// [`OptimError::Setting`] for settings outside their ranges.
    pub fn new(group: &str, len: usize, config: AdamConfig) -> Result<Self, OptimError> {
        config.check(group)?;
        Ok(Self { group: group.to_owned(), config, state: State::new(len, len) })
    }

    /// Takes `grads` into the moments and returns `factor` such that a step is `p -= rate * factor * m`, with `m` the
    /// first moments in [`State::m`]; for callers that filter `m` before moving. `None` for an empty group.
    ///
    /// # Errors
    /// [`OptimError::NonFiniteGradient`] or [`OptimError::Length`]; the state is then unchanged.
    pub fn accumulate(&mut self, grads: &[T]) -> Result<Option<T>, OptimError> {
        let rows = Rows { rates: &[T::one()], touched: None };
        rows.check(&self.group, grads, grads, self.state.m.len())?;
        let Some(mean) = mean_square(&self.group, grads, &rows)? else { return Ok(None) };
        self.state.observe(mean, self.config.beta2);
        self.state.step += 1;
        let inverse_scale = self.state.inverse_scale();
        let [b1, b2] = [self.config.beta1, self.config.beta2].map(T::of);
        let [r1, r2] = [1.0 - self.config.beta1, 1.0 - self.config.beta2].map(T::of);
        let chunk = rows.chunk();
        let state = self.state.m.par_chunks_mut(chunk).zip(self.state.v.par_chunks_mut(chunk));
        let largest: Vec<T> = state
            .zip(grads.par_chunks(chunk))
            .map(|((m, v), g)| {
                let mut largest = T::zero();
                for ((m, v), g) in m.iter_mut().zip(v).zip(g) {
                    let g = *g * inverse_scale;
                    *m = b1 * *m + r1 * g;
                    *v = b2 * *v + r2 * (g * g);
                    largest = if *v > largest { *v } else { largest };
                }
                largest
            })
            .collect();
        let largest = largest.into_iter().fold(T::zero(), T::max).f64();
        let [c1, c2] = self.config.corrections(self.state.step);
        let factor = if largest > 0.0 { c1 / (largest * c2).sqrt() } else { 0.0 };
        Ok(Some(T::of(factor)))
    }
}

impl<T: Real> Optimizer<T> for UniformAdam<T> {
    fn group(&self) -> &str {
        &self.group
    }

    fn step(&mut self, params: &mut [T], grads: &[T], rate: T) -> Result<(), OptimError> {
        let rows = Rows { rates: &[rate], touched: None };
        rows.check(&self.group, params, grads, self.state.m.len())?;
        let Some(factor) = self.accumulate(grads)? else { return Ok(()) };
        let (chunk, scale) = (rows.chunk(), rate * factor);
        params.par_chunks_mut(chunk).zip(self.state.m.par_chunks(chunk)).for_each(|(p, m)| {
            p.iter_mut().zip(m).for_each(|(p, m)| *p -= scale * *m);
        });
        Ok(())
    }

    fn state(&self) -> &State<T> {
        &self.state
    }

    fn restore(&mut self, state: State<T>) -> Result<(), OptimError> {
        state.check(&self.group, &self.state)?;
        self.state = state;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_gradcheck::Uniform;

    #[test]
    fn finds_the_optimum_of_a_quadratic_at_any_scale() {
        for scale in [1e-20_f32, 1.0, 1e20] {
            let mut x = [3.0_f32, -2.0, 0.5];
            let mut adam = UniformAdam::new("x", 3, AdamConfig::default()).unwrap();
            for t in 0..600 {
                let g = [x[0] - 1.0, x[1] - 1.0, x[2] - 1.0].map(|d| d * scale);
                adam.step(&mut x, &g, 0.1 * 0.99_f32.powi(t)).unwrap();
            }
            assert!(x.iter().all(|x| (x - 1.0).abs() < 1e-3), "scale {scale}: {x:?}");
        }
    }

    #[test]
    fn the_first_step_keeps_the_direction_and_has_the_rate_as_largest_component() {
        let mut x = [0.0_f64; 3];
        let mut adam = UniformAdam::new("x", 3, AdamConfig::default()).unwrap();
        adam.step(&mut x, &[1.0, -4.0, 2.0], 0.5).unwrap();
        for (x, expected) in x.iter().zip([-0.125, 0.5, -0.25]) {
            assert!((x - expected).abs() < 1e-12, "{x} against {expected}");
        }
        let mut still = [1.0_f32; 2];
        let mut adam = UniformAdam::new("still", 2, AdamConfig::default()).unwrap();
        adam.step(&mut still, &[0.0; 2], 0.5).unwrap();
        assert_eq!(still, [1.0; 2]);
    }

    #[test]
    fn the_temporal_bound_holds_for_the_global_maximum() {
        for b1 in [0.0, 0.2, 0.5, 0.9_f64] {
            let bound = ((2.0 - b1) / (2.0 * (1.0 - b1))).sqrt();
            let config = AdamConfig {
                beta1: b1,
                beta2: 1.0 - (1.0 - b1) * (1.0 - b1),
                bias_correction: false,
                ..AdamConfig::default()
            };
            let mut rng = Uniform::new(7);
            let mut adam = UniformAdam::new("x", 16, config).unwrap();
            for t in 0..200 {
                let g: Vec<f64> =
                    (0..16).map(|i| rng.range(-1.0, 1.0 + 0.1 * f64::from(i)).powi(1 + t % 5)).collect();
                let factor = adam.accumulate(&g).unwrap().unwrap();
                let largest = adam.state().m.iter().fold(0.0_f64, |s, m| s.max((m * factor).abs()));
                assert!(largest <= bound * (1.0 + 1e-12), "b1 {b1} step {t}: {largest} above {bound}");
            }
        }
    }

    #[test]
    fn bad_gradients_change_nothing() {
        let mut x = vec![1.0_f32; 40_000];
        let mut adam = UniformAdam::new("positions", x.len(), AdamConfig::default()).unwrap();
        let mut g = vec![0.5_f32; x.len()];
        adam.step(&mut x, &g, 0.1).unwrap();
        let (before, state) = (x.clone(), adam.state().clone());
        g[33_333] = f32::INFINITY;
        let error = adam.step(&mut x, &g, 0.1).unwrap_err();
        assert!(matches!(error, OptimError::NonFiniteGradient { index: 33_333, .. }), "{error}");
        assert_eq!((&x, adam.state()), (&before, &state));
    }

    #[test]
    fn a_restored_state_continues_to_the_same_bits() {
        let mut rng = Uniform::new(2);
        let gradients: Vec<Vec<f32>> =
            (0..20).map(|_| rng.vec(50, -1.0, 1.0).iter().map(|g| *g as f32).collect()).collect();
        let mut a = (vec![0.0_f32; 50], UniformAdam::new("a", 50, AdamConfig::default()).unwrap());
        gradients[..10].iter().for_each(|g| a.1.step(&mut a.0, g, 0.01).unwrap());
        let mut b = (a.0.clone(), UniformAdam::new("a", 50, AdamConfig::default()).unwrap());
        b.1.restore(a.1.state().clone()).unwrap();
        for g in &gradients[10..] {
            a.1.step(&mut a.0, g, 0.01).unwrap();
            b.1.step(&mut b.0, g, 0.01).unwrap();
        }
        assert_eq!((&a.0, a.1.state()), (&b.0, b.1.state()));
        assert!(b.1.restore(State::default()).is_err());
    }
}
