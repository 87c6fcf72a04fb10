//! The two kernels in one dimension: derivatives of a Gaussian made densities, sampled by inversion.
//!
//! Everything is in units of sigma, `t = tau / sigma`. With `N` the standard normal density,
//!
//! - gradient kernel: density `|t| e^(-t^2/2) / 2`, weight `sign(t)` [`GRADIENT_WEIGHT`] `/ sigma`;
//! - Hessian kernel: density proportional to `|t^2 - 1| N(t)`, weight [`HESSIAN_WEIGHT`] `/ sigma^2`, negative for
//!   `|t| < 1`.
//!
//! Fischer and Ritschel (2023) for the first, Wang et al. (2025) for the second; the distribution function of the second is
//! theirs with the signs of two cases put right.

use std::f64::consts::FRAC_2_PI;

/// `sqrt(2 / pi)`: the integral of `|t| N(t)`.
pub const GRADIENT_WEIGHT: f64 = 0.797_884_560_802_865_4;

/// `4 / sqrt(2 pi e)`: the integral of `|t^2 - 1| N(t)`.
pub const HESSIAN_WEIGHT: f64 = 0.967_882_898_076_573_4;

/// `2 / pi`: the integral of `|t u| N(t) N(u)`.
pub const OFF_DIAGONAL_WEIGHT: f64 = FRAC_2_PI;

/// Distribution function of the gradient kernel.
pub fn gradient_cdf(t: f64) -> f64 {
    let tail = 0.5 * (-0.5 * t * t).exp();
    if t < 0.0 { tail } else { 1.0 - tail }
}

/// Inverse of [`gradient_cdf`]; `xi` outside of (0, 1) is moved to its ends.
pub fn gradient_quantile(xi: f64) -> f64 {
    let size = gradient_magnitude(2.0 * xi.min(1.0 - xi));
    if xi < 0.5 { -size } else { size }
}

/// `|t|` that a share `y` in (0, 1) of the kernel exceeds.
#[inline]
pub(crate) fn gradient_magnitude(y: f64) -> f64 {
    (-2.0 * y.clamp(f64::MIN_POSITIVE, 1.0).ln()).sqrt()
}

/// Distribution function of the Hessian kernel: a quarter of the mass lies in each outer lobe, half in the inner one.
pub fn hessian_cdf(t: f64) -> f64 {
    let c = 0.25 * t * (0.5 * (1.0 - t * t)).exp();
    if t < -1.0 {
        -c
    } else if t <= 1.0 {
        0.5 + c
    } else {
        1.0 - c
    }
}

/// Inverse of [`hessian_cdf`]; `xi` outside of (0, 1) is moved to its ends.
///
/// ```
/// use photofit_optim::sampled::kernel::{hessian_cdf, hessian_quantile};
/// for xi in [0.01, 0.2, 0.3, 0.6, 0.9] {
///     assert!((hessian_cdf(hessian_quantile(xi)) - xi).abs() < 1e-12);
/// }
/// ```
pub fn hessian_quantile(xi: f64) -> f64 {
    let tail = xi.min(1.0 - xi);
    let size = if tail < 0.25 { hessian_outer(4.0 * tail) } else { hessian_inner(4.0 * (xi - 0.5).abs()) };
    if xi < 0.5 { -size } else { size }
}

/// The root above 1 of `t e^((1-t^2)/2) = y`, for `y` in (0, 1).
#[inline]
pub(crate) fn hessian_outer(y: f64) -> f64 {
    let log = y.clamp(f64::MIN_POSITIVE, 1.0).ln();
    let p = (-log).sqrt();
    let start = if p < 0.6 {
        1.0 + p + p * p / 12.0
    } else {
        let s = 1.0 - 2.0 * log;
        (s + s.ln()).sqrt()
    };
    halley(start, log).max(1.0)
}

/// The root in [0, 1] of `t e^((1-t^2)/2) = y`, for `y` in (0, 1).
#[inline]
pub(crate) fn hessian_inner(y: f64) -> f64 {
    let y = y.clamp(f64::MIN_POSITIVE, 1.0);
    let log = y.ln();
    let start = if y < 0.3 {
        let q = y * (-0.5_f64).exp();
        q * (1.0 + 0.5 * q * q)
    } else {
        let p = (-log).sqrt();
        1.0 - p + p * p / 6.0
    };
    halley(start, log).min(1.0)
}

/// Three Halley steps on `ln t + (1 - t^2)/2 - log = 0`.
#[inline]
fn halley(mut t: f64, log: f64) -> f64 {
    for _ in 0..3 {
        let value = t.ln() + 0.5 * (1.0 - t * t) - log;
        let first = 1.0 / t - t;
        let second = -1.0 / (t * t) - 1.0;
        let denominator = 2.0 * first * first - value * second;
        // Zero only at the double root t = 1.
        if denominator.abs() > f64::MIN_POSITIVE {
            t -= 2.0 * value * first / denominator;
        }
    }
    t
}
