//! Where a minimisation stands, in units of the parameters' scales.

use super::settings::Settings;
use crate::sampled::error::SampledError;
use crate::sampled::estimate::{Estimate, Estimator, norm};
use crate::sampled::noise::hash;
use crate::sampled::objective::{Objective, SamplePoint, rescale};

/// The state that all methods share.
pub(crate) struct Walk<'a, O> {
    pub(crate) objective: &'a mut O,
    pub(crate) theta: Vec<f64>,
    pub(crate) scales: Vec<f64>,
    pub(crate) sigma: f64,
    pub(crate) sigma_start: f64,
    /// Longest step in sigmas.
    pub(crate) trust: f64,
    pub(crate) iteration: usize,
    pub(crate) stage: usize,
    /// Number of the sample set of those methods that keep one.
    pub(crate) sample_set: u64,
    gradient: Estimator,
    curvature: Estimator,
    /// Samples of a gradient now and at most; see [`Self::sure_gradient`].
    pub(crate) samples: usize,
    most_samples: usize,
    seed: u64,
}

/// Noise that moves a step by less than this, in sigmas and per root of the number of parameters, does no harm.
const HARMLESS: f64 = 0.25;

/// Signal-to-noise ratio from which on a gradient is believed: 1, and more where few samples had to tell the noise.
fn sure(samples: usize) -> f64 {
    1.0 + 1.0 / (samples as f64 - 1.0)
}

/// What one step did.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Step {
    pub(crate) loss: f64,
    pub(crate) signal_to_noise: Option<f64>,
    /// In units of the scales.
    pub(crate) length: f64,
    /// What the length would have been without a limit.
    pub(crate) wanted: f64,
    pub(crate) informative: bool,
}

impl Step {
    /// A step on this gradient: its length, and the length without limit.
    pub(crate) fn of(gradient: &Estimate, [length, wanted]: [f64; 2]) -> Self {
        let Estimate { mean, informative, .. } = *gradient;
        Self { loss: mean, signal_to_noise: gradient.signal_to_noise(), length, wanted, informative }
    }
}

/// A rule for the step.
pub(crate) trait Stepper<O: Objective> {
    /// Estimates what it needs and moves.
    fn step(&mut self, walk: &mut Walk<'_, O>) -> Result<Step, SampledError<O::Error>>;

    /// Sigma or the sample set changed: nothing seen before compares with what comes.
    fn restart(&mut self);
}

impl<'a, O: Objective> Walk<'a, O> {
    pub(crate) fn new(objective: &'a mut O, start: &[f64], settings: &Settings) -> Self {
        let sigma = settings.annealing.sigma(0);
        Self {
            theta: start.to_vec(),
            scales: objective.scales().to_vec(),
            objective,
            sigma,
            sigma_start: sigma,
            trust: settings.trust,
            iteration: 0,
            stage: 0,
            sample_set: 0,
            gradient: settings.gradient,
            curvature: settings.curvature,
            samples: settings.gradient.samples,
            most_samples: settings.most_samples.max(settings.gradient.samples),
            seed: settings.seed,
        }
    }

    pub(crate) fn next_stage(&mut self, settings: &Settings) {
        self.stage += 1;
        self.sample_set += 1;
        self.sigma = settings.annealing.sigma(self.stage);
        self.samples = (self.samples / 2).max(self.gradient.samples);
    }

    /// The gradient by sample set `set`, per unit of the scales.
    pub(crate) fn gradient(&mut self, set: u64) -> Result<Estimate, SampledError<O::Error>> {
        let at = SamplePoint { theta: &self.theta, sigma: self.sigma, seed: hash(self.seed, set) };
        let estimate = self.objective.gradient(at, Estimator { samples: self.samples, ..self.gradient })?;
        Ok(rescale(estimate, |i| self.scales[i]))
    }

    /// The gradient, with as many more samples as it takes to tell it from noise, within the limit. `wanted` is the length
    /// of the step that it asks for, where that is known: noise that hardly moves the step is let pass, above all at a
    /// minimum. Whether the samples are others than before.
    pub(crate) fn sure_gradient(
        &mut self,
        set: u64,
        wanted: impl Fn(&Estimate) -> Option<f64>,
    ) -> Result<(Estimate, bool), SampledError<O::Error>> {
        let before = self.samples;
        let harmless = HARMLESS * (self.theta.len() as f64).sqrt() * self.sigma;
        loop {
            let gradient = self.gradient(set)?;
            let doubtful = gradient.signal_to_noise().is_some_and(|ratio| {
                ratio < sure(self.samples) && wanted(&gradient).is_none_or(|w| w > harmless * ratio)
            });
            if !doubtful && gradient.informative || 2 * self.samples > self.most_samples {
                return Ok((gradient, self.samples != before));
            }
            self.samples *= 2;
        }
    }

    /// The Hessian by sample set `set`, per unit of the scales.
    pub(crate) fn hessian(&mut self, set: u64) -> Result<Estimate, SampledError<O::Error>> {
        let at = SamplePoint { theta: &self.theta, sigma: self.sigma, seed: hash(!self.seed, set) };
        let estimate = self.objective.hessian(at, self.curvature)?;
        let n = self.scales.len();
        Ok(rescale(estimate, |e| self.scales[e / n] * self.scales[e % n]))
    }

    /// `d^T H d` for a direction in units of the scales.
    pub(crate) fn curvature(
        &mut self,
        set: u64,
        direction: &[f64],
    ) -> Result<Estimate, SampledError<O::Error>> {
        let direction: Vec<f64> = direction.iter().zip(&self.scales).map(|(d, s)| d * s).collect();
        let at = SamplePoint { theta: &self.theta, sigma: self.sigma, seed: hash(!self.seed, set) };
        self.objective.curvature(at, &direction, self.curvature)
    }

    /// Moves along `direction` (in units of the scales), shortened to at most `limit`; the length of the step
    /// and the direction's.
    pub(crate) fn advance(&mut self, direction: &[f64], limit: f64) -> [f64; 2] {
        let length = norm(direction);
        if length == 0.0 || !length.is_finite() {
            return [0.0, length];
        }
        let factor = (limit / length).min(1.0);
        for ((x, d), s) in self.theta.iter_mut().zip(direction).zip(&self.scales) {
            *x += factor * d * s;
        }
        [factor * length, length]
    }
}

pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
