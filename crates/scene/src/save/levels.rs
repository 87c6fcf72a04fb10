//! Mip levels of textures for files that hold them, by what materials use an image for.
//!
//! - Colour is averaged in linear light; by coverage where alpha is, so that hidden colours do not bleed in. Where alpha is a
//!   mask, it is rescaled on every level so that the part that passes the cutoff is as close to that of the base as one factor
//!   brings it (Castaño 2010): thin leaves do not vanish.
//! - Normals are averaged and normalised.
//! - Other data are averaged. Roughness too: that it takes up the spread of the averaged normals (Toksvig 2005) was tried, and
//!   lost in pictures of three.js, whose isotropic lookups take coarser levels than the pixels need.

use crate::{AlphaMode, Material, Scene, TextureImage, TextureSlot};
use photofit_image::srgb_u8_to_linear;
use photofit_ktx2::Level;
use photofit_scalar::linear_to_srgb_u8;
use photofit_texture::{MipLayout, MipRule, MipTexture, Pyramid, Texture};
use rayon::prelude::*;

/// What materials use an image for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Use {
    /// sRGB colour, and what alpha means; with the cutoff of texels where it is a mask.
    Color { coverage: bool, cutoff: Option<f32> },
    /// Normals of the tangent frame.
    Normals,
    /// Other numbers.
    Data,
}

impl Use {
    /// `None` where an image is colour and data at once, or nobody uses it.
    pub(super) fn of(scene: &Scene, image: usize) -> Option<Self> {
        let uses: Vec<Self> = scene.materials.iter().flat_map(|m| material_uses(m, image)).collect();
        let first = *uses.first()?;
        let color = |u: &Self| matches!(u, Self::Color { .. });
        let normals = |u: &Self| *u == Self::Normals;
        if uses.iter().any(|u| color(u) != color(&first) || normals(u) != normals(&first)) {
            return None;
        }
        // Of several uses the one that asks for most: a mask, coverage.
        let asks = |u: &Self| match u {
            Self::Color { cutoff: Some(_), .. } => 2,
            Self::Color { coverage: true, .. } => 1,
            _ => 0,
        };
        Some(uses.iter().rev().max_by_key(|u| asks(u)).copied().unwrap_or(first))
    }

    pub(super) fn is_color(self) -> bool {
        matches!(self, Self::Color { .. })
    }
}

fn material_uses(m: &Material, image: usize) -> Vec<Use> {
    let mut uses = Vec::new();
    let plain_color = Use::Color { coverage: false, cutoff: None };
    let is = |slot: &Option<TextureSlot>| slot.as_ref().is_some_and(|s| s.image == image);
    if is(&m.base_color_texture) {
        let cutoff = match m.alpha_mode {
            AlphaMode::Mask { cutoff } if m.base_color[3] > 0.0 => Some(cutoff / m.base_color[3]),
            _ => None,
        };
        uses.push(Use::Color { coverage: m.alpha_mode != AlphaMode::Opaque, cutoff });
    }
    if is(&m.emissive_texture) {
        uses.push(plain_color);
    }
    if is(&m.normal_texture) {
        uses.push(Use::Normals);
    }
    if is(&m.occlusion_texture) {
        uses.push(Use::Data);
    }
    if is(&m.metallic_roughness_texture) {
        uses.push(Use::Data);
    }
    let extensions = m.extensions.iter().flat_map(|e| e.textures());
    let names: Vec<&str> = extensions.filter(|(_, slot)| slot.image == image).map(|(name, _)| name).collect();
    for name in &names {
        uses.push(match *name {
            "specular colour" | "sheen colour" => plain_color,
            "clearcoat normal" => Use::Normals,
            // Alpha, which is no colour: the other channels may be one.
            "specular" | "sheen roughness" if names.iter().any(|n| n.ends_with("colour")) => continue,
            _ => Use::Data,
        });
    }
    uses
}

