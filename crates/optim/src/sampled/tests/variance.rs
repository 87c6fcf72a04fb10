//! What each way of sampling costs: the table of the specification, slopes, dimensions, tails.

use super::*;
use crate::sampled::kernel::{HESSIAN_WEIGHT, hessian_quantile};
use crate::sampled::noise::Noise;

type Function = fn(&[f64]) -> f64;

fn gradient_cost(f: Function, stencil: Stencil, kernel: Kernel) -> f64 {
    cost(&value(smooth(1, f).gradient(AT, estimator(200_000, stencil, kernel))))
}

fn hessian_cost(f: Function, stencil: Stencil, kernel: Kernel) -> f64 {
    cost(&value(smooth(1, f).hessian(AT, estimator(200_000, stencil, kernel))))
}

#[test]
fn variance_times_cost_is_that_of_the_specification() {
    use Kernel::{Coordinates, Score};
    use Stencil::{Antithetic, FourPoint, Plain};
    let columns = [(Plain, Coordinates), (Antithetic, Coordinates), (FourPoint, Coordinates), (Plain, Score)];
    type Cost = fn(Function, Stencil, Kernel) -> f64;
    let rows: [(&str, Cost, Function, [f64; 4]); 4] = [
        ("gradient, quadratic", gradient_cost, quadratic, [87.0, 0.088, 0.0046, 196.0]),
        ("gradient, step", gradient_cost, step, [0.52, 0.083, 0.068, 0.83]),
        ("Hessian, quadratic", hessian_cost, quadratic, [276.0, 551.0, 59.0, 1422.0]),
        ("Hessian, step", hessian_cost, step, [2.6, 4.0, 0.16, 4.8]),
    ];
    for (name, measure, f, expected) in rows {
        for ((stencil, kernel), expected) in columns.into_iter().zip(expected) {
            let got = measure(f, stencil, kernel);
            println!("{name} {stencil:?} {kernel:?}: {got:.4} (specification {expected})");
            assert!((got / expected).ln().abs() < 0.1, "{name} {stencil:?} {kernel:?}: {got} for {expected}");
        }
    }
}

#[test]
fn the_published_pair_does_not_help_hessians() {
    for f in [quadratic as Function, step] {
        let [plain, pair, four] = [Stencil::Plain, Stencil::Antithetic, Stencil::FourPoint]
            .map(|t| hessian_cost(f, t, Kernel::Coordinates));
        assert!(pair > 1.3 * plain, "{pair} against {plain}");
        assert!(four <= 0.25 * plain, "{four} against {plain}");
    }
}

/// Slope of the root mean square error over the number of samples.
fn slope(stratified: bool, estimate: impl Fn(Estimator, u64) -> f64, exact: f64, stencil: Stencil) -> f64 {
    let runs = 300;
    let error = |samples: usize| {
        let estimator = Estimator { samples, stencil, kernel: Kernel::Coordinates, stratified };
        let square: f64 = (0..runs).map(|seed| (estimate(estimator, seed) - exact).powi(2)).sum();
        (square / runs as f64).sqrt()
    };
    let (few, many) = (16, 1024);
    (error(many) / error(few)).ln() / (many as f64 / few as f64).ln()
}

#[test]
fn errors_fall_with_the_root_of_the_samples_and_faster_in_strata() {
    let gradient =
        |estimator, seed| value(smooth(1, step).gradient(SamplePoint { seed, ..AT }, estimator)).value[0];
    let hessian =
        |estimator, seed| value(smooth(1, step).hessian(SamplePoint { seed, ..AT }, estimator)).value[0];
    let (g, h) = smoothed_step(0.4, 0.7);
    for (name, slopes) in [
        ("gradient", [false, true].map(|s| slope(s, gradient, g, Stencil::Antithetic))),
        ("Hessian", [false, true].map(|s| slope(s, hessian, h, Stencil::FourPoint))),
    ] {
        println!("{name}: slopes {slopes:?}");
        assert!((-0.55..=-0.45).contains(&slopes[0]), "{name}: {slopes:?}");
        assert!(slopes[1] <= -0.9, "{name}: {slopes:?}");
    }
}

/// `sum_i (i+1)/n x_i^2` and a half-space, both of `n` parameters.
fn spread(x: &[f64]) -> f64 {
    let n = x.len() as f64;
    x.iter().enumerate().map(|(i, x)| (i as f64 + 1.0) / n * x * x).sum::<f64>() + 3.0
}
fn half_space(x: &[f64]) -> f64 {
    let n = x.len() as f64;
    f64::from(u8::from(x.iter().sum::<f64>() / n.sqrt() > 0.0))
}

/// Variance times cost of the curvature along a unit vector.
fn directional(n: usize, f: Function) -> f64 {
    let d = vec![1.0 / (n as f64).sqrt(); n];
    let theta: Vec<f64> = d.iter().map(|d| 0.4 * d).collect();
    let at = SamplePoint { theta: &theta, sigma: 0.7, seed: 3 };
    let e = value(smooth(n, f).curvature(at, &d, estimator(20_000, Stencil::FourPoint, Kernel::Coordinates)));
    cost(&e)
}

