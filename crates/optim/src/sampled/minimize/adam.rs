//! Adam on sampled gradients.

use super::walk::{Step, Stepper, Walk};
use crate::sampled::error::SampledError;
use crate::sampled::estimate::norm;
use crate::sampled::objective::{GROUP, Objective, positive};
use crate::{OptimError, Optimizer, Temporal};

/// Fresh samples at each step; the rate follows sigma, so that the steps shrink with what the samples can tell apart.
#[derive(Debug)]
pub(crate) struct AdamSteps {
    adam: Optimizer<f64>,
    rate: f64,
    /// Size of the first gradient, which Adam's steps do not depend on: squares of 1e-170 would vanish.
    unit: f64,
}

impl AdamSteps {
    pub(crate) fn new(n: usize, rate: f64, config: Temporal) -> Result<Self, OptimError> {
        positive("learning rate", rate)?;
        Ok(Self { adam: Optimizer::new(GROUP, n, config)?, rate, unit: 0.0 })
    }
}

impl<O: Objective> Stepper<O> for AdamSteps {
    fn step(&mut self, walk: &mut Walk<'_, O>) -> Result<Step, SampledError<O::Error>> {
        let gradient = walk.gradient(walk.iteration as u64)?;
        if !gradient.informative {
            return Ok(Step::of(&gradient, [0.0; 2]));
        }
        if self.unit == 0.0 {
            self.unit = norm(&gradient.value);
        }
        if self.unit == 0.0 {
            return Ok(Step::of(&gradient, [0.0; 2]));
        }
        let g: Vec<f64> = gradient.value.iter().map(|g| g / self.unit).collect();
        let mut step = vec![0.0; g.len()];
        self.adam.step(&mut step, &g, self.rate * walk.sigma / walk.sigma_start)?;
        let length = walk.advance(&step, f64::INFINITY);
        Ok(Step::of(&gradient, length))
    }

    /// The moments go on: Adam compares no two gradients.
    fn restart(&mut self) {}
}
