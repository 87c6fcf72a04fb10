//! Newton's method on the full sampled Hessian.

use super::cholesky::ModifiedCholesky;
use super::walk::{Step, Stepper, Walk};
use crate::sampled::error::SampledError;
use crate::sampled::estimate::norm;
use crate::sampled::objective::Objective;

/// Fresh samples at each step.
#[derive(Debug)]
pub(crate) struct NewtonSteps;

impl<O: Objective> Stepper<O> for NewtonSteps {
    fn step(&mut self, walk: &mut Walk<'_, O>) -> Result<Step, SampledError<O::Error>> {
        let set = walk.iteration as u64;
        let (gradient, _) = walk.sure_gradient(set, |_| None)?;
        let size = norm(&gradient.value);
        if !gradient.informative || size == 0.0 {
            return Ok(Step::of(&gradient, [0.0; 2]));
        }
        let hessian = walk.hessian(set)?;
        let reach = gradient.signal_to_noise().map_or(walk.trust, |s| walk.trust.min(0.5 * s));
        let limit = walk.sigma * reach;
        // Curvatures below the one that leads to the boundary, or below their own noise, count as that.
        let n = gradient.value.len();
        let noise = (0..n).map(|i| hessian.standard_error(i * n + i) / size).fold(0.0, f64::max);
        let least = (1.0 / limit).max(noise);
        let h: Vec<f64> = hessian.value.iter().map(|h| h / size).collect();
        let g: Vec<f64> = gradient.value.iter().map(|g| g / size).collect();
        let mut d = ModifiedCholesky::new(h, n, least).solve(g);
        d.iter_mut().for_each(|d| *d = -*d);
        let length = walk.advance(&d, limit);
        Ok(Step::of(&gradient, length))
    }

    fn restart(&mut self) {}
}
