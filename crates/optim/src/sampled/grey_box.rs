//! A black box behind a function with known derivatives: `z = f(g(x))`.
//!
//! Only `f`, of few parameters `y`, is sampled; the derivatives of `g` are exact:
//!
//! - gradient `J^T grad_y f`,
//! - Hessian `J^T H_y J + sum_k (d_k f) Hess g_k`. The sum is not small: without it the Hessian of a curved `g` may be
//!   wrong by its own size.

use super::error::SampledError;
use super::estimate::{Estimate, Estimator};
use super::objective::{GROUP, Objective, SamplePoint, check_scales};
use crate::OptimError;

/// A function g: x -> y with exact derivatives.
pub trait WhiteBox {
    /// Number of `x`.
    fn inputs(&self) -> usize;
    /// Number of `y`.
    fn outputs(&self) -> usize;
    /// Writes `g(x)` to `y`.
    fn value(&self, x: &[f64], y: &mut [f64]);
    /// Writes `J v` to `out`.
    fn jvp(&self, x: &[f64], v: &[f64], out: &mut [f64]);
    /// Writes `J^T w` to `out`.
    fn vjp(&self, x: &[f64], w: &[f64], out: &mut [f64]);
    /// Writes `(sum_k w_k Hess g_k) v` to `out`: the derivative of `J^T w` along `v` for constant `w`. Zero for a linear
    /// function.
    fn second(&self, x: &[f64], w: &[f64], v: &[f64], out: &mut [f64]);
}

/// `f(g(x))` with `f` smoothed in its own parameters `y`; an [`Objective`] of `x`.
#[derive(Clone, Debug)]
pub struct GreyBox<O, G> {
    outer: O,
    inner: G,
    scales: Vec<f64>,
}

impl<O: Objective, G: WhiteBox> GreyBox<O, G> {
    /// `outer` smooths `y` by its own scales; `scales` are the units in which optimizers count `x`.
    ///
    /// # Errors
    /// [`SampledError::Setting`] when the numbers of parameters do not fit, or for a scale that is not finite and
    /// positive.
    pub fn new(outer: O, inner: G, scales: Vec<f64>) -> Result<Self, SampledError<O::Error>> {
        check_scales(&scales)?;
        OptimError::length(GROUP, "scales", scales.len(), inner.inputs())?;
        OptimError::length(GROUP, "outputs of the inner function", inner.outputs(), outer.scales().len())?;
        Ok(Self { outer, inner, scales })
    }

    fn image(&self, x: &[f64]) -> Result<Vec<f64>, OptimError> {
        OptimError::length(GROUP, "theta", x.len(), self.inner.inputs())?;
        let mut y = vec![0.0; self.inner.outputs()];
        self.inner.value(x, &mut y);
        Ok(y)
    }

    fn jvp(&self, x: &[f64], v: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.inner.outputs()];
        self.inner.jvp(x, v, &mut out);
        out
    }

    fn vjp(&self, x: &[f64], w: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.inner.inputs()];
        self.inner.vjp(x, w, &mut out);
        out
    }

    fn second(&self, x: &[f64], w: &[f64], v: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.inner.inputs()];
        self.inner.second(x, w, v, &mut out);
        out
    }

    /// Variances of `J^T w` from those of `w`, by the squares of J's rows (its columns by [`WhiteBox::jvp`] would cost
    /// one call per input).
    fn variance(&self, x: &[f64], variance: &[f64]) -> Vec<f64> {
        let m = variance.len();
        let mut total = vec![0.0; self.inner.inputs()];
        let mut unit = vec![0.0; m];
        for k in 0..m {
            unit[k] = 1.0;
            for (t, j) in total.iter_mut().zip(self.vjp(x, &unit)) {
                *t += if j == 0.0 { 0.0 } else { j * j * variance[k] };
            }
            unit[k] = 0.0;
        }
        total
    }

    /// One estimate at `g(x)` and the gradient of `f` there.
    fn with_gradient(
        &mut self,
        at: SamplePoint<'_>,
        estimator: Estimator,
        estimate: impl FnOnce(&mut O, SamplePoint<'_>) -> Result<Estimate, SampledError<O::Error>>,
    ) -> Result<(Estimate, Estimate), SampledError<O::Error>> {
        let y = self.image(at.theta)?;
        let place = SamplePoint { theta: &y, ..at };
        let first = self.outer.gradient(place, estimator)?;
        let mut second = estimate(&mut self.outer, place)?;
        second.evaluations += first.evaluations;
        second.informative |= first.informative;
        Ok((first, second))
    }
}

