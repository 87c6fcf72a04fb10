//! What a minimisation is told.

use super::adam::AdamSteps;
use super::newton::NewtonSteps;
use super::newton_cg::ConjugateSteps;
use super::quasi_newton::{Memory, QuasiNewtonSteps};
use super::walk::{Step, Stepper};
use crate::OptimError;
use crate::Temporal;
use crate::sampled::error::SampledError;
use crate::sampled::estimate::{Estimator, Kernel, Stencil};
use crate::sampled::objective::{GROUP, Objective, positive};

/// A stage is over when a step wants to be shorter than this, in sigmas: the next stage will move on.
const EARLY: f64 = 0.25;

/// The same for the last stage.
const LATE: f64 = 0.05;

/// Largest number of parameters for [`Method::Newton`]: its Hessian costs `2 n (n + 1)` evaluations per sample.
const NEWTON: usize = 10;

/// Largest number of parameters for [`Method::Bfgs`], which stores an `n x n` matrix.
const BFGS: usize = 2048;

/// Settings of all methods.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// How sigma shrinks.
    pub annealing: Annealing,
    /// Samples of a gradient.
    pub gradient: Estimator,
    /// Most samples of a gradient: all methods but [`Method::Adam`] double the samples of [`Self::gradient`] while the
    /// gradient is lost in noise that would move the step by a quarter of sigma (times the root of the number of
    /// parameters), and halve them again from stage to stage.
    pub most_samples: usize,
    /// Samples of a curvature or a Hessian, for the methods that ask for one.
    pub curvature: Estimator,
    /// Longest step, in units of sigma (and of the parameters' scales): what lies further away was not seen.
    /// [`Method::Adam`] takes no notice of it.
    pub trust: f64,
    /// Most iterations.
    pub iterations: usize,
    /// Evaluations after which no iteration is begun.
    pub evaluations: u64,
    /// Stops when the gradient's signal-to-noise ratio stays below this in the last stage, for [`Self::patience`]
    /// iterations on end.
    pub signal_to_noise: Option<f64>,
    /// Iterations on end without any information, or below [`Self::signal_to_noise`], before giving up.
    pub patience: usize,
    /// Determines all samples.
    pub seed: u64,
    /// Whether the history holds the parameters of each iteration.
    pub keep_theta: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            annealing: Annealing::default(),
            gradient: Estimator {
                stencil: Stencil::FourPoint,
                samples: 2,
                kernel: Kernel::Coordinates,
                stratified: true,
            },
            most_samples: 8,
            curvature: Estimator {
                stencil: Stencil::FourPoint,
                samples: 2,
                kernel: Kernel::Coordinates,
                stratified: true,
            },
            trust: 1.0,
            iterations: 1000,
            evaluations: u64::MAX,
            signal_to_noise: None,
            patience: 5,
            seed: 0,
            keep_theta: false,
        }
    }
}

impl Settings {
    pub(crate) fn check(&self) -> Result<(), OptimError> {
        let Annealing { start, end, stages, advance, .. } = self.annealing;
        positive("first sigma", start)?;
        positive("last sigma", end)?;
        positive("trust", self.trust)?;
        let at_least_one = [
            ("annealing stages", stages),
            ("patience", self.patience),
            ("iterations of a stage", advance.at_most()),
            ("samples", self.gradient.samples.min(self.curvature.samples)),
        ];
        at_least_one
            .iter()
            .try_for_each(|(name, n)| OptimError::setting(GROUP, name, *n as f64, "at least 1", *n >= 1))
    }
}

/// The course of sigma: constant in each of a number of stages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Annealing {
    /// Sigma of the first stage.
    pub start: f64,
    /// Sigma of the last stage.
    pub end: f64,
    /// Number of stages.
    pub stages: usize,
    /// How sigma runs from the first to the last.
    pub curve: Curve,
    /// When a stage ends.
    pub advance: Advance,
}

/// How sigma runs over the stages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Curve {
    /// By a constant difference.
    Linear,
    /// By a constant factor.
    Geometric,
}

/// When a stage of the annealing ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Advance {
    /// After so many iterations.
    Every(usize),
    /// When a step wants to be below a quarter of sigma (in the last stage a twentieth), or when two gradients on end, of different samples, were lost in
    /// noise; at the latest after so many iterations.
    Settled {
        /// Most iterations of a stage.
        at_most: usize,
    },
}

impl Advance {
    fn at_most(self) -> usize {
        match self {
            Self::Every(n) | Self::Settled { at_most: n } => n,
        }
    }
}

