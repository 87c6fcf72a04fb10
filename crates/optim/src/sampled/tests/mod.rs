//! Gates of the specification, negative controls, stress.

mod kernels;
mod methods;
mod numbers;
mod smoothing;
mod stress;
mod unbiased;
mod variance;

use std::convert::Infallible;

use super::{BlackBox, Estimate, Estimator, Kernel, Objective, SamplePoint, SmoothedLoss, Stencil, serial};

/// A deterministic objective of `n` parameters of scale 1.
fn smooth(n: usize, f: impl Fn(&[f64]) -> f64) -> SmoothedLoss<impl BlackBox<Error = Infallible>> {
    SmoothedLoss::new(serial(move |x: &[f64], _| Ok::<_, Infallible>(f(x))), n).expect("parameters")
}

/// The quadratic of the specification's table.
fn quadratic(x: &[f64]) -> f64 {
    3.0 * x[0] * x[0] - 2.0 * x[0] + 5.0
}

/// The step of the specification's table.
fn step(x: &[f64]) -> f64 {
    f64::from(u8::from(x[0] > 0.0))
}

/// Point of the table: 1-D, sigma 0.7.
const AT: SamplePoint<'_> = SamplePoint { theta: &[0.4], sigma: 0.7, seed: 1 };

fn estimator(samples: usize, stencil: Stencil, kernel: Kernel) -> Estimator {
    Estimator { samples, stencil, kernel, stratified: false }
}

/// Derivatives of the smoothed step at `x`: the normal density and its derivative.
fn smoothed_step(x: f64, sigma: f64) -> (f64, f64) {
    let t = x / sigma;
    let density = (-0.5 * t * t).exp() / (std::f64::consts::TAU.sqrt() * sigma);
    (density, -t / sigma * density)
}

/// Variance of one evaluation: that of the mean times the evaluations it took.
fn cost(e: &Estimate) -> f64 {
    e.variance[0] * e.evaluations as f64
}

fn value(x: Result<Estimate, super::SampledError<Infallible>>) -> Estimate {
    x.expect("an estimate")
}
