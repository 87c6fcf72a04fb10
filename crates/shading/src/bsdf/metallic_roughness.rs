//! The metallic-roughness model of glTF 2.0 without extensions: Lambert plus isotropic GGX.

use super::ggx::Ggx;
use super::refraction::{Facets, reflect};
use super::{BsdfSample, Scatter, weighted};
use crate::energy::{Energy, SpecularAlbedo, schlick_weight};
use crate::eval::{Compensation, LobesEvalGradient, eval_lobes_vjp, value};
use crate::ggx::Terms;
use crate::surface::{Lobes, Surface};
use photofit_sampling::cosine_hemisphere;
use photofit_scalar::{Real, Vec3, vec3};

/// The model of [`crate::eval()`], by the same code, in the local frame, with sampling.
///
/// It has no delta lobe: a mirror is a lobe of the roughness [`crate::ROUGHNESS_MIN`], as for the rasterizer. Sampling
/// chooses between the cosine and the GGX distribution of visible normals by the albedos that Schlick's term predicts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MetallicRoughness<T = f32> {
    /// The lobes; the roughness is at least [`crate::ROUGHNESS_MIN`].
    pub lobes: Lobes<T>,
    /// Single or multiple scattering.
    pub energy: Energy,
}

impl<T: Real> MetallicRoughness<T> {
    /// The BSDF of a material of the rasterizer.
    #[inline]
    pub fn new(surface: &Surface<T>, energy: Energy) -> Self {
        Self { lobes: surface.lobes(), energy }
    }

    /// Adjoint of [`Scatter::eval`] for the gradient `g` of the value: with respect to the lobes
    /// ([`Surface::lobes_vjp`] leads on to the material), to the normal (in the local frame, where it is +z) and to both
    /// directions.
    ///
    /// Densities and probabilities have none: estimators hold them (path replay).
    #[inline]
    pub fn eval_vjp(&self, wo: Vec3<T>, wi: Vec3<T>, g: Vec3<T>) -> LobesEvalGradient<T> {
        if !(wo.z > T::zero() && wi.z > T::zero()) {
            return LobesEvalGradient::default();
        }
        let up = vec3(T::zero(), T::zero(), T::one());
        let compensation = Compensation::by(self.energy, &self.lobes, wo.z);
        eval_lobes_vjp(&self.lobes, compensation.as_ref(), up, wo, wi, g).1
    }

    /// Schlick's term for a cosine.
    #[inline(always)]
    fn fresnel(&self, cosine: T) -> Vec3<T> {
        let p = schlick_weight(cosine);
        self.lobes.f0 * (T::one() - p) + Vec3::splat(self.lobes.f90 * p)
    }

    #[inline(always)]
    fn prepare(&self, wo: Vec3<T>) -> Prepared<T> {
        let compensation = Compensation::by(self.energy, &self.lobes, wo.z);
        let (specular, broad) = match &compensation {
            None => (self.fresnel(wo.z).sum(), self.lobes.diffuse.sum()),
            Some(c) => {
                let whole = c.albedo.of([c.viewer.scale, c.viewer.bias]);
                let broad = c.albedo.broad_albedo(self.lobes.diffuse, &c.viewer).sum();
                (c.albedo.single(whole).sum().relu(), broad)
            }
        };
        let sum = specular + broad;
        Prepared { specular: if sum > T::zero() { specular / sum } else { T::one() }, compensation }
    }

    #[inline(always)]
    fn evaluate(&self, prepared: &Prepared<T>, wo: Vec3<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        let terms = Terms::in_local(self.lobes.roughness, wo, wi);
        let cosine_pdf = wi.z * T::of(std::f64::consts::FRAC_1_PI);
        let pdf = (T::one() - prepared.specular) * cosine_pdf + prepared.specular * terms.pdf();
        (value(&self.lobes, prepared.compensation.as_ref(), &terms), pdf)
    }

    #[inline(always)]
    fn ggx(&self) -> Ggx<T> {
        Ggx::isotropic(self.lobes.roughness * self.lobes.roughness)
    }
}

/// What depends on `wo` alone.
struct Prepared<T> {
    /// Probability of the specular lobe.
    specular: T,
    compensation: Option<Compensation<T>>,
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
        } else {
            reflect(wo, self.ggx().sample(wo, u))
        };
        if wi.z > zero { weighted(wi, self.evaluate(&prepared, wo, wi), one) } else { None }
    }

    #[inline]
    fn albedo(&self, wo: Vec3<T>) -> Vec3<T> {
        let Lobes { diffuse, f0, f90, roughness } = self.lobes;
        let albedo = SpecularAlbedo::new(f0, f90, roughness);
        let (e, lost) = albedo.at(wo.z.abs());
        match self.energy {
            Energy::Single => diffuse + e - albedo.multiple_albedo(lost),
            Energy::Compensated => e + diffuse.mul(e.map(|e| (T::one() - e).relu())),
        }
    }
}
