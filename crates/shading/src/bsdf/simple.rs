//! BSDFs without parameters worth a file: nothing, Lambert, and the wrapper that scatters on both sides.

use super::{BsdfSample, Scatter, mirror_z, weighted};
use photofit_sampling::cosine_hemisphere;
use photofit_scalar::{Real, Vec3};

/// A surface that is not there: light passes straight through.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Null;

impl<T: Real> Scatter<T> for Null {
    #[inline]
    fn eval_pdf(&self, _: Vec3<T>, _: Vec3<T>) -> (Vec3<T>, T) {
        (Vec3::zero(), T::zero())
    }

    #[inline]
    fn sample(&self, wo: Vec3<T>, _: T, _: [T; 2]) -> Option<BsdfSample<T>> {
        let one = T::one();
        Some(BsdfSample { wi: -wo, weight: Vec3::splat(one), pdf: one, delta: true, eta: one })
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
    fn albedo(&self, _: Vec3<T>) -> Vec3<T> {
        Vec3::splat(T::one())
    }
}

/// Lambertian reflection, `f = reflectance / pi`; sampled by the cosine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Diffuse<T = f32> {
    /// Albedo, in `[0, 1]` per channel.
    pub reflectance: Vec3<T>,
}

impl<T: Real> Scatter<T> for Diffuse<T> {
    #[inline]
    fn eval_pdf(&self, wo: Vec3<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        if wo.z > T::zero() && wi.z > T::zero() {
            let pdf = wi.z * T::of(std::f64::consts::FRAC_1_PI);
            (self.reflectance * pdf, pdf)
        } else {
            (Vec3::zero(), T::zero())
        }
    }

    #[inline]
    fn sample(&self, wo: Vec3<T>, _: T, u: [T; 2]) -> Option<BsdfSample<T>> {
        let wi = cosine_hemisphere(u);
        weighted(wi, self.eval_pdf(wo, wi), T::one())
    }

    #[inline]
    fn albedo(&self, _: Vec3<T>) -> Vec3<T> {
        self.reflectance
    }
}

/// A one-sided BSDF that looks the same from below as from above.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TwoSided<B>(pub B);

impl<T: Real, B: Scatter<T>> Scatter<T> for TwoSided<B> {
    #[inline]
    fn eval_pdf(&self, wo: Vec3<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        if wo.z < T::zero() { self.0.eval_pdf(mirror_z(wo), mirror_z(wi)) } else { self.0.eval_pdf(wo, wi) }
    }

    #[inline]
    fn sample(&self, wo: Vec3<T>, lobe: T, u: [T; 2]) -> Option<BsdfSample<T>> {
        if wo.z < T::zero() {
            self.0.sample(mirror_z(wo), lobe, u).map(|s| BsdfSample { wi: mirror_z(s.wi), ..s })
        } else {
            self.0.sample(wo, lobe, u)
        }
    }

    #[inline]
    fn is_delta(&self) -> bool {
        self.0.is_delta()
    }

    #[inline]
    fn transmits(&self) -> bool {
        self.0.transmits()
    }

    #[inline]
    fn eta(&self, wo: Vec3<T>) -> T {
        self.0.eta(if wo.z < T::zero() { mirror_z(wo) } else { wo })
    }

    #[inline]
    fn albedo(&self, wo: Vec3<T>) -> Vec3<T> {
        self.0.albedo(if wo.z < T::zero() { mirror_z(wo) } else { wo })
    }
}
