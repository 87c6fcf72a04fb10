//! Materials: metallic-roughness factors and texture slots.

use super::document::Document;
use super::extensions;
use crate::error::{Fault, fault};
use crate::load::file::clip;
use crate::load::texture::{Textures, affine_of_transform};
use crate::{AlphaMode, Filter, Material, Sampler, TextureSlot, Wrap};
use gltf::json;
use gltf::json::texture::{MagFilter, MinFilter, WrappingMode};
use gltf::json::validation::Checked;
use serde_json::Value;
use std::borrow::Cow;

/// Reads material `m`; its textures are requested from `textures`.
pub(super) fn read<'a>(
    document: &'a Document<'_>,
    m: usize,
    textures: &mut Textures<'a>,
    warnings: &mut Vec<String>,
) -> Result<Material, Fault> {
    let count = document.root.materials.len();
    let place = format!("material {m}");
    let json = document
        .root
        .materials
        .get(m)
        .ok_or_else(|| fault(&place, format!("does not exist; there are {count} materials")))?;
    let raw = &document.materials[m];
    let pbr = &json.pbr_metallic_roughness;
    let mut slot = |texture: Option<usize>, set: u32, path: &str| {
        texture.map(|t| read_slot(document, t, set, raw, m, path, textures, warnings)).transpose()
    };
    let info = |i: &Option<json::texture::Info>| {
        (i.as_ref().map(|i| i.index.value()), i.as_ref().map_or(0, |i| i.tex_coord))
    };
    let (t, set) = info(&pbr.base_color_texture);
    let base_color_texture = slot(t, set, "/pbrMetallicRoughness/baseColorTexture")?;
    let (t, set) = info(&pbr.metallic_roughness_texture);
    let metallic_roughness_texture = slot(t, set, "/pbrMetallicRoughness/metallicRoughnessTexture")?;
    let (t, set) = info(&json.emissive_texture);
    let emissive_texture = slot(t, set, "/emissiveTexture")?;
    let normal = json.normal_texture.as_ref();
    let normal_texture =
        slot(normal.map(|n| n.index.value()), normal.map_or(0, |n| n.tex_coord), "/normalTexture")?;
    let occlusion = json.occlusion_texture.as_ref();
    let occlusion_texture =
        slot(occlusion.map(|o| o.index.value()), occlusion.map_or(0, |o| o.tex_coord), "/occlusionTexture")?;
    let typed = json.extensions.as_ref();
    let name = json.name.clone().unwrap_or_default();
    let described = if name.is_empty() { place.clone() } else { format!("{place} `{}`", clip(&name)) };
    let added = extensions::read(document, m, &described, textures, warnings)?;
    let strength = typed.and_then(|e| e.emissive_strength.as_ref()).map_or(1.0, |e| e.emissive_strength.0);
    let alpha_mode = match json.alpha_mode {
        Checked::Valid(json::material::AlphaMode::Opaque) => AlphaMode::Opaque,
        Checked::Valid(json::material::AlphaMode::Mask) => {
            AlphaMode::Mask { cutoff: json.alpha_cutoff.map_or(0.5, |c| c.0) }
        }
        Checked::Valid(json::material::AlphaMode::Blend) => AlphaMode::Blend,
        Checked::Invalid => {
            return Err(fault(place, "alphaMode is unknown; it must be OPAQUE, MASK or BLEND"));
        }
    };
    let material = Material {
        name,
        base_color: pbr.base_color_factor.0,
        base_color_texture,
        metallic: pbr.metallic_factor.0,
        roughness: pbr.roughness_factor.0,
        metallic_roughness_texture,
        normal_texture,
        normal_scale: normal.map_or(1.0, |n| n.scale),
        occlusion_texture,
        occlusion_strength: occlusion.map_or(1.0, |o| o.strength.0),
        emissive: json.emissive_factor.0.map(|e| e * strength),
        emissive_texture,
        alpha_mode,
        double_sided: json.double_sided,
        unlit: typed.is_some_and(|e| e.unlit.is_some()),
        extensions: added,
        extras: document.extras(&json.extras, || place.clone())?,
    };
    check_factors(&material).map_err(|rule| fault(described, rule))?;
    Ok(material)
}

