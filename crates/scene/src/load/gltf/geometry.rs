//! Mesh primitives: attributes, morph targets, joints, topology modes.

use super::accessor::Need;
use super::document::Document;
use super::draco::{Elements, RawPrimitive};
use crate::error::{Fault, fault};
use crate::load::file::clip;
use crate::load::{Budget, normals};
use crate::skin::{Bind, Influences, MorphTarget, unit_tangent};
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;
use photofit_geometry::Mesh;
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec3, vec4};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// Names of attributes that are not read: so many are listed.
const MOST_NAMES: usize = 64;

/// Vertex attributes of one number with their names.
pub(super) type Attributes = Vec<(String, Vec<f32>)>;

/// A triangle primitive as the file has it.
#[derive(Debug)]
pub(super) struct Part {
    pub(super) bind: Bind,
    pub(super) material: Option<usize>,
    /// Application data.
    pub(super) extras: Option<Value>,
    /// What glTF has no meaning for.
    pub(super) attributes: Attributes,
}

/// The triangle primitives of mesh `m`.
pub(super) fn mesh(
    document: &Document<'_>,
    m: usize,
    budget: &mut Budget<'_>,
    warnings: &mut Vec<String>,
    ignored: &mut BTreeSet<String>,
) -> Result<Vec<Part>, Fault> {
    let json = &document.root.meshes[m];
    let mut out = Vec::with_capacity(json.primitives.len());
    for (p, primitive) in json.primitives.iter().enumerate() {
        let place = format!("mesh {m} primitive {p}");
        budget.primitive(&place)?;
        let mode = match primitive.mode {
            Checked::Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) => mode,
            Checked::Valid(_) => {
                warnings.push(format!("{place}: points and lines are ignored"));
                continue;
            }
            Checked::Invalid => return Err(fault(place, "has an unknown mode; it must be one of 0 to 6")),
        };
        let elements = Elements::of(document, m, p, &place, budget, warnings)?;
        let bind = read(&elements, primitive, mode, &place, budget, warnings)?;
        let vertices = (bind.mesh.positions.len(), bind.posed_vertices());
        let attributes = custom(document, &elements, primitive, vertices, &place, budget, ignored)?;
        let unread = document.primitive(m, p).map(|json| unread(json, bind.influences.len()));
        let names = unread.iter().flatten().map(|name| clip(name));
        ignored.extend(names.take(MOST_NAMES.saturating_sub(ignored.len())));
        let extras = document.extras(&primitive.extras, || place)?;
        out.push(Part { bind, material: primitive.material.map(|m| m.value()), extras, attributes });
    }
    Ok(out)
}

fn attribute(primitive: &Primitive, semantic: Semantic) -> Option<usize> {
    primitive.attributes.get(&Checked::Valid(semantic)).map(|a| a.value())
}

fn read(
    elements: &Elements<'_>,
    primitive: &Primitive,
    mode: Mode,
    place: &str,
    budget: &mut Budget<'_>,
    warnings: &mut Vec<String>,
) -> Result<Bind, Fault> {
    let Some(positions) = attribute(primitive, Semantic::Positions) else {
        return Err(fault(place, "has no attribute POSITION; it must have one"));
    };
    if !elements.holds(positions) {
        return Err(fault(place, "has a Draco stream without POSITION; it must hold it"));
    }
    let what = |name: &str| format!("{place} {name}");
    budget.vertices(elements.count(positions, place)?, || place.into())?;
    let mut mesh = Mesh {
        positions: bytemuck::cast_vec::<[f32; 3], Vec3f>(elements.floats(
            positions,
            &what("POSITION"),
            Need::All,
        )?),
        ..Mesh::default()
    };
    let n = Need::Exactly(mesh.positions.len());
    if let Some(a) = attribute(primitive, Semantic::Normals) {
        mesh.normals = bytemuck::cast_vec(elements.floats::<3>(a, &what("NORMAL"), n)?);
    }
    // Without normals the specification asks for flat ones, and for given tangents to be ignored.
    if let (Some(a), false) = (attribute(primitive, Semantic::Tangents), mesh.normals.is_empty()) {
        mesh.tangents = bytemuck::cast_vec(elements.floats::<4>(a, &what("TANGENT"), n)?);
    }
    if let Some(a) = attribute(primitive, Semantic::TexCoords(0)) {
        mesh.uvs = bytemuck::cast_vec(elements.floats::<2>(a, &what("TEXCOORD_0"), n)?);
    }
    if let Some(a) = attribute(primitive, Semantic::TexCoords(1)) {
        mesh.uvs1 = bytemuck::cast_vec(elements.floats::<2>(a, &what("TEXCOORD_1"), n)?);
    }
    if let Some(a) = attribute(primitive, Semantic::Colors(0)) {
        mesh.colors = colors(elements, a, &what("COLOR_0"), n)?;
    }
    let targets = targets(elements, primitive, mesh.positions.len(), place, budget)?;
    let influences = influences(elements, primitive, n, place)?;
    mesh.triangles = triangles(elements, primitive, mode, mesh.positions.len(), place, budget)?;
    clean(&mut mesh, place, warnings)?;
    Ok(Bind { mesh, influences, targets })
}

