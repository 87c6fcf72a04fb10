//! Wavefront OBJ with its material library.

use super::file::{Folder, clip};
use super::texture::Textures;
use super::{Budget, Limits, mtl, normals, place, polygon};
use crate::error::{Fault, fault};
use crate::{Primitive, Scene};
use photofit_geometry::Mesh;
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec2, vec3};
use std::borrow::Cow;
use std::collections::HashMap;

/// Each may be large; more than a few are no honest file.
const MOST_LIBRARIES: usize = 64;

/// Stands for "none" in a corner.
const NONE: u32 = u32::MAX;

/// Indices of position, texture coordinate and normal.
type Corner = [u32; 3];

/// The statements of a file.
#[derive(Debug, Default)]
struct Statements {
    positions: Vec<Vec3f>,
    /// One per position once any position has a colour, else empty.
    colors: Vec<Vec4f>,
    uvs: Vec<Vec2f>,
    normals: Vec<Vec3f>,
    /// How many of them the file gives; those behind are computed.
    given_normals: usize,
    /// How many of them have no direction and are computed.
    without_direction: usize,
    /// Triangles by material, in the order of first use.
    groups: Vec<(usize, Vec<[Corner; 3]>)>,
    /// Index into `groups` by material.
    group_of: HashMap<usize, usize>,
}

/// What corners without normals get.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Missing {
    /// Smooth normals but for sharp edges.
    Creased,
    /// Smooth normals everywhere, as Mitsuba gives them.
    #[cfg(feature = "mitsuba")]
    Smooth,
}

/// Loads an OBJ file: polygons, negative indices, texture coordinates (turned to the upper left origin), normals,
/// vertex colours (sRGB, as tools write them) and `usemtl`; lines, points, curves and smoothing groups are ignored.
pub(crate) fn parse(text: &[u8], folder: &Folder, limits: &Limits, missing: Missing) -> Result<Scene, Fault> {
    let mut scene = Scene::default();
    let mut textures = Textures::new(limits);
    let mut library = mtl::Library::default();
    let mut names: HashMap<String, usize> = HashMap::new();
    let mut statements = Statements::default();
    let mut budget = Budget::new(limits);
    let mut current: Option<usize> = None;
    let mut clay: Option<usize> = None;
    let mut libraries: Vec<String> = Vec::new();
    let mut files: Vec<String> = Vec::new();
    let mut polygon = Vec::new();
    let mut ignored = Ignored::default();
    for (line, text) in lines(text) {
        let line = || format!("line {line}");
        let (keyword, rest) = split_keyword(&text);
        match keyword {
            "v" => {
                budget.vertices(1, line)?;
                statements.position(rest).map_err(|rule| fault(line(), rule))?;
            }
            "vt" => {
                let [u, v] = numbers(rest, &[0.0, 0.0], 1).map_err(|rule| fault(line(), rule))?;
                statements.uvs.push(vec2(u, 1.0 - v));
            }
            "vn" => {
                statements.normal(rest).map_err(|rule| fault(line(), rule))?;
            }
            "f" => {
                statements.corners(rest, &mut polygon).map_err(|rule| fault(line(), rule))?;
                budget.triangles(polygon.len() as u64 - 2, line)?;
                let material = *current.get_or_insert_with(|| add_clay(&mut clay, &mut scene));
                statements.face(material, &polygon);
            }
            "usemtl" => {
                let material = names.get(rest).copied().unwrap_or_else(|| {
                    scene.warnings.push(format!("{}: the material `{}` is not defined", line(), clip(rest)));
                    let clay = add_clay(&mut clay, &mut scene);
                    names.insert(rest.to_owned(), clay);
                    clay
                });
                current = Some(material);
            }
            "mtllib" if libraries.iter().any(|l| l == rest) => {}
            "mtllib" if libraries.len() >= MOST_LIBRARIES => {
                return Err(too_many(&line()));
            }
            "mtllib" => {
                libraries.push(rest.to_owned());
                for file in mtl::named(rest, folder, MOST_LIBRARIES) {
                    // One of a list may stand on a line of its own, too.
                    if files.iter().any(|known| known == file) {
                        continue;
                    }
                    if files.len() >= MOST_LIBRARIES {
                        return Err(too_many(&line()));
                    }
                    files.push(file.to_owned());
                    library.load(file, folder, limits, &line(), &mut scene, &mut names, &mut textures)?;
                }
            }
            "" | "#" | "o" | "g" | "s" => {}
            other => ignored.add(other),
        }
    }
    if let Some(text) = ignored.message() {
        scene.warnings.push(text);
    }
    if statements.without_direction > 0 {
        let found = statements.without_direction;
        scene.warnings.push(format!("normals without a direction: {found}, which are computed"));
    }
    if statements.groups.is_empty() {
        add_clay(&mut clay, &mut scene);
    }
    statements.fill_normals(missing);
    statements.build(&mut scene, &mut budget, clay.unwrap_or(0))?;
    if missing == Missing::Creased {
        let turned = scene.primitives.iter_mut().map(|p| normals::turn_opposed(&mut p.mesh)).sum();
        scene.warnings.extend(normals::turned(turned));
    }
    scene.images = textures.decode(&library.normal_maps(), &mut scene.warnings)?;
    let colored = !statements.colors.is_empty();
    if let (Some(clay), true) = (clay, colored) {
        scene.materials[clay].base_color = [1.0; 4];
    }
    library.finish(&mut scene, colored, limits)?;
    Ok(scene)
}

