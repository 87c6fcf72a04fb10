//! What the material extensions of glTF add to a [`crate::Material`].
//!
//! Ranges are those of the specifications; the loader refuses other values. Factors multiply their textures.

use crate::TextureSlot;

/// The extensions that a material uses; `None` where it does not name them.
#[derive(Clone, Debug, PartialEq)]
pub struct Extensions {
    /// `KHR_materials_ior`: index of refraction of the dielectric, at least 1; 0 makes it reflect everything. 1.5 by
    /// default.
    pub ior: f32,
    /// `KHR_materials_specular`.
    pub specular: Option<Specular>,
    /// `KHR_materials_transmission`.
    pub transmission: Option<Transmission>,
    /// `KHR_materials_volume`.
    pub volume: Option<Volume>,
    /// `KHR_materials_clearcoat`.
    pub clearcoat: Option<Clearcoat>,
    /// `KHR_materials_sheen`.
    pub sheen: Option<Sheen>,
    /// `KHR_materials_anisotropy`.
    pub anisotropy: Option<Anisotropy>,
}

impl Default for Extensions {
    fn default() -> Self {
        Self {
            ior: Self::IOR,
            specular: None,
            transmission: None,
            volume: None,
            clearcoat: None,
            sheen: None,
            anisotropy: None,
        }
    }
}

impl Extensions {
    /// The index of refraction of a material that names none.
    pub const IOR: f32 = 1.5;

    /// Names of the extensions in use, without their prefix.
    pub fn names(&self) -> Vec<&'static str> {
        let used = [
            ("ior", self.ior.to_bits() != Self::IOR.to_bits()),
            ("specular", self.specular.is_some()),
            ("transmission", self.transmission.is_some()),
            ("volume", self.volume.is_some()),
            ("clearcoat", self.clearcoat.is_some()),
            ("sheen", self.sheen.is_some()),
            ("anisotropy", self.anisotropy.is_some()),
        ];
        used.into_iter().filter(|(_, used)| *used).map(|(name, _)| name).collect()
    }

    /// The texture slots in use, named.
    pub fn textures(&self) -> impl Iterator<Item = (&'static str, &TextureSlot)> {
        let specular = self
            .specular
            .iter()
            .flat_map(|s| [("specular", &s.texture), ("specular colour", &s.color_texture)]);
        let transmission = self.transmission.iter().map(|t| ("transmission", &t.texture));
        let volume = self.volume.iter().map(|v| ("thickness", &v.thickness_texture));
        let clearcoat = self.clearcoat.iter().flat_map(|c| {
            [
                ("clearcoat", &c.texture),
                ("clearcoat roughness", &c.roughness_texture),
                ("clearcoat normal", &c.normal_texture),
            ]
        });
        let sheen = self
            .sheen
            .iter()
            .flat_map(|s| [("sheen colour", &s.color_texture), ("sheen roughness", &s.roughness_texture)]);
        let anisotropy = self.anisotropy.iter().map(|a| ("anisotropy", &a.texture));
        specular
            .chain(transmission)
            .chain(volume)
            .chain(clearcoat)
            .chain(sheen)
            .chain(anisotropy)
            .filter_map(|(name, slot)| slot.as_ref().map(|s| (name, s)))
    }
}

/// `KHR_materials_specular`: strength and colour of the dielectric's reflection.
#[derive(Clone, Debug, PartialEq)]
pub struct Specular {
    /// Strength, in `[0, 1]`.
    pub factor: f32,
    /// Linear texture: alpha = strength.
    pub texture: Option<TextureSlot>,
    /// Linear colour at normal incidence, not negative; may exceed 1.
    pub color: [f32; 3],
    /// sRGB colour texture.
    pub color_texture: Option<TextureSlot>,
}

impl Default for Specular {
    fn default() -> Self {
        Self { factor: 1.0, texture: None, color: [1.0; 3], color_texture: None }
    }
}

/// `KHR_materials_transmission`: the part of the dielectric that lets light pass.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Transmission {
    /// The part, in `[0, 1]`.
    pub factor: f32,
    /// Linear texture: red = the part.
    pub texture: Option<TextureSlot>,
}

/// `KHR_materials_volume`: what lies below the surface. A thickness of 0 is a thin wall without inside.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    /// Thickness for renderers that do not trace the inside, in the asset's units, not negative.
    pub thickness: f32,
    /// Linear texture: green = thickness.
    pub thickness_texture: Option<TextureSlot>,
    /// Distance after which white light has [`Self::attenuation_color`], in the asset's units, positive; infinite
    /// without absorption.
    pub attenuation_distance: f32,
    /// Linear colour, in `[0, 1]`.
    pub attenuation_color: [f32; 3],
}

impl Default for Volume {
    fn default() -> Self {
        Self {
            thickness: 0.0,
            thickness_texture: None,
            attenuation_distance: f32::INFINITY,
            attenuation_color: [1.0; 3],
        }
    }
}

impl Volume {
    /// Absorption coefficient `-ln(color) / distance` per channel, in 1 over the asset's units; black channels absorb
    /// as if their colour were 1e-6.
    pub fn absorption(&self) -> [f32; 3] {
        self.attenuation_color.map(|c| (-c.clamp(1e-6, 1.0).ln() / self.attenuation_distance).max(0.0))
    }
}

/// `KHR_materials_clearcoat`: a clear layer over everything.
#[derive(Clone, Debug, PartialEq)]
pub struct Clearcoat {
    /// Strength, in `[0, 1]`.
    pub factor: f32,
    /// Linear texture: red = strength.
    pub texture: Option<TextureSlot>,
    /// Perceptual roughness, in `[0, 1]`.
    pub roughness: f32,
    /// Linear texture: green = roughness.
    pub roughness_texture: Option<TextureSlot>,
    /// Tangent-space normal texture of the layer (linear); without one the layer has the geometry's normal.
    pub normal_texture: Option<TextureSlot>,
    /// Scale of the x and y of the normal texture.
    pub normal_scale: f32,
}

impl Default for Clearcoat {
    fn default() -> Self {
        Self {
            factor: 0.0,
            texture: None,
            roughness: 0.0,
            roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
        }
    }
}

/// `KHR_materials_sheen`: microfibres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sheen {
    /// Linear colour, in `[0, 1]`; black is none.
    pub color: [f32; 3],
    /// sRGB colour texture.
    pub color_texture: Option<TextureSlot>,
    /// Perceptual roughness, in `[0, 1]`.
    pub roughness: f32,
    /// Linear texture: alpha = roughness.
    pub roughness_texture: Option<TextureSlot>,
}

/// `KHR_materials_anisotropy`: highlights that are longer along one direction of the surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Anisotropy {
    /// Strength, in `[0, 1]`.
    pub strength: f32,
    /// Angle of the longer axis from the tangent towards the bitangent, radians.
    pub rotation: f32,
    /// Linear texture: red and green = direction in the tangent plane (mapped from `[0, 1]` to `[-1, 1]`), blue =
    /// strength.
    pub texture: Option<TextureSlot>,
}
