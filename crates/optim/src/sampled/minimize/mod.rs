//! Minimisation with sampled derivatives: one driver that anneals sigma, several rules for the step.

mod adam;
mod cholesky;
mod newton;
mod newton_cg;
mod quasi_newton;
mod settings;
mod walk;

use std::ops::ControlFlow;

use super::error::SampledError;
use super::objective::{Objective, check_scales};
use crate::OptimError;
pub use settings::{Advance, Annealing, Curve, Method, Settings};
use walk::Walk;

/// Why a minimisation ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The annealing came to its end and the last step was below a twentieth of sigma, or lost in noise
    /// ([`Advance::Settled`]).
    Settled,
    /// [`Settings::iterations`].
    Iterations,
    /// [`Settings::evaluations`].
    Evaluations,
    /// The gradient stayed below [`Settings::signal_to_noise`] in the last stage.
    SignalToNoise,
    /// The samples of [`Settings::patience`] iterations on end all saw one and the same value: an exact plateau. Only
    /// a wider sigma or another start helps.
    NoInformation,
    /// The progress callback asked for it.
    Cancelled,
}

/// What is known after an iteration.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// Evaluations of the black box so far.
    pub evaluations: u64,
    /// Mean of the values that the gradient's samples saw, before the step: roughly the smoothed loss.
    pub loss: f64,
    /// Width of the smoothing.
    pub sigma: f64,
    /// Signal-to-noise ratio of the gradient, where known.
    pub signal_to_noise: Option<f64>,
    /// Length of the step in units of the scales.
    pub step: f64,
    /// The parameters after the step; empty unless [`Settings::keep_theta`].
    pub theta: Vec<f64>,
}

/// What the progress callback sees after each iteration.
#[derive(Clone, Copy, Debug)]
pub struct Progress<'a> {
    /// Iterations so far.
    pub iteration: usize,
    /// This iteration.
    pub record: &'a Record,
    /// The parameters after the step.
    pub theta: &'a [f64],
}

/// The result of a minimisation.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The parameters found.
    pub theta: Vec<f64>,
    /// Why it ended.
    pub stop: Stop,
    /// Evaluations of the black box spent by this call.
    pub evaluations: u64,
    /// One entry per iteration.
    pub history: Vec<Record>,
}

/// Minimises a smoothed objective from `start`, while sigma shrinks.
///
/// # Errors
/// [`SampledError`]: a failed evaluation, a value that is not finite, a wrong length, a setting out of range.
pub fn minimize<O: Objective>(
    objective: &mut O,
    start: &[f64],
    method: &Method,
    settings: &Settings,
) -> Result<Outcome, SampledError<O::Error>> {
    minimize_watched(objective, start, method, settings, |_| ControlFlow::Continue(()))
}

/// [`minimize`] with a callback after each iteration, which may end it.
///
/// # Errors
/// As [`minimize`].
pub fn minimize_watched<O: Objective>(
    objective: &mut O,
    start: &[f64],
    method: &Method,
    settings: &Settings,
    mut watch: impl FnMut(&Progress<'_>) -> ControlFlow<()>,
) -> Result<Outcome, SampledError<O::Error>> {
    settings.check()?;
    check_scales(objective.scales())?;
    OptimError::length(super::objective::GROUP, "start", start.len(), objective.scales().len())?;
    let before = objective.evaluations();
    let mut stepper = method.stepper(start.len())?;
    let mut walk = Walk::new(objective, start, settings);
    let mut history = Vec::new();
    let (mut in_stage, mut noisy, mut blind, mut faint) = (0, 0, 0, 0);
    let stop = loop {
        if history.len() >= settings.iterations {
            break Stop::Iterations;
        }
        if walk.objective.evaluations() - before >= settings.evaluations {
            break Stop::Evaluations;
        }
        let step = stepper.step(&mut walk)?;
        walk.iteration += 1;
        in_stage += 1;
        let record = Record {
            evaluations: walk.objective.evaluations() - before,
            loss: step.loss,
            sigma: walk.sigma,
            signal_to_noise: step.signal_to_noise,
            step: step.length,
            theta: if settings.keep_theta { walk.theta.clone() } else { Vec::new() },
        };
        let seen = Progress { iteration: walk.iteration, record: &record, theta: &walk.theta };
        let flow = watch(&seen);
        history.push(record);
        if flow.is_break() {
            break Stop::Cancelled;
        }
        blind = if step.informative { 0 } else { blind + 1 };
        if blind >= settings.patience {
            break Stop::NoInformation;
        }
        noisy = if step.signal_to_noise.is_some_and(|s| s < 1.0) { noisy + 1 } else { 0 };
        if !step.informative || noisy > 0 {
            // Other samples may see more.
            walk.sample_set += 1;
            stepper.restart();
        }
        let last = walk.stage + 1 >= settings.annealing.stages;
        if let Some(least) = settings.signal_to_noise {
            faint = if last && step.signal_to_noise.is_some_and(|s| s < least) { faint + 1 } else { 0 };
            if faint >= settings.patience {
                break Stop::SignalToNoise;
            }
        }
        let settled = matches!(settings.annealing.advance, Advance::Settled { .. });
        if step.informative && settings.annealing.is_over(in_stage, noisy, &step, walk.sigma, last) {
            if last && settled {
                break Stop::Settled;
            }
            if !last {
                walk.next_stage(settings);
                stepper.restart();
                (in_stage, noisy) = (0, 0);
            }
        }
    };
    let evaluations = walk.objective.evaluations() - before;
    Ok(Outcome { theta: walk.theta, stop, evaluations, history })
}
