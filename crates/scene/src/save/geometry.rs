//! Primitives, accessors and nodes.

use super::compress::{Compression, Rounding};
use super::order::ordered;
use super::{INDICES, VERTICES, Writer, named, with_extras};
use crate::error::{Fault, fault};
use crate::flat::{lean_for_file, moved_tangent};
use crate::nodes::NodeMesh;
use crate::skin::{Bind, unit_tangent};
use crate::{Instance, Scene};
use glam::{Affine3A, Quat, Vec3};
use photofit_geometry::Mesh;
use photofit_geometry::skinning::Affine;
use photofit_scalar::{Vec3f, Vec4f, vec3};
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, HashMap};

/// A primitive with morph targets, and the mesh that it is a part of.
#[derive(Clone, Copy)]
pub(super) struct Morphed<'a> {
    pub(super) bind: &'a Bind,
    pub(super) mesh: &'a NodeMesh,
}

/// Writes placed primitives as meshes and these instances of them as nodes; those of `morphed`, by index, with their targets.
pub(super) fn write(
    scene: &Scene,
    instances: &[Instance],
    morphed: &BTreeMap<usize, Morphed<'_>>,
    writer: &mut Writer,
) -> Result<(), Fault> {
    let mut meshes: HashMap<usize, usize> = HashMap::new();
    for instance in instances {
        let primitive = &scene.primitives[instance.primitive];
        // A mesh without vertices cannot be written, and shows nothing.
        if primitive.mesh.positions.is_empty() {
            continue;
        }
        check_finite(&primitive.mesh, &instance.transform)
            .map_err(|rule| fault(format!("primitive {}", instance.primitive), rule))?;
        let mesh = || lean_for_file(primitive, &scene.materials[primitive.material]);
        let morphed = morphed.get(&instance.primitive);
        match Trs::of(&instance.transform) {
            Some(trs) => {
                let mesh = *meshes.entry(instance.primitive).or_insert_with(|| match morphed {
                    Some(morphed) => write_morphed(*morphed, primitive.material, writer),
                    None => write_mesh(&mesh(), primitive.material, writer),
                });
                writer.top(trs.node(mesh));
            }
            None => {
                let moved = transformed(&mesh(), &instance.transform);
                let mesh = write_mesh(&moved, primitive.material, writer);
                writer.top(json!({"mesh": mesh}));
            }
        }
    }
    Ok(())
}

