//! Mesh primitives: attributes, morph targets, topology modes.

use super::accessor::Need;
use super::document::Document;
use super::skin::{Influences, Skin};
use crate::error::{Fault, fault};
use crate::load::{Budget, normals};
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;
use photofit_geometry::Mesh;
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec3, vec4};

/// What a node adds to its mesh.
#[derive(Debug)]
pub(super) struct Context<'a> {
    pub(super) document: &'a Document<'a>,
    /// Morph weights of the node, which replace those of the mesh.
    pub(super) weights: Option<&'a [f32]>,
    pub(super) skin: Option<&'a Skin>,
}

/// The triangle primitives of mesh `m`, each with its material.
pub(super) fn mesh(
    context: &Context<'_>,
    m: usize,
    node: usize,
    budget: &mut Budget<'_>,
    warnings: &mut Vec<String>,
) -> Result<Vec<(Mesh, Option<usize>)>, Fault> {
    let root = &context.document.root;
    let count = root.meshes.len();
    let json = root
        .meshes
        .get(m)
        .ok_or_else(|| fault(format!("node {node}"), format!("mesh {m} is one of {count}")))?;
    let weights = context.weights.or(json.weights.as_deref()).unwrap_or(&[]);
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
            Checked::Invalid => return Err(fault(place, "mode is one of 0 to 6")),
        };
        let mesh = read(context, primitive, mode, weights, &place, budget, warnings)?;
        out.push((mesh, primitive.material.map(|m| m.value())));
    }
    Ok(out)
}

fn attribute(primitive: &Primitive, semantic: Semantic) -> Option<usize> {
    primitive.attributes.get(&Checked::Valid(semantic)).map(|a| a.value())
}

fn read(
    context: &Context<'_>,
    primitive: &Primitive,
    mode: Mode,
    weights: &[f32],
    place: &str,
    budget: &mut Budget<'_>,
    warnings: &mut Vec<String>,
) -> Result<Mesh, Fault> {
    let document = context.document;
    let Some(positions) = attribute(primitive, Semantic::Positions) else {
        return Err(fault(place, "has the attribute POSITION"));
    };
    let what = |name: &str| format!("{place} {name}");
    budget.vertices(document.count(positions, place)?, || place.into())?;
    let mut mesh = Mesh {
        positions: bytemuck::cast_vec::<[f32; 3], Vec3f>(document.floats(
            positions,
            &what("POSITION"),
            Need::All,
        )?),
        ..Mesh::default()
    };
    let n = Need::Exactly(mesh.positions.len());
    if let Some(a) = attribute(primitive, Semantic::Normals) {
        mesh.normals = bytemuck::cast_vec(document.floats::<3>(a, &what("NORMAL"), n)?);
    }
    // Without normals the specification asks for flat ones, and for given tangents to be ignored.
    if let (Some(a), false) = (attribute(primitive, Semantic::Tangents), mesh.normals.is_empty()) {
        mesh.tangents = bytemuck::cast_vec(document.floats::<4>(a, &what("TANGENT"), n)?);
    }
    if let Some(a) = attribute(primitive, Semantic::TexCoords(0)) {
        mesh.uvs = bytemuck::cast_vec(document.floats::<2>(a, &what("TEXCOORD_0"), n)?);
    }
    if let Some(a) = attribute(primitive, Semantic::TexCoords(1)) {
        mesh.uvs1 = bytemuck::cast_vec(document.floats::<2>(a, &what("TEXCOORD_1"), n)?);
    }
    if let Some(a) = attribute(primitive, Semantic::Colors(0)) {
        mesh.colors = colors(document, a, &what("COLOR_0"), n)?;
    }
    morph(document, primitive, weights, &mut mesh, place, budget)?;
    if let Some(skin) = context.skin {
        let influences = influences(document, primitive, n, place)?;
        skin.apply(&mut mesh, &influences, place)?;
    }
    mesh.triangles = triangles(document, primitive, mode, mesh.positions.len(), place, budget)?;
    clean(&mut mesh, place, warnings)?;
    if mesh.normals.is_empty() {
        budget.vertices(mesh.triangles.len() as u64 * 3, || place.into())?;
        mesh = normals::flat(&mesh);
    }
    Ok(mesh)
}

fn colors(document: &Document<'_>, a: usize, place: &str, n: Need) -> Result<Vec<Vec4f>, Fault> {
    if document.components(a, place)? == 3 {
        let rgb = document.floats::<3>(a, place, n)?;
        Ok(rgb.into_iter().map(|[r, g, b]| vec4(r, g, b, 1.0)).collect())
    } else {
        Ok(bytemuck::cast_vec(document.floats::<4>(a, place, n)?))
    }
}

