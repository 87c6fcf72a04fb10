//! Metals by their complex index of refraction, smooth and rough.

use super::fresnel::fresnel_conductor;
use super::refraction::{Facets, reflect, reflection};
use super::{BsdfSample, Microfacet, Scatter, reflect_z, weighted};
use photofit_scalar::{Real, Vec3};

/// A smooth metal.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Conductor<T = f32> {
    /// Real part of the index of refraction per channel, relative to the outside.
    pub eta: Vec3<T>,
    /// Extinction per channel.
    pub k: Vec3<T>,
    /// Factor of the reflectance, 1 for real metals.
    pub reflectance: Vec3<T>,
}

impl<T: Real> Conductor<T> {
    #[inline(always)]
    pub(super) fn fresnel(&self, cosine: T) -> Vec3<T> {
        fresnel_conductor(cosine, self.eta, self.k).mul(self.reflectance)
    }
}

impl<T: Real> Scatter<T> for Conductor<T> {
    #[inline]
    fn eval_pdf(&self, _: Vec3<T>, _: Vec3<T>) -> (Vec3<T>, T) {
        (Vec3::zero(), T::zero())
    }

    #[inline]
    fn sample(&self, wo: Vec3<T>, _: T, _: [T; 2]) -> Option<BsdfSample<T>> {
        let one = T::one();
        if wo.z <= T::zero() || wo.z.is_nan() {
            return None;
        }
        Some(BsdfSample { wi: reflect_z(wo), weight: self.fresnel(wo.z), pdf: one, delta: true, eta: one })
    }

    #[inline]
    fn is_delta(&self) -> bool {
        true
    }

    #[inline]
    fn albedo(&self, wo: Vec3<T>) -> Vec3<T> {
        self.fresnel(wo.z.abs())
    }
}

/// A rough metal: `F D G / (4 wo.z wi.z)`, single scattering; a [`Conductor`] where the surface is smooth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RoughConductor<T = f32> {
    /// The metal.
    pub metal: Conductor<T>,
    /// The surface.
    pub surface: Microfacet<T>,
}

impl<T: Real> Scatter<T> for RoughConductor<T> {
    #[inline]
    fn eval_pdf(&self, wo: Vec3<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        if !(wo.z > T::zero() && wi.z > T::zero()) || self.surface.is_smooth() {
            return (Vec3::zero(), T::zero());
        }
        match reflection(&self.surface, wo, wi) {
            Some(e) => (self.metal.fresnel(e.cosine) * e.value, e.pdf),
            None => (Vec3::zero(), T::zero()),
        }
    }

    #[inline]
    fn sample(&self, wo: Vec3<T>, lobe: T, u: [T; 2]) -> Option<BsdfSample<T>> {
        if self.surface.is_smooth() {
            return self.metal.sample(wo, lobe, u);
        }
        if wo.z <= T::zero() || wo.z.is_nan() {
            return None;
        }
        let wi = reflect(wo, self.surface.sample(wo, u));
        weighted(wi, self.eval_pdf(wo, wi), T::one())
    }

    #[inline]
    fn is_delta(&self) -> bool {
        self.surface.is_smooth()
    }

    #[inline]
    fn albedo(&self, wo: Vec3<T>) -> Vec3<T> {
        self.metal.albedo(wo)
    }
}