fn check_factors(m: &Material) -> Result<(), String> {
    let unit = |x: f32| (0.0..=1.0).contains(&x);
    if !m.base_color.iter().all(|&x| unit(x)) {
        return Err(format!("baseColorFactor is {:?}; it must lie in [0, 1]", m.base_color));
    }
    if !unit(m.metallic) || !unit(m.roughness) {
        let found = format!("metallicFactor is {} and roughnessFactor {}", m.metallic, m.roughness);
        return Err(format!("{found}; they must lie in [0, 1]"));
    }
    if !m.emissive.iter().all(|x| x.is_finite() && *x >= 0.0) {
        let found = format!("emissiveFactor times emissiveStrength is {:?}", m.emissive);
        return Err(format!("{found}; it must be finite and not negative"));
    }
    if !m.normal_scale.is_finite() {
        return Err(format!("normalTexture.scale is {}; it must be finite", m.normal_scale));
    }
    if !unit(m.occlusion_strength) {
        return Err(format!("occlusionTexture.strength is {}; it must lie in [0, 1]", m.occlusion_strength));
    }
    match m.alpha_mode {
        AlphaMode::Mask { cutoff } if !(cutoff.is_finite() && cutoff >= 0.0) => {
            Err(format!("alphaCutoff is {cutoff}; it must be finite and not negative"))
        }
        _ => Ok(()),
    }
}

pub(super) fn read_slot<'a>(
    document: &'a Document<'_>,
    texture: usize,
    set: u32,
    raw: &Value,
    m: usize,
    path: &str,
    textures: &mut Textures<'a>,
    warnings: &mut Vec<String>,
) -> Result<TextureSlot, Fault> {
    let place = format!("material {m}{}", path.replace('/', "."));
    let root = &document.root;
    let json = root.textures.get(texture).ok_or_else(|| {
        fault(&place, format!("names texture {texture}; there are {} textures", root.textures.len()))
    })?;
    let source = source(&document.textures[texture], json)
        .map_err(|rule| fault(format!("texture {texture}"), rule))?;
    let image = image(document, source, texture, textures)?;
    let sampler = match json.sampler.map(|s| s.value()) {
        None => Sampler::default(),
        Some(s) => {
            let json = root.samplers.get(s).ok_or_else(|| {
                fault(
                    format!("texture {texture}"),
                    format!("names sampler {s}; there are {} samplers", root.samplers.len()),
                )
            })?;
            sampler(json).ok_or_else(|| {
                fault(
                    format!("sampler {s}"),
                    "wrap or filter is unknown; both must be constants of the specification",
                )
            })?
        }
    };
    let transform = raw.pointer(path).and_then(|t| t.pointer("/extensions/KHR_texture_transform"));
    let (transform, set) = match transform {
        None => (IDENTITY, set),
        Some(t) => {
            let own = t.get("texCoord").and_then(Value::as_u64).map_or(set, |s| s.min(99) as u32);
            (
                read_transform(t).ok_or_else(|| {
                    fault(&place, "KHR_texture_transform is not made of finite numbers; it must be")
                })?,
                own,
            )
        }
    };
    if set > 1 {
        warnings.push(format!("{place}: texture coordinate set {set} is not read, set 0 is used"));
    }
    Ok(TextureSlot { image, sampler, tex_coord: if set == 1 { 1 } else { 0 }, transform })
}

