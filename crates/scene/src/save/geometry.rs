//! Primitives, accessors and nodes.

use super::{INDICES, VERTICES, Writer};
use crate::Scene;
use crate::error::{Fault, fault};
use crate::flat::{Normals, for_file};
use glam::{Affine3A, Quat, Vec3};
use photofit_geometry::Mesh;
use photofit_scalar::{Vec3f, Vec4f, vec3};
use serde_json::{Map, Value, json};
use std::collections::HashMap;

/// Writes the placed primitives as meshes and their instances as nodes.
pub(super) fn write(scene: &Scene, writer: &mut Writer) -> Result<(), Fault> {
    let mut meshes: HashMap<usize, usize> = HashMap::new();
    for instance in &scene.instances {
        let primitive = &scene.primitives[instance.primitive];
        // A mesh without vertices cannot be written, and shows nothing.
        if primitive.mesh.positions.is_empty() {
            continue;
        }
        check_finite(&primitive.mesh, &instance.transform)
            .map_err(|rule| fault(format!("primitive {}", instance.primitive), rule))?;
        let mesh = || for_file(primitive, &scene.materials[primitive.material]);
        match Trs::of(&instance.transform) {
            Some(trs) => {
                let mesh = *meshes
                    .entry(instance.primitive)
                    .or_insert_with(|| write_mesh(&mesh(), primitive.material, writer));
                writer.nodes.push(trs.node(mesh));
            }
            None => {
                let moved = transformed(&mesh(), &instance.transform);
                let mesh = write_mesh(&moved, primitive.material, writer);
                writer.nodes.push(json!({"mesh": mesh}));
            }
        }
    }
    Ok(())
}

fn check_finite(mesh: &Mesh, transform: &Affine3A) -> Result<(), &'static str> {
    if !transform.is_finite() {
        return Err("transforms are finite");
    }
    if !mesh.positions.iter().all(|p| p.is_finite()) {
        return Err("positions are finite");
    }
    let uvs = mesh.uvs.iter().chain(&mesh.uvs1).all(|uv| uv.is_finite());
    let rest = mesh.tangents.iter().chain(&mesh.colors).all(|x| x.is_finite());
    if uvs && rest && mesh.normals.iter().all(|n| n.is_finite()) {
        Ok(())
    } else {
        Err("attributes are finite")
    }
}

/// What a node can express.
struct Trs {
    scale: Vec3,
    rotation: Quat,
    translation: Vec3,
}

impl Trs {
    /// `None` where the transform shears or is singular.
    fn of(transform: &Affine3A) -> Option<Self> {
        if *transform == Affine3A::IDENTITY {
            return Some(Self { scale: Vec3::ONE, rotation: Quat::IDENTITY, translation: Vec3::ZERO });
        }
        let m = transform.matrix3;
        let size = m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length());
        let smallest = m.x_axis.length().min(m.y_axis.length()).min(m.z_axis.length());
        // A tiny axis leaves no digits for the rotation.
        if !(size.is_finite() && smallest > 1e-5 * size) {
            return None;
        }
        let (scale, rotation, translation) = transform.to_scale_rotation_translation();
        let rotation = rotation.normalize();
        let again = Affine3A::from_scale_rotation_translation(scale, rotation, translation);
        let error = (again.matrix3.x_axis - m.x_axis)
            .abs()
            .max((again.matrix3.y_axis - m.y_axis).abs())
            .max((again.matrix3.z_axis - m.z_axis).abs());
        (error.max_element() <= 4e-6 * size).then_some(Self { scale, rotation, translation })
    }

    fn node(&self, mesh: usize) -> Value {
        let mut node = json!({"mesh": mesh});
        if self.translation != Vec3::ZERO {
            node["translation"] = json!(self.translation.to_array());
        }
        if self.rotation != Quat::IDENTITY {
            node["rotation"] = json!(self.rotation.to_array());
        }
        if self.scale != Vec3::ONE {
            node["scale"] = json!(self.scale.to_array());
        }
        node
    }
}

