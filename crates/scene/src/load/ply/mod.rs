//! PLY in its three encodings.

#[cfg(feature = "mitsuba")]
mod attributes;
mod body;
mod cloud;
mod header;

#[cfg(feature = "mitsuba")]
pub(crate) use attributes::parse_attributes;
pub(crate) use cloud::parse_points;

use super::file::Folder;
use super::texture::Textures;
use super::{Budget, Limits, normals, place, polygon};
use crate::error::{Fault, fault};
use crate::{Primitive, Scene, TextureSlot};
use body::Body;
use header::{Element, Header, Kind, Property};
use photofit_geometry::Mesh;
use photofit_scalar::{Vec2f, Vec3f, vec2, vec3, vec4};
use std::collections::{HashMap, HashSet};

/// Loads a PLY file: vertices with normals, colours (8 and 16 bit ones are sRGB) and texture coordinates (turned to
/// the upper left origin), faces of any number of corners with optional corner coordinates, and triangle strips. Faces that
/// look away from their normals are turned.
/// Without faces the vertices are kept as a point cloud.
pub(crate) fn parse(bytes: &[u8], folder: &Folder, limits: &Limits) -> Result<Scene, Fault> {
    let header = Header::parse(bytes)?;
    let mut scene = Scene::default();
    let mut mesh = geometry(bytes, &header, limits, &mut scene.warnings)?;
    if mesh.normals.is_empty() {
        let (split, computed) = normals::creased(&mesh.positions, &mesh.triangles);
        mesh = split.apply(&mesh);
        mesh.normals = computed;
        scene.computed_normals.extend((!mesh.positions.is_empty()).then_some(0));
    } else {
        scene.warnings.extend(normals::turned(normals::turn_opposed(&mut mesh)));
        if mesh.normals.contains(&Vec3f::zero()) {
            let found = normals::repair(&mut mesh);
            scene.warnings.push(format!("normals without a direction: {found}, which are computed"));
        }
    }
    let mut material = super::clay();
    if !mesh.colors.is_empty() {
        material.base_color = [1.0; 4];
    }
    let mut textures = Textures::new(limits);
    if let (Some(file), false) = (&header.texture, mesh.uvs.is_empty()) {
        let bytes = folder.read_name(file, limits.file_bytes, "comment TextureFile")?;
        let image =
            textures.request(file.clone(), "comment TextureFile".into(), file.clone(), bytes.into())?;
        material.base_color = [1.0; 4];
        material.base_color_texture = Some(TextureSlot::new(image));
    }
    scene.materials.push(material);
    if !mesh.positions.is_empty() {
        place(&mut scene, Primitive { mesh, material: 0 });
    }
    scene.images = textures.decode(&HashSet::new(), &mut scene.warnings)?;
    Ok(scene)
}

/// Vertices and triangles; without normals where the file has none.
fn geometry(
    bytes: &[u8],
    header: &Header,
    limits: &Limits,
    warnings: &mut Vec<String>,
) -> Result<Mesh, Fault> {
    let mut budget = Budget::new(limits);
    let mut mesh = Mesh::default();
    let mut wedges: Vec<[Vec2f; 3]> = Vec::new();
    let mut body = Body::new(bytes, header);
    for element in &header.elements {
        let name = element.name.as_str();
        body.check_count(element)?;
        match name {
            "vertex" if mesh.positions.is_empty() => {
                budget.vertices(element.count, || "element vertex".into())?;
                vertices(element, &mut body, &mut mesh)?;
            }
            "vertex" => return Err(fault("element vertex", "comes twice; it must come once")),
            "face" => faces(element, &mut body, &mut mesh, &mut wedges, &mut budget)?,
            "tristrips" => strips(element, &mut body, &mut mesh, &mut budget)?,
            _ => {
                warnings.push(format!("the element `{name}` is ignored"));
                body.skip(element)?;
            }
        }
    }
    if !wedges.is_empty() {
        budget.vertices(wedges.len() as u64 * 3, || "element face texcoord".into())?;
        mesh = split_wedges(&mesh, &wedges);
    }
    Ok(mesh)
}

/// Vertices and triangles alone; without normals where the file has none.
#[cfg(feature = "mitsuba")]
pub(crate) fn parse_geometry(bytes: &[u8], limits: &Limits) -> Result<Mesh, Fault> {
    geometry(bytes, &Header::parse(bytes)?, limits, &mut Vec::new())
}

