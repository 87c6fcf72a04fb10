//! The metallic-roughness model of glTF 2.0 with its extensions: `KHR_materials_ior`, `specular`, `transmission`,
//! `volume`, `clearcoat`, `sheen` and `anisotropy`.
//!
//! From the inside out:
//!
//! - the base of [`MetallicRoughness`]: Lambert, and GGX with Schlick's term between `f0` and `f90` (`specular` scales
//!   both and colours `f0`), with an alpha along each axis for `anisotropy`;
//! - `transmission` replaces that part of the Lambertian lobe by `base_color (1 - F)` of light that passes through the
//!   microfacets: straight for thin walls (the reflection lobe, mirrored), refracted for volumes (Walter et al. 2007);
//!   Schlick's term takes the cosine on the side of the lower index;
//! - `sheen` (Charlie) over it, the rest scaled by `min(1 - c E(wo), 1 - c E(wi))` with `c` the largest channel of the
//!   colour and `E` the albedo of the lobe;
//! - `clearcoat` (GGX, index 1.5, own normal) over all, the rest scaled in the same way by its weight and albedo. The
//!   specification scales by Fresnel's term towards the viewer alone, which is not reciprocal.
//!
//! All but refraction is reciprocal; single scattering is height-correlated Smith.

mod glass;
mod layers;
mod sampling;
mod sheen;

pub use layers::GltfBsdf;

use super::{ALPHA_DELTA, Bsdf, Energy, MetallicRoughness, TransportMode};
use crate::ggx::ROUGHNESS_MIN;
use crate::surface::Lobes;
use photofit_scalar::{Real, Vec3, vec3};

/// The numbers of a glTF material at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GltfParameters<T = f32> {
    /// Linear base colour, in `[0, 1]`.
    pub base_color: Vec3<T>,
    /// Metalness, in `[0, 1]`.
    pub metallic: T,
    /// Perceptual roughness, in `[0, 1]`; GGX alpha is its square.
    pub roughness: T,
    /// Index of refraction, at least 1, or 0: then the dielectric reflects everything that `specular` lets it.
    pub ior: T,
    /// Strength of the dielectric's reflection, in `[0, 1]`.
    pub specular: T,
    /// Colour of the dielectric's reflection at normal incidence, not negative; `f0` stays at most 1.
    pub specular_color: Vec3<T>,
    /// Part of the dielectric that transmits instead of scattering diffusely, in `[0, 1]`.
    pub transmission: T,
    /// The surface bounds a volume (`thickness > 0`): light is refracted. Otherwise the wall is thin.
    pub volume: bool,
    /// Strength of the coat, in `[0, 1]`.
    pub clearcoat: T,
    /// Perceptual roughness of the coat.
    pub clearcoat_roughness: T,
    /// Unit normal of the coat in the local frame, +z where it has none of its own.
    pub clearcoat_normal: Vec3<T>,
    /// Colour of the sheen, in `[0, 1]`; black is none.
    pub sheen_color: Vec3<T>,
    /// Perceptual roughness of the sheen.
    pub sheen_roughness: T,
    /// Strength of the anisotropy, in `[0, 1]`.
    pub anisotropy: T,
    /// Direction of the longer highlight axis in the local frame: cosine and sine of the rotation from +x (the
    /// tangent) to +y (the bitangent).
    pub anisotropy_direction: [T; 2],
    /// Single or multiple scattering.
    pub energy: Energy,
    /// What is carried, for refraction.
    pub mode: TransportMode,
}

impl<T: Real> Default for GltfParameters<T> {
    /// The defaults of the specification.
    fn default() -> Self {
        let (zero, one) = (T::zero(), T::one());
        Self {
            base_color: Vec3::splat(one),
            metallic: one,
            roughness: one,
            ior: T::of(1.5),
            specular: one,
            specular_color: Vec3::splat(one),
            transmission: zero,
            volume: false,
            clearcoat: zero,
            clearcoat_roughness: zero,
            clearcoat_normal: vec3(zero, zero, one),
            sheen_color: Vec3::zero(),
            sheen_roughness: zero,
            anisotropy: zero,
            anisotropy_direction: [one, zero],
            energy: Energy::Single,
            mode: TransportMode::Radiance,
        }
    }
}

impl<T: Real> GltfParameters<T> {
    /// Reflectance of the dielectric at normal and at grazing incidence:
    /// `specular min(((ior - 1) / (ior + 1))^2 specular_color, 1)` and `specular`.
    #[inline]
    pub fn dielectric(&self) -> (Vec3<T>, T) {
        let r = (self.ior - T::one()) / (self.ior + T::one());
        (self.specular_color.map(|c| (r * r * c).min(T::one()) * self.specular), self.specular)
    }

    /// The base without extensions but `ior` and `specular`.
    #[inline]
    pub(in crate::bsdf) fn base(&self) -> MetallicRoughness<T> {
        let (f0, f90) = self.dielectric();
        let (m, one) = (self.metallic, T::one());
        let lobes = Lobes {
            diffuse: self.base_color * (one - m),
            f0: f0 * (one - m) + self.base_color * m,
            f90: f90 * (one - m) + m,
            roughness: self.roughness.max(T::of(ROUGHNESS_MIN)),
        };
        MetallicRoughness { lobes, energy: self.energy }
    }

    /// The scattering function: [`MetallicRoughness`] where no layer, transmission or anisotropy is used.
    #[inline]
    pub fn bsdf(&self) -> Bsdf<T> {
        let zero = T::zero();
        let plain = self.clearcoat <= zero
            && (self.transmission <= zero || self.metallic >= T::one())
            && self.sheen_color == Vec3::zero()
            && (self.anisotropy <= zero || self.roughness >= T::one());
        if plain { Bsdf::MetallicRoughness(self.base()) } else { Bsdf::Gltf(GltfBsdf::new(self)) }
    }

    /// Alpha along the direction of anisotropy and across it.
    ///
    /// Roughness has the floor of opaque surfaces; where light is transmitted there is none, and clear glass is clear.
    #[inline]
    fn alphas(&self, transmits: bool) -> (T, T) {
        let floor = if transmits { T::zero() } else { T::of(ROUGHNESS_MIN) };
        let roughness = self.roughness.max(floor);
        let a = roughness * roughness;
        let strength = self.anisotropy * self.anisotropy;
        let along = a + (T::one() - a) * strength;
        // A lobe is a delta lobe along both axes or along none.
        let across = if along < T::of(ALPHA_DELTA) { a } else { a.max(T::of(ALPHA_DELTA)) };
        (along, across)
    }
}
