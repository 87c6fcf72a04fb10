//! Triangle meshes: from files, and of the simple shapes.

use super::{Importer, serialized};
use crate::error::{Fault, fault};
use crate::load;
use photofit_geometry::Mesh;
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec2, vec3};
use std::collections::HashMap;
use std::f32::consts::TAU;
use std::sync::Arc;

/// Segments around disks and cylinders.
const SEGMENTS: u32 = 720;
/// Bands from pole to pole of a sphere of triangles.
const BANDS: u32 = 256;

/// What a mesh says about its vertices and triangles beside their geometry.
#[derive(Clone, Debug, Default)]
pub(super) struct Attributes {
    pub(super) vertices: HashMap<String, Vec<Vec3f>>,
    pub(super) faces: HashMap<String, Arc<[Vec3f]>>,
    /// The attribute of the vertices that textures use.
    pub(super) chosen: Option<String>,
}

impl Importer {
    /// The mesh of an `obj`, `ply` or `serialized` shape with its attributes.
    pub(super) fn mesh_file(&mut self, element: usize, kind: &str) -> Result<(Mesh, Attributes), Fault> {
        let place = self.reader.place(element);
        let name = self.reader.string(element, "filename")?;
        let name = name.ok_or_else(|| fault(&place, "the shape has no filename; it must have one"))?;
        let path = self.reader.document.resolve(&name, &place)?;
        let mut flat = self.reader.boolean(element, "face_normals", false)?;
        // The loaders of the others turn the coordinates to the upper left origin.
        let turn_back =
            kind != "serialized" && !self.reader.boolean(element, "flip_tex_coords", kind == "obj")?;
        let bytes =
            load::read_file(&path, self.limits.file_bytes).map_err(|e| fault(&place, e.to_string()))?;
        let named = |f: Fault| fault(format!("{place}: {}: {}", path.display(), f.place), f.rule);
        let loaded = match kind {
            "obj" => load::obj_geometry(&bytes, &self.limits).map_err(named)?,
            "ply" => load::ply_geometry(&bytes, &self.limits).map_err(named)?,
            _ => {
                let index = self.reader.integer(element, "shape_index")?.unwrap_or(0);
                let index = usize::try_from(index).ok().ok_or_else(|| {
                    fault(&place, format!("shape_index is {index}; it must not be negative"))
                })?;
                let (mesh, own) = serialized::read(&bytes, index, &self.limits)
                    .map_err(|rule| fault(format!("{place}: {}", path.display()), rule))?;
                flat |= own;
                let has_normals = !mesh.normals.is_empty();
                load::Geometry { mesh, has_normals, vertices: HashMap::new(), faces: HashMap::new() }
            }
        };
        let mut mesh = loaded.mesh;
        self.vertices += mesh.positions.len() as u64 + mesh.triangles.len() as u64;
        if self.vertices > (self.limits.vertices + self.limits.triangles) as u64 {
            return Err(fault(place, "the scene has more vertices and triangles than its limits allow"));
        }
        if turn_back {
            mesh.uvs.iter_mut().for_each(|uv| uv.y = 1.0 - uv.y);
        }
        mesh.colors.clear();
        if flat {
            mesh.normals.clear();
        } else if !loaded.has_normals {
            mesh.normals = load::normals_by_index(&mesh.positions, &mesh.triangles);
        }
        let faces = loaded.faces.into_iter().map(|(n, v)| (n, v.into())).collect();
        Ok((mesh, Attributes { vertices: loaded.vertices, faces, chosen: None }))
    }
}

/// Winds triangles so that their front is the side of their normals.
pub(super) fn align(mesh: &mut Mesh) {
    if mesh.normals.is_empty() {
        return;
    }
    for t in &mut mesh.triangles {
        let [a, b, c] = t.map(|i| mesh.positions[i as usize].cast::<f64>());
        let n = (b - a).cross(c - a);
        let sum = t.iter().fold(Vec3f::zero(), |s, &i| s + mesh.normals[i as usize]).cast::<f64>();
        if n.dot(sum) < 0.0 {
            t.swap(1, 2);
        }
    }
}

/// The other side becomes the front.
pub(super) fn flip(mesh: &mut Mesh) {
    mesh.normals.iter_mut().for_each(|n| *n = -*n);
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
}

/// Colours for the attribute that textures use.
pub(super) fn colors(attributes: &Attributes) -> Vec<Vec4f> {
    let chosen = attributes.chosen.as_ref().and_then(|c| attributes.vertices.get(c));
    chosen.map_or(Vec::new(), |values| values.iter().map(|v| v.extend(1.0)).collect())
}

