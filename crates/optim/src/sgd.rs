//! Stochastic gradient descent with momentum.

use crate::error::OptimError;
use crate::scan::{Rows, mean_square};
use crate::state::{Optimizer, State};
use photofit_scalar::Real;
use rayon::prelude::*;

/// Gradient descent `m = momentum m + g`, `p -= rate m` (heavy ball; Polyak 1964).
///
/// ```
/// use photofit_optim::{Optimizer, Sgd};
/// let mut x = [4.0_f64];
/// let mut sgd = Sgd::new("x", 1, 0.0)?;
/// for _ in 0..50 {
///     let gradient = [2.0 * x[0]];
///     sgd.step(&mut x, &gradient, 0.2)?;
/// }
/// assert!(x[0].abs() < 1e-9);
/// # Ok::<(), photofit_optim::OptimError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Sgd<T> {
    group: String,
    len: usize,
    momentum: T,
    state: State<T>,
}

impl<T: Real> Sgd<T> {
    /// For a group of `len` parameters; `momentum` in `[0, 1)`, zero needs no memory.
    ///
    /// # Errors
    /// [`OptimError::Setting`] for a momentum outside its range.
    pub fn new(group: &str, len: usize, momentum: f64) -> Result<Self, OptimError> {
        OptimError::setting(group, "momentum", momentum, "in [0, 1)", (0.0..1.0).contains(&momentum))?;
        let memory = if momentum > 0.0 { len } else { 0 };
        Ok(Self { group: group.to_owned(), len, momentum: T::of(momentum), state: State::new(memory, 0) })
    }
}

impl<T: Real> Optimizer<T> for Sgd<T> {
    fn group(&self) -> &str {
        &self.group
    }

    fn step(&mut self, params: &mut [T], grads: &[T], rate: T) -> Result<(), OptimError> {
        let rows = Rows { rates: &[rate], touched: None };
        rows.check(&self.group, params, grads, self.len)?;
        if mean_square(&self.group, grads, &rows)?.is_none() {
            return Ok(());
        }
        self.state.step += 1;
        let (chunk, momentum) = (rows.chunk(), self.momentum);
        let chunks = params.par_chunks_mut(chunk).zip(grads.par_chunks(chunk));
        if self.state.m.is_empty() {
            chunks.for_each(|(p, g)| p.iter_mut().zip(g).for_each(|(p, g)| *p -= rate * *g));
        } else {
            chunks.zip(self.state.m.par_chunks_mut(chunk)).for_each(|((p, g), m)| {
                for ((p, g), m) in p.iter_mut().zip(g).zip(m) {
                    *m = momentum * *m + *g;
                    *p -= rate * *m;
                }
            });
        }
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

    #[test]
    fn momentum_finds_the_optimum_of_an_ill_conditioned_quadratic() {
        let scales = [1.0, 0.05];
        for (momentum, limit) in [(0.0, 0.5), (0.9, 1e-4)] {
            let mut x = [3.0_f64, -2.0];
            let mut sgd = Sgd::new("x", 2, momentum).unwrap();
            for _ in 0..300 {
                let g = [scales[0] * (x[0] - 1.0), scales[1] * (x[1] - 2.0)];
                sgd.step(&mut x, &g, 0.1).unwrap();
            }
            let error = (x[0] - 1.0).abs().max((x[1] - 2.0).abs());
            assert!(error < limit * 4.0, "momentum {momentum}: {error}");
            // The comparison must be able to fail: without momentum the flat direction is far from done.
            assert!(momentum > 0.0 || error > 0.1, "{error}");
        }
    }

    #[test]
    fn bad_gradients_and_settings_are_refused() {
        let mut x = [1.0_f32, 2.0];
        let mut sgd = Sgd::new("colour", 2, 0.5).unwrap();
        let error = sgd.step(&mut x, &[0.0, f32::NAN], 0.1).unwrap_err();
        assert_eq!(error.to_string(), "gradient 1 of parameter group `colour` is NaN");
        assert_eq!((x, sgd.state().step), ([1.0, 2.0], 0));
        assert!(sgd.step(&mut x, &[0.0, 0.0], f32::NAN).is_err());
        assert!(sgd.step(&mut x, &[0.0], 0.1).is_err());
        assert!(Sgd::<f32>::new("x", 1, 1.0).is_err());
    }
}
