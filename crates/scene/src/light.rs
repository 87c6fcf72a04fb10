//! Lights of an asset without a size (`KHR_lights_punctual`).

use crate::graph::Texture;
use glam::Vec3;

/// What a light without size is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightKind {
    /// Infinitely far away.
    Directional,
    /// Shines equally in all directions.
    Point,
    /// Shines inside of a cone.
    Spot {
        /// Angle from the axis up to which the light has its full intensity, radians.
        inner: f32,
        /// Angle from the axis from which on there is no light, radians; above `inner`, at most pi / 2.
        outer: f32,
    },
    /// Throws its picture, which it must have, and nothing beside it. The intensity grows with the inverse cube of the
    /// cosine between axis and direction, so that a plane that faces the light is lit as the picture says.
    Projector,
}

/// A picture that a light throws through its position, as a slide does: it lies on the plane at distance 1 along the
/// light's direction, centred, with texture coordinates from 0 to 1.
#[derive(Clone, Debug, PartialEq)]
pub struct LightPicture {
    /// Factor of the intensity at texture coordinates.
    pub texture: Texture,
    /// Unit vector in the world along which `u` grows, at right angles to the light's direction.
    pub u: Vec3,
    /// Unit vector along which `v` grows, at right angles to both, of either handedness.
    pub v: Vec3,
    /// Half the width (along `u`) and height of the picture: tangents of half angles.
    pub half: [f32; 2],
}

/// A light without size, in world space.
///
/// Units are photometric, as in glTF: intensities of points and spots in candela (lm/sr), directional lights in lux
/// (lm/m^2 on a surface that faces them). They are used as they are: one unit of radiance in photofit is one nit
/// (cd/m^2), the unit of `KHR_materials_emissive_strength`, so that lights and emissive materials agree; there is no
/// factor of 683 lm/W. Irradiance of points and spots falls with the square of the distance in the asset's units
/// (metres in glTF).
#[derive(Clone, Debug, PartialEq)]
pub struct PunctualLight {
    /// Name in the file.
    pub name: String,
    /// What it is.
    pub kind: LightKind,
    /// Linear colour times intensity: candela for points and spots, lux for directional lights.
    pub intensity: [f32; 3],
    /// Place; without meaning for directional lights.
    pub position: Vec3,
    /// Unit vector in which the light travels; without meaning for points.
    pub direction: Vec3,
    /// Distance beyond which the light may be left out, in the asset's units; a hint that physical renderers ignore.
    pub range: Option<f32>,
    /// What a spot or projector throws; glTF has no such lights.
    pub picture: Option<LightPicture>,
}

impl PunctualLight {
    /// Whether what it throws is not the same everywhere, which no light of glTF can.
    pub(crate) fn throws_picture(&self) -> bool {
        self.picture.is_some() || self.kind == LightKind::Projector
    }

    /// Attenuation of a spot towards a direction whose cosine with the axis is `cosine`: the squared clamped ramp of the
    /// specification, 1 inside of the inner cone, 0 outside of the outer one. The inverse cube of a projector, 1 for other lights; pictures
    /// are not in it.
    ///
    /// ```
    /// use photofit_scene::{LightKind, PunctualLight};
    /// let spot = PunctualLight {
    ///     name: String::new(),
    ///     kind: LightKind::Spot { inner: 0.2, outer: 0.4 },
    ///     intensity: [1.0; 3],
    ///     position: glam::Vec3::ZERO,
    ///     direction: glam::Vec3::NEG_Z,
    ///     range: None,
    ///     picture: None,
    /// };
    /// assert_eq!(spot.attenuation(0.1_f32.cos()), 1.0);
    /// assert_eq!(spot.attenuation(0.5_f32.cos()), 0.0);
    /// ```
    pub fn attenuation(&self, cosine: f32) -> f32 {
        let (inner, outer) = match self.kind {
            LightKind::Spot { inner, outer } => (inner, outer),
            LightKind::Projector => return if cosine > 0.0 { cosine.powi(-3) } else { 0.0 },
            LightKind::Directional | LightKind::Point => return 1.0,
        };
        let (inner, outer) = (inner.cos(), outer.cos());
        let ramp = ((cosine - outer) / (inner - outer).max(1e-4)).clamp(0.0, 1.0);
        ramp * ramp
    }
}
