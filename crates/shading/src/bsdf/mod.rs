//! Scattering functions for path tracing: value, density and sampling of every BSDF, in one local frame.
//!
//! The local frame has the shading normal along +z; `wo` (towards the viewer) and `wi` (towards the light) are unit
//! vectors that point away from the surface. Values are `f |cos theta_i|` in 1/sr per colour channel, densities are per
//! solid angle of `wi` in 1/sr.
//!
//! Each BSDF is a small `Copy` struct with the methods of [`Scatter`]; [`Bsdf`] holds any of them. An integrator that is
//! compiled for one kind of material can use the struct itself.
//!
//! - One-sided BSDFs (all that reflect only) scatter nothing where `wo.z <= 0`: turn the frame, or use [`TwoSided`].
//! - Refracting ones tell the sides by the sign of `wo.z`: +z is outside. [`TransportMode`] says whether radiance is
//!   scaled by the square of the relative index of refraction.
//! - A delta lobe has value and density zero in [`Scatter::eval_pdf`]; [`Scatter::sample`] returns it with
//!   [`BsdfSample::delta`] set, its weight divided by the probability of choosing it.
//! - Microfacet lobes with alpha below [`ALPHA_DELTA`] are delta lobes; opaque metallic-roughness surfaces have none
//!   (see [`crate::ROUGHNESS_MIN`]).
//! - `eval_vjp` of [`Diffuse`], [`RoughConductor`], [`MetallicRoughness`], [`Bsdf`] and [`GltfParameters`] is the adjoint of the value.

mod adjoint;
mod anisotropic;
mod beckmann;
mod conductor;
mod dielectric;
mod fresnel;
mod ggx;
mod gltf;
mod metallic_roughness;
mod microfacet;
mod microfacet_adjoint;
mod plastic;
mod principled;
mod principled_thin;
mod refraction;
mod simple;
mod table;
#[cfg(test)]
mod tests;

pub use crate::energy::Energy;
pub use adjoint::{BsdfGradient, DiffuseGradient, GltfGradient};
pub use conductor::{Conductor, RoughConductor};
pub use dielectric::{Dielectric, RoughDielectric, ThinDielectric};
pub use fresnel::{fresnel_average, fresnel_conductor, fresnel_dielectric};
pub use gltf::{GltfBsdf, GltfParameters};
pub use metallic_roughness::MetallicRoughness;
pub use microfacet::{Distribution, Masking, Microfacet};
pub use microfacet_adjoint::RoughConductorGradient;
pub use plastic::{Plastic, RoughPlastic};
pub use principled::{Principled, PrincipledParameters};
pub use principled_thin::{PrincipledThin, PrincipledThinParameters};
pub use simple::{Diffuse, Null, TwoSided};

use photofit_scalar::{Real, Vec3, vec3};

/// GGX or Beckmann alpha below which a lobe is a delta lobe (perceptual roughness 0.01): the slopes of directions in
/// `f32` keep three digits there.
pub const ALPHA_DELTA: f64 = 1e-4;

/// A sampled direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample<T = f32> {
    /// The direction, away from the surface.
    pub wi: Vec3<T>,
    /// `f |cos theta_i| / pdf`; for a delta lobe its reflectance or transmittance over the probability of choosing it.
    pub weight: Vec3<T>,
    /// Density per solid angle, 1/sr; 1 for a delta lobe.
    pub pdf: T,
    /// The direction comes from a delta lobe: no other strategy finds it.
    pub delta: bool,
    /// Index of refraction on the side of `wi` over that on the side of `wo`; 1 for reflection and thin surfaces.
    pub eta: T,
}

/// What is carried along a path, which decides about the factor at refraction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TransportMode {
    /// Radiance (paths from the camera): refraction from `wo` into a medium of relative index `eta` scales by
    /// `1 / eta^2`, because radiance grows where beams are squeezed together.
    #[default]
    Radiance,
    /// Importance (paths from lights), and renderers that leave the factor to others: no scaling.
    Importance,
}

/// What every BSDF can do; see the [module documentation](self) for the frame and the units.
pub trait Scatter<T: Real> {
    /// `f(wo, wi) |cos theta_i|` without delta lobes, and the density with which [`Self::sample`] makes `wi`.
    fn eval_pdf(&self, wo: Vec3<T>, wi: Vec3<T>) -> (Vec3<T>, T);

    /// A direction for `lobe` and `u` in `[0, 1)`; `None` where the path ends.
    fn sample(&self, wo: Vec3<T>, lobe: T, u: [T; 2]) -> Option<BsdfSample<T>>;

    /// Whether all lobes are delta lobes; most BSDFs have others.
    #[inline]
    fn is_delta(&self) -> bool {
        false
    }

    /// Whether light can pass to the other side; most BSDFs reflect only.
    #[inline]
    fn transmits(&self) -> bool {
        false
    }

    /// Part of uniform incident light that is scattered towards `wo`, approximately: for albedo images.
    fn albedo(&self, wo: Vec3<T>) -> Vec3<T>;

    /// Index of refraction on the other side over that on the side of `wo`, as samples that pass tell it
    /// ([`BsdfSample::eta`]): for directions that something else chose. 1 where nothing is refracted.
    #[inline]
    fn eta(&self, _wo: Vec3<T>) -> T {
        T::one()
    }

    /// `f(wo, wi) |cos theta_i|` without delta lobes.
    #[inline]
    fn eval(&self, wo: Vec3<T>, wi: Vec3<T>) -> Vec3<T> {
        self.eval_pdf(wo, wi).0
    }

