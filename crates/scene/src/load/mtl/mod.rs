//! Material libraries of OBJ files: statements become metallic-roughness materials as Blender's importer reads them.

mod maps;
mod statements;

use super::Limits;
use super::file::{Folder, clip};
use super::obj::{lines, split_keyword};
use super::texture::Textures;
use crate::error::{Fault, FaultKind, fault};
use crate::{Material, Sampler, Scene, TextureSlot, Wrap};
use statements::Statements;
use std::collections::HashMap;

/// Materials of libraries, complete once their textures are decoded.
#[derive(Debug, Default)]
pub(super) struct Library {
    /// Index into the scene's materials, and what the file says about it.
    statements: Vec<(usize, Statements)>,
}

impl Library {
    /// Appends the materials of the library named on an `mtllib` line.
    ///
    /// A library or a texture that is not there is a warning, and so is a texture outside of the folder. In place of either
    /// texture one of its name beside the library is taken, with a warning; a texture of the base colour or of the emission that is
    /// damaged is an error, another map that is a warning.
    pub(super) fn load(
        &mut self,
        file: &str,
        folder: &Folder,
        limits: &Limits,
        place: &str,
        scene: &mut Scene,
        names: &mut HashMap<String, usize>,
        textures: &mut Textures<'_>,
    ) -> Result<(), Fault> {
        let read = |name: &str| folder.read_name(name, limits.file_bytes, place);
        let found = match read(file) {
            // Exporters write the path that the library had on their machine.
            Err(f) if f.kind == FaultKind::Outside => {
                let name = file.rsplit(['/', '\\']).next().filter(|n| !n.is_empty());
                match name.and_then(|n| Some((n, read(n).ok()?))) {
                    Some((name, text)) => {
                        let instead =
                            format!("`{}`, the file of its name beside the asset, is read", clip(name));
                        scene.warnings.push(format!("{place}: {}; {instead}", f.rule));
                        Ok(text)
                    }
                    None => Err(f),
                }
            }
            other => other,
        };
        let text = match found {
            Ok(text) => text,
            Err(f) if matches!(f.kind, FaultKind::Unreadable | FaultKind::Outside) => {
                scene.warnings.push(format!("{place}: {}: the library is left out", f.rule));
                return Ok(());
            }
            Err(f) => return Err(f),
        };
        let mut ignored: Vec<String> = Vec::new();
        let mut begun = false;
        let mut beyond: Vec<Beyond> = Vec::new();
        for (line, text) in lines(&text) {
            let place = format!("{} line {line}", clip(file));
            let (keyword, rest) = split_keyword(&text);
            if keyword == "newmtl" {
                names.insert(rest.to_owned(), scene.materials.len());
                self.statements.push((scene.materials.len(), Statements::default()));
                scene.materials.push(Material { name: rest.to_owned(), ..super::clay() });
                begun = true;
                continue;
            }
            let Some((_, statements)) = self.statements.last_mut().filter(|_| begun) else { continue };
            let kind = rest.split_whitespace().next().filter(|w| ["spectral", "xyz"].contains(w));
            if let Some(kind) = kind.filter(|_| !statements::may_be_left_out(keyword)) {
                let statement = clip(&format!("{keyword} {kind}"));
                if !ignored.contains(&statement) && ignored.len() < 16 {
                    ignored.push(statement);
                }
                continue;
            }
            let mut warning = None;
            let mut map = |rest: &str, needed: bool| match map(rest, folder, limits, &place, textures) {
                Ok((map, told)) => {
                    warning = told;
                    Ok(Some(map))
                }
                Err(f) if needed && f.kind == FaultKind::Content => Err(f),
                Err(f) => {
                    warning = Some(format!("{}: {}: the map is left out", f.place, f.rule));
                    Ok(None)
                }
            };
            let mut told = None;
            let known = match statements.statement(keyword, rest, &place, &mut map, &mut told) {
                Err(f) if statements::may_be_left_out(keyword) => {
                    warning = Some(format!("{}: {}: `{keyword}` is left out", f.place, f.rule));
                    true
                }
                other => other?,
            };
            scene.warnings.extend(warning);
            if let Some(rule) = told {
                match beyond.iter_mut().find(|b| b.keyword == keyword) {
                    Some(b) => b.more += 1,
                    None => beyond.push(Beyond {
                        keyword: keyword.to_owned(),
                        first: format!("{place}: {rule}"),
                        more: 0,
                    }),
                }
            }
            if !known && !ignored.iter().any(|k| k == keyword) && ignored.len() < 16 {
                ignored.push(clip(keyword));
            }
        }
        scene.warnings.extend(beyond.into_iter().map(|b| match b.more {
            0 => b.first,
            n => format!("{} (and {n} more of `{}`)", b.first, b.keyword),
        }));
        if !ignored.is_empty() {
            scene.warnings.push(format!("{}: ignored statements: {}", clip(file), ignored.join(", ")));
        }
        Ok(())
    }

