//! The fitted candidate as a scene that can be written.

use super::light_asset::LightAsset;
use crate::candidate::Candidate;
use photofit_geometry::Mesh;
use photofit_geometry::atlas::{dilate, mesh_coverage};
use photofit_image::linear_to_srgb_u8;
use photofit_raster::{CHANNELS, Maps, channel};
use photofit_scene::{
    AlphaMode, Filter, Instance, Material, Primitive, Sampler, Scene, TextureImage, TextureSlot, Wrap,
};
use photofit_shading::Sides;

/// Differences below this are one step of 8 bits: a map that varies less becomes a factor.
const FLAT: f32 = 0.75 / 255.0;

/// Turns a candidate into a scene: one primitive and material for all classes that are written alike, all sharing one set of maps, with their mip levels
/// where these have texels of their own. Maps that are constant become factors, a flat normal map and absent emission are left out. Materials are named after those that
/// they stand for.
pub fn to_scene(candidate: &Candidate, light: &LightAsset) -> Scene {
    let mut mesh = candidate.mesh();
    for p in &mut mesh.positions {
        *p = light.frame.to_world(*p);
    }
    let levels = candidate.maps.levels.iter().take(candidate.fitted_levels());
    let levels: Vec<WrittenLevel> =
        levels.map(|level| WrittenLevel::new(level, &mesh, candidate, light)).collect();

    let mut scene = Scene { name: light.name.clone(), ..Scene::default() };
    let written = |class: &u32| light.classes[*class as usize].written;
    let transparent = candidate.class.iter().any(|c| written(c) != AlphaMode::Opaque);
    let template = material(&mut scene, &levels, transparent);
    let materials: Vec<Material> = light
        .classes
        .iter()
        .map(|class| Material {
            name: class.name.clone(),
            alpha_mode: class.written,
            double_sided: class.sides == Sides::Both,
            unlit: class.unlit,
            extensions: class.extensions.clone(),
            ..template.clone()
        })
        .collect();
    // Of classes that differ in their normals alone, which vertices have, the first stands for all.
    let first = |m: &Material| materials.iter().position(|other| other == m);
    let first: Vec<Option<usize>> = materials.iter().map(first).collect();
    for (k, material) in materials.iter().enumerate() {
        let part = part(&mesh, &candidate.class, |class| first[class as usize] == Some(k));
        if part.triangles.is_empty() {
            continue;
        }
        scene.materials.push(material.clone());
        let primitive = scene.primitives.len();
        scene.primitives.push(Primitive { mesh: part, material: scene.materials.len() - 1 });
        scene.instances.push(Instance { primitive, transform: glam::Affine3A::IDENTITY });
    }
    scene
}

/// A level of the maps as it is written.
struct WrittenLevel {
    width: usize,
    height: usize,
    texels: Vec<[f32; CHANNELS]>,
    /// Texels that triangles show; the others repeat them.
    owned: Vec<bool>,
}

impl WrittenLevel {
    fn new(level: &Maps, mesh: &Mesh, candidate: &Candidate, light: &LightAsset) -> Self {
        let (width, height) = (level.width, level.height);
        let mut texels = level.texels.clone();
        let owned = mesh_coverage(&mesh.uvs, &mesh.triangles, width, height, true).mask();
        write_alpha(&mut texels, candidate, light, (width, height));
        show_unlit(&mut texels, candidate, light, (width, height));
        dilate(&mut texels, &owned, width, height, None);
        Self { width, height, texels, owned }
    }
}

/// Changes the texels of the triangles of some classes.
fn change(
    texels: &mut [[f32; CHANNELS]],
    candidate: &Candidate,
    (width, height): (usize, usize),
    wanted: impl Fn(usize) -> bool,
    change: impl Fn(usize, &mut [f32; CHANNELS]),
) {
    let triangles = candidate.triangles.iter().zip(&candidate.class);
    let triangles: Vec<[u32; 3]> = triangles.filter(|(_, c)| wanted(**c as usize)).map(|(t, _)| *t).collect();
    if triangles.is_empty() {
        return;
    }
    let drawn = mesh_coverage(&candidate.uvs, &triangles, width, height, true).mask();
    let texels = texels.iter_mut().enumerate().zip(drawn).filter(|(_, drawn)| *drawn);
    texels.for_each(|((i, texel), _)| change(i, texel));
}

/// Gives glass, which is drawn with less alpha than it has, the alpha that it has.
fn write_alpha(
    texels: &mut [[f32; CHANNELS]],
    candidate: &Candidate,
    light: &LightAsset,
    size: (usize, usize),
) {
    // Triangles of several classes may show one texel.
    let drawn: Vec<f32> = texels.iter().map(|t| t[channel::ALPHA]).collect();
    for (k, class) in light.classes.iter().enumerate().filter(|(_, class)| class.is_see_through()) {
        let write = |i: usize, t: &mut [f32; CHANNELS]| t[channel::ALPHA] = class.written_alpha(drawn[i]);
        change(texels, candidate, size, |c| c == k, write);
    }
}

