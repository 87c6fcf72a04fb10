//! Plastic: a diffuse base under a dielectric boundary, smooth and rough.
//!
//! Light that the boundary lets in is scattered diffusely, partly reflected back inside, and so on:
//! `T(wo) T(wi) / (pi eta^2) * d / (1 - d R)` with the diffuse reflectance `d`, the transmittance `T` of the boundary from
//! outside and its average reflectance `R` from inside. The linear variant has `1 - R` instead of `1 - d R`, which
//! leaves out how repeated absorption saturates colours. `T` and `R` of a rough boundary are those of single scattering
//! (as in Mitsuba), which loses some light: two percent at alpha 0.05.

use super::fresnel::{fresnel_average, fresnel_dielectric};
use super::refraction::{Facets, reflect, reflection, refract};
use super::{BsdfSample, Microfacet, Scatter, reflect_z, weighted};
use photofit_sampling::cosine_hemisphere;
use photofit_scalar::{Real, Vec3};

/// Plastic with a smooth boundary: a delta reflection and a diffuse lobe.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Plastic<T = f32> {
    /// Diffuse reflectance of the base.
    pub diffuse: Vec3<T>,
    /// Factor of the reflection, 1 for real plastic.
    pub specular: Vec3<T>,
    /// Saturated colours by repeated absorption.
    pub nonlinear: bool,
    ior: T,
    /// Average reflectance of the boundary from inside.
    inside: T,
}

impl<T: Real> Plastic<T> {
    /// Plastic of index `ior` (inside over outside, at least 1). Integrates numerically: make it once per material, and
    /// set the colours per point.
    pub fn new(diffuse: Vec3<T>, specular: Vec3<T>, ior: T, nonlinear: bool) -> Self {
        Self { diffuse, specular, nonlinear, ior, inside: fresnel_average(T::one() / ior) }
    }

    /// Probability of the reflection.
    #[inline(always)]
    fn chosen(&self, f: T) -> T {
        choose(f * self.specular.sum(), (T::one() - f) * self.diffuse.sum())
    }
}

/// Part of the first weight in the sum.
#[inline(always)]
fn choose<T: Real>(a: T, b: T) -> T {
    if a + b > T::zero() { a / (a + b) } else { T::one() }
}

/// `d / (1 - d R)`, or `d / (1 - R)` in the linear variant.
#[inline(always)]
fn repeated<T: Real>(diffuse: Vec3<T>, inside: T, nonlinear: bool) -> Vec3<T> {
    let one = T::one();
    diffuse.map(|d| d / (one - if nonlinear { d * inside } else { inside }))
}

impl<T: Real> Scatter<T> for Plastic<T> {
    #[inline]
    fn eval_pdf(&self, wo: Vec3<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        if !(wo.z > T::zero() && wi.z > T::zero()) {
            return (Vec3::zero(), T::zero());
        }
        let one = T::one();
        let (fo, fi) = (fresnel_dielectric(wo.z, self.ior), fresnel_dielectric(wi.z, self.ior));
        let cosine = wi.z * T::of(std::f64::consts::FRAC_1_PI);
        let factor = cosine * (one - fo) * (one - fi) / (self.ior * self.ior);
        (repeated(self.diffuse, self.inside, self.nonlinear) * factor, (one - self.chosen(fo)) * cosine)
    }

    #[inline]
    fn sample(&self, wo: Vec3<T>, lobe: T, u: [T; 2]) -> Option<BsdfSample<T>> {
        let one = T::one();
        if wo.z <= T::zero() || wo.z.is_nan() {
            return None;
        }
        let f = fresnel_dielectric(wo.z, self.ior);
        let chosen = self.chosen(f);
        if lobe < chosen {
            let weight = self.specular * (f / chosen);
            return Some(BsdfSample { wi: reflect_z(wo), weight, pdf: one, delta: true, eta: one });
        }
        let wi = cosine_hemisphere(u);
        weighted(wi, self.eval_pdf(wo, wi), one)
    }