impl<O: Objective, G: WhiteBox> Objective for GreyBox<O, G> {
    type Error = O::Error;

    fn scales(&self) -> &[f64] {
        &self.scales
    }

    fn evaluations(&self) -> u64 {
        self.outer.evaluations()
    }

    fn gradient(
        &mut self,
        at: SamplePoint<'_>,
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<O::Error>> {
        let y = self.image(at.theta)?;
        let outer = self.outer.gradient(SamplePoint { theta: &y, ..at }, estimator)?;
        let value = self.vjp(at.theta, &outer.value);
        let variance = self.variance(at.theta, &outer.variance);
        Ok(Estimate { value, variance, ..outer })
    }

    /// `(J d)^T H_y (J d) + d^T (sum_k d_k f Hess g_k) d`; the variance is that of the first term.
    fn curvature(
        &mut self,
        at: SamplePoint<'_>,
        direction: &[f64],
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<O::Error>> {
        OptimError::length(GROUP, "direction", direction.len(), self.inner.inputs())?;
        let along = self.jvp(at.theta, direction);
        let (first, mut second) =
            self.with_gradient(at, estimator, |outer, at| outer.curvature(at, &along, estimator))?;
        let bent = self.second(at.theta, &first.value, direction);
        second.value[0] += bent.iter().zip(direction).map(|(a, b)| a * b).sum::<f64>();
        Ok(second)
    }

    /// `J^T H_y J + sum_k d_k f Hess g_k`, column by column; the variances are unknown (NaN).
    fn hessian(
        &mut self,
        at: SamplePoint<'_>,
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<O::Error>> {
        let (n, m) = (self.inner.inputs(), self.inner.outputs());
        let (first, outer) = self.with_gradient(at, estimator, |outer, at| outer.hessian(at, estimator))?;
        let mut value = vec![0.0; n * n];
        let mut unit = vec![0.0; n];
        for j in 0..n {
            unit[j] = 1.0;
            let along = self.jvp(at.theta, &unit);
            let dot = |row: &[f64]| row.iter().zip(&along).map(|(a, b)| a * b).sum();
            let curved: Vec<f64> = outer.value.chunks_exact(m).map(dot).collect();
            let column = self.vjp(at.theta, &curved);
            let bent = self.second(at.theta, &first.value, &unit);
            for (i, (a, b)) in column.iter().zip(bent).enumerate() {
                value[i * n + j] = a + b;
            }
            unit[j] = 0.0;
        }
        Ok(Estimate { value, variance: vec![f64::NAN; n * n], ..outer })
    }

    /// Forward through g, the outer product, back through g: `J^T H_y J v` and the curvature of g; the variances are
    /// those of the first term.
    fn hessian_product(
        &mut self,
        at: SamplePoint<'_>,
        vector: &[f64],
        estimator: Estimator,
    ) -> Result<Estimate, SampledError<O::Error>> {
        OptimError::length(GROUP, "direction", vector.len(), self.inner.inputs())?;
        let along = self.jvp(at.theta, vector);
        let (first, outer) =
            self.with_gradient(at, estimator, |outer, at| outer.hessian_product(at, &along, estimator))?;
        let mut value = self.vjp(at.theta, &outer.value);
        let bent = self.second(at.theta, &first.value, vector);
        value.iter_mut().zip(bent).for_each(|(a, b)| *a += b);
        let variance = self.variance(at.theta, &outer.variance);
        Ok(Estimate { value, variance, ..outer })
    }
}
