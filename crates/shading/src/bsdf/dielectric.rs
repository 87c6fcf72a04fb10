//! Glass: smooth, thin and rough.

use super::fresnel::fresnel_dielectric;
use super::refraction::{Facets, REFRACTION_DELTA, reflect, reflection, refract, refraction};
use super::{BsdfSample, Microfacet, Scatter, TransportMode, mirror_z, reflect_z, weighted};
use photofit_scalar::{Real, Vec3, vec3};

/// The smooth boundary of a transparent medium: the inside is below (`wo.z < 0`).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Dielectric<T = f32> {
    /// Index of refraction inside over that outside, positive.
    pub ior: T,
    /// Factor of reflected light, 1 for real glass.
    pub reflectance: Vec3<T>,
    /// Factor of refracted light, 1 for real glass.
    pub transmittance: Vec3<T>,
    /// What is carried.
    pub mode: TransportMode,
}

impl<T: Real> Dielectric<T> {
    /// Relative index of the other side, and the frame with `wo` above.
    #[inline(always)]
    fn sides(&self, wo: Vec3<T>) -> (T, Vec3<T>, bool) {
        if wo.z < T::zero() { (T::one() / self.ior, mirror_z(wo), true) } else { (self.ior, wo, false) }
    }

    /// Factor of refracted light.
    #[inline(always)]
    fn passed(&self, eta: T) -> Vec3<T> {
        match self.mode {
            TransportMode::Radiance => self.transmittance / (eta * eta),
            TransportMode::Importance => self.transmittance,
        }
    }
}

impl<T: Real> Scatter<T> for Dielectric<T> {
    #[inline]
    fn eval_pdf(&self, _: Vec3<T>, _: Vec3<T>) -> (Vec3<T>, T) {
        (Vec3::zero(), T::zero())
    }

    #[inline]
    fn sample(&self, wo: Vec3<T>, lobe: T, _: [T; 2]) -> Option<BsdfSample<T>> {
        let (zero, one) = (T::zero(), T::one());
        let (eta, up, below) = self.sides(wo);
        let f = fresnel_dielectric(up.z, eta);
        if lobe < f {
            let wi = reflect_z(wo);
            return Some(BsdfSample { wi, weight: self.reflectance, pdf: one, delta: true, eta: one });
        }
        let wi = refract(up, vec3(zero, zero, one), eta).filter(|wi| wi.z < zero)?;
        let wi = if below { mirror_z(wi) } else { wi };
        Some(BsdfSample { wi, weight: self.passed(eta), pdf: one, delta: true, eta })
    }

    #[inline]
    fn is_delta(&self) -> bool {
        true
    }

    #[inline]
    fn transmits(&self) -> bool {
        true
    }

    #[inline]
    fn eta(&self, wo: Vec3<T>) -> T {
        self.sides(wo).0
    }

    #[inline]
    fn albedo(&self, wo: Vec3<T>) -> Vec3<T> {
        let (eta, up, _) = self.sides(wo);
        let f = fresnel_dielectric(up.z, eta);
        self.reflectance * f + self.transmittance * (T::one() - f)
    }
}

/// A pane: two parallel smooth boundaries without offset, all reflections between them summed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ThinDielectric<T = f32> {
    /// Index of refraction inside over that outside, positive.
    pub ior: T,
    /// Factor of reflected light.
    pub reflectance: Vec3<T>,
    /// Factor of transmitted light.
    pub transmittance: Vec3<T>,
}

impl<T: Real> ThinDielectric<T> {
    /// Part of light at this cosine that goes straight through.
    #[inline]
    pub fn straight(&self, cosine: T) -> Vec3<T> {
        self.transmittance * (T::one() - self.reflected(cosine))
    }

    /// `R + T^2 R + T^2 R^3 + ... = 2 R / (1 + R)`.
    #[inline(always)]
    fn reflected(&self, cosine: T) -> T {
        let r = fresnel_dielectric(cosine, self.ior);
        (r + r) / (T::one() + r)
    }
}

impl<T: Real> Scatter<T> for ThinDielectric<T> {
    #[inline]
    fn eval_pdf(&self, _: Vec3<T>, _: Vec3<T>) -> (Vec3<T>, T) {
        (Vec3::zero(), T::zero())
    }

    #[inline]
    fn sample(&self, wo: Vec3<T>, lobe: T, _: [T; 2]) -> Option<BsdfSample<T>> {
        let one = T::one();
        let (wi, weight) = if lobe < self.reflected(wo.z.abs()) {
            (reflect_z(wo), self.reflectance)
        } else {
            (-wo, self.transmittance)
        };
        Some(BsdfSample { wi, weight, pdf: one, delta: true, eta: one })
    }