    #[inline]
    fn is_delta(&self) -> bool {
        self.diffuse == Vec3::zero()
    }

    #[inline]
    fn albedo(&self, wo: Vec3<T>) -> Vec3<T> {
        let f = fresnel_dielectric(wo.z.abs(), self.ior);
        // What the base returns to all directions: the average of `1 - F` outside is `eta^2 (1 - R)`.
        let below =
            repeated(self.diffuse, self.inside, self.nonlinear) * ((T::one() - f) * (T::one() - self.inside));
        self.specular * f + below
    }
}

/// Terms of the Chebyshev series of the transmittance.
const TERMS: usize = 16;

/// Plastic with a rough boundary.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RoughPlastic<T = f32> {
    /// Diffuse reflectance of the base.
    pub diffuse: Vec3<T>,
    /// Factor of the reflection, 1 for real plastic.
    pub specular: Vec3<T>,
    /// Saturated colours by repeated absorption.
    pub nonlinear: bool,
    surface: Microfacet<T>,
    ior: T,
    /// Average reflectance of the boundary from inside.
    inside: T,
    /// Chebyshev series of the transmittance from outside over the cosine.
    transmittance: [T; TERMS],
}

impl<T: Real> RoughPlastic<T> {
    /// Plastic of index `ior` (inside over outside, at least 1) with an isotropic surface; alpha is floored at
    /// [`super::ALPHA_DELTA`].
    ///
    /// Integrates numerically (milliseconds): make it once per material, and set the colours per point.
    pub fn new(diffuse: Vec3<T>, specular: Vec3<T>, ior: T, nonlinear: bool, surface: Microfacet<T>) -> Self {
        // Total reflection sets in abruptly: many cosines, few microfacets.
        let steps = 256;
        let average = |reflected: &dyn Fn(f64) -> f64| {
            let cosine = |i: u32| (f64::from(i) + 0.5) / f64::from(steps);
            (0..steps).map(|i| 2.0 * cosine(i) * reflected(cosine(i))).sum::<f64>() / f64::from(steps)
        };
        Self::with_average(diffuse, specular, ior, nonlinear, surface, average)
    }

    /// As [`Self::new`], with the average reflectance from inside that Mitsuba computes: the mean over 64 cosines with
    /// both ends, 1.6 % below the integral. For pictures that are compared with its own.
    pub fn like_mitsuba(
        diffuse: Vec3<T>,
        specular: Vec3<T>,
        ior: T,
        nonlinear: bool,
        surface: Microfacet<T>,
    ) -> Self {
        let average = |reflected: &dyn Fn(f64) -> f64| {
            let cosine = |i: u32| f64::from(i) / 63.0;
            (1..64).map(|i| 2.0 * cosine(i) * reflected(cosine(i))).sum::<f64>() / 64.0
        };
        Self::with_average(diffuse, specular, ior, nonlinear, surface, average)
    }

    /// With a way to take the cosine-weighted average of a function of the cosine.
    fn with_average(
        diffuse: Vec3<T>,
        specular: Vec3<T>,
        ior: T,
        nonlinear: bool,
        surface: Microfacet<T>,
        average: impl Fn(&dyn Fn(f64) -> f64) -> f64,
    ) -> Self {
        let eta = ior.f64();
        let wide = Microfacet {
            distribution: surface.distribution,
            masking: surface.masking,
            alpha_x: surface.alpha_x.f64(),
            alpha_y: surface.alpha_y.f64(),
        };
        let angle = |k: usize| std::f64::consts::PI * (k as f64 + 0.5) / TERMS as f64;
        let at: [f64; TERMS] =
            std::array::from_fn(|k| integrate(&wide, 0.5 + 0.5 * angle(k).cos(), eta, Part::Passed, 32));
        let transmittance = std::array::from_fn(|n| {
            let sum: f64 = (0..TERMS).map(|k| at[k] * (n as f64 * angle(k)).cos()).sum();
            T::of(sum * if n == 0 { 1.0 } else { 2.0 } / TERMS as f64)
        });
        let inside = T::of(average(&|mu| integrate(&wide, mu, 1.0 / eta, Part::Reflected, 16)));
        Self { diffuse, specular, nonlinear, surface, ior, inside, transmittance }
    }