/// The levels of an image down to 1 x 1; where it has some of its own, these as they are.
pub(super) fn levels(image: &TextureImage, used: Use) -> Vec<Level> {
    if !image.mips.is_empty() {
        let sizes = MipLayout::first(image.width, image.height, image.mips.len() + 1);
        let texels = std::iter::once(&image.texels).chain(&image.mips);
        return sizes.levels().iter().zip(texels).map(|(l, t)| (l.width, l.height, t.clone())).collect();
    }
    let chain = |texel: &dyn Fn(&[u8; 4]) -> [f32; 4], rule| {
        let texels = image.texels.iter().map(texel).collect();
        Pyramid::with_rule(Texture { width: image.width, height: image.height, texels }, rule)
    };
    let mut pyramid = match used {
        Use::Color { coverage, .. } => {
            let rule = if coverage { MipTexture::COVERAGE } else { MipRule::Area };
            chain(&|t| linear(*t), rule)
        }
        Use::Normals => chain(&|t| with_alpha(normal(*t), t[3]), MipRule::Area),
        Use::Data => chain(&|t| unit(*t), MipRule::Area),
    };
    if let Use::Color { cutoff: Some(cutoff), .. } = used {
        keep_coverage(&mut pyramid, cutoff);
    }
    let coarse = pyramid.levels.iter().skip(1).map(|level| {
        let texel = |t: &[f32; 4]| match used {
            Use::Color { .. } => {
                let [r, g, b] = [t[0], t[1], t[2]].map(linear_to_srgb_u8);
                [r, g, b, byte(t[3])]
            }
            Use::Normals => {
                let length = length(t).max(1e-6);
                let [x, y, z] = [t[0], t[1], t[2]].map(|x| byte(0.5 + 0.5 * x / length));
                [x, y, z, byte(t[3])]
            }
            Use::Data => t.map(byte),
        };
        (level.width as u32, level.height as u32, level.texels.iter().map(texel).collect())
    });
    // The base as it is, bit for bit.
    let base = (image.width as u32, image.height as u32, image.texels.clone());
    std::iter::once(base).chain(coarse).collect()
}

