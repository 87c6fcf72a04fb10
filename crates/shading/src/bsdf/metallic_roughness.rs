//! The metallic-roughness model of glTF 2.0 without extensions: Lambert plus isotropic GGX.

use super::energy::{Energy, SpecularAlbedo, schlick_weight};
use super::ggx::Ggx;
use super::refraction::{Facets, reflect};
use super::{ALPHA_DELTA, BsdfSample, Scatter, reflect_z, weighted};
use crate::surface::Surface;
use photofit_sampling::cosine_hemisphere;
use photofit_scalar::{Real, Vec3};

/// `diffuse / pi + F D V`, the same as [`crate::eval`] (formulas there) in the local frame.
///
/// Sampling chooses between the cosine and the GGX distribution of visible normals by the albedos that Schlick's term
/// predicts. Differences to [`crate::eval`]: alpha is not floored at the rasterizer's roughness but becomes a delta
/// lobe below [`ALPHA_DELTA`]; the cosine of the viewer is not floored.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MetallicRoughness<T = f32> {
    /// Albedo of the Lambertian lobe: `base_color (1 - metallic)`.
    pub diffuse: Vec3<T>,
    /// Specular reflectance at normal incidence.
    pub f0: Vec3<T>,
    /// Specular reflectance at grazing incidence: 1 but for `KHR_materials_specular`.
    pub f90: T,
    /// GGX alpha: the square of the perceptual roughness.
    pub alpha: T,
    /// Single or multiple scattering.
    pub energy: Energy,
}

impl<T: Real> MetallicRoughness<T> {
    /// The BSDF of a material of the rasterizer.
    #[inline]
    pub fn new(surface: &Surface<T>, energy: Energy) -> Self {
        let lobes = surface.lobes();
        let roughness = surface.roughness.relu();
        Self { diffuse: lobes.diffuse, f0: lobes.f0, f90: T::one(), alpha: roughness * roughness, energy }
    }

    #[inline(always)]
    fn is_smooth(&self) -> bool {
        self.alpha < T::of(ALPHA_DELTA)
    }

    /// Schlick's term for a cosine.
    #[inline(always)]
    fn fresnel(&self, cosine: T) -> Vec3<T> {
        let p = schlick_weight(cosine);
        self.f0 * (T::one() - p) + Vec3::splat(self.f90 * p)
    }

    /// Probability of the specular lobe, and the value of the lobe that is sampled by the cosine as a function of
    /// `wi`, without cosine.
    #[inline(always)]
    fn prepare(&self, wo: Vec3<T>) -> Prepared<T> {
        let (specular, broad, compensation) = match self.energy {
            Energy::Single => (self.fresnel(wo.z).sum(), self.diffuse.sum(), None),
            Energy::Compensated => {
                let albedo = SpecularAlbedo::new(self.f0, self.f90, self.alpha);
                let (e_o, lost_o) = albedo.at(wo.z);
                let multiple = albedo.multiple_albedo(lost_o).sum();
                let rest = self.diffuse.mul(e_o.map(|e| (T::one() - e).relu())).sum();
                ((e_o.sum() - multiple).relu(), rest + multiple, Some((albedo, e_o, lost_o)))
            }
        };
        let sum = specular + broad;
        Prepared { specular: if sum > T::zero() { specular / sum } else { T::one() }, compensation }
    }

    /// Value without cosine of what is sampled by the cosine: the Lambertian lobe and multiple scattering.
    #[inline(always)]
    fn broad(&self, prepared: &Prepared<T>, wi: Vec3<T>) -> Vec3<T> {
        let inv_pi = T::of(std::f64::consts::FRAC_1_PI);
        match &prepared.compensation {
            None => self.diffuse * inv_pi,
            Some((albedo, e_o, lost_o)) => {
                let (e_i, lost_i) = albedo.at(wi.z);
                self.diffuse.mul(albedo.below(*e_o, e_i)) * inv_pi + albedo.multiple(*lost_o, lost_i)
            }
        }
    }

    #[inline(always)]
    fn evaluate(&self, prepared: &Prepared<T>, wo: Vec3<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        let cosine_pdf = wi.z * T::of(std::f64::consts::FRAC_1_PI);
        let mut value = self.broad(prepared, wi) * wi.z;
        let mut pdf = (T::one() - prepared.specular) * cosine_pdf;
        if !self.is_smooth() {
            let r = Ggx::isotropic(self.alpha).reflection(wo, wi);
            value += self.fresnel(r.cosine) * (r.value * wi.z);
            pdf += prepared.specular * r.pdf;
        }
        (value, pdf)
    }
}

/// What depends on `wo` alone.
struct Prepared<T> {
    /// Probability of the specular lobe.
    specular: T,
    /// With multiple scattering: the albedos, and those towards `wo`.
    compensation: Option<(SpecularAlbedo<T>, Vec3<T>, T)>,
}

impl<T: Real> Scatter<T> for MetallicRoughness<T> {
    #[inline]
    fn eval_pdf(&self, wo: Vec3<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        if !(wo.z > T::zero() && wi.z > T::zero()) {
            return (Vec3::zero(), T::zero());
        }
        self.evaluate(&self.prepare(wo), wo, wi)
    }

    #[inline]
    fn sample(&self, wo: Vec3<T>, lobe: T, u: [T; 2]) -> Option<BsdfSample<T>> {
        let (zero, one) = (T::zero(), T::one());
        if wo.z <= zero || wo.z.is_nan() {
            return None;
        }
        let prepared = self.prepare(wo);
        let wi = if lobe >= prepared.specular {
            cosine_hemisphere(u)
        } else if self.is_smooth() {
            let weight = self.fresnel(wo.z) / prepared.specular;
            return Some(BsdfSample { wi: reflect_z(wo), weight, pdf: one, delta: true, eta: one });
        } else {
            reflect(wo, Ggx::isotropic(self.alpha).sample(wo, u))
        };
        if wi.z > zero { weighted(wi, self.evaluate(&prepared, wo, wi), one) } else { None }
    }

    #[inline]
    fn is_delta(&self) -> bool {
        self.is_smooth() && self.diffuse == Vec3::zero()
    }

    #[inline]
    fn transmits(&self) -> bool {
        false
    }

    #[inline]
    fn albedo(&self, wo: Vec3<T>) -> Vec3<T> {
        let albedo = SpecularAlbedo::new(self.f0, self.f90, self.alpha);
        let (e, lost) = albedo.at(wo.z.abs());
        match self.energy {
            Energy::Single => self.diffuse + e - albedo.multiple_albedo(lost),
            Energy::Compensated => e + self.diffuse.mul(e.map(|e| (T::one() - e).relu())),
        }
    }
}