    /// Transmittance from outside, by Clenshaw's recurrence.
    #[inline]
    fn passed(&self, cosine: T) -> T {
        let x = cosine + cosine - T::one();
        let (mut b1, mut b2) = (T::zero(), T::zero());
        for &c in self.transmittance[1..].iter().rev() {
            (b1, b2) = (c + (x + x) * b1 - b2, b1);
        }
        (self.transmittance[0] + x * b1 - b2).clamp_to(T::zero(), T::one())
    }

    /// Probability of the reflection.
    #[inline(always)]
    fn chosen(&self, passed: T) -> T {
        choose((T::one() - passed) * self.specular.sum(), passed * self.diffuse.sum())
    }
}

/// Which part of the light that meets a rough boundary.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Reflected,
    Passed,
}

/// Part of the light from a direction of cosine `mu` that a rough boundary reflects or lets pass, by single scattering;
/// `n * n` points over the visible normals.
fn integrate(surface: &Microfacet<f64>, mu: f64, eta: f64, part: Part, n: usize) -> f64 {
    let wo = Vec3 { x: (1.0 - mu * mu).sqrt(), y: 0.0, z: mu };
    let mut sum = 0.0;
    for i in 0..n * n {
        let at = |k: usize| (k as f64 + 0.5) / n as f64;
        let m = surface.sample(wo, [at(i % n), at(i / n)]);
        let f = fresnel_dielectric(wo.dot(m).max(0.0), eta);
        let (wi, factor, right) = match part {
            Part::Reflected => (Some(reflect(wo, m)), f, 1.0),
            Part::Passed => (refract(wo, m, eta), 1.0 - f, -1.0),
        };
        if let Some(wi) = wi.filter(|wi| wi.z * right > 0.0) {
            // The masking of both directions over that of `wo`.
            sum += factor * 4.0 * surface.visibility(wo, wi) * wi.z.abs() * surface.masked(wo);
        }
    }
    sum / (n * n) as f64
}

impl<T: Real> Scatter<T> for RoughPlastic<T> {
    #[inline]
    fn eval_pdf(&self, wo: Vec3<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        if !(wo.z > T::zero() && wi.z > T::zero()) {
            return (Vec3::zero(), T::zero());
        }
        let one = T::one();
        let (to, ti) = (self.passed(wo.z), self.passed(wi.z));
        let chosen = self.chosen(to);
        let cosine = wi.z * T::of(std::f64::consts::FRAC_1_PI);
        let factor = cosine * to * ti / (self.ior * self.ior);
        let mut value = repeated(self.diffuse, self.inside, self.nonlinear) * factor;
        let mut pdf = (one - chosen) * cosine;
        if let Some(e) = reflection(&self.surface, wo, wi) {
            value += self.specular * (fresnel_dielectric(e.cosine, self.ior) * e.value);
            pdf += chosen * e.pdf;
        }
        (value, pdf)
    }

    #[inline]
    fn sample(&self, wo: Vec3<T>, lobe: T, u: [T; 2]) -> Option<BsdfSample<T>> {
        if wo.z <= T::zero() || wo.z.is_nan() {
            return None;
        }
        let wi = if lobe < self.chosen(self.passed(wo.z)) {
            reflect(wo, self.surface.sample(wo, u))
        } else {
            cosine_hemisphere(u)
        };
        weighted(wi, self.eval_pdf(wo, wi), T::one())
    }

    #[inline]
    fn albedo(&self, wo: Vec3<T>) -> Vec3<T> {
        let passed = self.passed(wo.z.abs());
        let below = repeated(self.diffuse, self.inside, self.nonlinear) * (passed * (T::one() - self.inside));
        self.specular * (T::one() - passed) + below
    }
}
