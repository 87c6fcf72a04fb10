//! What the material extensions of glTF add to a [`crate::Material`].
//!
//! Ranges are those of the specifications; the loader refuses other values. Factors multiply their textures.

use crate::{SurfacePoints, TextureImage, TextureSlot};

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

    /// Whether light passes: where none does a volume means nothing.
    pub(crate) fn transmits(&self) -> bool {
        self.transmission.as_ref().is_some_and(|t| t.factor > 0.0)
    }

    /// Those of [`Self::names`] that change what is seen of any core: their factors leave something of them.
    pub(crate) fn acting(&self) -> Vec<&'static str> {
        let acts = |name: &&str| match *name {
            "specular" => self.specular.as_ref().is_some_and(|s| *s != Specular::default()),
            "transmission" | "volume" => self.transmits(),
            "clearcoat" => self.clearcoat.as_ref().is_some_and(|c| c.factor > 0.0),
            "sheen" => self.sheen.as_ref().is_some_and(|s| s.color.iter().any(|c| *c > 0.0)),
            "anisotropy" => self.anisotropy.as_ref().is_some_and(|a| a.strength > 0.0),
            _ => true,
        };
        self.names().into_iter().filter(acts).collect()
    }

    /// The same without textures: each has become its mean over the points in the factor, or over its image where there are
    /// none. Directions of anisotropy and normals of a coat have no mean and are dropped.
    ///
    /// # Panics
    /// If a slot names an image that is not in `images`.
    pub fn averaged(&self, images: &[TextureImage], points: &SurfacePoints) -> Self {
        let mean = |slot: &mut Option<TextureSlot>, channel: usize| {
            let decode = |t: &[u8; 4]| f64::from(t[channel]) / 255.0;
            slot.take().map_or(1.0, |s| points.mean(&s, &images[s.image], decode))
        };
        let color = |slot: &mut Option<TextureSlot>| {
            let slot = slot.take();
            [0, 1, 2].map(|c| {
                let decode = |t: &[u8; 4]| f64::from(photofit_image::srgb_u8_to_linear(t[c]));
                slot.as_ref().map_or(1.0, |s| points.mean(s, &images[s.image], decode))
            })
        };
        let mut out = self.clone();
        if let Some(s) = &mut out.specular {
            s.factor *= mean(&mut s.texture, 3);
            s.color = scaled(s.color, color(&mut s.color_texture));
        }
        if let Some(t) = &mut out.transmission {
            t.factor *= mean(&mut t.texture, 0);
        }
        if let Some(v) = &mut out.volume {
            v.thickness *= mean(&mut v.thickness_texture, 1);
        }
        if let Some(c) = &mut out.clearcoat {
            c.factor *= mean(&mut c.texture, 0);
            c.roughness *= mean(&mut c.roughness_texture, 1);
            c.normal_texture = None;
        }
        if let Some(s) = &mut out.sheen {
            s.color = scaled(s.color, color(&mut s.color_texture));
            s.roughness *= mean(&mut s.roughness_texture, 3);
        }
        if let Some(a) = &mut out.anisotropy {
            a.strength *= mean(&mut a.texture, 2);
        }
        out
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

impl Extensions {
    /// The texture slots in use, to be changed.
    pub(crate) fn slots_mut(&mut self) -> impl Iterator<Item = &mut TextureSlot> {
        let specular = self.specular.iter_mut().flat_map(|s| [&mut s.texture, &mut s.color_texture]);
        let transmission = self.transmission.iter_mut().map(|t| &mut t.texture);
        let volume = self.volume.iter_mut().map(|v| &mut v.thickness_texture);
        let clearcoat = self
            .clearcoat
            .iter_mut()
            .flat_map(|c| [&mut c.texture, &mut c.roughness_texture, &mut c.normal_texture]);
        let sheen = self.sheen.iter_mut().flat_map(|s| [&mut s.color_texture, &mut s.roughness_texture]);
        let anisotropy = self.anisotropy.iter_mut().map(|a| &mut a.texture);
        let all = specular.chain(transmission).chain(volume).chain(clearcoat).chain(sheen).chain(anisotropy);
        all.filter_map(Option::as_mut)
    }
}

fn scaled(color: [f32; 3], by: [f32; 3]) -> [f32; 3] {
    [0, 1, 2].map(|c| color[c] * by[c])
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn textures_become_means_in_their_own_encoding() {
        let texels = vec![[0, 100, 20, 255], [255, 100, 40, 51]];
        let images = [TextureImage { width: 2, height: 1, texels, ..TextureImage::default() }];
        let slot = || Some(TextureSlot::new(0));
        let textured = Extensions {
            ior: 1.4,
            specular: Some(Specular { factor: 0.5, texture: slot(), ..Specular::default() }),
            transmission: Some(Transmission { factor: 0.8, texture: slot() }),
            volume: Some(Volume { thickness: 2.0, thickness_texture: slot(), ..Volume::default() }),
            clearcoat: Some(Clearcoat { factor: 1.0, normal_texture: slot(), ..Clearcoat::default() }),
            sheen: Some(Sheen { color: [1.0; 3], color_texture: slot(), ..Sheen::default() }),
            anisotropy: Some(Anisotropy { strength: 1.0, texture: slot(), ..Anisotropy::default() }),
        };
        let plain = textured.averaged(&images, &SurfacePoints::default());
        assert_eq!(plain.textures().count(), 0);
        assert_eq!(plain.names(), textured.names());
        let near = |a: f32, b: f32| assert!((a - b).abs() < 1e-5, "{a} {b}");
        near(plain.specular.as_ref().unwrap().factor, 0.5 * 0.6);
        near(plain.transmission.as_ref().unwrap().factor, 0.4);
        near(plain.volume.as_ref().unwrap().thickness, 2.0 * 100.0 / 255.0);
        near(plain.clearcoat.as_ref().unwrap().factor, 1.0);
        near(plain.anisotropy.as_ref().unwrap().strength, 30.0 / 255.0);
        // Means of light, not of bytes.
        let sheen = plain.sheen.as_ref().unwrap().color;
        near(sheen[0], 0.5);
        near(sheen[1], photofit_image::srgb_u8_to_linear(100));
    }
}
