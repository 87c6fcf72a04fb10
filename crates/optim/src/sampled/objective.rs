//! The smoothed objective: what the optimizers ask for, and its form for a loss known by values.

use super::black_box::BlackBox;
use super::directional::{Curvature, Product, axis};
use super::error::SampledError;
use super::estimate::{Estimate, Estimator, Evaluator, Kernel, Pattern};
use super::gradient::Gradient;
use super::hessian::{Aggregate, Entries};
use crate::OptimError;

/// Name of the parameters in messages.
pub(crate) const GROUP: &str = "sampled objective";

/// Where a derivative is sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SamplePoint<'a> {
    /// The parameters.
    pub theta: &'a [f64],
    /// Width of the smoothing, in units of the parameters' scales.
    pub sigma: f64,
    /// The sample set. The same seed at another place gives the same perturbations and the same seeds for the black
    /// box (common random numbers), so that differences between places are exact.
    pub seed: u64,
}

/// An objective smoothed by a Gaussian, with sampled derivatives in the parameters' own units.
pub trait Objective {
    /// Why an evaluation failed.
    type Error;

    /// A length for each parameter: parameter `i` is smoothed by `sigma * scales()[i]`, and optimizers count it in this
    /// unit. All parameters should matter about equally in their units.
    fn scales(&self) -> &[f64];

    /// Evaluations so far.
    fn evaluations(&self) -> u64;

