//! The accelerated primal-dual method for ROF.

use photofit_scalar::Real;

use super::layout::range;
use super::saddle::{DualMap, Saddle, Steps};
use super::{Gap, rof_gap};
use crate::DenoiseError;
use crate::admm::{DataTerm, Problem, Weight};

/// Accelerated Chambolle-Pock (Chambolle and Pock 2011) for `lambda/2 (u-u0)^2 + alpha |grad u|`, `lambda > 0` everywhere:
/// the energy falls as 1/k^2.
///
/// ```
/// use photofit_denoise::{Shape, models, primal_dual::ChambollePock};
/// let noisy: Vec<f64> = (0..256).map(|k| if k % 3 == 0 { 0.2 } else { 0.4 }).collect();
/// let problem = models::rof(Shape::new(16, 16, 1), &noisy, 5.0);
/// let mut solver = ChambollePock::new(&problem)?;
/// let gap = solver.solve(1e-4, 500);
/// assert!(gap.relative() <= 1e-4);
/// # Ok::<(), photofit_denoise::DenoiseError>(())
/// ```
#[derive(Clone, Debug)]
pub struct ChambollePock<'a, T> {
    problem: Problem<'a, T>,
    saddle: Saddle<T>,
    steps: Steps,
    convexity: f64,
}

impl<'a, T: Real> ChambollePock<'a, T> {
    /// Starts at the target.
    ///
    /// # Errors
    /// If the problem does not pass its check, or is not a quadratic data term without holes plus total variation.
    pub fn new(problem: &Problem<'a, T>) -> Result<Self, DenoiseError> {
        problem.check()?;
        let lambda = lambda(problem)?;
        let [low, _] = range(lambda, problem.shape);
        DenoiseError::setting("lambda", low, "positive everywhere for this method", low > 0.0)?;
        let tau = 1.0 / low;
        Ok(Self {
            saddle: Saddle::new(problem.shape, problem.coupling, problem.target),
            steps: Steps { sigma: 0.125 / tau, tau, theta: 1.0 / (1.0 + 2.0 * low * tau).sqrt() },
            convexity: low,
            problem: problem.clone(),
        })
    }

    /// One iteration.
    pub fn step(&mut self) {
        if let (Ok(lambda), Some(alpha)) = (lambda(&self.problem), &self.problem.alpha) {
            let Steps { sigma, tau, .. } = self.steps;
            let theta = 1.0 / (1.0 + 2.0 * self.convexity * tau).sqrt();
            self.saddle.step(DualMap::Ball(alpha), lambda, Steps { sigma, tau, theta });
            self.steps = Steps { sigma: sigma / theta, tau: tau * theta, theta };
        }
    }

    /// Iterates until the relative gap is at most `gap`, looked at every tenth iteration, or `limit` iterations.
    pub fn solve(&mut self, gap: f64, limit: usize) -> Gap {
        for k in 1..=limit {
            self.step();
            if k % 10 == 0 && self.gap().relative() <= gap {
                break;
            }
        }
        self.gap()
    }

    /// The estimate.
    pub fn solution(&self) -> Vec<T> {
        self.saddle.solution()
    }

    /// The energy of the estimate and the lower bound of the dual variable.
    pub fn gap(&self) -> Gap {
        rof_gap(&self.problem, &self.solution(), &self.saddle.dual())
    }
}

/// The weight of the square, if the problem is ROF.
fn lambda<'p, T: Real>(problem: &'p Problem<'_, T>) -> Result<&'p Weight<T>, DenoiseError> {
    let only = problem.alpha.is_some() && problem.beta.is_none() && problem.guide.is_none();
    DenoiseError::setting("the number of regularisers", f64::from(!only), "total variation alone", only)?;
    match &problem.data {
        DataTerm::L2 { lambda } => Ok(lambda),
        _ => Err(DenoiseError::Setting { setting: "the data term", value: 1.0, rule: "quadratic" }),
    }
}