/// Adds the morph targets with a weight other than zero.
fn morph(
    document: &Document<'_>,
    primitive: &Primitive,
    weights: &[f32],
    mesh: &mut Mesh,
    place: &str,
    budget: &mut Budget<'_>,
) -> Result<(), Fault> {
    let n = Need::Exactly(mesh.positions.len());
    let targets = primitive.targets.as_deref().unwrap_or(&[]);
    for (t, (target, &w)) in targets.iter().zip(weights).enumerate() {
        if w == 0.0 {
            continue;
        }
        let what = |name: &str| format!("{place} target {t} {name}");
        budget.vertices(mesh.positions.len() as u64, || what("attributes"))?;
        if let Some(a) = target.positions {
            let d = document.floats::<3>(a.value(), &what("POSITION"), n)?;
            mesh.positions.iter_mut().zip(d).for_each(|(p, d)| *p += Vec3f::from_array(d) * w);
        }
        if let (Some(a), false) = (target.normals, mesh.normals.is_empty()) {
            let d = document.floats::<3>(a.value(), &what("NORMAL"), n)?;
            mesh.normals.iter_mut().zip(d).for_each(|(p, d)| *p += Vec3f::from_array(d) * w);
        }
        if let (Some(a), false) = (target.tangents, mesh.tangents.is_empty()) {
            let d = document.floats::<3>(a.value(), &what("TANGENT"), n)?;
            for (p, d) in mesh.tangents.iter_mut().zip(d) {
                *p += Vec3f::from_array(d).extend(0.0) * w;
            }
        }
    }
    Ok(())
}

fn influences(
    document: &Document<'_>,
    primitive: &Primitive,
    n: Need,
    place: &str,
) -> Result<Influences, Fault> {
    let mut sets = Vec::new();
    for s in 0..4 {
        let joints = attribute(primitive, Semantic::Joints(s));
        let weights = attribute(primitive, Semantic::Weights(s));
        match (joints, weights) {
            (Some(j), Some(w)) => sets.push((
                document.integers::<4>(j, &format!("{place} JOINTS_{s}"), n)?,
                document.floats::<4>(w, &format!("{place} WEIGHTS_{s}"), n)?,
            )),
            (None, None) => break,
            _ => return Err(fault(place, format!("JOINTS_{s} and WEIGHTS_{s} come together"))),
        }
    }
    if sets.is_empty() {
        return Err(fault(place, "a mesh with a skin has JOINTS_0 and WEIGHTS_0"));
    }
    Ok(Influences { sets })
}

fn triangles(
    document: &Document<'_>,
    primitive: &Primitive,
    mode: Mode,
    vertices: usize,
    place: &str,
    budget: &mut Budget<'_>,
) -> Result<Vec<[u32; 3]>, Fault> {
    let place = format!("{place} indices");
    let count = match primitive.indices {
        Some(a) => document.count(a.value(), &place)?,
        None => vertices as u64,
    };
    let of_count = |n: u64| if mode == Mode::Triangles { n / 3 } else { n.saturating_sub(2) };
    budget.triangles(of_count(count), || place.clone())?;
    let indices: Vec<u32> = match primitive.indices {
        Some(a) => {
            let indices = document.integers::<1>(a.value(), &place, Need::All)?;
            let bad = indices.iter().position(|[i]| *i as usize >= vertices);
            if let Some(k) = bad {
                let rule = format!("index {k} is {} and stays below the {vertices} vertices", indices[k][0]);
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

/// Rejects what cannot be used and repairs what can: zero normals, tangents and texture coordinates that are no
/// numbers.
fn clean(mesh: &mut Mesh, place: &str, warnings: &mut Vec<String>) -> Result<(), Fault> {
    if let Some(v) = mesh.positions.iter().position(|p| !p.is_finite()) {
        return Err(fault(format!("{place} POSITION"), format!("element {v} is finite")));
    }
    if let Some(v) = mesh.normals.iter().position(|p| !p.is_finite()) {
        return Err(fault(format!("{place} NORMAL"), format!("element {v} is finite")));
    }
    mesh.normals.iter_mut().for_each(|n| *n = n.normalize_or_zero());
    if mesh.normals.iter().any(|n| *n == Vec3f::zero()) {
        let found = normals::repair(mesh);
        warnings.push(format!("{place} NORMAL: {found} zero normals are computed"));
    }
    let mut tangents = 0;
    for (t, n) in mesh.tangents.iter_mut().zip(&mesh.normals) {
        let direction = t.xyz().normalize_or_zero();
        let direction = if direction == Vec3f::zero() {
            tangents += 1;
            n.orthonormal_pair().0
        } else {
            direction
        };
        *t = direction.extend(if t.w < 0.0 { -1.0 } else { 1.0 });
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
