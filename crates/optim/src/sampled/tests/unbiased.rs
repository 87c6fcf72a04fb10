//! Estimates against exact derivatives: quadratic and step, every kernel and stencil.

use super::*;
use crate::sampled::noise::Noise;

const SAMPLES: usize = 1_000_000;

/// Every way to draw samples, with [`SAMPLES`] evaluations for each parameter, or in all, for 4-point stencils.
fn estimators() -> Vec<Estimator> {
    let mut estimators = Vec::new();
    for kernel in [Kernel::Coordinates, Kernel::Aggregate, Kernel::Score] {
        for stencil in [Stencil::Plain, Stencil::Antithetic, Stencil::FourPoint] {
            let samples = if kernel == Kernel::Score { SAMPLES / 20 } else { SAMPLES / 4 };
            estimators.push(estimator(samples, stencil, kernel));
        }
    }
    estimators
}

fn check(name: &str, estimator: Estimator, got: &Estimate, expected: &[f64]) {
    assert_eq!(got.value.len(), expected.len(), "{name}");
    for (i, e) in expected.iter().enumerate() {
        let error = (got.value[i] - e).abs();
        // Entries without any scatter are exact up to rounding.
        let tolerance = 4.0 * got.standard_error(i) + 1e-9 * e.abs().max(1.0);
        assert!(
            error < tolerance,
            "{name} {estimator:?} entry {i}: {} for {e}, z = {}",
            got.value[i],
            error / got.standard_error(i)
        );
    }
}

/// A quadratic of two parameters, its gradient and Hessian.
const HESSIAN: [f64; 4] = [10.0, 7.5, 7.5, 6.0];
fn bowl(x: &[f64]) -> f64 {
    5.0 * x[0] * x[0] + 7.5 * x[0] * x[1] + 3.0 * x[1] * x[1] - x[0] + 2.0
}
fn bowl_gradient(x: &[f64]) -> [f64; 2] {
    [10.0 * x[0] + 7.5 * x[1] - 1.0, 7.5 * x[0] + 6.0 * x[1]]
}

/// A quadrant: a step in each of two parameters.
fn quadrant(x: &[f64]) -> f64 {
    f64::from(u8::from(x[0] > 0.0 && x[1] > 0.0))
}
fn quadrant_derivatives(x: &[f64], sigma: [f64; 2]) -> ([f64; 2], [f64; 4]) {
    let share = |x: f64, s: f64| 0.5 * (1.0 + erf(x / s / 2.0_f64.sqrt()));
    let (p, q) = (share(x[0], sigma[0]), share(x[1], sigma[1]));
    let ((a, aa), (b, bb)) = (smoothed_step(x[0], sigma[0]), smoothed_step(x[1], sigma[1]));
    ([a * q, p * b], [aa * q, a * b, a * b, p * bb])
}

/// The error function by its series.
fn erf(x: f64) -> f64 {
    let mut term = x;
    let mut sum = x;
    for k in 1..60 {
        let k = f64::from(k);
        term *= -x * x / k;
        sum += term / (2.0 * k + 1.0);
    }
    2.0 / std::f64::consts::PI.sqrt() * sum
}

const THETA: [f64; 2] = [0.4, -0.3];

fn scaled(f: fn(&[f64]) -> f64) -> SmoothedLoss<impl BlackBox<Error = Infallible>> {
    let f = serial(move |x: &[f64], _| Ok::<_, Infallible>(f(x)));
    SmoothedLoss::with_scales(f, vec![1.0, 1.6]).expect("scales")
}

fn at(seed: u64) -> SamplePoint<'static> {
    SamplePoint { theta: &THETA, sigma: 0.7, seed }
}

#[test]
fn gradients() {
    let (exact, _) = quadrant_derivatives(&THETA, [0.7, 1.12]);
    for (seed, estimator) in estimators().into_iter().enumerate() {
        check(
            "quadratic",
            estimator,
            &value(scaled(bowl).gradient(at(seed as u64), estimator)),
            &bowl_gradient(&THETA),
        );
        check("quadrant", estimator, &value(scaled(quadrant).gradient(at(seed as u64), estimator)), &exact);
    }
}

#[test]
fn hessians() {
    let (_, exact) = quadrant_derivatives(&THETA, [0.7, 1.12]);
    for (seed, estimator) in estimators().into_iter().enumerate() {
        check("quadratic", estimator, &value(scaled(bowl).hessian(at(seed as u64), estimator)), &HESSIAN);
        check("quadrant", estimator, &value(scaled(quadrant).hessian(at(seed as u64), estimator)), &exact);
    }
}

#[test]
fn single_entries_and_the_diagonal_equal_those_of_the_matrix() {
    let (_, exact) = quadrant_derivatives(&THETA, [0.7, 1.12]);
    let estimator = estimator(SAMPLES / 4, Stencil::FourPoint, Kernel::Coordinates);
    check(
        "diagonal",
        estimator,
        &value(scaled(quadrant).hessian_diagonal(at(2), estimator)),
        &[exact[0], exact[3]],
    );
    check("entry", estimator, &value(scaled(quadrant).hessian_entry(at(3), 1, 0, estimator)), &[exact[1]]);
    assert!(scaled(quadrant).hessian_entry(at(3), 2, 0, estimator).is_err(), "there is no row 2");
}

