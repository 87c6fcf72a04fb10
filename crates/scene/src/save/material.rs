//! Materials, textures, samplers and images.

use super::encode::{KTX2, WEBP, encode};
use super::{Writer, extensions, named, with_extras};
use crate::error::{Fault, fault};
use crate::load::affine_of_transform;
use crate::{AlphaMode, Filter, Material, Sampler, Scene, TextureSlot, Wrap};
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use std::collections::HashMap;

/// Writes all materials, and the images that they use.
pub(super) fn write(scene: &Scene, writer: &mut Writer) -> Result<(), Fault> {
    let mut used: Vec<usize> =
        scene.materials.iter().flat_map(|m| m.texture_slots()).map(|s| s.image).collect();
    used.sort_unstable();
    used.dedup();
    let encoded: Vec<Result<_, Fault>> = used
        .par_iter()
        .map(|&i| encode(scene, i, &scene.images[i]).map_err(|rule| fault(format!("image {i}"), rule)))
        .collect();
    let mut images = HashMap::new();
    for (&i, encoded) in used.iter().zip(encoded) {
        let (bytes, mime) = encoded?;
        let view = writer.view(&bytes, None);
        images.insert(i, writer.images.len());
        let image = json!({"bufferView": view, "mimeType": mime});
        writer.images.push(with_extras(named(image, &scene.images[i].name), &scene.images[i].extras));
    }
    let mut tables = Tables { images, samplers: Vec::new(), textures: Vec::new() };
    for (m, material) in scene.materials.iter().enumerate() {
        let value = write_material(material, &mut tables, writer)
            .map_err(|rule| fault(format!("material {m}"), rule))?;
        writer.materials.push(with_extras(named(value, &material.name), &material.extras));
    }
    Ok(())
}

/// Samplers and textures written so far; the order is that of first use.
pub(super) struct Tables {
    images: HashMap<usize, usize>,
    samplers: Vec<Sampler>,
    textures: Vec<(usize, Sampler)>,
}

impl Tables {
    fn texture(&mut self, slot: &TextureSlot, writer: &mut Writer) -> usize {
        let key = (slot.image, slot.sampler);
        if let Some(i) = self.textures.iter().position(|t| *t == key) {
            return i;
        }
        let sampler = self.samplers.iter().position(|s| *s == slot.sampler).unwrap_or_else(|| {
            self.samplers.push(slot.sampler);
            writer.samplers.push(sampler(&slot.sampler));
            self.samplers.len() - 1
        });
        self.textures.push(key);
        let source = self.images[&slot.image];
        let extension = match writer.images[source]["mimeType"].as_str() {
            Some(WEBP) => Some("EXT_texture_webp"),
            Some(KTX2) => Some("KHR_texture_basisu"),
            _ => None,
        };
        writer.textures.push(match extension {
            Some(name) => {
                writer.extensions.insert(name);
                writer.required.insert(name);
                json!({"extensions": {name: {"source": source}}, "sampler": sampler})
            }
            None => json!({"source": source, "sampler": sampler}),
        });
        self.textures.len() - 1
    }
}

fn sampler(s: &Sampler) -> Value {
    let wrap = |w| match w {
        Wrap::Repeat => 10497,
        Wrap::MirroredRepeat => 33648,
        Wrap::ClampToEdge => 33071,
    };
    let (mag, min) = match s.filter {
        Filter::Nearest => (9728, 9728),
        Filter::Bilinear => (9729, 9729),
        Filter::Trilinear => (9729, 9987),
    };
    json!({"magFilter": mag, "minFilter": min, "wrapS": wrap(s.wrap_u), "wrapT": wrap(s.wrap_v)})
}

