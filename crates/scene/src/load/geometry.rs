//! Meshes without materials, as renderers' scene files name them.

use super::file::Folder;
use super::{Limits, obj, ply};
use crate::error::{Fault, fault};
use photofit_geometry::normals::{Weighting, vertex_normals};
use photofit_geometry::weld::Weld;
use photofit_geometry::{Incidence, Mesh};
use photofit_scalar::Vec3f;
use std::collections::HashMap;
use std::path::Path;

/// A mesh of a file.
#[derive(Debug)]
pub(crate) struct Geometry {
    pub(crate) mesh: Mesh,
    /// The file has normals; else those of an OBJ are smooth and a PLY has none.
    pub(crate) has_normals: bool,
    /// Attributes of vertices by name.
    pub(crate) vertices: HashMap<String, Vec<Vec3f>>,
    /// Attributes of triangles by name.
    pub(crate) faces: HashMap<String, Vec<Vec3f>>,
}

/// Reads an OBJ file without its materials; all its groups become one mesh.
pub(crate) fn obj_geometry(bytes: &[u8], limits: &Limits) -> Result<Geometry, Fault> {
    let mut text = Vec::with_capacity(bytes.len());
    let mut has_normals = false;
    for line in bytes.split_inclusive(|b| *b == b'\n') {
        let start = line.trim_ascii_start();
        has_normals |= start.starts_with(b"vn");
        if start.starts_with(b"usemtl") || start.starts_with(b"mtllib") {
            // Lines keep their numbers.
            text.push(b'\n');
        } else {
            text.extend_from_slice(line);
        }
    }
    let scene = obj::parse(&text, &Folder::of(Path::new("")), limits, obj::Missing::Smooth)?;
    let mesh = scene.primitives.into_iter().next().map(|p| p.mesh).unwrap_or_default();
    if mesh.triangles.is_empty() {
        return Err(fault("the file", "has no faces; it must have some"));
    }
    Ok(Geometry { mesh, has_normals, vertices: HashMap::new(), faces: HashMap::new() })
}

/// Reads a PLY file without its materials.
pub(crate) fn ply_geometry(bytes: &[u8], limits: &Limits) -> Result<Geometry, Fault> {
    if !bytes.starts_with(b"ply\n") && !bytes.starts_with(b"ply\r") {
        return Err(fault("byte 0", "the file does not begin with the line `ply`; a .ply file must"));
    }
    let mesh = ply::parse_geometry(bytes, limits)?;
    if mesh.triangles.is_empty() {
        return Err(fault("the file", "has no faces; it must have some"));
    }
    let attributes = ply::parse_attributes(bytes)?;
    let fits = |v: &Vec<Vec3f>| v.len() == mesh.positions.len();
    let vertices = attributes.vertices.into_iter().filter(|(_, v)| fits(v)).collect();
    let faces = attributes.faces.into_iter().filter(|(_, v)| v.len() == mesh.triangles.len()).collect();
    let has_normals = !mesh.normals.is_empty();
    Ok(Geometry { mesh, has_normals, vertices, faces })
}

/// Smooth unit normals, weighted by angle, over vertices of equal index; zero where no face has an area.
pub(crate) fn normals_by_index(positions: &[Vec3f], triangles: &[[u32; 3]]) -> Vec<Vec3f> {
    let groups = Weld::identity(positions.len());
    let incidence = Incidence::new(triangles, &groups);
    let normals = vertex_normals(&incidence, positions, Weighting::Angle);
    normals.into_iter().map(Vec3f::normalize_or_zero).collect()
}