fn byte(x: f32) -> u8 {
    (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

fn unit(t: [u8; 4]) -> [f32; 4] {
    t.map(|x| f32::from(x) / 255.0)
}

fn linear(t: [u8; 4]) -> [f32; 4] {
    let [r, g, b] = [t[0], t[1], t[2]].map(srgb_u8_to_linear);
    [r, g, b, f32::from(t[3]) / 255.0]
}

fn length(t: &[f32; 4]) -> f32 {
    (t[0] * t[0] + t[1] * t[1] + t[2] * t[2]).sqrt()
}

/// The unit normal that bytes stand for.
fn normal(t: [u8; 4]) -> [f32; 3] {
    let [x, y, z] = [t[0], t[1], t[2]].map(|x| f32::from(x) / 127.5 - 1.0);
    let length = (x * x + y * y + z * z).sqrt().max(1e-6);
    [x / length, y / length, z / length]
}

fn with_alpha([x, y, z]: [f32; 3], alpha: u8) -> [f32; 4] {
    [x, y, z, f32::from(alpha) / 255.0]
}

/// Points of a texel at which a mask is looked at, on each axis.
const MASK_POINTS: usize = 4;
/// Halvings of the interval in which the factor of alpha is sought, and its end.
const HALVINGS: usize = 16;
const FACTOR_MAX: f32 = 64.0;

/// Rescales alpha on every coarse level so that the part of the surface at or above the cutoff is as close to that of the
/// base as bytes of alpha allow.
fn keep_coverage(pyramid: &mut Pyramid<f32, 4>, cutoff: f32) {
    let (base, coarse) = pyramid.levels.split_at_mut(1);
    let wanted = passing(&base[0], cutoff);
    for level in coarse {
        let original: Vec<f32> = level.texels.iter().map(|t| t[3]).collect();
        // What is stored with this factor, and the part that passes then.
        let mut part = |factor: f32| {
            let stored = |a: &f32| f32::from(byte(a * factor)) / 255.0;
            level.texels.iter_mut().zip(&original).for_each(|(t, a)| t[3] = stored(a));
            passing(level, cutoff)
        };
        let before = part(1.0);
        // The part grows with the factor; `far` lies beyond the one that is sought, `near`, at first 1, before it.
        let (mut near, mut far) = (1.0, if before < wanted { FACTOR_MAX } else { 0.0 });
        for _ in 0..if before == wanted { 0 } else { HALVINGS } {
            let factor = 0.5 * (near + far);
            let is_beyond = (part(factor) >= wanted) == (before < wanted);
            *(if is_beyond { &mut far } else { &mut near }) = factor;
        }
        let mut off = |factor: f32| (part(factor) - wanted).abs();
        let factor = if before == wanted || off(near) <= off(far) { near } else { far };
        part(factor);
    }
}

/// The part of a texture where alpha, interpolated between texels as readers do, is at or above the cutoff.
fn passing(level: &Texture<f32, 4>, cutoff: f32) -> f64 {
    let (w, h) = (level.width, level.height);
    // Texel and weight of its follower, for each point of an axis; texels at the border are held.
    let axis = |n: usize| -> Vec<(usize, usize, f32)> {
        let point = |k: usize| (k as f32 + 0.5) / MASK_POINTS as f32 - 0.5;
        let places = (0..n * MASK_POINTS).map(|k| point(k).clamp(0.0, (n - 1) as f32));
        places.map(|x| (x as usize, (x as usize + 1).min(n - 1), x.fract())).collect()
    };
    let (columns, alpha) = (axis(w), |x: usize, y: usize| level.texels[y * w + x][3]);
    let count = |&(y0, y1, v): &(usize, usize, f32)| {
        let row = |y: usize, (x0, x1, u): (usize, usize, f32)| (1.0 - u) * alpha(x0, y) + u * alpha(x1, y);
        columns.iter().filter(|&&c| (1.0 - v) * row(y0, c) + v * row(y1, c) >= cutoff).count()
    };
    let pass: usize = axis(h).par_iter().map(count).sum();
    pass as f64 / (w * h * MASK_POINTS * MASK_POINTS) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Instance, Primitive, SurfaceLibrary, TextureEncoding, TextureSlot, load, save_glb, to_glb};
    use photofit_geometry::shapes;
    use photofit_scalar::vec2;
    use photofit_texture::{LevelOfDetail, lookup};

    fn image(side: usize, texel: impl Fn(usize, usize) -> [u8; 4]) -> TextureImage {
        let texels = (0..side * side).map(|i| texel(i % side, i / side)).collect();
        TextureImage { width: side, height: side, texels, ..TextureImage::default() }
    }

    fn slot(image: usize) -> Option<TextureSlot> {
        Some(TextureSlot::new(image))
    }

    fn levels_of(scene: &Scene, image: usize) -> Vec<Level> {
        levels(&scene.images[image], Use::of(scene, image).unwrap())
    }

    #[test]
    fn colours_are_averaged_in_linear_light_and_by_coverage() {
        let checker = image(8, |x, y| if (x + y) % 2 == 0 { [255, 255, 255, 255] } else { [0, 0, 0, 0] });
        let opaque = Material { base_color_texture: slot(0), ..Material::default() };
        let blended = Material { alpha_mode: AlphaMode::Blend, ..opaque.clone() };
        let mut scene = Scene { materials: vec![opaque], images: vec![checker.clone()], ..Scene::default() };
        let plain = levels_of(&scene, 0);
        assert_eq!(plain.iter().map(|l| (l.0, l.1)).collect::<Vec<_>>(), [(8, 8), (4, 4), (2, 2), (1, 1)]);
        assert_eq!(plain[0].2, checker.texels, "the base is not touched");
        assert_eq!(plain[3].2, [[188, 188, 188, 128]], "half the light");
        scene.materials = vec![blended];
        assert_eq!(levels_of(&scene, 0)[3].2, [[255, 255, 255, 128]], "what cannot be seen does not count");
    }

    #[test]
    fn masks_keep_their_coverage() {
        // Spots of a few texels.
        let lines = image(128, |x, y| {
            let (x, y) = (x as f32, y as f32);
            let inside = (0.9 * x + 0.3 * y).sin() + (0.41 * x - 0.83 * y).sin() > 1.3;
            [9, 200, 9, if inside { 255 } else { 0 }]
        });
        let mask = AlphaMode::Mask { cutoff: 0.5 };
        let leaf = Material { base_color_texture: slot(0), alpha_mode: mask, ..Material::default() };
        let scene = Scene { materials: vec![leaf], images: vec![lines], ..Scene::default() };
        let plain = Material { alpha_mode: AlphaMode::Blend, ..scene.materials[0].clone() };
        let plain = Scene { materials: vec![plain], ..scene.clone() };
        let part = |(width, height, texels): &Level| {
            let texels = texels.iter().map(|t| unit(*t)).collect();
            passing(&Texture { width: *width as usize, height: *height as usize, texels }, 0.5)
        };
        let (kept, plain) = (levels_of(&scene, 0), levels_of(&plain, 0));
        let base = part(&kept[0]);
        assert!(part(&plain[2]) < 1e-6, "plain averages lose the spots: {}", part(&plain[2]));
        let opaque = Scene { images: vec![image(16, |x, _| [x as u8, 1, 2, 255])], ..scene.clone() };
        let whole = levels_of(&opaque, 0);
        assert!(
            whole.iter().all(|l| l.2.iter().all(|t| t[3] == 255)),
            "what passes everywhere is not changed"
        );
        // Of all factors of the plain averages none comes closer.
        for (level, average) in kept.iter().zip(&plain).skip(1) {
            let scaled = |factor: f32| {
                let texel = |t: &[u8; 4]| [t[0], t[1], t[2], byte(f32::from(t[3]) / 255.0 * factor)];
                (part(&(average.0, average.1, average.2.iter().map(texel).collect())) - base).abs()
            };
            let least = (0..4000).map(|k| scaled(0.002 * k as f32)).fold(f64::INFINITY, f64::min);
            let off = (part(level) - base).abs();
            assert!(off <= least + 0.02, "{off} and {least} of {base} at {}", level.0);
            assert!(level.0 < 16 || off < 0.03, "{off} of {base} at {}", level.0);
        }
    }

    #[test]
    fn normals_stay_unit_vectors_and_data_are_averaged() {
        let bumps = image(8, |x, _| if x % 2 == 0 { [218, 128, 218, 255] } else { [38, 128, 218, 255] });
        let rough = image(8, |x, _| [255, if x % 2 == 0 { 40 } else { 100 }, 128, 255]);
        let material =
            Material { normal_texture: slot(0), metallic_roughness_texture: slot(1), ..Material::default() };
        let scene = Scene { materials: vec![material], images: vec![bumps, rough], ..Scene::default() };
        for level in &levels_of(&scene, 0)[1..] {
            assert!(level.2.iter().all(|t| t[0].abs_diff(128) <= 1 && t[2] == 255), "{:?}", level.2[0]);
        }
        assert!(levels_of(&scene, 1)[1..].iter().all(|l| l.2.iter().all(|t| *t == [255, 70, 128, 255])));
    }

    /// Levels that do not follow from the base come back, are drawn, and are written again; files without room for them lose them.
    #[test]
    fn mip_levels_of_an_image_survive_in_ktx2() {
        let flat = |side: usize, texel: [u8; 4]| vec![texel; side * side];
        let [red, green, blue] = [[200, 20, 20, 255], [20, 200, 20, 255], [20, 20, 200, 255]];
        let image = TextureImage {
            width: 8,
            height: 8,
            texels: flat(8, red),
            mips: vec![flat(4, green), flat(2, blue), flat(1, green)],
            encoding: TextureEncoding::Ktx2 { quality: 100 },
            ..TextureImage::default()
        };
        let material = Material { base_color_texture: slot(0), ..Material::clay() };
        let mut scene = Scene { materials: vec![material], images: vec![image], ..Scene::default() };
        scene.primitives.push(Primitive { mesh: shapes::uv_sphere(6, 3), material: 0 });
        scene.instances.push(Instance { primitive: 0, transform: glam::Affine3A::IDENTITY });
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        save_glb(&path, &scene).unwrap();
        let mut again = load(&path).unwrap();
        assert_eq!(again.images[0].texels, scene.images[0].texels);
        assert_eq!(again.images[0].mips, scene.images[0].mips);
        // A lookup reads them: half way between the second and the third level.
        let library = SurfaceLibrary::new(&again);
        let texture = library.texture(0);
        let lod = LevelOfDetail { level: 1.5 };
        let at = lookup(texture.layout(), vec2(0.3, 0.6), Some(&lod), &Default::default());
        let linear = srgb_u8_to_linear;
        let mean = 0.5 * (linear(20) + linear(200));
        let got = texture.read(&at);
        assert!((got[1] - mean).abs() < 1e-4 && (got[2] - mean).abs() < 1e-4, "{got:?}");
        // Written once more, and as a file without levels.
        again.images[0].encoding = TextureEncoding::Ktx2 { quality: 100 };
        assert_eq!(to_glb(&again).unwrap(), to_glb(&scene).unwrap());
        assert!(again.stored_as(0, TextureEncoding::Png).unwrap().mips.is_empty());
        again.images[0].mips[1].pop();
        let refused = again.validate().unwrap_err().to_string();
        assert!(refused.contains("[16, 3, 1] texels; they must be [16, 4, 1]"), "{refused}");
    }

    #[test]
    fn uses_that_exclude_each_other_have_no_levels() {
        let mixed = Material { base_color_texture: slot(0), normal_texture: slot(0), ..Material::default() };
        let scene =
            Scene { materials: vec![mixed], images: vec![image(4, |_, _| [0; 4])], ..Scene::default() };
        assert_eq!(Use::of(&scene, 0), None);
        assert_eq!(Use::of(&Scene::default(), 0), None);
    }
}