/// The image of a texture: that of the extension whose format is read here, before the one for all readers.
fn source(raw: &Value, json: &json::Texture) -> Result<usize, String> {
    for extension in ["KHR_texture_basisu", "EXT_texture_webp"] {
        let Some(object) = raw.pointer(&format!("/extensions/{extension}")) else { continue };
        let index = object.get("source").and_then(Value::as_u64).and_then(|i| usize::try_from(i).ok());
        return index
            .ok_or_else(|| format!("{extension}.source is missing or no index; it must be an image"));
    }
    let source = json.source.value();
    if source == u32::MAX as usize {
        let rule = "has no `source` that is read here; it must have a `source` image (PNG or JPEG, WebP with \
                    EXT_texture_webp, or KTX 2.0 with KHR_texture_basisu)";
        return Err(rule.into());
    }
    Ok(source)
}

const IDENTITY: [[f32; 3]; 2] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

fn read_transform(t: &Value) -> Option<[[f32; 3]; 2]> {
    let number = |v: &Value| v.as_f64().map(|x| x as f32).filter(|x| x.is_finite());
    let pair = |key: &str, default: f32| match t.get(key) {
        None => Some([default; 2]),
        Some(v) => match v.as_array()?.as_slice() {
            [a, b] => Some([number(a)?, number(b)?]),
            _ => None,
        },
    };
    let rotation = t.get("rotation").map_or(Some(0.0), number)?;
    Some(affine_of_transform(pair("offset", 0.0)?, rotation, pair("scale", 1.0)?))
}

/// `None` where a constant is not of the specification.
fn sampler(json: &json::texture::Sampler) -> Option<Sampler> {
    fn valid<T: Copy>(c: Option<Checked<T>>) -> Option<Option<T>> {
        match c {
            None => Some(None),
            Some(Checked::Valid(v)) => Some(Some(v)),
            Some(Checked::Invalid) => None,
        }
    }
    let wrap = |w| {
        Some(match w {
            Checked::Valid(WrappingMode::Repeat) => Wrap::Repeat,
            Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::MirroredRepeat,
            Checked::Valid(WrappingMode::ClampToEdge) => Wrap::ClampToEdge,
            Checked::Invalid => return None,
        })
    };
    let filter = match (valid(json.mag_filter)?, valid(json.min_filter)?) {
        // Blocks are what an asset with nearest magnification wants to show.
        (Some(MagFilter::Nearest), _) => Filter::Nearest,
        (_, Some(MinFilter::Linear | MinFilter::Nearest)) => Filter::Bilinear,
        _ => Filter::Trilinear,
    };
    Some(Sampler { wrap_u: wrap(json.wrap_s)?, wrap_v: wrap(json.wrap_t)?, filter })
}

/// Requests an image; the same image is decoded once.
fn image<'a>(
    document: &'a Document<'_>,
    i: usize,
    texture: usize,
    textures: &mut Textures<'a>,
) -> Result<usize, Fault> {
    let root = &document.root;
    let json = root.images.get(i).ok_or_else(|| {
        fault(
            format!("texture {texture}"),
            format!("names image {i}; there are {} images", root.images.len()),
        )
    })?;
    let place = format!("image {i}");
    // By source, so that images that share one are decoded once.
    let key = match (&json.buffer_view, &json.uri) {
        (Some(view), _) => format!("bufferView {view}"),
        (None, Some(uri)) if !uri.starts_with("data:") => format!("file {uri}"),
        _ => place.clone(),
    };
    if let Some(known) = textures.known(&key) {
        return Ok(known);
    }
    let name = json.name.clone().or_else(|| json.uri.clone().filter(|u| !u.starts_with("data:")));
    let bytes = match (&json.buffer_view, &json.uri) {
        (Some(view), _) => Cow::Borrowed(document.view(view.value(), &place)?),
        (None, Some(uri)) => document.folder.read_uri(uri, document.limits.file_bytes, &place)?.into(),
        (None, None) => return Err(fault(place, "has neither bufferView nor URI; it must have one of them")),
    };
    let extras = document.extras(&json.extras, || place.clone())?;
    let image = textures.request(key, place, name.unwrap_or_default(), bytes)?;
    textures.set_extras(image, extras);
    Ok(image)
}
