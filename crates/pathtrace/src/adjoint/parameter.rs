//! What derivatives are taken with respect to.

use crate::volume::{MediumRef, MediumValue};
use crate::world::{BsdfSource, Material, World};
use photofit_scene::{MapKind, SurfaceLibrary};
use photofit_shading::bsdf::Bsdf;

/// A value, or all texels of an image, that pictures depend on.
///
/// Colours have three channels, numbers one. Positions, cameras, coverage, indices of refraction and phase functions have
/// no derivatives here.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Parameter {
    /// A value that materials share.
    Material {
        /// Indices of the materials, whose values are alike. A factor of a library material is that of all materials that
        /// name it ([`BsdfSource::Library`]), whichever of them stand here.
        materials: Vec<usize>,
        /// Which value.
        value: MaterialValue,
    },
    /// All texels of a texture of the library, in linear light, row 0 at v = 0, as [`World::set_texels`] takes them: red,
    /// green and blue of colours, roughness (green) and metalness (blue), normals (0 to 1).
    Texels {
        /// Index of the texture ([`photofit_scene::SurfaceLibrary::texture_of`]).
        texture: usize,
    },
    /// A texture of trees of BSDFs ([`BsdfSource::Graph`]): the value of a constant, or all texels of an image, row by
    /// row as stored. In places that want a number the gradient is in the first channel.
    Graph {
        /// Materials and indices of the texture ([`photofit_scene::graph::SurfaceGraph::textures`]) that share it and
        /// hold the same values.
        places: Vec<[usize; 2]>,
    },
    /// Intensity of a point or spot light, irradiance of a directional one.
    Light {
        /// Index of the light.
        light: usize,
    },
    /// All texels of the environment's image, before its scale; row 0 at +y.
    Environment,
    /// A value of a medium: everywhere, or of every voxel, x fastest.
    Medium {
        /// Which medium.
        medium: MediumRef,
        /// Which value.
        value: MediumValue,
    },
    /// Positions of the vertices of a shape: refused, see [`crate::Adjoint::new`].
    Positions {
        /// Index of the shape.
        shape: usize,
    },
}

/// A value of a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MaterialValue {
    /// Reflectance of a uniform [`Bsdf::Diffuse`].
    Reflectance,
    /// Factor of the reflectance of a uniform [`Bsdf::RoughConductor`].
    SpecularReflectance,
    /// Alpha of a uniform [`Bsdf::RoughConductor`] that is isotropic, along both axes.
    Alpha,
    /// Its alpha along the tangent alone.
    AlphaU,
    /// Its alpha along the bitangent alone.
    AlphaV,
    /// Factor of the base colour of a library material.
    BaseColor,
    /// Factor of its perceptual roughness.
    Roughness,
    /// Factor of its metalness.
    Metallic,
    /// Factor of its emission.
    Emissive,
    /// [`Material::emission`], or the constant emission of a uniform surface.
    Emission,
    /// [`Material::absorption`].
    Absorption,
}

/// Number of [`MaterialValue`]s.
pub(super) const VALUES: usize = 11;

impl MaterialValue {
    /// Number of channels.
    pub fn channels(self) -> usize {
        match self {
            Self::Alpha | Self::AlphaU | Self::AlphaV | Self::Roughness | Self::Metallic => 1,
            _ => 3,
        }
    }

    /// Whether it is a factor of a library material, which all materials of the world that name that one share.
    pub(super) fn is_factor(self) -> bool {
        matches!(self, Self::BaseColor | Self::Roughness | Self::Metallic | Self::Emissive)
    }

    /// Why a material has no such value with a derivative; `None` where it has.
    pub(super) fn missing(self, world: &World, index: usize) -> Option<&'static str> {
        let material = &world.materials[index];
        let uniform = material.library.is_none() && material.graph.is_none();
        let has = match self {
            Self::Reflectance => uniform && matches!(material.uniform(), Bsdf::Diffuse(_)),
            Self::SpecularReflectance | Self::Alpha | Self::AlphaU | Self::AlphaV => {
                uniform && matches!(material.uniform(), Bsdf::RoughConductor(c) if !c.surface.is_smooth())
            }
            Self::BaseColor | Self::Roughness | Self::Metallic | Self::Emissive => material.library.is_some(),
            Self::Emission | Self::Absorption => true,
        };
        if !has {
            return Some(match self {
                Self::Reflectance => "it must be a diffuse surface that is the same everywhere",
                Self::SpecularReflectance | Self::Alpha | Self::AlphaU | Self::AlphaV => {
                    "it must be a rough conductor that is the same everywhere"
                }
                _ => "it must be a material of the library",
            });
        }
        if self == Self::Alpha
            && let Bsdf::RoughConductor(c) = material.uniform()
            && c.surface.alpha_x != c.surface.alpha_y
        {
            return Some("it is anisotropic: AlphaU and AlphaV must be given, each by itself");
        }
        let scatters = matches!(self, Self::BaseColor | Self::Roughness | Self::Metallic);
        match material.library {
            Some(of_library) if scatters => not_differentiable(world, of_library),
            _ => None,
        }
    }
}

/// Why scattering of a library material has no derivatives.
pub(super) fn not_differentiable(world: &World, material: usize) -> Option<&'static str> {
    let library = world.library.as_ref()?;
    (library.may_transmit(material) || library.may_be_anisotropic(material))
        .then_some("transmitting and anisotropic materials have no derivatives; it must be neither")
}

/// Whether one of these maps of a library material reads a texture.
fn reads(world: &World, material: usize, texture: usize, maps: &[MapKind]) -> bool {
    let of = |l: &SurfaceLibrary| maps.iter().any(|map| l.texture_of(material, *map) == Some(texture));
    world.library.as_ref().is_some_and(of)
}

/// Whether a map of a library material reads a texture, and whether scattering depends on it.
pub(super) fn maps_of(world: &World, material: usize, texture: usize) -> (bool, bool) {
    let scatters = reads(world, material, texture, &[MapKind::BaseColor])
        || changes_directions(world, material, texture);
    (scatters || reads(world, material, texture, &[MapKind::Emissive]), scatters)
}

/// Whether a texture changes the directions of light scattered by a library material: by its roughness or its normals.
pub(super) fn changes_directions(world: &World, material: usize, texture: usize) -> bool {
    reads(world, material, texture, &[MapKind::MetallicRoughness, MapKind::Normal])
}

/// Whether a material as it was given scatters by a library material.
pub(super) fn library_material(material: &Material) -> Option<usize> {
    match material.scattering {
        BsdfSource::Library { index } => Some(index),
        _ => None,
    }
}