/// Turns the emission with which unlit surfaces are drawn into the base colour that their material shows.
fn show_unlit(
    texels: &mut [[f32; CHANNELS]],
    candidate: &Candidate,
    light: &LightAsset,
    size: (usize, usize),
) {
    change(
        texels,
        candidate,
        size,
        |c| light.classes[c].unlit,
        |_, texel| {
            for k in 0..3 {
                texel[channel::BASE_COLOR + k] = texel[channel::EMISSIVE + k];
                texel[channel::EMISSIVE + k] = 0.0;
            }
        },
    );
}

/// The triangles of some classes with the vertices that they use; tangents are left to the reader, which derives the same
/// ones by `MikkTSpace`.
fn part(mesh: &Mesh, class: &[u32], wanted: impl Fn(u32) -> bool) -> Mesh {
    let mut map = vec![u32::MAX; mesh.positions.len()];
    let mut out = Mesh::default();
    for (t, _) in mesh.triangles.iter().zip(class).filter(|(_, c)| wanted(**c)) {
        out.triangles.push(t.map(|v| {
            let at = &mut map[v as usize];
            if *at == u32::MAX {
                *at = out.positions.len() as u32;
                let v = v as usize;
                out.positions.push(mesh.positions[v]);
                // A vertex of degenerate faces alone has no normal; any unit vector is valid.
                let normal = mesh.normals[v];
                let up = photofit_scalar::vec3(0.0, 1.0, 0.0);
                out.normals.push(if normal.length_squared() > 0.5 { normal } else { up });
                out.uvs.push(mesh.uvs[v]);
            }
            *at
        }));
    }
    out
}

/// The slot of an image that an atlas addresses.
pub(crate) fn atlas_slot(image: usize) -> TextureSlot {
    let wrap = Wrap::ClampToEdge;
    TextureSlot {
        sampler: Sampler { wrap_u: wrap, wrap_v: wrap, filter: Filter::Trilinear },
        ..TextureSlot::new(image)
    }
}

/// Smallest and largest value of a channel over the owned texels of all levels.
fn range(levels: &[WrittenLevel], c: usize) -> (f32, f32) {
    levels
        .iter()
        .flat_map(|l| l.texels.iter().zip(&l.owned))
        .filter(|(_, o)| **o)
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(lo, hi), (t, _)| (lo.min(t[c]), hi.max(t[c])))
}

