//! The one-dimensional kernels against numerical integrals.

use crate::sampled::kernel::*;

/// Composite Gauss rule of 3 points on `[a, b]`.
fn integral(f: impl Fn(f64) -> f64, a: f64, b: f64) -> f64 {
    let panels = 2000;
    let h = (b - a) / f64::from(panels);
    let node = 0.6_f64.sqrt();
    (0..panels)
        .map(|i| {
            let m = a + (f64::from(i) + 0.5) * h;
            h / 18.0 * (5.0 * f(m - 0.5 * h * node) + 8.0 * f(m) + 5.0 * f(m + 0.5 * h * node))
        })
        .sum()
}

fn normal(t: f64) -> f64 {
    (-0.5 * t * t).exp() / std::f64::consts::TAU.sqrt()
}

fn gradient_density(t: f64) -> f64 {
    0.5 * t.abs() * (-0.5 * t * t).exp()
}

fn hessian_density(t: f64) -> f64 {
    (t * t - 1.0).abs() * normal(t) / HESSIAN_WEIGHT
}

#[test]
fn distribution_functions_integrate_their_densities() {
    // Piecewise, so that the kinks at 0 and 1 fall on panels' ends.
    let check = |name: &str, cdf: fn(f64) -> f64, density: fn(f64) -> f64| {
        let mut below = 0.0;
        let mut worst = 0.0_f64;
        let mut from = -12.0;
        for i in 0..=96 {
            let to = -6.0 + 0.125 * f64::from(i);
            below += integral(density, from, to);
            from = to;
            worst = worst.max((cdf(to) - below).abs());
        }
        assert!(worst < 1e-8, "{name}: {worst:e}");
        assert!((below + integral(density, from, 12.0) - 1.0).abs() < 1e-8, "{name} is a density");
    };
    check("gradient", gradient_cdf, gradient_density);
    check("Hessian", hessian_cdf, hessian_density);
}

#[test]
fn inverses_return_to_their_number() {
    let mut worst = [0.0_f64; 2];
    for i in 1..200_000 {
        let xi = f64::from(i) / 200_000.0;
        worst[0] = worst[0].max((gradient_cdf(gradient_quantile(xi)) - xi).abs());
        worst[1] = worst[1].max((hessian_cdf(hessian_quantile(xi)) - xi).abs());
    }
    assert!(worst.iter().all(|w| *w < 1e-12), "{worst:?}");
}

#[test]
fn inverses_of_small_numbers_are_relatively_exact() {
    for exponent in 1..300 {
        let xi = 10.0_f64.powi(-exponent);
        assert!((gradient_cdf(gradient_quantile(xi)) / xi - 1.0).abs() < 1e-11, "gradient 1e-{exponent}");
        assert!((hessian_cdf(hessian_quantile(xi)) / xi - 1.0).abs() < 1e-11, "Hessian 1e-{exponent}");
    }
}

#[test]
fn inverses_keep_to_their_branch_next_to_its_ends() {
    for e in [1e-17, 1e-16, 1e-12, 1e-8, 1e-4] {
        for xi in
            [0.25 - e, 0.25, 0.25 + e, 0.75 - e, 0.75, 0.75 + e, 0.5 - e, 0.5, 0.5 + e, e, 1.0 - e, 0.0, 1.0]
        {
            let t = hessian_quantile(xi);
            assert!(t.is_finite() && (hessian_cdf(t) - xi).abs() < 1e-12, "{xi}: {t}");
            let outer = !(0.25..=0.75).contains(&xi);
            assert!(if outer { t.abs() >= 1.0 } else { t.abs() <= 1.0 }, "{xi}: {t}");
        }
    }
}

#[test]
fn the_published_distribution_function_is_off_by_a_half() {
    // Equation 52 of Wang et al. (2025) as printed: the derivative of the Gaussian without the signs of its lobes.
    let printed = |t: f64| {
        let c = 0.25 * t * (0.5 * (1.0 - t * t)).exp();
        if t < -1.0 {
            -c
        } else if t <= 1.0 {
            0.5 - c
        } else {
            1.0 + c
        }
    };
    let worst = (-60..=60).map(|i| f64::from(i) / 10.0).map(|t| (printed(t) - hessian_cdf(t)).abs());
    assert!((worst.fold(0.0, f64::max) - 0.5).abs() < 1e-12);
}