#[test]
fn products_and_curvatures() {
    let (_, exact) = quadrant_derivatives(&THETA, [0.7, 1.12]);
    let v = [0.8, -1.7];
    let times = |h: &[f64; 4]| [h[0] * v[0] + h[1] * v[1], h[2] * v[0] + h[3] * v[1]];
    let along = |h: &[f64; 4]| [times(h)[0] * v[0] + times(h)[1] * v[1]];
    for (seed, stencil) in [Stencil::Plain, Stencil::Antithetic, Stencil::FourPoint].into_iter().enumerate() {
        let estimator = estimator(SAMPLES / 4, stencil, Kernel::Coordinates);
        let at = at(10 + seed as u64);
        // On the quadratic also the sign: the published product has it flipped.
        check(
            "quadratic product",
            estimator,
            &value(scaled(bowl).hessian_product(at, &v, estimator)),
            &times(&HESSIAN),
        );
        check(
            "quadrant product",
            estimator,
            &value(scaled(quadrant).hessian_product(at, &v, estimator)),
            &times(&exact),
        );
        check(
            "quadratic curvature",
            estimator,
            &value(scaled(bowl).curvature(at, &v, estimator)),
            &along(&HESSIAN),
        );
        check(
            "quadrant curvature",
            estimator,
            &value(scaled(quadrant).curvature(at, &v, estimator)),
            &along(&exact),
        );
    }
}

#[test]
fn product_by_differences_has_common_random_numbers() {
    let v = [0.8, -1.7];
    let exact = [HESSIAN[0] * v[0] + HESSIAN[1] * v[1], HESSIAN[2] * v[0] + HESSIAN[3] * v[1]];
    // Each difference is an independent estimate: their scatter is the error.
    let estimator = estimator(8, Stencil::Antithetic, Kernel::Coordinates);
    let runs = 4000;
    let mut mean = [0.0; 2];
    let mut squares = [0.0; 2];
    for seed in 0..runs {
        let e = value(scaled(bowl).hessian_product_difference(at(seed), &v, 0.5, estimator));
        for k in 0..2 {
            mean[k] += e.value[k] / runs as f64;
            squares[k] += e.value[k] * e.value[k] / runs as f64;
        }
    }
    for k in 0..2 {
        let error = ((squares[k] - mean[k] * mean[k]) / runs as f64).sqrt();
        assert!((mean[k] - exact[k]).abs() < 4.0 * error, "{mean:?} for {exact:?}, {error}");
    }
}

#[test]
fn reported_variances_are_those_seen() {
    let runs = 3000;
    for kernel in [Kernel::Coordinates, Kernel::Aggregate] {
        let estimator = estimator(16, Stencil::Antithetic, kernel);
        let (mut mean, mut square, mut reported) = (0.0, 0.0, 0.0);
        for seed in 0..runs {
            let e = value(scaled(quadrant).gradient(at(seed), estimator));
            mean += e.value[0] / runs as f64;
            square += e.value[0] * e.value[0] / runs as f64;
            reported += e.variance[0] / runs as f64;
        }
        let seen = square - mean * mean;
        assert!((seen / reported - 1.0).abs() < 0.15, "{kernel:?}: {seen} seen, {reported} reported");
    }
}

#[test]
fn samples_follow_their_kernels() {
    // Chi-square of the perturbations that the black box sees, along the axis: 40 bins of equal mass.
    let bins = 40;
    let mut counts = vec![0_u32; bins];
    let estimator =
        Estimator { stratified: false, ..estimator(20_000, Stencil::FourPoint, Kernel::Coordinates) };
    let mut seen = Vec::new();
    let f = serial(|x: &[f64], _| {
        seen.push(x[0]);
        Ok::<_, Infallible>(0.0)
    });
    let mut objective = SmoothedLoss::new(f, 1).expect("parameters");
    value(objective.hessian(SamplePoint { theta: &[0.0], sigma: 1.0, seed: 4 }, estimator));
    drop(objective);
    // One of each stencil at random: its four points depend on each other.
    let mut noise = Noise::new(9, 9);
    for stencil in seen.chunks_exact(4) {
        let t = stencil[(4.0 * noise.uniform()) as usize];
        counts[((crate::sampled::kernel::hessian_cdf(t) * bins as f64) as usize).min(bins - 1)] += 1;
    }
    let expected = 20_000.0 / bins as f64;
    let chi: f64 = counts.iter().map(|c| (f64::from(*c) - expected).powi(2) / expected).sum();
    // 39 degrees of freedom: 99.9% lie below 72.1.
    assert!(chi < 72.1, "{chi}");
}
