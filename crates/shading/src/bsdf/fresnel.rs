//! Fresnel's equations for unpolarised light.

use super::refraction::refracted_cosine;
use photofit_scalar::{Real, Vec3};

/// Reflectance of a dielectric for the cosine `c >= 0` of the incident direction; `eta` is the index of the other side
/// over that of the incident side. 1 at total internal reflection.
///
/// ```
/// use photofit_shading::bsdf::fresnel_dielectric;
/// assert!((fresnel_dielectric(1.0_f64, 1.5) - 0.04).abs() < 1e-12);
/// assert_eq!(fresnel_dielectric(0.5_f64, 1.0 / 1.5), 1.0);
/// ```
#[inline]
pub fn fresnel_dielectric<T: Real>(c: T, eta: T) -> T {
    let Some(t) = refracted_cosine(c, eta) else { return T::one() };
    let sum = |a: T, b: T| if a + b > T::zero() { (a - b) / (a + b) } else { T::one() };
    let (s, p) = (sum(c, eta * t), sum(eta * c, t));
    (s * s + p * p) * T::of(0.5)
}

/// Reflectance of a conductor of complex index `eta + i k`, per channel, relative to the incident side.
#[inline]
pub fn fresnel_conductor<T: Real>(c: T, eta: Vec3<T>, k: Vec3<T>) -> Vec3<T> {
    let (c2, s2) = (c * c, T::one() - c * c);
    let channel = |eta: T, k: T| {
        let (eta2, k2) = (eta * eta, k * k);
        let t = eta2 - k2 - s2;
        let ab = (t * t + T::of(4.0) * eta2 * k2).sqrt();
        let a = ((ab + t) * T::of(0.5)).relu().sqrt();
        let (sum, cross) = (ab + c2, T::of(2.0) * c * a);
        let s = (sum - cross) / (sum + cross);
        let (sum, cross) = (c2 * ab + s2 * s2, cross * s2);
        let p = if sum + cross > T::zero() { (sum - cross) / (sum + cross) } else { T::one() };
        T::of(0.5) * s * (T::one() + p)
    };
    Vec3 { x: channel(eta.x, k.x), y: channel(eta.y, k.y), z: channel(eta.z, k.z) }
}

/// Average `2 int mu F(mu) dmu` of the reflectance of a dielectric: of uniform light from the incident side.
///
/// Light from the denser side follows from the other one by `1 - F' = (1 - F) / eta^2`, whose integrand is smooth.
pub fn fresnel_average<T: Real>(eta: T) -> T {
    let eta = eta.f64();
    let outer = if eta < 1.0 { 1.0 / eta } else { eta };
    let steps = 512;
    let sum: f64 = (0..steps)
        .map(|i| {
            // Points dense at grazing: mu = x^2.
            let x = (f64::from(i) + 0.5) / f64::from(steps);
            fresnel_dielectric(x * x, outer) * 4.0 * x * x * x
        })
        .sum();
    let average = sum / f64::from(steps);
    T::of(if eta < 1.0 { 1.0 - (1.0 - average) * eta * eta } else { average })
}
