//! Penalties of the splits and their defaults.

use photofit_scalar::Real;

use super::survey::Survey;
use super::{DataTerm, Problem};
use crate::DenoiseError;

/// How the linear step `(t0 + (t1+t3) L + t2 L^2) u = f` is taken. Both lead to the same optimum.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum LinearStep {
    /// The sweep where it needs about as many iterations as the exact step (no Hessian, no holes, `t1 + t3 <= 4 t0`),
    /// else the exact step.
    #[default]
    Auto,
    /// Solved by a Fourier transform along the rows and banded Cholesky factors down the columns.
    Exact,
    /// One symmetric red-black Gauss-Seidel sweep from the estimate (Bredies and Sun 2015): less than half of the time
    /// per iteration. Not with the Hessian.
    Sweep,
}

/// Penalties `t0..t3` of the splits and the over-relaxation `a`. They change the speed of convergence, not the optimum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Penalties {
    /// `t0`, of the data split.
    pub data: f64,
    /// `t1`, of the gradient.
    pub gradient: f64,
    /// `t2`, of the Hessian.
    pub hessian: f64,
    /// `t3`, of the guided gradient.
    pub guide: f64,
    /// `a` in (0, 2); 1 is none, 1.7 needs 2-3 times fewer iterations (Eckstein and Bertsekas 1992).
    pub relaxation: f64,
}

impl Penalties {
    /// Defaults in the units of the problem: scaling the target scales the iterates.
    ///
    /// `sigma` is [`contrast`] of the target; `t0` is the curvature of the data term, or for an absolute value
    /// twice its weight over `sigma`; the thresholds `alpha/t1`, `beta/t2`, `gamma/t3` are fractions of `sigma`.
    pub fn for_problem<T: Real>(problem: &Problem<'_, T>) -> Self {
        Self::at_contrast(problem, contrast(problem))
    }

    /// As [`Self::for_problem`] with a given scale `sigma > 0` of the target.
    pub fn at_contrast<T: Real>(problem: &Problem<'_, T>, sigma: f64) -> Self {
        let mean = |w: &Option<super::Weight<T>>| w.as_ref().map_or(0.0, super::Weight::mean);
        let guide = problem.guide.as_ref().map_or(0.0, |g| g.weight.mean());
        let (alpha, beta) = (mean(&problem.alpha), mean(&problem.beta));
        let data = match &problem.data {
            DataTerm::L2 { lambda } | DataTerm::Huber { lambda, .. } => lambda.mean(),
            DataTerm::L1 { lambda } => 2.0 * lambda.mean() / sigma,
            DataTerm::Hybrid { l1, l2 } => l2.mean() + 2.0 * l1.mean() / sigma,
        };
        let regularity = (alpha + beta + guide) / sigma;
        Self {
            // Without data anywhere the split only holds the estimate.
            data: if data > 0.0 {
                data
            } else if regularity > 0.0 {
                1e-2 * regularity
            } else {
                1.0
            },
            gradient: alpha / (THRESHOLDS[0] * sigma),
            hessian: beta / (THRESHOLDS[1] * sigma),
            guide: guide / (THRESHOLDS[2] * sigma),
            relaxation: 1.7,
        }
    }

    pub(crate) fn check(&self) -> Result<(), DenoiseError> {
        let positive = "finite and positive";
        let ok = |v: f64| v.is_finite() && v >= 0.0;
        DenoiseError::setting(
            "the penalty of the data",
            self.data,
            positive,
            ok(self.data) && self.data > 0.0,
        )?;
        for (name, value) in [
            ("the penalty of the gradient", self.gradient),
            ("the penalty of the Hessian", self.hessian),
            ("the penalty of the guide", self.guide),
        ] {
            DenoiseError::setting(name, value, "finite and not negative", ok(value))?;
        }
        let a = self.relaxation;
        DenoiseError::setting("the relaxation", a, "above 0 and below 2", a > 0.0 && a < 2.0)
    }
}

/// Thresholds of gradient, Hessian and guide as fractions of the contrast.
const THRESHOLDS: [f64; 3] = [0.33, 0.17, 0.17];

/// A scale of the target: its standard deviation over the samples that are read, about each channel's mean; 1 for
/// constant images.
pub fn contrast<T: Real>(problem: &Problem<'_, T>) -> f64 {
    Survey::new(problem).contrast
}