    /// The gradient.
    ///
    /// # Errors
    /// [`SampledError`]: a failed evaluation, a value that is not finite, a wrong length, a setting out of range.
    fn gradient(
        &mut self,
        at: SamplePoint<'_>,
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<Self::Error>>;

    /// `d^T H d` for one direction `d` of the parameters.
    ///
    /// # Errors
    /// As [`Self::gradient`].
    fn curvature(
        &mut self,
        at: SamplePoint<'_>,
        direction: &[f64],
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<Self::Error>>;

    /// The Hessian, `n x n` row by row, symmetric.
    ///
    /// # Errors
    /// As [`Self::gradient`].
    fn hessian(
        &mut self,
        at: SamplePoint<'_>,
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<Self::Error>>;

    /// `H v` by the direct kernel.
    ///
    /// # Errors
    /// As [`Self::gradient`].
    fn hessian_product(
        &mut self,
        at: SamplePoint<'_>,
        vector: &[f64],
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<Self::Error>>;

    /// `H v` as the central difference of two gradients with common random numbers, `step` (in sigmas) to either side.
    ///
    /// The variance holds the two gradients' as if they were independent: an upper bound, usually a loose one.
    ///
    /// # Errors
    /// As [`Self::gradient`].
    fn hessian_product_difference(
        &mut self,
        at: SamplePoint<'_>,
        vector: &[f64],
        step: f64,
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<Self::Error>> {
        let n = self.scales().len();
        OptimError::length(GROUP, "direction", vector.len(), n)?;
        positive("step", step)?;
        let Some((_, length)) = axis(vector, self.scales()) else {
            return Ok(zero(n));
        };
        let h = step * at.sigma / length;
        let mut shifted = |sign: f64| {
            let theta: Vec<f64> = at.theta.iter().zip(vector).map(|(x, v)| x + sign * h * v).collect();
            self.gradient(SamplePoint { theta: &theta, ..at }, estimator)
        };
        let (plus, minus) = (shifted(1.0)?, shifted(-1.0)?);
        let pairs = |a: &[f64], b: &[f64], f: fn(f64, f64) -> f64, s: f64| -> Vec<f64> {
            a.iter().zip(b).map(|(a, b)| s * f(*a, *b)).collect()
        };
        Ok(Estimate {
            value: pairs(&plus.value, &minus.value, |a, b| a - b, 0.5 / h),
            variance: pairs(&plus.variance, &minus.variance, |a, b| a + b, 0.25 / (h * h)),
            mean: 0.5 * (plus.mean + minus.mean),
            evaluations: plus.evaluations + minus.evaluations,
            informative: plus.informative || minus.informative,
        })
    }
}

/// An estimate of nothing, at no cost.
pub(crate) fn zero(n: usize) -> Estimate {
    Estimate {
        value: vec![0.0; n],
        variance: vec![0.0; n],
        mean: f64::NAN,
        evaluations: 0,
        informative: true,
    }
}

pub(crate) fn positive(setting: &'static str, value: f64) -> Result<(), OptimError> {
    OptimError::setting(GROUP, setting, value, "finite and positive", value > 0.0 && value.is_finite())
}

/// Multiplies entry `i` by `factor(i)`.
pub(crate) fn rescale(mut estimate: Estimate, factor: impl Fn(usize) -> f64) -> Estimate {
    for (i, (value, variance)) in estimate.value.iter_mut().zip(&mut estimate.variance).enumerate() {
        let f = factor(i);
        *value *= f;
        // Twice, because the square alone may overflow where the product does not.
        *variance *= f;
        *variance *= f;
    }
    estimate
}

/// The loss itself is smoothed: derivatives of `E[f(theta + sigma t)]`.
///
/// For a loss of an image this is `E[L(R)]`; smoothing the image instead gives `L(E[R])`.
///
/// ```
/// use photofit_optim::sampled::{Objective, SamplePoint, Estimator, SmoothedLoss, serial};
/// // A step: no derivative exists, that of the smoothed step does.
/// let step = serial(|x: &[f64], _seed| Ok::<_, std::convert::Infallible>(f64::from(u8::from(x[0] > 0.0))));
/// let mut objective = SmoothedLoss::new(step, 1)?;
/// let estimator = Estimator { samples: 10_000, ..Estimator::default() };
/// let gradient = objective.gradient(SamplePoint { theta: &[0.4], sigma: 0.7, seed: 1 }, estimator)?;
/// // The normal density at 0.4 / 0.7, over 0.7.
/// assert!((gradient.value[0] - 0.4839).abs() < 0.001);
/// # Ok::<(), photofit_optim::sampled::SampledError<std::convert::Infallible>>(())
/// ```
#[derive(Clone, Debug)]
pub struct SmoothedLoss<B> {
    evaluator: Evaluator<B>,
    scales: Vec<f64>,
}

impl<B: BlackBox> SmoothedLoss<B> {
    /// For `dimension` parameters of scale 1.
    ///
    /// # Errors
    /// [`SampledError::Setting`] without parameters.
    pub fn new(black_box: B, dimension: usize) -> Result<Self, SampledError<B::Error>> {
        Self::with_scales(black_box, vec![1.0; dimension])
    }

    /// With a scale for each parameter.
    ///
    /// # Errors
    /// [`SampledError::Setting`] without parameters, or for a scale that is not finite and positive.
    pub fn with_scales(black_box: B, scales: Vec<f64>) -> Result<Self, SampledError<B::Error>> {
        check_scales(&scales)?;
        Ok(Self { evaluator: Evaluator::new(black_box), scales })
    }

    /// The black box.
    pub fn into_inner(self) -> B {
        self.evaluator.black_box
    }

    pub(crate) fn black_box(&self) -> &B {
        &self.evaluator.black_box
    }

    pub(crate) fn black_box_mut(&mut self) -> &mut B {
        &mut self.evaluator.black_box
    }

    /// The diagonal of the Hessian.
    ///
    /// # Errors
    /// As [`Objective::gradient`].
    pub fn hessian_diagonal(
        &mut self,
        at: SamplePoint<'_>,
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<B::Error>> {
        let list = (0..self.scales.len()).map(|i| [i, i]).collect();
        self.entries(at, list, estimator)
    }

    /// One entry of the Hessian.
    ///
    /// # Errors
    /// As [`Objective::gradient`]; [`SampledError::Setting`] when there is no such row or column.
    pub fn hessian_entry(
        &mut self,
        at: SamplePoint<'_>,
        row: usize,
        column: usize,
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<B::Error>> {
        let n = self.scales.len();
        for i in [row, column] {
            OptimError::setting(GROUP, "row or column", i as f64, "below the number of parameters", i < n)?;
        }
        self.entries(at, vec![[row, column]], estimator)
    }

    fn entries(
        &mut self,
        at: SamplePoint<'_>,
        list: Vec<[usize; 2]>,
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<B::Error>> {
        let pattern = Entries { dimension: self.scales.len(), list, estimator };
        let (estimate, sigma) = self.run(at, estimator, &pattern)?;
        Ok(rescale(estimate, |e| {
            let [i, j] = pattern.list[e];
            1.0 / (sigma[i] * sigma[j])
        }))
    }

    fn run(
        &mut self,
        at: SamplePoint<'_>,
        estimator: Estimator,
        pattern: &impl Pattern,
    ) -> Result<(Estimate, Vec<f64>), SampledError<B::Error>> {
        let sigma = check(at, &self.scales, estimator)?;
        Ok((self.evaluator.estimate(at.theta, &sigma, at.seed, pattern)?, sigma))
    }
}

pub(crate) fn check_scales(scales: &[f64]) -> Result<(), OptimError> {
    OptimError::setting(GROUP, "number of parameters", 0.0, "at least 1", !scales.is_empty())?;
    scales.iter().try_for_each(|s| positive("scale", *s))
}

/// Checks what an estimate is asked for; the standard deviation of each parameter.
pub(crate) fn check(
    at: SamplePoint<'_>,
    scales: &[f64],
    estimator: Estimator,
) -> Result<Vec<f64>, OptimError> {
    OptimError::length(GROUP, "theta", at.theta.len(), scales.len())?;
    positive("sigma", at.sigma)?;
    let samples = estimator.samples as f64;
    OptimError::setting(GROUP, "samples", samples, "in 1..=2^40", (1.0..=1.1e12).contains(&samples))?;
    if let Some(x) = at.theta.iter().find(|x| !x.is_finite()) {
        OptimError::setting(GROUP, "parameter", *x, "finite", false)?;
    }
    Ok(scales.iter().map(|s| s * at.sigma).collect())
}

/// Row and column of the lower triangle's entries.
fn triangle(n: usize) -> impl Iterator<Item = [usize; 2]> {
    (0..n).flat_map(|i| (0..=i).map(move |j| [i, j]))
}

impl<B: BlackBox> Objective for SmoothedLoss<B> {
    type Error = B::Error;

    fn scales(&self) -> &[f64] {
        &self.scales
    }

    fn evaluations(&self) -> u64 {
        self.evaluator.evaluations
    }

    fn gradient(
        &mut self,
        at: SamplePoint<'_>,
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<B::Error>> {
        let pattern = Gradient { dimension: self.scales.len(), estimator };
        let (estimate, sigma) = self.run(at, estimator, &pattern)?;
        Ok(rescale(estimate, |i| 1.0 / sigma[i]))
    }

    fn curvature(
        &mut self,
        at: SamplePoint<'_>,
        direction: &[f64],
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<B::Error>> {
        let sigma = check(at, &self.scales, estimator)?;
        OptimError::length(GROUP, "direction", direction.len(), sigma.len())?;
        let Some((axis, length)) = axis(direction, &sigma) else { return Ok(zero(1)) };
        let estimate = self.evaluator.estimate(at.theta, &sigma, at.seed, &Curvature { axis, estimator })?;
        Ok(rescale(estimate, |_| length * length))
    }

    fn hessian(
        &mut self,
        at: SamplePoint<'_>,
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<B::Error>> {
        let n = self.scales.len();
        if estimator.kernel != Kernel::Coordinates {
            let (estimate, sigma) = self.run(at, estimator, &Aggregate { dimension: n, estimator })?;
            return Ok(rescale(estimate, |e| 1.0 / (sigma[e / n] * sigma[e % n])));
        }
        let lower = self.entries(at, triangle(n).collect(), estimator)?;
        let mut full = Estimate { value: vec![0.0; n * n], variance: vec![0.0; n * n], ..lower };
        for (e, [i, j]) in triangle(n).enumerate() {
            for at in [i * n + j, j * n + i] {
                (full.value[at], full.variance[at]) = (lower.value[e], lower.variance[e]);
            }
        }
        Ok(full)
    }

    fn hessian_product(
        &mut self,
        at: SamplePoint<'_>,
        vector: &[f64],
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<B::Error>> {
        let sigma = check(at, &self.scales, estimator)?;
        OptimError::length(GROUP, "direction", vector.len(), sigma.len())?;
        // H v = (1/sigma) H_t (v/sigma), with H_t in units of sigma.
        let whitened: Vec<f64> = vector.iter().zip(&sigma).map(|(v, s)| v / s).collect();
        let Some((axis, length)) = axis(&whitened, &vec![1.0; sigma.len()]) else {
            return Ok(zero(sigma.len()));
        };
        let estimate = self.evaluator.estimate(at.theta, &sigma, at.seed, &Product { axis, estimator })?;
        Ok(rescale(estimate, |i| length / sigma[i]))
    }
}