    #[inline]
    fn is_delta(&self) -> bool {
        true
    }

    #[inline]
    fn transmits(&self) -> bool {
        true
    }

    #[inline]
    fn albedo(&self, wo: Vec3<T>) -> Vec3<T> {
        self.reflectance * self.reflected(wo.z.abs()) + self.straight(wo.z.abs())
    }
}

/// The rough boundary of a transparent medium (Walter et al. 2007), single scattering.
///
/// A [`Dielectric`] where the surface is smooth. Where only the refracted lobe is narrower than directions resolve
/// (indices that nearly agree), that lobe is a delta lobe.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RoughDielectric<T = f32> {
    /// The glass.
    pub glass: Dielectric<T>,
    /// The surface.
    pub surface: Microfacet<T>,
}

/// Least probability of reflection where refraction is a delta lobe: microfacets that are seen at grazing angles
/// reflect more than the plane.
const REFLECTION_MIN: f64 = 0.05;

impl<T: Real> RoughDielectric<T> {
    /// Whether refraction alone is a delta lobe.
    #[inline(always)]
    fn straight(&self) -> bool {
        self.surface.alpha_max() * (self.glass.ior - T::one()).abs() < T::of(REFRACTION_DELTA)
    }

    /// Probability of reflection where refraction is a delta lobe.
    #[inline(always)]
    fn reflection_probability(f: T) -> T {
        f.max(T::of(REFLECTION_MIN))
    }
}

impl<T: Real> Scatter<T> for RoughDielectric<T> {
    #[inline]
    fn eval_pdf(&self, wo: Vec3<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        let zero = (Vec3::zero(), T::zero());
        if self.surface.is_smooth() {
            return zero;
        }
        let (eta, up, below) = self.glass.sides(wo);
        let wi = if below { mirror_z(wi) } else { wi };
        if up.z > T::zero() && wi.z > T::zero() {
            let Some(e) = reflection(&self.surface, up, wi) else { return zero };
            let f = fresnel_dielectric(e.cosine, eta);
            let chosen =
                if self.straight() { Self::reflection_probability(fresnel_dielectric(up.z, eta)) } else { f };
            (self.glass.reflectance * (f * e.value), chosen * e.pdf)
        } else if up.z > T::zero() && wi.z < T::zero() && !self.straight() {
            let Some(e) = refraction(&self.surface, up, wi, eta) else { return zero };
            let t = T::one() - fresnel_dielectric(e.cosine, eta);
            (self.glass.passed(eta) * (t * e.value), t * e.pdf)
        } else {
            zero
        }
    }

    #[inline]
    fn sample(&self, wo: Vec3<T>, lobe: T, u: [T; 2]) -> Option<BsdfSample<T>> {
        if self.surface.is_smooth() {
            return self.glass.sample(wo, lobe, u);
        }
        let (zero, one) = (T::zero(), T::one());
        let (eta, up, below) = self.glass.sides(wo);
        if up.z <= zero || up.z.is_nan() {
            return None;
        }
        let out = |wi: Vec3<T>| if below { mirror_z(wi) } else { wi };
        let m = self.surface.sample(up, u);
        let f = fresnel_dielectric(if self.straight() { up.z } else { up.dot(m) }, eta);
        let chosen = if self.straight() { Self::reflection_probability(f) } else { f };
        if lobe < chosen {
            let wi = reflect(up, m);
            return if wi.z > zero { weighted(out(wi), self.eval_pdf(wo, out(wi)), one) } else { None };
        }
        if self.straight() {
            let wi = refract(up, vec3(zero, zero, one), eta).filter(|wi| wi.z < zero)?;
            let weight = self.glass.passed(eta) * ((one - f) / (one - chosen));
            return Some(BsdfSample { wi: out(wi), weight, pdf: one, delta: true, eta });
        }
        let wi = refract(up, m, eta).filter(|wi| wi.z < zero)?;
        weighted(out(wi), self.eval_pdf(wo, out(wi)), eta)
    }

    #[inline]
    fn is_delta(&self) -> bool {
        self.surface.is_smooth()
    }

    #[inline]
    fn transmits(&self) -> bool {
        true
    }

    #[inline]
    fn eta(&self, wo: Vec3<T>) -> T {
        self.glass.eta(wo)
    }

    #[inline]
    fn albedo(&self, wo: Vec3<T>) -> Vec3<T> {
        self.glass.albedo(wo)
    }
}
