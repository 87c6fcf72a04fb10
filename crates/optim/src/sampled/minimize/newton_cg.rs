//! Conjugate gradients with sampled curvature along the direction.

use super::walk::{Step, Stepper, Walk, dot};
use crate::sampled::error::SampledError;
use crate::sampled::estimate::norm;
use crate::sampled::objective::Objective;

/// The last step, while it compares with the next.
#[derive(Debug)]
pub(crate) struct ConjugateSteps {
    restart: usize,
    since: usize,
    last: Option<LastStep>,
}

/// Direction and gradient in units of the gradient's length, and that length: squares of 1e-200 would be zero.
#[derive(Debug)]
struct LastStep {
    direction: Vec<f64>,
    gradient: Vec<f64>,
    size: f64,
    /// Step length that the curvature asked for.
    reach: f64,
}

impl ConjugateSteps {
    pub(crate) fn new(restart: usize) -> Self {
        Self { restart, since: 0, last: None }
    }

    /// `-g`, plus the last direction by Polak and Ribiere's beta where that leads downhill; `g` is a unit vector of true
    /// length `size`, and so is the result's unit.
    fn direction(&self, g: &[f64], size: f64) -> Vec<f64> {
        let steepest: Vec<f64> = g.iter().map(|g| -g).collect();
        let Some(last) = &self.last else { return steepest };
        let ratio = size / last.size;
        let beta = (ratio * (ratio - dot(g, &last.gradient))).clamp(0.0, 1.0);
        let old = last.direction.iter().map(|d| beta / ratio * d);
        let direction: Vec<f64> = steepest.iter().zip(old).map(|(s, d)| s + d).collect();
        if beta > 0.0 && dot(&direction, g) < 0.0 { direction } else { steepest }
    }
}

impl<O: Objective> Stepper<O> for ConjugateSteps {
    fn step(&mut self, walk: &mut Walk<'_, O>) -> Result<Step, SampledError<O::Error>> {
        if self.since >= self.restart {
            walk.sample_set += 1;
            <Self as Stepper<O>>::restart(self);
        }
        let set = walk.sample_set;
        let scale = self.last.as_ref().map(|l| l.reach / l.size);
        let (gradient, resampled) = walk.sure_gradient(set, |g| scale.map(|s| s * norm(&g.value)))?;
        if resampled {
            <Self as Stepper<O>>::restart(self);
        }
        let size = norm(&gradient.value);
        if !gradient.informative || size == 0.0 {
            return Ok(Step::of(&gradient, [0.0; 2]));
        }
        let g: Vec<f64> = gradient.value.iter().map(|g| g / size).collect();
        let mut d = self.direction(&g, size);
        let limit = walk.trust * walk.sigma;
        let along = dot(&d, &g);
        let curvature = walk.curvature(set, &d)?.value[0] / size;
        let boundary = limit / norm(&d);
        // Not positive: downhill without a minimum in sight, hence to the boundary; never divide by it.
        let alpha = if curvature > 0.0 { -along / curvature } else { boundary };
        self.last = Some(LastStep { reach: alpha * norm(&d), direction: d.clone(), gradient: g, size });
        self.since += 1;
        d.iter_mut().for_each(|d| *d *= alpha);
        let length = walk.advance(&d, limit);
        Ok(Step::of(&gradient, length))
    }

    fn restart(&mut self) {
        self.last = None;
        self.since = 0;
    }
}