/// Where the numbers of a vertex go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Target {
    Position(usize),
    Normal(usize),
    Color(usize),
    Uv(usize),
    Nothing,
}

fn target(name: &str) -> Target {
    match name {
        "x" => Target::Position(0),
        "y" => Target::Position(1),
        "z" => Target::Position(2),
        "nx" => Target::Normal(0),
        "ny" => Target::Normal(1),
        "nz" => Target::Normal(2),
        "red" | "diffuse_red" | "r" => Target::Color(0),
        "green" | "diffuse_green" | "g" => Target::Color(1),
        "blue" | "diffuse_blue" | "b" => Target::Color(2),
        "alpha" => Target::Color(3),
        "s" | "u" | "texture_u" | "tx" => Target::Uv(0),
        "t" | "v" | "texture_v" | "ty" => Target::Uv(1),
        _ => Target::Nothing,
    }
}

fn vertices(element: &Element, body: &mut Body<'_>, mesh: &mut Mesh) -> Result<(), Fault> {
    let mut targets = Vec::new();
    for p in &element.properties {
        targets.push(if p.list.is_some() { Target::Nothing } else { target(&p.name) });
    }
    let has = |t: Target| targets.contains(&t);
    if !(0..3).all(|k| has(Target::Position(k))) {
        return Err(fault(
            "element vertex",
            "lacks one of x, y and z; it must have the properties x, y and z",
        ));
    }
    let normals = (0..3).all(|k| has(Target::Normal(k)));
    let colors = (0..3).all(|k| has(Target::Color(k)));
    let uvs = (0..2).all(|k| has(Target::Uv(k)));
    let count = element.count as usize;
    mesh.positions.reserve_exact(count);
    for v in 0..count {
        let (mut p, mut n, mut c, mut t) = ([0.0_f32; 3], [0.0_f32; 3], [1.0_f32; 4], [0.0_f32; 2]);
        for (property, &to) in element.properties.iter().zip(&targets) {
            if property.list.is_some() {
                body.skip_property(element, property, v)?;
                continue;
            }
            let x = body.number(element, property.kind, v)?;
            match to {
                Target::Position(k) => p[k] = x as f32,
                Target::Normal(k) => n[k] = x as f32,
                Target::Color(k) => c[k] = color(x, property.kind, k == 3),
                Target::Uv(k) => t[k] = x as f32,
                Target::Nothing => {}
            }
        }
        let p = Vec3f::from_array(p);
        if !p.is_finite() {
            return Err(fault(format!("element vertex {v}"), "x, y and z are not finite; they must be"));
        }
        mesh.positions.push(p);
        if normals {
            mesh.normals.push(Vec3f::from_array(n).normalize_or_zero());
        }
        if colors {
            mesh.colors.push(vec4(c[0], c[1], c[2], c[3]));
        }
        if uvs {
            let uv = vec2(t[0], 1.0 - t[1]);
            mesh.uvs.push(if uv.is_finite() { uv } else { Vec2f::zero() });
        }
    }
    Ok(())
}

/// Integer colours are sRGB, floating-point ones linear.
fn color(x: f64, kind: Kind, alpha: bool) -> f32 {
    let unit = match kind {
        Kind::U8 | Kind::I8 => x / 255.0,
        Kind::U16 | Kind::I16 => x / 65535.0,
        _ => x,
    };
    let unit = (unit as f32).clamp(0.0, 1.0);
    let unit = if unit.is_nan() { 1.0 } else { unit };
    let encoded = !matches!(kind, Kind::F32 | Kind::F64) && !alpha;
    if encoded { photofit_image::srgb_decode(unit) } else { unit }
}

