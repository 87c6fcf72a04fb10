//! The Beckmann distribution of microfacet normals in the local frame: Gaussian slopes (Beckmann and Spizzichino 1963;
//! Walter et al. 2007), with Smith masking and sampling of visible normals by slopes (Heitz and d'Eon 2014).

use super::refraction::Facets;
use photofit_sampling::inverse_normal_cdf;
use photofit_scalar::{Real, Vec3, vec3};
use std::f64::consts::{FRAC_1_PI, FRAC_1_SQRT_2, FRAC_2_SQRT_PI};

/// `1 / sqrt(pi)`.
const FRAC_1_SQRT_PI: f64 = 0.5 * FRAC_2_SQRT_PI;

/// The distribution: alpha along x and y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Beckmann<T> {
    pub(super) ax: T,
    pub(super) ay: T,
}

impl<T: Real> Facets<T> for Beckmann<T> {
    #[inline]
    fn d(&self, m: Vec3<T>) -> T {
        let z2 = m.z * m.z;
        if z2 <= T::of(1e-12) {
            return T::zero();
        }
        let (x, y) = (m.x / self.ax, m.y / self.ay);
        let d = T::of(FRAC_1_PI) * (-(x * x + y * y) / z2).exp();
        d / (self.ax * self.ay * z2 * z2)
    }

    /// `|z| (1 + Lambda)`, `Lambda = (exp(-a^2) / (a sqrt(pi)) - erfc(a)) / 2`, `a = |z|` over the length of
    /// `(ax x, ay y)`.
    #[inline]
    fn masked(&self, v: Vec3<T>) -> T {
        let z = v.z.abs();
        let (x, y) = (self.ax * v.x, self.ay * v.y);
        let stretch = (x * x + y * y).sqrt();
        if stretch <= T::of(1e-12) * z {
            return z;
        }
        let a = z / stretch;
        let lost = (stretch * T::of(FRAC_1_SQRT_PI) - z * scaled_erfc(a)).relu();
        z + T::of(0.5) * (-a * a).exp() * lost
    }

    #[inline]
    fn visibility(&self, wo: Vec3<T>, wi: Vec3<T>) -> T {
        let (zo, zi) = (wo.z.abs(), wi.z.abs());
        T::of(0.25) / (zi * self.masked(wo) + zo * self.masked(wi) - zo * zi)
    }

    fn sample(&self, wo: Vec3<T>, u: [T; 2]) -> Vec3<T> {
        let v = vec3(self.ax * wo.x, self.ay * wo.y, wo.z);
        let across = (v.x * v.x + v.y * v.y).sqrt();
        let (cos, sin) =
            if across > T::zero() { (v.x / across, v.y / across) } else { (T::one(), T::zero()) };
        let tangent = (across / v.z).f64();
        let along = T::of(visible_slope(tangent, u[0].f64()));
        let beside = T::of(gaussian_slope(u[1].f64()));
        let x = self.ax * (cos * along - sin * beside);
        let y = self.ay * (sin * along + cos * beside);
        vec3(-x, -y, T::one()).normalize_or_zero()
    }

    #[inline]
    fn alpha_max(&self) -> T {
        self.ax.max(self.ay)
    }
}

/// `erfc(x) exp(x^2)` for `x >= 0`, to 2e-7 relative to the exponential (Abramowitz and Stegun 1964, 7.1.26).
#[inline]
fn scaled_erfc<T: Real>(x: T) -> T {
    let t = T::one() / (T::one() + T::of(0.327_591_1) * x);
    let p = [0.254_829_592, -0.284_496_736, 1.421_413_741, -1.453_152_027, 1.061_405_429];
    t * p.iter().rev().fold(T::zero(), |sum, &c| sum * t + T::of(c))
}

/// A slope of density `exp(-s^2) / sqrt(pi)`.
fn gaussian_slope(u: f64) -> f64 {
    inverse_normal_cdf(u.clamp(1e-12, 1.0 - 1e-12)) * FRAC_1_SQRT_2
}

/// The slope along the view direction of tangent `t` among visible normals: density proportional to
/// `(1 - s t) exp(-s^2)` for `s < 1 / t`.
///
/// The distribution function `(1 + erf s) / 2 + t exp(-s^2) / (2 sqrt(pi))` is inverted by Newton steps that bisection
/// keeps inside of a bracket.
fn visible_slope(t: f64, u: f64) -> f64 {
    if t <= 1e-9 {
        return gaussian_slope(u);
    }
    let cumulative = |s: f64| {
        let tail = (-s * s).exp();
        let erfc = scaled_erfc(s.abs()) * tail;
        let below = if s < 0.0 { 0.5 * erfc } else { 1.0 - 0.5 * erfc };
        (below + 0.5 * FRAC_1_SQRT_PI * t * tail, FRAC_1_SQRT_PI * (1.0 - s * t) * tail)
    };
    let (mut low, mut high) = (-6.0, (1.0 / t).min(6.0));
    let target = u * cumulative(high).0;
    let mut s = gaussian_slope(u).clamp(low, high);
    for _ in 0..64 {
        let (f, density) = cumulative(s);
        if f > target {
            high = s;
        } else {
            low = s;
        }
        let newton = s - (f - target) / density;
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        let step = (next - s).abs();
        s = next;
        if step < 1e-9 {
            break;
        }
    }
    s
}