#[test]
fn curvature_along_a_direction_does_not_know_the_dimension() {
    for f in [spread as Function, half_space] {
        let [few, many] = [2, 1000].map(|n| directional(n, f));
        println!("n = 2: {few}, n = 1000: {many}");
        assert!(many < 3.0 * few, "{many} at 1000, {few} at 2");
    }
}

#[test]
fn curvature_beats_differences_of_gradients_and_these_need_common_numbers() {
    let n = 200;
    let d = vec![1.0 / (n as f64).sqrt(); n];
    // Far out across `d`: the gradients are large, their difference is not.
    let theta: Vec<f64> = d.iter().enumerate().map(|(i, d)| 0.4 * d + [2.0, -2.0][i % 2]).collect();
    let plan_for = |samples| estimator(samples, Stencil::Antithetic, Kernel::Aggregate);
    let runs = 600;
    let scatter = |f: Function, estimate: &dyn Fn(Function, u64) -> (f64, f64)| {
        let all: Vec<(f64, f64)> = (0..runs).map(|seed| estimate(f, seed)).collect();
        let mean = all.iter().map(|e| e.0).sum::<f64>() / runs as f64;
        all.iter().map(|e| (e.0 - mean).powi(2) * e.1).sum::<f64>() / runs as f64
    };
    let along = |g: &[f64]| g.iter().zip(&d).map(|(g, d)| g * d).sum::<f64>();
    let common = |f: Function, seed: u64| {
        let at = SamplePoint { theta: &theta, sigma: 0.7, seed };
        let e = value(smooth(n, f).hessian_product_difference(at, &d, 0.5, plan_for(1)));
        (along(&e.value), e.evaluations as f64)
    };
    let independent = |f: Function, seed: u64| {
        let mut sum = 0.0;
        for (k, sign) in [1.0, -1.0].into_iter().enumerate() {
            let shifted: Vec<f64> = theta.iter().zip(&d).map(|(x, d)| x + sign * 0.35 * d).collect();
            let at = SamplePoint { theta: &shifted, sigma: 0.7, seed: 2 * seed + k as u64 + 9000 };
            sum += sign * along(&value(smooth(n, f).gradient(at, plan_for(1))).value) / 0.7;
        }
        (sum, 4.0)
    };
    for f in [spread as Function, half_space] {
        let (ours, common, independent) = (directional(n, f), scatter(f, &common), scatter(f, &independent));
        println!("4-point stencil {ours:.3}, common {common:.3}, independent {independent:.1}");
        assert!(ours < common && common < 0.5 * independent, "{ours} {common} {independent}");
    }
}

/// Fourth central moment over the squared second.
fn kurtosis(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let moment = |p: i32| values.iter().map(|v| (v - mean).powi(p)).sum::<f64>() / n;
    moment(4) / moment(2).powi(2)
}

#[test]
fn aggregate_weights_have_bounded_tails_and_single_densities_do_not() {
    let runs = 100_000;
    let f = |x: &[f64]| step(x) + 0.5 * x[1];
    for hessian in [false, true] {
        let mut objective = smooth(2, f);
        let estimator = estimator(1, Stencil::Plain, Kernel::Aggregate);
        let mut entries = vec![Vec::new(); if hessian { 4 } else { 2 }];
        for seed in 0..runs {
            let at = SamplePoint { theta: &[0.4, 0.1], sigma: 0.7, seed };
            let e = value(if hessian {
                objective.hessian(at, estimator)
            } else {
                objective.gradient(at, estimator)
            });
            entries.iter_mut().zip(&e.value).for_each(|(all, v)| all.push(*v));
        }
        for (i, all) in entries.iter().enumerate() {
            let k = kurtosis(all);
            assert!(k < 100.0, "Hessian {hessian}, entry {i}: {k}");
        }
    }
    // Each sample over the density of the one entry it was drawn for: the other entries' weights have poles.
    let mut noise = Noise::new(5, 5);
    let single: Vec<f64> = (0..runs)
        .map(|_| {
            let t = [hessian_quantile(noise.uniform()), noise.normal()];
            let density = (t[0] * t[0] - 1.0).abs() / HESSIAN_WEIGHT;
            (t[1] * t[1] - 1.0) / density
        })
        .collect();
    assert!(kurtosis(&single) > 1000.0, "{}", kurtosis(&single));
}

#[test]
fn four_points_cancel_constants_and_lines_exactly() {
    let line = |x: &[f64]| 7.0 + 2.0 * x[0] - 3.0 * x[1];
    let at = SamplePoint { theta: &[0.25, -0.5], sigma: 0.5, seed: 8 };
    let estimator = estimator(50, Stencil::FourPoint, Kernel::Coordinates);
    let hessian = value(smooth(2, line).hessian(at, estimator));
    let curvature = value(smooth(2, line).curvature(at, &[0.6, 0.8], estimator));
    for v in hessian.value.iter().chain(&curvature.value) {
        assert!(v.abs() < 1e-13, "{v}");
    }
    let constant = value(smooth(2, |_| 7.1).hessian(at, estimator));
    assert!(constant.value.iter().all(|v| *v == 0.0), "{constant:?}");
}