/// The square from -1 to 1 in the plane `z = 0`, seen from +z.
pub(super) fn rectangle() -> Mesh {
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    Mesh {
        positions: corners.iter().map(|&(x, y)| vec3(x, y, 0.0)).collect(),
        normals: vec![vec3(0.0, 0.0, 1.0); 4],
        uvs: corners.iter().map(|&(x, y)| vec2(0.5 * (x + 1.0), 0.5 * (y + 1.0))).collect(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    }
}

/// The cube from -1 to 1.
pub(super) fn cube() -> Mesh {
    let mut mesh = Mesh::default();
    // Normal, and the directions in which u and v grow.
    let sides = [
        ([0, -1, 0], [0, 0, 1], [1, 0, 0]),
        ([0, 1, 0], [-1, 0, 0], [0, 0, -1]),
        ([1, 0, 0], [0, 1, 0], [0, 0, -1]),
        ([0, 0, 1], [0, 1, 0], [1, 0, 0]),
        ([-1, 0, 0], [0, 1, 0], [0, 0, 1]),
        ([0, 0, -1], [0, -1, 0], [1, 0, 0]),
    ];
    for (n, u, v) in sides {
        let [n, u, v] = [n, u, v].map(|a: [i8; 3]| Vec3f::from_array(a.map(f32::from)));
        let base = mesh.positions.len() as u32;
        for (s, t) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
            mesh.positions.push(n + u * (2.0 * s - 1.0) + v * (2.0 * t - 1.0));
            mesh.normals.push(n);
            mesh.uvs.push(vec2(s, t));
        }
        mesh.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    }
    align(&mut mesh);
    mesh
}

fn turn(i: u32) -> (f32, f32, f32) {
    let share = i as f32 / SEGMENTS as f32;
    let (sin, cos) = (TAU * share).sin_cos();
    (share, cos, sin)
}

/// The unit disk in the plane `z = 0`, seen from +z; `u` is the radius, `v` the angle.
pub(super) fn disk() -> Mesh {
    let mut mesh = Mesh::default();
    // Of the same area as the round one.
    let step = TAU / SEGMENTS as f32;
    let reach = (step / step.sin()).sqrt();
    for i in 0..=SEGMENTS {
        let (share, x, y) = turn(i);
        mesh.positions.extend([vec3(0.0, 0.0, 0.0), vec3(reach * x, reach * y, 0.0)]);
        mesh.uvs.extend([vec2(0.0, share), vec2(1.0, share)]);
    }
    mesh.normals = vec![vec3(0.0, 0.0, 1.0); mesh.positions.len()];
    mesh.triangles = (0..SEGMENTS).map(|i| [2 * i, 2 * i + 1, 2 * i + 3]).collect();
    mesh
}

/// The side of a cylinder of a radius between two points, seen from outside.
pub(super) fn cylinder(p0: Vec3f, p1: Vec3f, radius: f32) -> Mesh {
    let axis = (p1 - p0).normalize_or_zero();
    let (s, t) = axis.orthonormal_pair();
    let (s, t) =
        if axis == vec3(0.0, 0.0, 1.0) { (vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0)) } else { (s, t) };
    let mut mesh = Mesh::default();
    for i in 0..=SEGMENTS {
        let (share, cos, sin) = turn(i);
        let n = s * cos + t * sin;
        mesh.positions.extend([p0 + n * radius, p1 + n * radius]);
        mesh.normals.extend([n, n]);
        mesh.uvs.extend([vec2(share, 0.0), vec2(share, 1.0)]);
    }
    for i in 0..SEGMENTS {
        let k = 2 * i;
        mesh.triangles.extend([[k, k + 2, k + 3], [k, k + 3, k + 1]]);
    }
    align(&mut mesh);
    mesh
}

/// A sphere of triangles, for those that are seen from inside.
pub(super) fn sphere(center: Vec3f, radius: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let columns = 2 * BANDS;
    for j in 0..=BANDS {
        let (sin, cos) = (0.5 * TAU * j as f32 / BANDS as f32).sin_cos();
        for i in 0..=columns {
            let share = i as f32 / columns as f32;
            let (y, x) = (TAU * share).sin_cos();
            let n = vec3(sin * x, sin * y, cos);
            mesh.positions.push(center + n * radius);
            mesh.normals.push(n);
            mesh.uvs.push(Vec2f::from_array([share, j as f32 / BANDS as f32]));
        }
    }
    let row = columns + 1;
    for j in 0..BANDS {
        for i in 0..columns {
            let k = j * row + i;
            if j > 0 {
                mesh.triangles.push([k, k + row, k + 1]);
            }
            if j + 1 < BANDS {
                mesh.triangles.push([k + 1, k + row, k + row + 1]);
            }
        }
    }
    align(&mut mesh);
    mesh
}