/// Index of the grey material, appended at its first use.
fn add_clay(clay: &mut Option<usize>, scene: &mut Scene) -> usize {
    *clay.get_or_insert_with(|| {
        scene.materials.push(super::clay());
        scene.materials.len() - 1
    })
}

/// Keywords without a meaning here, each named once.
#[derive(Debug, Default)]
struct Ignored(Vec<String>);

impl Ignored {
    fn add(&mut self, keyword: &str) {
        if self.0.len() < 8 && !keyword.starts_with('#') && !self.0.iter().any(|k| k == keyword) {
            self.0.push(clip(keyword));
        }
    }

    fn message(&self) -> Option<String> {
        (!self.0.is_empty()).then(|| format!("ignored statements: {}", self.0.join(", ")))
    }
}

/// The text of a line. Old exporters write Latin-1, which is what a line is taken for that is no UTF-8: names of
/// materials and files are then the same in files of both kinds.
fn decoded(line: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(line) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => Cow::Owned(line.iter().map(|b| char::from(*b)).collect()),
    }
}

fn too_many(place: &str) -> Fault {
    let rule =
        format!("is one library more than allowed; there may be at most {MOST_LIBRARIES} material libraries");
    fault(place, rule)
}

/// Lines with their number from 1, continuation lines joined.
pub(super) fn lines(text: &[u8]) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    // Editors on Windows begin files with a byte order mark.
    let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text);
    let mut raw = text.split(|&b| b == b'\n').enumerate();
    std::iter::from_fn(move || {
        let (i, first) = raw.next()?;
        let mut line = decoded(first.trim_ascii());
        while line.ends_with('\\') {
            let joined = line.to_mut();
            joined.pop();
            joined.push(' ');
            match raw.next() {
                Some((_, next)) => joined.push_str(&decoded(next.trim_ascii())),
                None => break,
            }
        }
        Some((i + 1, line))
    })
}

/// First word and the rest of a line.
pub(super) fn split_keyword(line: &str) -> (&str, &str) {
    if line.starts_with('#') {
        return ("#", "");
    }
    line.split_once(|c: char| c.is_ascii_whitespace()).map_or((line, ""), |(k, r)| (k, r.trim()))
}