fn material(scene: &mut Scene, levels: &[WrittenLevel], transparent: bool) -> Material {
    let constant = |c: usize| {
        let (lo, hi) = range(levels, c);
        (hi - lo <= FLAT || !lo.is_finite()).then(|| if lo.is_finite() { 0.5 * (lo + hi) } else { 1.0 })
    };
    let mut add = |name: &str, texel: &dyn Fn(&[f32; CHANNELS]) -> [u8; 4]| {
        let of = |level: &WrittenLevel| level.texels.iter().map(texel).collect();
        let (base, coarse) = levels.split_first().expect("maps have a base level");
        scene.images.push(TextureImage {
            name: name.into(),
            width: base.width,
            height: base.height,
            texels: of(base),
            mips: coarse.iter().map(of).collect(),
            ..TextureImage::default()
        });
        Some(atlas_slot(scene.images.len() - 1))
    };
    let unorm = |x: f32| (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    let mut out = Material { metallic: 1.0, roughness: 1.0, ..Material::default() };
    match [0, 1, 2].map(constant) {
        [Some(r), Some(g), Some(b)] if !transparent => out.base_color = [r, g, b, 1.0],
        _ => {
            out.base_color_texture = add("base-color", &|t| {
                let a = if transparent { unorm(t[channel::ALPHA]) } else { 255 };
                [linear_to_srgb_u8(t[0]), linear_to_srgb_u8(t[1]), linear_to_srgb_u8(t[2]), a]
            });
        }
    }
    // One texture for both, as glTF allows it.
    let occluded = range(levels, channel::OCCLUSION).0 < 1.0 - FLAT;
    match [channel::ROUGHNESS, channel::METALLIC].map(constant) {
        [Some(r), Some(m)] if !occluded => (out.roughness, out.metallic) = (r, m),
        _ => {
            let name = if occluded { "occlusion-roughness-metallic" } else { "roughness-metallic" };
            out.metallic_roughness_texture = add(name, &|t| {
                let occlusion = if occluded { unorm(t[channel::OCCLUSION]) } else { 255 };
                [occlusion, unorm(t[channel::ROUGHNESS]), unorm(t[channel::METALLIC]), 255]
            });
            out.occlusion_texture = out.metallic_roughness_texture.filter(|_| occluded);
        }
    }
    let flat = [channel::NORMAL, channel::NORMAL + 1].map(|c| range(levels, c));
    if flat.iter().any(|(lo, hi)| lo.abs().max(hi.abs()) > FLAT) {
        out.normal_texture = add("normal", &|t| {
            let n = |k: usize| unorm(t[channel::NORMAL + k] * 0.5 + 0.5);
            [n(0), n(1), n(2), 255]
        });
    }
    let peak = (0..3).map(|k| range(levels, channel::EMISSIVE + k).1).fold(0.0, f32::max);
    if peak > FLAT * 0.1 {
        let scale = peak.max(1.0);
        out.emissive = [scale; 3];
        out.emissive_texture = add("emissive", &|t| {
            let e = |k: usize| linear_to_srgb_u8(t[channel::EMISSIVE + k] / scale);
            [e(0), e(1), e(2), 255]
        });
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::classes::drawn;
    use crate::engine::plan::tests::{candidate, scene};
    use crate::engine::{Normalised, vertex_colors};
    use photofit_scene::{Extensions, SurfaceLibrary, Transmission};

    /// A cube of glass whose transmission and whose alpha come from a texture as well.
    fn glass(alpha_mode: AlphaMode, factor: f32, texels: Option<[u8; 4]>) -> Scene {
        let slot = texels.map(|_| TextureSlot::new(0));
        let transmission = Some(Transmission { factor, texture: slot });
        let mut asset = scene(Material {
            base_color: [0.9, 0.5, 0.2, 0.8],
            base_color_texture: slot,
            alpha_mode,
            extensions: Some(Box::new(Extensions { transmission, ..Extensions::default() })),
            ..Material::clay()
        });
        asset.images.extend(texels.map(|t| TextureImage {
            width: 1,
            height: 1,
            texels: vec![t],
            ..TextureImage::default()
        }));
        let mesh = &mut asset.primitives[0].mesh;
        mesh.uvs = vec![photofit_scalar::vec2(0.5, 0.5); mesh.positions.len()];
        asset
    }

    #[test]
    fn alpha_of_glass_is_written_so_that_it_is_drawn_as_in_the_fit() {
        // Half of the light passes by the red of the texture; its alpha of 102 / 255 counts where alpha counts.
        let texels = Some([128, 255, 255, 102]);
        for (alpha_mode, factor, texels, written) in [
            (AlphaMode::Blend, 1.0, None, 0.8),
            (AlphaMode::Blend, 0.5, None, 0.8),
            (AlphaMode::Opaque, 1.0, None, 1.0),
            (AlphaMode::Blend, 1.0, texels, 0.8 * 0.4),
            (AlphaMode::Opaque, 0.8, texels, 1.0),
        ] {
            let asset = glass(alpha_mode, factor, texels);
            let (light, class) = LightAsset::of(&asset, Normalised::new(&asset).unwrap().frame());
            // Maps hold what is baked from the asset as a fit draws it.
            let middle = photofit_scalar::vec2(0.5, 0.5);
            let shown = SurfaceLibrary::new(&drawn(&asset)).alpha(0, middle, middle, 1.0);
            let passes = factor * texels.map_or(1.0, |t| f32::from(t[0]) / 255.0);
            assert!((shown - written * (1.0 - 0.75 * passes)).abs() < 1e-5, "{alpha_mode:?}: {shown}");
            let mut sheet = candidate(AlphaMode::Blend, |_, t| {
                t[..3].copy_from_slice(&asset.materials[0].base_color[..3]);
                t[channel::ALPHA] = shown;
            });
            sheet.class.fill(class[0]);
            sheet.classes = light.drawn_classes();
            for made in [to_scene(&sheet, &light), vertex_colors::colored(&sheet, &light).scene] {
                let alpha = |scene: &Scene| {
                    let m = &scene.materials[0];
                    let texel = m.base_color_texture.as_ref().map_or(1.0, |s| {
                        let image = &scene.images[s.image];
                        f32::from(image.texels[image.texels.len() / 2][3]) / 255.0
                    });
                    let vertex = scene.primitives[0].mesh.colors.first().map_or(1.0, |c| c.w);
                    m.base_color[3] * texel * vertex
                };
                assert!((alpha(&made) - written).abs() < 3e-3, "{alpha_mode:?}, {factor}: {}", alpha(&made));
                let judged = alpha(&drawn(&made));
                assert!((judged - shown).abs() < 3e-3, "{alpha_mode:?}, {factor}: {judged}, fitted {shown}");
            }
        }
    }

    #[test]
    fn alpha_that_means_nothing_is_not_drawn() {
        let mut asset = glass(AlphaMode::Opaque, 1.0, None);
        let mesh = &mut asset.primitives[0].mesh;
        mesh.colors = vec![photofit_scalar::vec4(1.0, 1.0, 1.0, 0.3); mesh.positions.len()];
        let n = Normalised::new(&asset).unwrap();
        assert!(n.flat.mesh.colors.iter().all(|c| c.w == 1.0), "opaque to glTF");
        asset.materials[0].alpha_mode = AlphaMode::Blend;
        let n = Normalised::new(&asset).unwrap();
        assert!(n.flat.mesh.colors.iter().all(|c| c.w < 0.5));
    }
}
