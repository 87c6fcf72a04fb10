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
use std::collections::{HashMap, HashSet};

/// The libraries of an `mtllib` line: one whose name may have spaces, or, where there is none of that name, several, one more than `most` at
/// most.
pub(super) fn named<'a>(rest: &'a str, folder: &Folder, most: usize) -> Vec<&'a str> {
    let several: Vec<&str> = rest.split_ascii_whitespace().take(most + 1).collect();
    let is_list = several.len() > 1 && !folder.notes(rest) && several.iter().any(|name| folder.notes(name));
    if is_list { several } else { vec![rest] }
}

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
        let mut notes = Notes::default();
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
            let mut map = |rest: &str, needed: bool| match map(
                keyword, rest, folder, limits, &place, textures, &mut notes,
            ) {
                Err(f) if needed && f.kind == FaultKind::Content => Err(f),
                Err(f) => {
                    let line = format!("{}: {}: the map is left out", f.place, f.rule);
                    notes.add(Kind::Map, keyword, line);
                    Ok(None)
                }
                Ok(map) => Ok(Some(map)),
            };
            let mut told = None;
            let known = match statements.statement(keyword, rest, &place, &mut map, &mut told) {
                Err(f) if statements::may_be_left_out(keyword) => {
                    let line = format!("{}: {}: `{keyword}` is left out", f.place, f.rule);
                    notes.add(Kind::Unread, keyword, line);
                    true
                }
                other => other?,
            };
            if !known {
                // Maps that have no meaning here are files of the asset all the same.
                folder.notes(rest.rsplit(|c: char| c.is_ascii_whitespace()).next().unwrap_or(rest));
            }
            if let Some(rule) = told {
                notes.add(Kind::Range, keyword, format!("{place}: {rule}"));
            }
            if !known && !ignored.iter().any(|k| k == keyword) && ignored.len() < 16 {
                ignored.push(clip(keyword));
            }
        }
        scene.warnings.extend(notes.lines());
        if !begun {
            let is = format!("{place}: the library `{}` defines no material", clip(file));
            scene
                .warnings
                .push(format!("{is}; each must begin with `newmtl` and its name, in ASCII or UTF-8"));
        }
        if !ignored.is_empty() {
            scene.warnings.push(format!("{}: ignored statements: {}", clip(file), ignored.join(", ")));
        }
        Ok(())
    }

    /// Images that materials take normals from, which are read as they are; other data are joined in 8 bits.
    pub(super) fn normal_maps(&self) -> HashSet<usize> {
        let maps = self.statements.iter().flat_map(|(_, s)| [&s.normal_map, &s.bump_map]);
        maps.flatten().map(|m| m.slot.image).collect()
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

/// What warnings of statements are about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// Numbers out of range.
    Range,
    /// Values that cannot be read.
    Unread,
    /// Options of a map.
    Option,
    /// A map that is not there, or another file in its place.
    Map,
}

impl Kind {
    /// How many of a kind are told in full; those of maps name their files.
    fn most(self) -> usize {
        if self == Self::Map { 8 } else { 1 }
    }
}

/// Warnings of one kind about one sort of statements.
#[derive(Debug)]
struct Note {
    kind: Kind,
    /// The keyword; of options with their name.
    of: String,
    /// The first ones.
    lines: Vec<String>,
    /// How many follow.
    more: usize,
}

/// Warnings of a library: a few of each kind and keyword in full, the others by their number.
#[derive(Debug, Default)]
struct Notes(Vec<Note>);

impl Notes {
    fn add(&mut self, kind: Kind, of: &str, line: String) {
        match self.0.iter_mut().find(|n| n.kind == kind && n.of == of) {
            Some(note) if note.lines.len() < kind.most() => note.lines.push(line),
            Some(note) => note.more += 1,
            None => self.0.push(Note { kind, of: of.to_owned(), lines: vec![line], more: 0 }),
        }
    }

    fn lines(self) -> impl Iterator<Item = String> {
        self.0.into_iter().flat_map(|mut note| {
            if let Some(last) = note.lines.last_mut().filter(|_| note.more > 0) {
                *last += &format!(" (and {} more of `{}`)", note.more, note.of);
            }
            note.lines
        })
    }
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

/// A texture statement: options, then the file's name to the end of the line; `notes` hears what to tell of it.
fn map(
    keyword: &str,
    rest: &str,
    folder: &Folder,
    limits: &Limits,
    place: &str,
    textures: &mut Textures<'_>,
    notes: &mut Notes,
) -> Result<Map, Fault> {
    let mut rest = rest;
    let (mut scale, mut offset, mut wrap) = ([1.0_f32; 2], [0.0_f32; 2], Wrap::Repeat);
    let mut strength = 1.0;
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
                let Ok(x) = word.parse::<f32>() else { break };
                let (value, wrong) = match option {
                    "-bm" if x.is_finite() && x < 0.0 => (0.0, Some("is below 0: 0 is taken")),
                    _ if x.abs() <= MOST => (x, None),
                    _ => (f32::NAN, Some("has no meaning: it is left out")),
                };
                values[k] = value;
                if let Some(wrong) = wrong {
                    let line = format!("{place}: `{option} {}` {wrong}", clip(word));
                    notes.add(Kind::Option, &format!("{keyword} {option}"), line);
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
                    let line =
                        format!("{place}: `{from}` is not there; `{name}` beside the library is taken");
                    notes.add(Kind::Map, keyword, line);
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
    Ok(Map { slot: TextureSlot { image, sampler, tex_coord: 0, transform }, strength })
}