pub(super) fn check_finite(mesh: &Mesh, transform: &Affine3A) -> Result<(), &'static str> {
    if !transform.is_finite() {
        return Err("the transform is not finite; it must be");
    }
    if !mesh.positions.iter().all(|p| p.is_finite()) {
        return Err("a position is not finite; all must be");
    }
    let uvs = mesh.uvs.iter().chain(&mesh.uvs1).all(|uv| uv.is_finite());
    let rest = mesh.tangents.iter().chain(&mesh.colors).all(|x| x.is_finite());
    if uvs && rest && mesh.normals.iter().all(|n| n.is_finite()) {
        Ok(())
    } else {
        Err("an attribute is not finite; all must be")
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
    let transform = Affine::from(*transform);
    let normals = transform.normals();
    let mut out = mesh.clone();
    out.positions.iter_mut().for_each(|p| *p = transform.point(*p));
    out.normals.iter_mut().for_each(|n| *n = normals.apply(*n));
    for v in 0..out.tangents.len().min(out.normals.len()) {
        out.tangents[v] = moved_tangent(&transform, normals.mirrored, out.tangents[v], out.normals[v]);
    }
    if normals.mirrored {
        out.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    out
}

fn write_mesh(mesh: &Mesh, material: usize, writer: &mut Writer) -> usize {
    let primitive = primitive_value(mesh, material, writer);
    writer.meshes.push(json!({"primitives": [primitive]}));
    writer.meshes.len() - 1
}

fn write_morphed(Morphed { bind, mesh }: Morphed<'_>, material: usize, writer: &mut Writer) -> usize {
    let primitive = bind_primitive(bind, material, writer);
    let mut value = json!({"primitives": [primitive]});
    if !mesh.weights.is_empty() {
        value["weights"] = json!(mesh.weights);
    }
    writer.meshes.push(with_extras(named(value, &mesh.name), &mesh.extras));
    writer.meshes.len() - 1
}

/// A primitive with its joints, weights and morph targets.
pub(super) fn bind_primitive(bind: &Bind, material: usize, writer: &mut Writer) -> Value {
    if writer.compression == Compression::None {
        return value(bind, material, writer);
    }
    value(&ordered(bind), material, writer)
}

/// The JSON of a primitive without joints and morph targets.
pub(super) fn primitive_value(mesh: &Mesh, material: usize, writer: &mut Writer) -> Value {
    if writer.compression == Compression::None {
        return attributes_value(mesh, material, writer);
    }
    bind_primitive(&Bind { mesh: mesh.clone(), ..Bind::default() }, material, writer)
}

fn value(bind: &Bind, material: usize, writer: &mut Writer) -> Value {
    let mut primitive = attributes_value(&bind.mesh, material, writer);
    for (s, set) in bind.influences.iter().enumerate() {
        let joints = set.joints.as_flattened();
        let wide = joints.iter().any(|&j| j > 0xff);
        let (component, bytes): (u32, Vec<u8>) = if wide {
            (5123, joints.iter().flat_map(|&j| (j as u16).to_le_bytes()).collect())
        } else {
            (5121, joints.iter().map(|&j| j as u8).collect())
        };
        let accessor = writer.accessor(&bytes, Some(VERTICES), component, set.joints.len(), 4);
        primitive["attributes"][format!("JOINTS_{s}")] = json!(accessor);
        let accessor = writer.floats(set.weights.as_flattened(), 4, Some(VERTICES));
        primitive["attributes"][format!("WEIGHTS_{s}")] = json!(accessor);
    }
    let targets: Vec<Value> = bind
        .targets
        .iter()
        .map(|target| {
            let mut value = Map::new();
            if !target.positions.is_empty() {
                value.insert("POSITION".into(), json!(bounded(&target.positions, writer)));
            }
            for (name, list) in [("NORMAL", &target.normals), ("TANGENT", &target.tangents)] {
                if !list.is_empty() {
                    let (accessor, _) = writer.rounded(bytemuck::cast_slice(list), 3, Rounding::Unit);
                    value.insert(name.into(), json!(accessor));
                }
            }
            // A target that moves nothing needs an attribute to be one.
            if value.is_empty() {
                let still = vec![Vec3f::zero(); bind.mesh.positions.len()];
                value.insert("POSITION".into(), json!(bounded(&still, writer)));
            }
            Value::Object(value)
        })
        .collect();
    if !targets.is_empty() {
        primitive["targets"] = Value::Array(targets);
    }
    primitive
}

/// An accessor of points with the bounds that the specification asks for.
fn bounded(points: &[Vec3f], writer: &mut Writer) -> usize {
    let (accessor, seen) = writer.rounded(bytemuck::cast_slice(points), 3, Rounding::Position);
    let points: &[Vec3f] = bytemuck::cast_slice(&seen);
    let first = points.first().copied().unwrap_or_default();
    let (lo, hi) = points.iter().fold((first, first), |(lo, hi), p| (lo.min(*p), hi.max(*p)));
    writer.accessors[accessor]["min"] = json!(lo.to_array());
    writer.accessors[accessor]["max"] = json!(hi.to_array());
    accessor
}

/// The JSON of a primitive whose attributes and indices are written.
fn attributes_value(mesh: &Mesh, material: usize, writer: &mut Writer) -> Value {
    let mut attributes = Map::new();
    let position = bounded(&mesh.positions, writer);
    attributes.insert("POSITION".into(), json!(position));
    let mut add = |name: &str, accessor: usize| attributes.insert(name.into(), json!(accessor));
    if !mesh.normals.is_empty() {
        let unit: Vec<Vec3f> = mesh.normals.iter().map(|&n| unit(n)).collect();
        let normals: Vec<[f32; 4]> = unit.iter().map(|n| n.extend(0.0).to_array()).collect();
        add("NORMAL", writer.directions(&normals, 3));
        if !mesh.tangents.is_empty() {
            let tangents: Vec<[f32; 4]> =
                mesh.tangents.iter().zip(&unit).map(|(&t, &n)| unit_tangent(t, n).to_array()).collect();
            add("TANGENT", writer.directions(&tangents, 4));
        }
    }
    let mut uvs = |values: &[f32]| writer.rounded(values, 2, Rounding::Coordinate).0;
    if !mesh.uvs.is_empty() {
        add("TEXCOORD_0", uvs(bytemuck::cast_slice(&mesh.uvs)));
        if !mesh.uvs1.is_empty() {
            add("TEXCOORD_1", uvs(bytemuck::cast_slice(&mesh.uvs1)));
        }
    } else if !mesh.uvs1.is_empty() {
        // Sets are counted from zero without gaps.
        let none = vec![0.0_f32; 2 * mesh.uvs1.len()];
        add("TEXCOORD_0", uvs(&none));
        add("TEXCOORD_1", uvs(bytemuck::cast_slice(&mesh.uvs1)));
    }
    if !mesh.colors.is_empty() {
        let unit: Vec<Vec4f> = mesh.colors.iter().map(|c| c.map(|x| x.clamp(0.0, 1.0))).collect();
        add("COLOR_0", writer.colors(&unit));
    }
    let mut primitive = json!({"attributes": attributes, "material": material});
    if mesh.triangles.is_empty() {
        primitive["mode"] = json!(0);
    } else {
        primitive["indices"] = json!(indices(mesh, writer));
    }
    primitive
}

fn unit(n: Vec3f) -> Vec3f {
    let n = n.normalize_or_zero();
    if n == Vec3f::zero() { vec3(0.0, 1.0, 0.0) } else { n }
}

fn indices(mesh: &Mesh, writer: &mut Writer) -> usize {
    if writer.compression != Compression::None {
        let (component, size) = if mesh.positions.len() <= 0xffff { (5123, 2) } else { (5125, 4) };
        return writer.compressed_indices(&mesh.triangles, component, size);
    }
    let flat = mesh.triangles.iter().flatten();
    // The largest index of a type is reserved.
    let (kind, bytes): (u32, Vec<u8>) = if mesh.positions.len() <= 0xffff {
        (5123, flat.flat_map(|&i| (i as u16).to_le_bytes()).collect())
    } else {
        (5125, flat.flat_map(|i| i.to_le_bytes()).collect())
    };
    writer.accessor(&bytes, Some(INDICES), kind, mesh.triangles.len() * 3, 1)
}