/// The attribute `_NAME` that is asked for; what is no number becomes 0. The names of others are noted in `ignored`.
fn custom(
    document: &Document<'_>,
    elements: &Elements<'_>,
    primitive: &Primitive,
    (vertices, posed): (usize, usize),
    place: &str,
    budget: &mut Budget<'_>,
    ignored: &mut BTreeSet<String>,
) -> Result<Attributes, Fault> {
    let mut out = Attributes::new();
    let asked = document.limits.vertex_attribute.as_deref();
    for (semantic, accessor) in &primitive.attributes {
        let Checked::Valid(Semantic::Extras(name)) = semantic else { continue };
        if asked.is_none_or(|asked| !asked.eq_ignore_ascii_case(name)) {
            if ignored.len() < MOST_NAMES {
                ignored.insert(format!("_{}", clip(name)));
            }
            continue;
        }
        let what = format!("{place} _{}", clip(name));
        budget.vertices((vertices + posed) as u64, || what.clone())?;
        let values = elements.floats::<1>(accessor.value(), &what, Need::Exactly(vertices))?;
        let finite = |[x]: [f32; 1]| if x.is_finite() { x } else { 0.0 };
        out.push((name.clone(), values.into_iter().map(finite).collect()));
    }
    Ok(out)
}

/// Names of glTF's own attributes that are not read, those of morph targets included; `sets` of joints and weights are.
fn unread(primitive: &RawPrimitive, sets: usize) -> BTreeSet<String> {
    let has = |name| primitive.attributes.contains_key(name);
    let read = |name: &str| match name {
        "POSITION" | "NORMAL" | "TEXCOORD_0" | "TEXCOORD_1" | "COLOR_0" => true,
        "TANGENT" => has("NORMAL"),
        _ => {
            name.starts_with('_')
                || (0..sets).any(|s| [format!("JOINTS_{s}"), format!("WEIGHTS_{s}")].contains(&name.into()))
        }
    };
    let moved = |name: &str| match name {
        "POSITION" => true,
        "NORMAL" => has("NORMAL"),
        "TANGENT" => has("NORMAL") && has("TANGENT"),
        _ => false,
    };
    let names = primitive.attributes.keys().filter(|name| !read(name)).cloned();
    let targets = primitive.targets.iter().flatten().flat_map(BTreeMap::keys).filter(|name| !moved(name));
    names.chain(targets.map(|name| format!("{name} of morph targets"))).collect()
}

fn colors(elements: &Elements<'_>, a: usize, place: &str, n: Need) -> Result<Vec<Vec4f>, Fault> {
    if elements.components(a, place)? == 3 {
        let rgb = elements.floats::<3>(a, place, n)?;
        Ok(rgb.into_iter().map(|[r, g, b]| vec4(r, g, b, 1.0)).collect())
    } else {
        Ok(bytemuck::cast_vec(elements.floats::<4>(a, place, n)?))
    }
}

/// The morph targets; what they say about attributes that the primitive lacks is left out.
fn targets(
    elements: &Elements<'_>,
    primitive: &Primitive,
    vertices: usize,
    place: &str,
    budget: &mut Budget<'_>,
) -> Result<Vec<MorphTarget>, Fault> {
    let n = Need::Exactly(vertices);
    let json = primitive.targets.as_deref().unwrap_or(&[]);
    let mut out = Vec::with_capacity(json.len());
    for (t, target) in json.iter().enumerate() {
        let what = |name: &str| format!("{place} target {t} {name}");
        budget.vertices(vertices as u64, || what("attributes"))?;
        let read = |a: Option<usize>, name: &str| -> Result<Vec<Vec3f>, Fault> {
            let Some(a) = a else { return Ok(Vec::new()) };
            Ok(bytemuck::cast_vec(elements.floats::<3>(a, &what(name), n)?))
        };
        let has = |semantic| attribute(primitive, semantic).is_some();
        let normals = has(Semantic::Normals);
        let tangents = normals && has(Semantic::Tangents);
        out.push(MorphTarget {
            positions: read(target.positions.map(|a| a.value()), "POSITION")?,
            normals: read(target.normals.filter(|_| normals).map(|a| a.value()), "NORMAL")?,
            tangents: read(target.tangents.filter(|_| tangents).map(|a| a.value()), "TANGENT")?,
        });
    }
    Ok(out)
}

