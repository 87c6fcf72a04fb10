//! The node hierarchy with its meshes, skins, cameras and lights.

use super::geometry::{bind_primitive, check_finite, primitive_value};
use super::{Writer, animation, extensions, named, with_extras};
use crate::Scene;
use crate::error::{Fault, fault};
use crate::flat::for_file;
use crate::nodes::{Hierarchy, Lens, Node, NodeTransform};
use crate::skin::Skin;
use glam::{Affine3A, Mat4, Quat, Vec3};
use serde_json::{Value, json};

/// Writes what the nodes place. Nodes, meshes with vertices, skins, cameras and lights keep their order.
pub(super) fn write(scene: &Scene, hierarchy: &Hierarchy, writer: &mut Writer) -> Result<(), Fault> {
    check_placed(scene, hierarchy)?;
    let mut meshes = Vec::with_capacity(hierarchy.meshes.len());
    for m in 0..hierarchy.meshes.len() {
        meshes.push(write_mesh(scene, hierarchy, m, writer)?);
    }
    for node in &hierarchy.nodes {
        let value = write_node(node, &meshes);
        writer.nodes.push(value);
    }
    writer.roots.extend(&hierarchy.roots);
    for skin in &hierarchy.skins {
        let value = write_skin(skin, writer);
        writer.skins.push(value);
    }
    for camera in &hierarchy.cameras {
        let value = with_extras(named(lens(&camera.lens), &camera.name), &camera.extras);
        writer.cameras.push(value);
    }
    for (i, light) in hierarchy.lights.iter().enumerate() {
        let value = extensions::light(&light.light).map_err(|rule| fault(format!("light {i}"), rule))?;
        writer.lights.push(with_extras(value, &light.extras));
    }
    let shown = |node: usize| hierarchy.nodes[node].mesh.is_some_and(|m| meshes[m].is_some());
    for motion in &hierarchy.animations {
        if let Some(value) = animation::write(motion, &shown, writer) {
            writer.animations.push(value);
        }
    }
    Ok(())
}

/// Instances stand where their nodes put them, so that nothing that was moved by hand is lost.
fn check_placed(scene: &Scene, hierarchy: &Hierarchy) -> Result<(), Fault> {
    let (placed, instances) = (hierarchy.placements.len(), scene.instances.len());
    if placed > instances {
        let rule =
            format!("place {placed} primitives; the scene has {instances} instances and must have them all");
        return Err(fault("the nodes", rule));
    }
    let world = hierarchy.worlds(&hierarchy.locals());
    for (i, (placement, instance)) in hierarchy.placements.iter().zip(&scene.instances).enumerate() {
        let skinned = hierarchy.nodes[placement.node].skin.is_some();
        let wanted = if skinned { Affine3A::IDENTITY } else { world[placement.node] };
        if instance.transform != wanted {
            let rule = format!(
                "does not stand where node {} puts it in the default pose; move the node and set that pose, or take \
                 the hierarchy away to write the instances alone",
                placement.node
            );
            return Err(fault(format!("instance {i}"), rule));
        }
    }
    Ok(())
}

/// The index of the written mesh; `None` where it has no vertices.
fn write_mesh(
    scene: &Scene,
    hierarchy: &Hierarchy,
    m: usize,
    writer: &mut Writer,
) -> Result<Option<usize>, Fault> {
    let mesh = &hierarchy.meshes[m];
    let mut primitives = Vec::with_capacity(mesh.primitives.len());
    for (p, part) in mesh.primitives.iter().enumerate() {
        let primitive = &scene.primitives[part.primitive];
        let geometry = part.bind.as_ref().map_or(&primitive.mesh, |b| &b.mesh);
        if geometry.positions.is_empty() {
            continue;
        }
        check_finite(geometry, &Affine3A::IDENTITY)
            .map_err(|rule| fault(format!("mesh {m} primitive {p}"), rule))?;
        let value = match &part.bind {
            Some(bind) => bind_primitive(bind, primitive.material, writer),
            None => {
                let mesh = for_file(primitive, &scene.materials[primitive.material]);
                primitive_value(&mesh, primitive.material, writer)
            }
        };
        primitives.push(with_extras(value, &part.extras));
    }
    if primitives.is_empty() {
        return Ok(None);
    }
    let mut value = json!({"primitives": primitives});
    if !mesh.weights.is_empty() {
        value["weights"] = json!(mesh.weights);
    }
    writer.meshes.push(with_extras(named(value, &mesh.name), &mesh.extras));
    Ok(Some(writer.meshes.len() - 1))
}

fn write_node(node: &Node, meshes: &[Option<usize>]) -> Value {
    let mut value = json!({});
    if !node.children.is_empty() {
        value["children"] = json!(node.children);
    }
    match node.transform {
        NodeTransform::Matrix(m) => value["matrix"] = json!(Mat4::from(m).to_cols_array()),
        NodeTransform::Parts { translation, rotation, scale } => {
            if translation != Vec3::ZERO {
                value["translation"] = json!(translation.to_array());
            }
            if rotation != Quat::IDENTITY {
                value["rotation"] = json!(rotation.to_array());
            }
            if scale != Vec3::ONE {
                value["scale"] = json!(scale.to_array());
            }
        }
    }
    if let Some(mesh) = node.mesh.and_then(|m| meshes[m]) {
        value["mesh"] = json!(mesh);
        if let Some(skin) = node.skin {
            value["skin"] = json!(skin);
        }
        if !node.weights.is_empty() {
            value["weights"] = json!(node.weights);
        }
    }
    if let Some(camera) = node.camera {
        value["camera"] = json!(camera);
    }
    if let Some(light) = node.light {
        value["extensions"] = json!({"KHR_lights_punctual": {"light": light}});
    }
    with_extras(named(value, &node.name), &node.extras)
}

fn write_skin(skin: &Skin, writer: &mut Writer) -> Value {
    let matrices: Vec<f32> = skin.inverse_binds.iter().flat_map(|m| Mat4::from(*m).to_cols_array()).collect();
    let mut value = json!({"joints": skin.joints});
    if !matrices.is_empty() {
        value["inverseBindMatrices"] = json!(writer.floats(&matrices, 16, None));
    }
    if let Some(skeleton) = skin.skeleton {
        value["skeleton"] = json!(skeleton);
    }
    with_extras(named(value, &skin.name), &skin.extras)
}

fn lens(lens: &Lens) -> Value {
    match *lens {
        Lens::Perspective { fov_y, aspect, near, far } => {
            let mut value = json!({"yfov": fov_y, "znear": near});
            if let Some(aspect) = aspect {
                value["aspectRatio"] = json!(aspect);
            }
            if let Some(far) = far {
                value["zfar"] = json!(far);
            }
            json!({"type": "perspective", "perspective": value})
        }
        Lens::Orthographic { half_width, half_height, near, far } => json!({
            "type": "orthographic",
            "orthographic": {"xmag": half_width, "ymag": half_height, "znear": near, "zfar": far},
        }),
    }
}
