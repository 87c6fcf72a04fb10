//! Emitters that throw pictures: projectors, and spots with a texture.

use super::Importer;
use super::spectrum::Meaning;
use crate::error::{Fault, fault};
use crate::graph::Texture;
use crate::{LightKind, LightPicture};
use glam::{DAffine3, DVec3};
use std::f32::consts::PI;

impl Importer {
    /// The picture of a spot, whose circle of half angle `cutoff` (degrees) touches the picture's sides.
    pub(super) fn thrown_by_spot(
        &mut self,
        element: usize,
        to_world: &DAffine3,
        cutoff: f64,
    ) -> Result<Option<LightPicture>, Fault> {
        let Some(texture) = self.thrown(element, "texture")? else { return Ok(None) };
        if texture.constant().is_some() {
            let rule =
                "the texture of the spot is the same everywhere; it must vary (its intensity holds a colour)";
            return Err(fault(self.reader.place(element), rule));
        }
        let ([left, up, _], scale) = self.axes(element, to_world)?;
        if scale.max_element() > scale.min_element() * (1.0 + 1e-4) {
            let rule =
                "the spot with a texture is stretched; it may be turned, mirrored and scaled uniformly";
            return Err(fault(self.reader.place(element), rule));
        }
        let half = [cutoff.to_radians().tan() as f32; 2];
        Ok(Some(LightPicture { texture, u: (-left).as_vec3(), v: up.as_vec3(), half }))
    }

    pub(super) fn projector(&mut self, element: usize) -> Result<(), Fault> {
        let texture = self.thrown(element, "irradiance")?.unwrap_or_else(|| Texture::number(1.0));
        let scale = self.reader.float(element, "scale")?.unwrap_or(1.0) as f32;
        if scale < 0.0 {
            let rule = format!("the scale is {scale}; it must not be negative");
            return Err(fault(self.reader.place(element), rule));
        }
        // What is not an image counts as square.
        let [width, height] = match &texture {
            Texture::Bitmap { image, .. } => image.size(),
            _ => [1, 1],
        };
        let aspect = width as f64 / height as f64;
        let x = (0.5 * self.field_of_view(element, aspect)?.to_radians()).tan();
        let to_world = self.reader.affine(element, "to_world")?;
        let ([right, up, back], size) = self.axes(element, &to_world)?;
        if (size - DVec3::ONE).abs().max_element() > 1e-4 {
            return Err(fault(self.reader.place(element), "the projector is scaled; it must not be"));
        }
        let half = [x as f32, (x / aspect) as f32];
        let picture = LightPicture { texture, u: right.as_vec3(), v: (-up).as_vec3(), half };
        // The irradiance at distance 1 is pi times the picture, so that a white plane there is as bright as the picture.
        let intensity = [PI * scale; 3];
        self.light(element, LightKind::Projector, to_world.translation, -back, intensity, Some(picture));
        Ok(())
    }

    /// A texture that light shines through.
    fn thrown(&mut self, element: usize, name: &str) -> Result<Option<Texture>, Fault> {
        let texture = self.optional_texture(element, name, Meaning::Emission)?;
        if texture.as_ref().is_some_and(|t| !is_light(t)) {
            let rule = format!("a texel of {name} is infinite or negative; it must be neither");
            return Err(fault(self.reader.place(element), rule));
        }
        Ok(texture)
    }
}

/// Whether all values are finite and not negative.
fn is_light(texture: &Texture) -> bool {
    match texture {
        Texture::Checkerboard { colors, .. } => colors.iter().all(is_light),
        Texture::Bitmap { image, .. } => image.texels().iter().all(|x| x.is_finite() && *x >= 0.0),
        _ => true,
    }
}
