//! Maps of a library as glTF keeps them: roughness and metalness in one image, alpha in that of the base colour.

use super::statements::Statements;
use crate::load::Limits;
use crate::{AlphaMode, Extensions, Material, Specular, TextureImage, TextureSlot};
use std::collections::HashMap;

/// Images that were made, by what they were made of.
#[derive(Debug)]
pub(super) struct Joined {
    texels: u64,
    most: u64,
    known: HashMap<(Kind, Option<usize>, Option<usize>), usize>,
}

/// What an image holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Kind {
    /// Roughness in green, metalness in blue.
    Surface,
    /// Base colour with alpha.
    Color,
    /// Strength of the specular reflection in alpha.
    Specular,
}

impl Joined {
    pub(super) fn new(limits: &Limits) -> Self {
        Self { texels: 0, most: limits.texels, known: HashMap::new() }
    }

    /// Puts the maps of a material in their slots; what is ignored.
    pub(super) fn apply(
        &mut self,
        statements: &Statements,
        material: &mut Material,
        images: &mut Vec<TextureImage>,
    ) -> Result<Vec<&'static str>, String> {
        let mut warnings = Vec::new();
        if let Some(map) = &statements.diffuse_map {
            // A map stands in place of Kd, as in Blender: exporters write 0.64 or 0.8 beside it.
            material.base_color[..3].fill(1.0);
            material.base_color_texture = Some(map.slot);
        }
        if let Some(alpha) = &statements.alpha_map {
            let color = statements.diffuse_map.as_ref().map_or(alpha.slot, |m| m.slot);
            if same_place(&color, &alpha.slot) {
                let base = statements.diffuse_map.as_ref().map(|m| m.slot.image);
                let image = self.join(Kind::Color, base, Some(alpha.slot.image), images)?;
                material.base_color_texture = Some(TextureSlot { image, ..color });
                material.base_color[3] = 1.0;
                material.alpha_mode = AlphaMode::Blend;
            } else {
                warnings.push("map_d is ignored: it lies on the surface otherwise than map_Kd");
            }
        }
        let (rough, metal) = (statements.roughness_map.as_ref(), statements.metallic_map.as_ref());
        if let Some(first) = rough.or(metal).map(|m| m.slot) {
            let fits = metal.is_none_or(|m| same_place(&m.slot, &first));
            if !fits {
                warnings
                    .push("map_Pm is ignored: it lies on the surface otherwise than the map of roughness");
            }
            let metal = metal.filter(|_| fits).map(|m| m.slot.image);
            let image = self.join(Kind::Surface, rough.map(|m| m.slot.image), metal, images)?;
            material.metallic_roughness_texture = Some(TextureSlot { image, ..first });
            if rough.is_some() {
                material.roughness = 1.0;
            }
            if metal.is_some() {
                material.metallic = 1.0;
            }
        }
        if let Some(map) = &statements.emission_map {
            material.emissive_texture = Some(map.slot);
            if material.emissive == [0.0; 3] {
                material.emissive = [1.0; 3];
            }
        }
        if let Some(map) = &statements.specular_map {
            let image = self.join(Kind::Specular, Some(map.slot.image), None, images)?;
            let texture = Some(TextureSlot { image, ..map.slot });
            // As Ks of one: twice the reflection of the index of refraction.
            let specular = Specular { texture, color: [2.0; 3], ..Specular::default() };
            let extensions = material.extensions.get_or_insert_with(|| Box::new(Extensions::default()));
            extensions.specular = Some(specular);
        }
        let bump = statements.bump_map.as_ref().filter(|m| !grey(&images[m.slot.image]));
        if statements.bump_map.is_some() && bump.is_none() {
            warnings.push("bump is ignored: its image holds heights, not normals");
        }
        if let Some(map) = statements.normal_map.as_ref().or(bump) {
            material.normal_texture = Some(map.slot);
            material.normal_scale = map.strength;
        }
        Ok(warnings)
    }

    /// The image of two others: their values at the nearest texels, at the larger of both sizes.
    fn join(
        &mut self,
        kind: Kind,
        first: Option<usize>,
        second: Option<usize>,
        images: &mut Vec<TextureImage>,
    ) -> Result<usize, String> {
        if let Some(&known) = self.known.get(&(kind, first, second)) {
            return Ok(known);
        }
        let of = |i: Option<usize>| i.map(|i| &images[i]);
        let (a, b) = (of(first), of(second));
        let side = |f: &dyn Fn(&TextureImage) -> usize| a.map_or(0, f).max(b.map_or(0, f));
        let (width, height) = (side(&|i| i.width), side(&|i| i.height));
        self.texels += width as u64 * height as u64;
        if self.texels > self.most {
            return Err(format!(
                "joined maps have {} texels up to here; there may be {}",
                self.texels, self.most
            ));
        }
        let opaque = b.is_some_and(|b| b.texels.iter().all(|t| t[3] == 255));
        let mut texels = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let at = |i: &TextureImage| i.texels[(y * i.height / height) * i.width + x * i.width / width];
                let (p, q) = (a.map(at), b.map(at));
                texels.push(match kind {
                    Kind::Surface => [255, p.map_or(255, grey_of), q.map_or(255, grey_of), 255],
                    Kind::Specular => [255, 255, 255, p.map_or(255, grey_of)],
                    Kind::Color => {
                        let [r, g, b, _] = p.unwrap_or([255; 4]);
                        // Pictures without alpha hold the opacity in their colours.
                        [r, g, b, q.map_or(255, |q| if opaque { grey_of(q) } else { q[3] })]
                    }
                });
            }
        }
        let name = a.or(b).map(|i| i.name.clone()).unwrap_or_default();
        images.push(TextureImage { name, width, height, texels, ..TextureImage::default() });
        self.known.insert((kind, first, second), images.len() - 1);
        Ok(images.len() - 1)
    }
}

/// The mean of the channels, weighted as the eye does.
fn grey_of(t: [u8; 4]) -> u8 {
    let [r, g, b, _] = t.map(f32::from);
    (0.2126 * r + 0.7152 * g + 0.0722 * b + 0.5) as u8
}

fn grey(image: &TextureImage) -> bool {
    image.texels.iter().all(|t| t[0] == t[1] && t[1] == t[2])
}

/// The same texture coordinates fall on the same places of both.
fn same_place(a: &TextureSlot, b: &TextureSlot) -> bool {
    (a.transform, a.sampler, a.tex_coord) == (b.transform, b.sampler, b.tex_coord)
}