fn write_material(m: &Material, tables: &mut Tables, writer: &mut Writer) -> Result<Value, String> {
    let unit = |x: f32| x.clamp(0.0, 1.0);
    let cutoff = if let AlphaMode::Mask { cutoff } = m.alpha_mode { cutoff } else { 0.0 };
    let factors = [m.metallic, m.roughness, m.normal_scale, m.occlusion_strength, cutoff];
    if !factors.iter().chain(&m.base_color).chain(&m.emissive).all(|x| x.is_finite()) {
        return Err("a factor is not finite; factors must be".into());
    }
    let mut pbr = Map::new();
    let mut out = Map::new();
    let mut extensions = Map::new();
    if m.base_color != [1.0; 4] {
        pbr.insert("baseColorFactor".into(), json!(m.base_color.map(unit)));
    }
    if m.metallic != 1.0 {
        pbr.insert("metallicFactor".into(), json!(unit(m.metallic)));
    }
    if m.roughness != 1.0 {
        pbr.insert("roughnessFactor".into(), json!(unit(m.roughness)));
    }
    if let Some(slot) = &m.base_color_texture {
        pbr.insert("baseColorTexture".into(), info(slot, tables, writer)?);
    }
    if let Some(slot) = &m.metallic_roughness_texture {
        pbr.insert("metallicRoughnessTexture".into(), info(slot, tables, writer)?);
    }
    if !pbr.is_empty() {
        out.insert("pbrMetallicRoughness".into(), Value::Object(pbr));
    }
    if let Some(slot) = &m.normal_texture {
        let mut info = info(slot, tables, writer)?;
        if m.normal_scale != 1.0 {
            info["scale"] = json!(m.normal_scale);
        }
        out.insert("normalTexture".into(), info);
    }
    if let Some(slot) = &m.occlusion_texture {
        let mut info = info(slot, tables, writer)?;
        if m.occlusion_strength != 1.0 {
            info["strength"] = json!(unit(m.occlusion_strength));
        }
        out.insert("occlusionTexture".into(), info);
    }
    if let Some(slot) = &m.emissive_texture {
        out.insert("emissiveTexture".into(), info(slot, tables, writer)?);
    }
    let strength = m.emissive.iter().fold(1.0_f32, |a, &e| a.max(e));
    if m.emissive.iter().any(|&e| e > 0.0) {
        out.insert("emissiveFactor".into(), json!(m.emissive.map(|e| unit(e / strength))));
    }
    if strength > 1.0 {
        extensions.insert("KHR_materials_emissive_strength".into(), json!({"emissiveStrength": strength}));
        writer.extensions.insert("KHR_materials_emissive_strength");
    }
    if m.unlit {
        extensions.insert("KHR_materials_unlit".into(), json!({}));
        writer.extensions.insert("KHR_materials_unlit");
    }
    if let Some(e) = &m.extensions {
        extensions::write(e, &mut extensions, tables, writer)?;
    }
    match m.alpha_mode {
        AlphaMode::Opaque => {}
        AlphaMode::Mask { cutoff } => {
            out.insert("alphaMode".into(), json!("MASK"));
            out.insert("alphaCutoff".into(), json!(cutoff.max(0.0)));
        }
        AlphaMode::Blend => {
            out.insert("alphaMode".into(), json!("BLEND"));
        }
    }
    if m.double_sided {
        out.insert("doubleSided".into(), json!(true));
    }
    if !extensions.is_empty() {
        out.insert("extensions".into(), Value::Object(extensions));
    }
    Ok(Value::Object(out))
}

pub(super) fn info(slot: &TextureSlot, tables: &mut Tables, writer: &mut Writer) -> Result<Value, String> {
    let mut info = json!({"index": tables.texture(slot, writer)});
    if slot.tex_coord != 0 {
        info["texCoord"] = json!(slot.tex_coord);
    }
    let (offset, rotation, scale) = parts(&slot.transform)
        .ok_or("the texture transform shears; it must be offset, rotation and scale")?;
    let mut transform = Map::new();
    if offset != [0.0; 2] {
        transform.insert("offset".into(), json!(offset));
    }
    if rotation != 0.0 {
        transform.insert("rotation".into(), json!(rotation));
    }
    if scale != [1.0; 2] {
        transform.insert("scale".into(), json!(scale));
    }
    if !transform.is_empty() {
        info["extensions"] = json!({"KHR_texture_transform": transform});
        writer.extensions.insert("KHR_texture_transform");
    }
    Ok(info)
}

/// Offset, rotation and scale of an affine map; `None` where it shears or is not finite.
pub(super) fn parts(m: &[[f32; 3]; 2]) -> Option<([f32; 2], f32, [f32; 2])> {
    if !m.iter().flatten().all(|x| x.is_finite()) {
        return None;
    }
    let offset = [m[0][2], m[1][2]];
    if m[0][1] == 0.0 && m[1][0] == 0.0 {
        return Some((offset, 0.0, [m[0][0], m[1][1]]));
    }
    let (x, y) = ([m[0][0], m[1][0]], [m[0][1], m[1][1]]);
    let (sx, sy) = (x[0].hypot(x[1]), y[0].hypot(y[1]));
    // From the longer column, the other one's sign from the determinant.
    let rotation = if sx >= sy { (-x[1]).atan2(x[0]) } else { y[0].atan2(y[1]) };
    let flip = if x[0] * y[1] - x[1] * y[0] < 0.0 { -1.0 } else { 1.0 };
    let scale = if sx >= sy { [sx, flip * sy] } else { [flip * sx, sy] };
    let again = affine_of_transform(offset, rotation, scale);
    let near = |a: f32, b: f32| (a - b).abs() <= 1e-5 * sx.max(sy);
    let same = (0..2).all(|r| (0..2).all(|c| near(again[r][c], m[r][c])));
    same.then_some((offset, rotation, scale))
}
