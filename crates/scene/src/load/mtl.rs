//! Material libraries of OBJ files.

use super::Limits;
use super::file::{Folder, clip};
use super::obj::{lines, numbers, split_keyword};
use super::texture::Textures;
use crate::error::{Fault, fault};
use crate::{AlphaMode, Material, Sampler, Scene, TextureSlot, Wrap};
use std::collections::HashMap;

/// Appends the materials of the libraries named on an `mtllib` line.
///
/// `Kd` or, where there is one, `map_Kd` is the base colour, `d` or `Tr` its alpha, `Ke` and `map_Ke` the emission; roughness is 0.5
/// and metalness 0. A library that does not exist is a warning, a texture that does not exist an error.
pub(super) fn load(
    files: &str,
    folder: &Folder,
    limits: &Limits,
    place: &str,
    scene: &mut Scene,
    names: &mut HashMap<String, usize>,
    textures: &mut Textures<'_>,
) -> Result<(), Fault> {
    let text = match folder.read_name(files, limits.file_bytes, place) {
        Ok(text) => text,
        Err(f) if f.rule.contains("cannot be read") => {
            scene.warnings.push(format!("{place}: {}", f.rule));
            return Ok(());
        }
        Err(f) => return Err(f),
    };
    let mut current: Option<usize> = None;
    let mut ignored: Vec<String> = Vec::new();
    for (line, text) in lines(&text) {
        let place = format!("{} line {line}", clip(files));
        let (keyword, rest) = split_keyword(&text);
        if keyword == "newmtl" {
            names.insert(rest.to_owned(), scene.materials.len());
            current = Some(scene.materials.len());
            let base_color = [0.8, 0.8, 0.8, 1.0];
            scene.materials.push(Material { name: rest.to_owned(), base_color, ..Material::clay() });
            continue;
        }
        let Some(material) = current.map(|m| &mut scene.materials[m]) else { continue };
        let known = statement(material, keyword, rest, folder, limits, &place, textures)?;
        if !known && !ignored.iter().any(|k| k == keyword) && ignored.len() < 16 {
            ignored.push(clip(keyword));
        }
    }
    if !ignored.is_empty() {
        scene.warnings.push(format!("{}: ignored statements: {}", clip(files), ignored.join(", ")));
    }
    Ok(())
}

/// Whether the statement has a meaning here (or none that is worth a warning).
fn statement(
    material: &mut Material,
    keyword: &str,
    rest: &str,
    folder: &Folder,
    limits: &Limits,
    place: &str,
    textures: &mut Textures<'_>,
) -> Result<bool, Fault> {
    let rule = |rule: String| fault(place, rule);
    let color = || -> Result<[f32; 3], Fault> {
        let c: [f32; 3] = numbers(rest, &[f32::MAX; 3], 1).map_err(rule)?;
        // One number stands for all three.
        Ok(if c[1] == f32::MAX {
            [c[0].max(0.0); 3]
        } else {
            c.map(|x| if x == f32::MAX { 0.0 } else { x.max(0.0) })
        })
    };
    let mut alpha = |a: f32| {
        material.base_color[3] = a.clamp(0.0, 1.0);
        material.alpha_mode = if material.base_color[3] < 1.0 { AlphaMode::Blend } else { AlphaMode::Opaque };
    };
    match keyword {
        // A map stands in place of Kd, as in Blender: exporters write 0.64 or 0.8 beside it.
        "Kd" if material.base_color_texture.is_some() => drop(color()?),
        "Kd" => {
            let c = color()?;
            material.base_color[..3].copy_from_slice(&c.map(|x| x.min(1.0)));
        }
        "Ke" => material.emissive = color()?,
        "d" => {
            let words = rest.strip_prefix("-halo").unwrap_or(rest);
            alpha(numbers::<1>(words, &[1.0], 1).map_err(rule)?[0]);
        }
        "Tr" => alpha(1.0 - numbers::<1>(rest, &[0.0], 1).map_err(rule)?[0]),
        "map_Kd" => {
            material.base_color_texture = Some(map(rest, folder, limits, place, textures)?);
            material.base_color[..3].fill(1.0);
        }
        "map_Ke" => {
            material.emissive_texture = Some(map(rest, folder, limits, place, textures)?);
            if material.emissive == [0.0; 3] {
                material.emissive = [1.0; 3];
            }
        }
        "" | "#" | "Ka" | "Ks" | "Ns" | "Ni" | "illum" | "Tf" => {}
        _ => return Ok(false),
    }
    Ok(true)
}

/// A texture statement: options, then the file's name to the end of the line.
fn map(
    rest: &str,
    folder: &Folder,
    limits: &Limits,
    place: &str,
    textures: &mut Textures<'_>,
) -> Result<TextureSlot, Fault> {
    let mut rest = rest;
    let (mut scale, mut offset, mut wrap) = ([1.0_f32; 2], [0.0_f32; 2], Wrap::Repeat);
    while rest.starts_with('-') {
        let (option, after) = split_keyword(rest);
        let (most, numeric) = match option {
            "-o" | "-s" | "-t" => (3, true),
            "-mm" => (2, true),
            "-bm" | "-boost" | "-texres" => (1, true),
            "-blendu" | "-blendv" | "-cc" | "-clamp" | "-imfchan" | "-type" => (1, false),
            // A file may begin with a dash.
            _ => break,
        };
        let mut values = [f32::NAN; 3];
        let mut after = after;
        for k in 0..most {
            let (word, next) = split_keyword(after);
            if numeric {
                match word.parse::<f32>().ok().filter(|x| x.is_finite()) {
                    Some(x) => values[k] = x,
                    None => break,
                }
            } else if option == "-clamp" && word == "on" {
                wrap = Wrap::ClampToEdge;
            }
            after = next;
        }
        let pick = |out: &mut [f32; 2]| {
            for k in 0..2 {
                if values[k].is_finite() {
                    out[k] = values[k];
                }
            }
        };
        match option {
            "-s" => pick(&mut scale),
            "-o" => pick(&mut offset),
            _ => {}
        }
        rest = after;
    }
    let key = format!("texture {rest}");
    let image = match textures.known(&key) {
        Some(image) => image,
        None => {
            let bytes = folder.read_name(rest, limits.file_bytes, place)?;
            textures.request(key, place.to_owned(), rest.to_owned(), bytes.into())?
        }
    };
    // The file's v points up: v' = 1 - (scale (1 - v) + offset).
    let transform = [[scale[0], 0.0, offset[0]], [0.0, scale[1], 1.0 - scale[1] - offset[1]]];
    Ok(TextureSlot {
        image,
        sampler: Sampler { wrap_u: wrap, wrap_v: wrap, ..Sampler::default() },
        tex_coord: 0,
        transform,
    })
}