fn faces(
    element: &Element,
    body: &mut Body<'_>,
    mesh: &mut Mesh,
    wedges: &mut Vec<[Vec2f; 3]>,
    budget: &mut Budget<'_>,
) -> Result<(), Fault> {
    let is_indices =
        |p: &Property| p.list.is_some() && matches!(p.name.as_str(), "vertex_indices" | "vertex_index");
    if !element.properties.iter().any(is_indices) {
        return Err(fault("element face", "has no list property vertex_indices; it must have one"));
    }
    let textured = element.properties.iter().any(|p| p.list.is_some() && p.name == "texcoord");
    let (mut list, mut corners, mut uvs, mut cut) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for f in 0..element.count as usize {
        uvs.clear();
        for property in &element.properties {
            if is_indices(property) {
                body.list(element, property, f, &mut list)?;
                corners.clear();
                for &x in &list {
                    corners.push(vertex_index(x, mesh.positions.len(), || format!("element face {f}"))?);
                }
            } else if textured && property.name == "texcoord" {
                body.list(element, property, f, &mut list)?;
                uvs.extend(list.as_chunks::<2>().0.iter().map(|&[u, v]| vec2(u as f32, 1.0 - v as f32)));
            } else {
                body.skip_property(element, property, f)?;
            }
        }
        let n = corners.len();
        // Faces with fewer corners are lines and points.
        if n < 3 {
            continue;
        }
        budget.triangles(n as u64 - 2, || format!("element face {f}"))?;
        cut.clear();
        if n == 3 {
            cut.push([0, 1, 2]);
        } else {
            let places: Vec<Vec3f> = corners.iter().map(|&c| mesh.positions[c as usize]).collect();
            polygon::triangulate(&places, &mut cut);
        }
        mesh.triangles.extend(cut.iter().map(|t| t.map(|k| corners[k])));
        if textured {
            let uv = |k: usize| uvs.get(k).copied().filter(|uv| uv.is_finite()).unwrap_or_default();
            wedges.extend(cut.iter().map(|t| t.map(uv)));
        }
    }
    Ok(())
}

fn vertex_index(x: f64, count: usize, place: impl FnOnce() -> String) -> Result<u32, Fault> {
    if x >= 0.0 && x < count as f64 && x.fract() == 0.0 {
        Ok(x as u32)
    } else {
        Err(fault(place(), format!("names index {x}; it must be below the {count} vertices before it")))
    }
}

fn strips(
    element: &Element,
    body: &mut Body<'_>,
    mesh: &mut Mesh,
    budget: &mut Budget<'_>,
) -> Result<(), Fault> {
    let mut list = Vec::new();
    let mut run = Vec::new();
    for s in 0..element.count as usize {
        for property in &element.properties {
            if property.list.is_none() || !matches!(property.name.as_str(), "vertex_indices" | "vertex_index")
            {
                body.skip_property(element, property, s)?;
                continue;
            }
            body.list(element, property, s, &mut list)?;
            list.push(-1.0);
            for &x in &list {
                if x != -1.0 {
                    run.push(vertex_index(x, mesh.positions.len(), || format!("element tristrips {s}"))?);
                    continue;
                }
                budget.triangles(run.len().saturating_sub(2) as u64, || format!("element tristrips {s}"))?;
                mesh.triangles.extend(super::gltf::strip(&run));
                run.clear();
            }
        }
    }
    Ok(())
}

/// A vertex for each distinct pair of vertex and corner coordinate.
fn split_wedges(mesh: &Mesh, wedges: &[[Vec2f; 3]]) -> Mesh {
    let mut out = Mesh::default();
    let mut known: HashMap<(u32, [u32; 2]), u32> = HashMap::new();
    // Strips have no corner coordinates; they come after the faces that have them.
    let none = [vec2(0.0, 0.0); 3];
    for (i, t) in mesh.triangles.iter().enumerate() {
        let uvs = wedges.get(i).unwrap_or(&none);
        let triangle = std::array::from_fn(|k| {
            let (v, uv) = (t[k], uvs[k]);
            *known.entry((v, [uv.x.to_bits(), uv.y.to_bits()])).or_insert_with(|| {
                out.positions.push(mesh.positions[v as usize]);
                out.uvs.push(uv);
                if let Some(&n) = mesh.normals.get(v as usize) {
                    out.normals.push(n);
                }
                if let Some(&c) = mesh.colors.get(v as usize) {
                    out.colors.push(c);
                }
                out.positions.len() as u32 - 1
            })
        });
        out.triangles.push(triangle);
    }
    if out.normals.is_empty() {
        let smooth = normals::smooth(&mesh.positions, &mesh.triangles);
        let mut all = vec![vec3(0.0, 1.0, 0.0); out.positions.len()];
        for (t, new) in mesh.triangles.iter().zip(&out.triangles) {
            for k in 0..3 {
                all[new[k] as usize] = smooth[t[k] as usize];
            }
        }
        out.normals = all;
    }
    out
}