    /// Density of `wi` per solid angle without delta lobes.
    #[inline]
    fn pdf(&self, wo: Vec3<T>, wi: Vec3<T>) -> T {
        self.eval_pdf(wo, wi).1
    }
}

/// Any scattering function.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Bsdf<T = f32> {
    /// A surface that is not there: light passes straight through (boundaries of media).
    Null(Null),
    /// Lambertian reflection.
    Diffuse(Diffuse<T>),
    /// The metallic-roughness model of glTF without extensions.
    MetallicRoughness(MetallicRoughness<T>),
    /// The metallic-roughness model of glTF with extensions.
    Gltf(GltfBsdf<T>),
    /// A smooth metal.
    Conductor(Conductor<T>),
    /// A rough metal.
    RoughConductor(RoughConductor<T>),
    /// The smooth boundary of a transparent medium.
    Dielectric(Dielectric<T>),
    /// A pane.
    ThinDielectric(ThinDielectric<T>),
    /// The rough boundary of a transparent medium.
    RoughDielectric(RoughDielectric<T>),
    /// Smooth plastic.
    Plastic(Plastic<T>),
    /// Rough plastic.
    RoughPlastic(RoughPlastic<T>),
    /// The principled model of Burley.
    Principled(Principled<T>),
    /// The thin principled model of Burley.
    PrincipledThin(PrincipledThin<T>),
}

macro_rules! each {
    ($bsdf:expr, $b:ident => $body:expr) => {
        match $bsdf {
            Bsdf::Null($b) => $body,
            Bsdf::Diffuse($b) => $body,
            Bsdf::MetallicRoughness($b) => $body,
            Bsdf::Gltf($b) => $body,
            Bsdf::Conductor($b) => $body,
            Bsdf::RoughConductor($b) => $body,
            Bsdf::Dielectric($b) => $body,
            Bsdf::ThinDielectric($b) => $body,
            Bsdf::RoughDielectric($b) => $body,
            Bsdf::Plastic($b) => $body,
            Bsdf::RoughPlastic($b) => $body,
            Bsdf::Principled($b) => $body,
            Bsdf::PrincipledThin($b) => $body,
        }
    };
}

impl<T: Real> Bsdf<T> {
    /// `f(wo, wi) |cos theta_i|`; zero for delta lobes.
    #[inline]
    pub fn eval(&self, wo: Vec3<T>, wi: Vec3<T>) -> Vec3<T> {
        each!(self, b => Scatter::<T>::eval(b, wo, wi))
    }

    /// Density of `wi` per solid angle; zero for delta lobes.
    #[inline]
    pub fn pdf(&self, wo: Vec3<T>, wi: Vec3<T>) -> T {
        each!(self, b => Scatter::<T>::pdf(b, wo, wi))
    }

    /// [`Self::eval`] and [`Self::pdf`] in one pass.
    #[inline]
    pub fn eval_pdf(&self, wo: Vec3<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        each!(self, b => Scatter::<T>::eval_pdf(b, wo, wi))
    }

    /// A direction for `lobe` and `u` in `[0, 1)`; `None` where the path ends.
    #[inline]
    pub fn sample(&self, wo: Vec3<T>, lobe: T, u: [T; 2]) -> Option<BsdfSample<T>> {
        each!(self, b => Scatter::<T>::sample(b, wo, lobe, u))
    }

    /// Index of refraction on the other side over that on the side of `wo`; 1 where nothing is refracted.
    #[inline]
    pub fn eta(&self, wo: Vec3<T>) -> T {
        each!(self, b => Scatter::<T>::eta(b, wo))
    }

    /// Whether all lobes are delta lobes: next-event estimation is in vain.
    #[inline]
    pub fn is_delta(&self) -> bool {
        each!(self, b => Scatter::<T>::is_delta(b))
    }

    /// Whether light can pass to the other side.
    #[inline]
    pub fn transmits(&self) -> bool {
        each!(self, b => Scatter::<T>::transmits(b))
    }

    /// Whether [`Self::sample`] uses its number `lobe`.
    #[inline]
    pub fn has_lobes(&self) -> bool {
        !matches!(self, Self::Null(_) | Self::Diffuse(_) | Self::Conductor(_) | Self::RoughConductor(_))
    }

    /// Part of uniform incident light that is scattered towards `wo`, approximately: for albedo images and
    /// demodulation.
    #[inline]
    pub fn albedo(&self, wo: Vec3<T>) -> Vec3<T> {
        each!(self, b => Scatter::<T>::albedo(b, wo))
    }
}

/// `v` mirrored at the surface: below becomes above.
#[inline(always)]
fn mirror_z<T: Real>(v: Vec3<T>) -> Vec3<T> {
    vec3(v.x, v.y, -v.z)
}

/// The specular reflection of `wo` at the surface.
#[inline(always)]
fn reflect_z<T: Real>(wo: Vec3<T>) -> Vec3<T> {
    vec3(-wo.x, -wo.y, wo.z)
}

/// `value / pdf` as a sample; `None` where the density is no usable number.
#[inline(always)]
fn weighted<T: Real>(wi: Vec3<T>, (value, pdf): (Vec3<T>, T), eta: T) -> Option<BsdfSample<T>> {
    if pdf > T::zero() && pdf < T::infinity() {
        Some(BsdfSample { wi, weight: value / pdf, pdf, delta: false, eta })
    } else {
        None
    }
}