    /// Completes the materials; the scene has its images. Maps that glTF keeps in one image are joined, at most
    /// `limits.texels` texels in all. Where vertices are `colored`, colours that no statement gives are theirs.
    pub(super) fn finish(self, scene: &mut Scene, colored: bool, limits: &Limits) -> Result<(), Fault> {
        let mut joined = maps::Joined::new(limits);
        for (m, statements) in self.statements {
            let mut material = statements.material(colored);
            material.name.clone_from(&scene.materials[m].name);
            let place = format!("material `{}`", clip(&material.name));
            let warnings =
                joined.apply(&statements, &mut material, &mut scene.images).map_err(|r| fault(&place, r))?;
            scene.warnings.extend(warnings.iter().map(|w| format!("{place}: {w}")));
            scene.materials[m] = material;
        }
        Ok(())
    }
}

/// Statements of one keyword whose numbers lie out of its range.
struct Beyond {
    keyword: String,
    /// Place and rule of the first one.
    first: String,
    more: usize,
}

/// A texture of a statement.
#[derive(Clone, Copy, Debug)]
struct Map {
    slot: TextureSlot,
    /// `-bm`: strength of a bump map.
    strength: f32,
}

/// Most of a number among the options of a texture: beyond it coordinates and slopes lose all their digits.
const MOST: f32 = 1e6;

/// A texture statement: options, then the file's name to the end of the line; and what to tell of it.
fn map(
    rest: &str,
    folder: &Folder,
    limits: &Limits,
    place: &str,
    textures: &mut Textures<'_>,
) -> Result<(Map, Option<String>), Fault> {
    let mut rest = rest;
    let (mut scale, mut offset, mut wrap) = ([1.0_f32; 2], [0.0_f32; 2], Wrap::Repeat);
    let mut strength = 1.0;
    let mut told = None;
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
                // `nan` and `inf` are numbers.
                match word.parse::<f32>() {
                    Ok(x) if x.abs() <= MOST && (x >= 0.0 || option != "-bm") => values[k] = x,
                    Ok(_) => {
                        let [option, word] = [option, word].map(clip);
                        told = Some(format!("{place}: `{option} {word}` has no meaning: it is left out"));
                    }
                    Err(_) => break,
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
            "-bm" if values[0].is_finite() => strength = values[0],
            _ => {}
        }
        rest = after;
    }
    let key = format!("texture {rest}");
    let image = match textures.known(&key) {
        Some(image) => image,
        None => {
            let bytes = match folder.read_name(rest, limits.file_bytes, place) {
                // Exporters write the path that the picture had on their machine; it may lie beside the library.
                Err(f) if f.kind != FaultKind::Content => {
                    let beside = rest.rsplit(['/', '\\']).next().filter(|name| *name != rest).ok_or(());
                    let (name, bytes) = beside
                        .and_then(|name| {
                            Ok((name, folder.read_name(name, limits.file_bytes, place).map_err(drop)?))
                        })
                        .map_err(|()| f)?;
                    let [from, name] = [rest, name].map(clip);
                    told =
                        Some(format!("{place}: `{from}` is not there; `{name}` beside the library is taken"));
                    bytes
                }
                other => other?,
            };
            textures.request(key, format!("{place}, {}", clip(rest)), rest.to_owned(), bytes.into())?
        }
    };
    // The file's v points up: v' = 1 - (scale (1 - v) + offset).
    let transform = [[scale[0], 0.0, offset[0]], [0.0, scale[1], 1.0 - scale[1] - offset[1]]];
    let sampler = Sampler { wrap_u: wrap, wrap_v: wrap, ..Sampler::default() };
    Ok((Map { slot: TextureSlot { image, sampler, tex_coord: 0, transform }, strength }, told))
}