/// Up to `N` finite numbers, at least `least` of them, the others by default.
pub(super) fn numbers<const N: usize>(
    text: &str,
    default: &[f32; N],
    least: usize,
) -> Result<[f32; N], String> {
    let mut out = *default;
    let mut found = 0;
    for (value, word) in out.iter_mut().zip(text.split_ascii_whitespace()) {
        *value = word
            .parse()
            .ok()
            .filter(|x: &f32| x.is_finite())
            .ok_or_else(|| format!("`{}` is no finite number; it must be one", clip(word)))?;
        found += 1;
    }
    if found < least {
        Err(format!("has {found} numbers; it must have at least {least} numbers"))
    } else {
        Ok(out)
    }
}

impl Statements {
    /// A unit normal; zero, to be computed, where it has no direction.
    fn normal(&mut self, rest: &str) -> Result<(), String> {
        // `nan` and `inf` are numbers.
        let words: Vec<&str> = rest.split_ascii_whitespace().take(3).collect();
        let parsed: Vec<f32> = words.iter().filter_map(|w| w.parse().ok()).collect();
        let normal = match parsed[..] {
            [x, y, z] => vec3(x, y, z).normalize_or_zero(),
            _ => numbers(rest, &[0.0; 3], 3).map(|_| Vec3f::zero())?,
        };
        self.without_direction += usize::from(normal == Vec3f::zero());
        self.normals.push(normal);
        Ok(())
    }

    fn position(&mut self, rest: &str) -> Result<(), String> {
        // Either x y z [w] or x y z r g b.
        let six: [f32; 6] = numbers(rest, &[0.0, 0.0, 0.0, f32::MAX, f32::MAX, f32::MAX], 3)?;
        let [x, y, z, r, g, b] = six;
        if b != f32::MAX || !self.colors.is_empty() {
            self.colors.resize(self.positions.len(), vec3(1.0, 1.0, 1.0).extend(1.0));
            let color = if b == f32::MAX {
                vec3(1.0, 1.0, 1.0)
            } else {
                vec3(r, g, b).map(|c| photofit_image::srgb_decode(c.clamp(0.0, 1.0)))
            };
            self.colors.push(color.extend(1.0));
        }
        self.positions.push(vec3(x, y, z));
        Ok(())
    }

    fn corners(&self, rest: &str, out: &mut Vec<Corner>) -> Result<(), String> {
        out.clear();
        let counts = [self.positions.len(), self.uvs.len(), self.normals.len()];
        for word in rest.split_ascii_whitespace() {
            if word.starts_with('#') {
                break;
            }
            let mut corner = [NONE; 3];
            for (k, part) in word.split('/').enumerate() {
                if k >= 3 {
                    return Err(format!(
                        "the corner is `{}`; it must be v, v/vt, v//vn or v/vt/vn",
                        clip(word)
                    ));
                }
                if !part.is_empty() {
                    corner[k] = index(part, counts[k]).map_err(|rule| format!("`{}`: {rule}", clip(word)))?;
                }
            }
            if corner[0] == NONE {
                return Err(format!("`{}` names no vertex; it must name one", clip(word)));
            }
            out.push(corner);
        }
        if out.len() < 3 {
            Err(format!("the face has {} corners; it must have at least 3 corners", out.len()))
        } else {
            Ok(())
        }
    }

    fn face(&mut self, material: usize, polygon: &[Corner]) {
        let group = *self.group_of.entry(material).or_insert_with(|| {
            self.groups.push((material, Vec::new()));
            self.groups.len() - 1
        });
        if let [a, b, c] = *polygon {
            self.groups[group].1.push([a, b, c]);
            return;
        }
        let places: Vec<Vec3f> = polygon.iter().map(|c| self.positions[c[0] as usize]).collect();
        let mut cut = Vec::new();
        polygon::triangulate(&places, &mut cut);
        self.groups[group].1.extend(cut.into_iter().map(|t| t.map(|k| polygon[k])));
    }