fn transformed(mesh: &Mesh, transform: &Affine3A) -> Mesh {
    let normals = Normals::of(transform);
    let mut out = mesh.clone();
    for p in &mut out.positions {
        let q = transform.transform_point3(Vec3::new(p.x, p.y, p.z));
        *p = vec3(q.x, q.y, q.z);
    }
    out.normals.iter_mut().for_each(|n| *n = normals.apply(*n));
    for v in 0..out.tangents.len().min(out.normals.len()) {
        out.tangents[v] = normals.tangent(transform, out.tangents[v], out.normals[v]);
    }
    if normals.mirrored {
        out.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    out
}

fn write_mesh(mesh: &Mesh, material: usize, writer: &mut Writer) -> usize {
    let mut attributes = Map::new();
    let (lo, hi) = mesh.bounds().unwrap_or_default();
    let position = floats(bytemuck::cast_slice(&mesh.positions), 3, writer);
    writer.accessors[position]["min"] = json!(lo.to_array());
    writer.accessors[position]["max"] = json!(hi.to_array());
    attributes.insert("POSITION".into(), json!(position));
    let mut add = |name: &str, accessor: usize| attributes.insert(name.into(), json!(accessor));
    if !mesh.normals.is_empty() {
        let unit: Vec<Vec3f> = mesh.normals.iter().map(|&n| unit(n)).collect();
        add("NORMAL", floats(bytemuck::cast_slice(&unit), 3, writer));
        if !mesh.tangents.is_empty() {
            let unit: Vec<Vec4f> =
                mesh.tangents.iter().zip(&unit).map(|(&t, &n)| unit_tangent(t, n)).collect();
            add("TANGENT", floats(bytemuck::cast_slice(&unit), 4, writer));
        }
    }
    if !mesh.uvs.is_empty() {
        add("TEXCOORD_0", floats(bytemuck::cast_slice(&mesh.uvs), 2, writer));
        if !mesh.uvs1.is_empty() {
            add("TEXCOORD_1", floats(bytemuck::cast_slice(&mesh.uvs1), 2, writer));
        }
    } else if !mesh.uvs1.is_empty() {
        // Sets are counted from zero without gaps.
        let none = vec![0.0_f32; 2 * mesh.uvs1.len()];
        add("TEXCOORD_0", floats(&none, 2, writer));
        add("TEXCOORD_1", floats(bytemuck::cast_slice(&mesh.uvs1), 2, writer));
    }
    if !mesh.colors.is_empty() {
        let unit: Vec<Vec4f> = mesh.colors.iter().map(|c| c.map(|x| x.clamp(0.0, 1.0))).collect();
        add("COLOR_0", floats(bytemuck::cast_slice(&unit), 4, writer));
    }
    let mut primitive = json!({"attributes": attributes, "material": material});
    if mesh.triangles.is_empty() {
        primitive["mode"] = json!(0);
    } else {
        primitive["indices"] = json!(indices(mesh, writer));
    }
    writer.meshes.push(json!({"primitives": [primitive]}));
    writer.meshes.len() - 1
}

fn unit(n: Vec3f) -> Vec3f {
    let n = n.normalize_or_zero();
    if n == Vec3f::zero() { vec3(0.0, 1.0, 0.0) } else { n }
}

fn unit_tangent(t: Vec4f, n: Vec3f) -> Vec4f {
    let direction = t.xyz().normalize_or_zero();
    let direction = if direction == Vec3f::zero() { n.orthonormal_pair().0 } else { direction };
    direction.extend(if t.w < 0.0 { -1.0 } else { 1.0 })
}

fn floats(values: &[f32], components: usize, writer: &mut Writer) -> usize {
    let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
    let view = writer.view(&bytes, Some(VERTICES));
    writer.accessors.push(json!({
        "bufferView": view,
        "componentType": 5126,
        "count": values.len() / components,
        "type": format!("VEC{components}"),
    }));
    writer.accessors.len() - 1
}

fn indices(mesh: &Mesh, writer: &mut Writer) -> usize {
    let flat = mesh.triangles.iter().flatten();
    // The largest index of a type is reserved.
    let (kind, bytes): (u32, Vec<u8>) = if mesh.positions.len() <= 0xffff {
        (5123, flat.flat_map(|&i| (i as u16).to_le_bytes()).collect())
    } else {
        (5125, flat.flat_map(|i| i.to_le_bytes()).collect())
    };
    let view = writer.view(&bytes, Some(INDICES));
    writer.accessors.push(json!({
        "bufferView": view,
        "componentType": kind,
        "count": mesh.triangles.len() * 3,
        "type": "SCALAR",
    }));
    writer.accessors.len() - 1
}
