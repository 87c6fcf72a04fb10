//! One method on one task: error of the parameters against iterations, evaluations and time.

use std::ops::ControlFlow;
use std::time::Instant;

use anyhow::Result;
use photofit_optim::sampled::{Annealing, Batch, BlackBox, Method, Settings, SmoothedLoss, minimize_watched};

use super::baselines::{evolution, finite_differences};
use super::tasks::Task;

/// A run is over when this share of the parameters' error is left.
pub(super) const DONE: f64 = 0.01;

/// Evaluations, seconds and share of the error that is left, per iteration.
#[derive(Clone, Debug)]
pub(super) struct Trace {
    pub(super) points: Vec<(u64, f64, f64)>,
    first: f64,
    target: Vec<f64>,
    start: Instant,
}

impl Trace {
    pub(super) fn begin(task: &Task, start: &[f64]) -> Self {
        let first = task.error(start);
        Self { points: Vec::new(), first, target: task.target.clone(), start: Instant::now() }
    }

    /// Records an iteration; whether the run is over.
    pub(super) fn see(&mut self, evaluations: u64, theta: &[f64]) -> bool {
        let square: f64 = theta.iter().zip(&self.target).map(|(a, b)| (a - b).powi(2)).sum();
        let left = square.sqrt() / self.first;
        self.points.push((evaluations, self.start.elapsed().as_secs_f64(), left));
        left <= DONE
    }

    /// Evaluations and seconds to 1% of the error.
    pub(super) fn done(&self) -> Option<(u64, f64)> {
        self.points.iter().find(|p| p.2 <= DONE).map(|p| (p.0, p.1))
    }

    /// Seconds of the whole run.
    pub(super) fn seconds(&self) -> f64 {
        self.points.last().map_or(0.0, |p| p.1)
    }

    /// The least share of the error that was left.
    pub(super) fn best(&self) -> f64 {
        self.points.iter().map(|p| p.2).fold(1.0, f64::min)
    }
}

/// The values of a task.
struct Values<'a>(&'a Task);

impl BlackBox for Values<'_> {
    type Error = std::convert::Infallible;

    fn evaluate(&mut self, batch: &Batch<'_>, values: &mut [f64]) -> Result<(), Self::Error> {
        self.0.values(batch, values);
        Ok(())
    }
}

/// A method with its settings.
pub(super) struct Entry {
    pub(super) name: &'static str,
    /// Most parameters.
    pub(super) most: usize,
    pub(super) run: fn(&Task, u64) -> Result<Trace>,
}

/// Runs a sampled method to 1% of the error or to the task's budget.
pub(super) fn sampled(task: &Task, seed: u64, method: &Method, settings: &Settings) -> Result<Trace> {
    let start = (task.start)(seed);
    let mut trace = Trace::begin(task, &start);
    let mut objective = SmoothedLoss::new(Values(task), task.dimension())?;
    let settings = Settings { seed, evaluations: task.budget, iterations: usize::MAX, ..settings.clone() };
    minimize_watched(&mut objective, &start, method, &settings, |now| {
        if trace.see(now.record.evaluations, now.theta) {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    })?;
    Ok(trace)
}

/// Runs a sampled method with the default settings between the task's sigmas.
fn settled(task: &Task, seed: u64, method: &Method) -> Result<Trace> {
    let [start, end] = task.sigma;
    let annealing = Annealing { start, end, ..Annealing::default() };
    sampled(task, seed, method, &Settings { annealing, ..task.settings() })
}

/// Adam, sigma falling linearly.
fn adam(task: &Task, seed: u64) -> Result<Trace> {
    let [start, end] = task.sigma;
    let (iterations, gradient) = task.adam;
    let annealing = Annealing::linear(start, end, iterations);
    sampled(task, seed, &Method::adam(task.rate), &Settings { annealing, gradient, ..Settings::default() })
}

/// The methods, each with the largest number of parameters for which it is run.
pub(super) const METHODS: [Entry; 7] = [
    Entry { name: "differences, Adam", most: 16, run: finite_differences },
    Entry { name: "sampled, Adam", most: usize::MAX, run: adam },
    Entry {
        name: "sampled, Newton-CG",
        most: usize::MAX,
        run: |t, s| settled(t, s, &Method::NewtonCg { restart: 5 }),
    },
    Entry { name: "sampled, L-BFGS", most: usize::MAX, run: |t, s| settled(t, s, &Method::l_bfgs()) },
    Entry { name: "sampled, BFGS", most: 16, run: |t, s| settled(t, s, &Method::Bfgs) },
    Entry { name: "sampled, Newton", most: 10, run: |t, s| settled(t, s, &Method::Newton) },
    Entry { name: "CMA-ES", most: 16, run: |t, s| Ok(evolution(t, s)) },
];