    /// Gives normals to the corners that have none.
    fn fill_normals(&mut self, missing: Missing) {
        self.given_normals = self.normals.len();
        let lacks = |c: &Corner, normals: &[Vec3f]| c[2] == NONE || normals[c[2] as usize] == Vec3f::zero();
        let triangles = || self.groups.iter().flat_map(|g| &g.1);
        if !triangles().flatten().any(|c| lacks(c, &self.normals)) {
            return;
        }
        let all: Vec<[u32; 3]> = triangles().map(|t| t.map(|c| c[0])).collect();
        let (corners, computed) = match missing {
            Missing::Creased => {
                let (split, computed) = normals::creased(&self.positions, &all);
                (split.triangles, computed)
            }
            #[cfg(feature = "mitsuba")]
            Missing::Smooth => {
                let computed = normals::smooth(&self.positions, &all);
                (all, computed)
            }
        };
        let first = self.normals.len() as u32;
        let given = std::mem::take(&mut self.normals);
        let filled = self.groups.iter_mut().flat_map(|g| g.1.as_flattened_mut());
        for (corner, place) in filled.zip(corners.as_flattened()) {
            if lacks(corner, &given) {
                corner[2] = first + place;
            }
        }
        self.normals = [given, computed].concat();
    }

    fn build(&self, scene: &mut Scene, budget: &mut Budget<'_>, clay: usize) -> Result<(), Fault> {
        for (material, triangles) in &self.groups {
            let mesh = self.group_mesh(triangles);
            let computed = triangles.iter().flatten().all(|c| c[2] as usize >= self.given_normals);
            scene.computed_normals.extend(computed.then_some(scene.primitives.len()));
            budget.vertices(mesh.positions.len() as u64, || "the corners of all faces".into())?;
            place(scene, Primitive { mesh, material: *material });
        }
        if self.groups.is_empty() && !self.positions.is_empty() {
            // Points alone: kept, so that the message can say what the file holds.
            let mesh = Mesh {
                positions: self.positions.clone(),
                normals: normals::smooth(&self.positions, &[]),
                colors: self.colors.clone(),
                ..Mesh::default()
            };
            scene.computed_normals.push(scene.primitives.len());
            place(scene, Primitive { mesh, material: clay });
        }
        Ok(())
    }

    /// A vertex for each distinct corner.
    fn group_mesh(&self, triangles: &[[Corner; 3]]) -> Mesh {
        let mut mesh = Mesh::default();
        let mut known: HashMap<Corner, u32> = HashMap::new();
        let textured = triangles.iter().flatten().any(|c| c[1] != NONE);
        for t in triangles {
            let triangle = t.map(|corner| {
                *known.entry(corner).or_insert_with(|| {
                    let [v, vt, vn] = corner.map(|i| i as usize);
                    mesh.positions.push(self.positions[v]);
                    if textured {
                        mesh.uvs.push(self.uvs.get(vt).copied().unwrap_or_default());
                    }
                    mesh.normals.push(self.normals[vn]);
                    if let Some(&color) = self.colors.get(v) {
                        mesh.colors.push(color);
                    }
                    mesh.positions.len() as u32 - 1
                })
            });
            mesh.triangles.push(triangle);
        }
        if mesh.colors.len() != mesh.positions.len() {
            mesh.colors.clear();
        }
        mesh
    }
}

/// A 1-based or negative index as a 0-based one.
fn index(text: &str, count: usize) -> Result<u32, String> {
    let i: i64 = text.parse().map_err(|e| format!("is no index; indices must be integers: {e}"))?;
    let at = if i < 0 { count as i64 + i } else { i - 1 };
    if at < 0 || at >= count as i64 || at >= i64::from(NONE) {
        return Err(format!("index {i} does not exist; {count} lines stand before this one"));
    }
    Ok(at as u32)
}