/// Joints and weights; joints of zero weight become 0.
fn influences(
    elements: &Elements<'_>,
    primitive: &Primitive,
    n: Need,
    place: &str,
) -> Result<Vec<Influences>, Fault> {
    let mut sets = Vec::new();
    for s in 0..4 {
        let joints = attribute(primitive, Semantic::Joints(s));
        let weights = attribute(primitive, Semantic::Weights(s));
        let (j, w) = match (joints, weights) {
            (Some(j), Some(w)) => (j, w),
            (None, None) => break,
            _ => {
                let rule = format!("has one of JOINTS_{s} and WEIGHTS_{s}; it must have both or neither");
                return Err(fault(place, rule));
            }
        };
        let mut joints = elements.integers::<4>(j, &format!("{place} JOINTS_{s}"), n)?;
        let weights = elements.floats::<4>(w, &format!("{place} WEIGHTS_{s}"), n)?;
        let unused = joints.as_flattened_mut().iter_mut().zip(weights.as_flattened());
        unused.filter(|(_, w)| **w == 0.0).for_each(|(j, _)| *j = 0);
        // Saving has 16 bits for a joint, as the specification.
        if let Some(j) = joints.as_flattened().iter().find(|j| **j > 0xffff) {
            return Err(fault(place, format!("JOINTS_{s} names joint {j}; joints go up to 65535")));
        }
        sets.push(Influences { joints, weights });
    }
    Ok(sets)
}

fn triangles(
    elements: &Elements<'_>,
    primitive: &Primitive,
    mode: Mode,
    vertices: usize,
    place: &str,
    budget: &mut Budget<'_>,
) -> Result<Vec<[u32; 3]>, Fault> {
    let place = format!("{place} indices");
    if let Some(triangles) = elements.triangles(vertices, &place)? {
        if mode == Mode::TriangleFan {
            return Err(fault(place, "are compressed, and the mode is 6; it must be 4 or 5"));
        }
        budget.triangles(triangles.len() as u64, || place)?;
        return Ok(triangles);
    }
    let count = match primitive.indices {
        Some(a) => elements.count(a.value(), &place)?,
        None => vertices as u64,
    };
    let of_count = |n: u64| if mode == Mode::Triangles { n / 3 } else { n.saturating_sub(2) };
    budget.triangles(of_count(count), || place.clone())?;
    let indices: Vec<u32> = match primitive.indices {
        Some(a) => {
            let indices = elements.integers::<1>(a.value(), &place, Need::All)?;
            let bad = indices.iter().position(|[i]| *i as usize >= vertices);
            if let Some(k) = bad {
                let rule =
                    format!("index {k} is {}; it must be below the {vertices} vertices", indices[k][0]);
                return Err(fault(place, rule));
            }
            bytemuck::cast_vec(indices)
        }
        None => (0..vertices as u32).collect(),
    };
    Ok(match mode {
        Mode::TriangleStrip => strip(&indices),
        Mode::TriangleFan => indices.windows(2).skip(1).map(|w| [w[0], w[1], indices[0]]).collect(),
        _ => indices.as_chunks::<3>().0.to_vec(),
    })
}

/// Triangles of a strip, every other one turned so that all face the same way.
pub(crate) fn strip(indices: &[u32]) -> Vec<[u32; 3]> {
    indices
        .windows(3)
        .enumerate()
        .map(|(i, w)| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] })
        .collect()
}

/// Rejects what cannot be used and repairs what can: normals and tangents without a direction, texture coordinates and
/// colours that are no numbers.
fn clean(mesh: &mut Mesh, place: &str, warnings: &mut Vec<String>) -> Result<(), Fault> {
    if let Some(v) = mesh.positions.iter().position(|p| !p.is_finite()) {
        return Err(fault(format!("{place} POSITION"), not_finite(v)));
    }
    mesh.normals.iter_mut().for_each(|n| *n = n.normalize_or_zero());
    if mesh.normals.iter().any(|n| *n == Vec3f::zero()) {
        let found = normals::repair(mesh);
        warnings.push(format!("{place} NORMAL: normals without a direction: {found}, which are computed"));
    }
    let mut tangents = 0;
    for (t, n) in mesh.tangents.iter_mut().zip(&mesh.normals) {
        tangents += usize::from(t.xyz().normalize_or_zero() == Vec3f::zero());
        *t = unit_tangent(*t, *n);
    }
    if tangents > 0 {
        warnings.push(format!("{place} TANGENT: {tangents} tangents without a direction are replaced"));
    }
    let mut others = 0;
    for uv in mesh.uvs.iter_mut().chain(&mut mesh.uvs1).filter(|uv| !uv.is_finite()) {
        *uv = Vec2f::zero();
        others += 1;
    }
    for c in mesh.colors.iter_mut().filter(|c| !c.is_finite()) {
        *c = vec3(1.0, 1.0, 1.0).extend(1.0);
        others += 1;
    }
    if others > 0 {
        warnings.push(format!(
            "{place}: {others} texture coordinates or colours that are no numbers are replaced"
        ));
    }
    Ok(())
}

fn not_finite(element: usize) -> String {
    format!("element {element} is not finite; it must be")
}