impl Default for Annealing {
    fn default() -> Self {
        let advance = Advance::Settled { at_most: 30 };
        Self { start: 1.0, end: 0.01, stages: 5, curve: Curve::Geometric, advance }
    }
}

impl Annealing {
    /// Sigma falls linearly at each of `iterations`, as in Wang et al. (2025).
    pub fn linear(start: f64, end: f64, iterations: usize) -> Self {
        Self { start, end, stages: iterations, curve: Curve::Linear, advance: Advance::Every(1) }
    }

    /// Sigma falls by a constant factor over `stages`, each of which lasts until the steps get small.
    pub fn settled(start: f64, end: f64, stages: usize) -> Self {
        Self { start, end, stages, ..Self::default() }
    }

    /// Sigma of a stage.
    pub fn sigma(&self, stage: usize) -> f64 {
        let x = if self.stages > 1 { stage as f64 / (self.stages - 1) as f64 } else { 0.0 };
        match self.curve {
            Curve::Linear => self.start + x.min(1.0) * (self.end - self.start),
            Curve::Geometric => self.start * (self.end / self.start).powf(x.min(1.0)),
        }
    }

    /// Whether a stage ends, after `in_stage` iterations of which the last `noisy` on end were lost in noise.
    pub(crate) fn is_over(&self, in_stage: usize, noisy: usize, step: &Step, sigma: f64, last: bool) -> bool {
        let share = if last { LATE } else { EARLY };
        match self.advance {
            Advance::Every(n) => in_stage >= n,
            Advance::Settled { at_most } => in_stage >= at_most || noisy >= 2 || step.wanted < share * sigma,
        }
    }
}

/// The rule for the step.
#[derive(Clone, Debug, PartialEq)]
pub enum Method {
    /// [Adam](crate::Temporal::adam) on the gradient, fresh samples at each step, the rate proportional to sigma.
    Adam {
        /// Learning rate at the first sigma, in units of the scales.
        rate: f64,
        /// Decay of the moments.
        config: Temporal,
    },
    /// Nonlinear conjugate gradients with the step from the sampled curvature along the direction, to the trust
    /// region's boundary where that is not positive (Wang et al. 2025). Polak and Ribiere's beta in [0, 1]; the gradients
    /// between two restarts have common random numbers.
    NewtonCg {
        /// Steps between restarts with new samples.
        restart: usize,
    },
    /// Limited-memory BFGS (Nocedal 1980): two-loop recursion, pairs with s.y <= 0 skipped, all pairs of one sample
    /// set, steps at most `sigma min(trust, signal-to-noise / 2)`. The sample set changes with sigma.
    LBfgs {
        /// Pairs remembered.
        memory: usize,
    },
    /// BFGS with Powell's damping (1978): the matrix stays positive definite where the objective is not. Otherwise as
    /// [`Self::LBfgs`]; at most 2048 parameters.
    Bfgs,
    /// Newton's method on the full sampled Hessian, made positive definite by a modified Cholesky factorisation (Gill,
    /// Murray and Wright 1981); at most 10 parameters.
    Newton,
}

impl Method {
    /// [`Method::Adam`] at `rate` with beta2 = 0.99: sigma's annealing is shorter than the customary memory of 1000
    /// steps.
    pub fn adam(rate: f64) -> Self {
        Self::Adam { rate, config: Temporal { beta2: 0.99, ..Temporal::adam() } }
    }

    /// [`Method::LBfgs`] with a memory of 8.
    pub fn l_bfgs() -> Self {
        Self::LBfgs { memory: 8 }
    }

    pub(crate) fn stepper<O: Objective>(
        &self,
        n: usize,
    ) -> Result<Box<dyn Stepper<O>>, SampledError<O::Error>> {
        let limit = |most: usize| {
            OptimError::setting(
                GROUP,
                "number of parameters",
                n as f64,
                "within the method's limit",
                n <= most,
            )
        };
        Ok(match self {
            Self::Adam { rate, config } => Box::new(AdamSteps::new(n, *rate, *config)?),
            Self::NewtonCg { restart } => {
                OptimError::setting(GROUP, "restart", 0.0, "at least 1", *restart > 0)?;
                Box::new(ConjugateSteps::new(*restart))
            }
            Self::LBfgs { memory } => {
                OptimError::setting(GROUP, "memory", 0.0, "at least 1", *memory > 0)?;
                Box::new(QuasiNewtonSteps::new(Memory::limited(*memory)))
            }
            Self::Bfgs => {
                limit(BFGS)?;
                Box::new(QuasiNewtonSteps::new(Memory::dense(n)))
            }
            Self::Newton => {
                limit(NEWTON)?;
                Box::new(NewtonSteps)
            }
        })
    }
}
