//! The node hierarchy, and the cameras and lights that hang on it.

use super::document::Document;
use super::{instancing, lights};
use crate::error::{Fault, fault};
use crate::nodes::{Hierarchy, Lens, Node, NodeCamera, NodeTransform};
use glam::{Affine3A, Mat4, Quat, Vec3};
use gltf::json;
use gltf::json::validation::Checked;

/// The nodes of a document with their cameras and lights; the meshes that they name are those of the document.
pub(super) fn read(document: &Document<'_>, warnings: &mut Vec<String>) -> Result<Hierarchy, Fault> {
    let root = &document.root;
    let mut nodes = Vec::with_capacity(root.nodes.len());
    for (i, node) in root.nodes.iter().enumerate() {
        nodes.push(Node {
            name: node.name.clone().unwrap_or_default(),
            extras: document.extras(&node.extras, || format!("node {i}"))?,
            children: node.children.iter().flatten().map(|c| c.value()).collect(),
            transform: transform(node),
            mesh: node.mesh.map(|m| m.value()),
            skin: node.skin.map(|s| s.value()),
            weights: node.weights.clone().unwrap_or_default(),
            camera: node.camera.map(|c| c.value()),
            light: document.light(i),
        });
    }
    instancing::expand(document, &mut nodes)?;
    let mut out = Hierarchy { nodes, ..Hierarchy::default() };
    out.roots = roots(document, &out, warnings)?;
    out.check_trees()?;
    for c in 0..root.cameras.len() {
        out.cameras.push(camera(document, c)?);
    }
    for l in 0..document.lights.len() {
        out.lights.push(lights::read(&document.lights, l)?);
    }
    for (i, node) in out.nodes.iter().enumerate() {
        let (cameras, lights) = (out.cameras.len(), out.lights.len());
        let place = || format!("node {i}");
        if let Some(c) = node.camera.filter(|&c| c >= cameras) {
            return Err(fault(place(), format!("names camera {c}; there are {cameras} cameras")));
        }
        if let Some(l) = node.light.filter(|&l| l >= lights) {
            return Err(fault(place(), format!("names light {l}; there are {lights} lights")));
        }
    }
    Ok(out)
}

fn roots(
    document: &Document<'_>,
    hierarchy: &Hierarchy,
    warnings: &mut Vec<String>,
) -> Result<Vec<usize>, Fault> {
    let scenes = &document.root.scenes;
    if scenes.len() > 1 {
        warnings.push(format!("{} scenes besides the default one are ignored", scenes.len() - 1));
    }
    let Some(scene) = document.default_scene()? else {
        warnings.push("the file has no scene: all nodes are loaded".into());
        let mut child = vec![false; hierarchy.nodes.len()];
        hierarchy.nodes.iter().flat_map(|n| &n.children).for_each(|&c| {
            if let Some(c) = child.get_mut(c) {
                *c = true;
            }
        });
        return Ok((0..child.len()).filter(|&i| !child[i]).collect());
    };
    Ok(scene.nodes.iter().map(|n| n.value()).collect())
}

fn transform(node: &json::Node) -> NodeTransform {
    match &node.matrix {
        Some(m) => NodeTransform::Matrix(Affine3A::from_mat4(Mat4::from_cols_array(m))),
        None => NodeTransform::Parts {
            translation: Vec3::from_array(node.translation.unwrap_or_default()),
            rotation: Quat::from_array(node.rotation.unwrap_or_default().0),
            scale: Vec3::from_array(node.scale.unwrap_or([1.0; 3])),
        },
    }
}

fn camera(document: &Document<'_>, c: usize) -> Result<NodeCamera, Fault> {
    let json = &document.root.cameras[c];
    let place = || format!("camera {c}");
    let positive = |x: f32| x.is_finite() && x > 0.0;
    let lens = match (json.type_, &json.perspective, &json.orthographic) {
        (Checked::Valid(json::camera::Type::Perspective), Some(p), _) => {
            let far = p.zfar.unwrap_or(p.znear * 1e6);
            let aspect = p.aspect_ratio.unwrap_or(1.0);
            let fits = [p.znear, far - p.znear, aspect, p.yfov].into_iter().all(positive);
            if !fits || p.yfov >= std::f32::consts::PI {
                let found = format!("znear {}, zfar {far}, yfov {}, aspectRatio {aspect}", p.znear, p.yfov);
                let rule = "0 < znear < zfar, 0 < yfov < pi and 0 < aspectRatio";
                return Err(fault(place(), format!("has {found}; it must have {rule}")));
            }
            Lens::Perspective { fov_y: p.yfov, aspect: p.aspect_ratio, near: p.znear, far: p.zfar }
        }
        (Checked::Valid(json::camera::Type::Orthographic), _, Some(o)) => {
            let size = o.xmag.abs().min(o.ymag.abs());
            if !(size > 0.0 && o.xmag.is_finite() && o.ymag.is_finite() && o.znear >= 0.0 && o.zfar > o.znear)
            {
                let found = format!("xmag {}, ymag {}, znear {}, zfar {}", o.xmag, o.ymag, o.znear, o.zfar);
                let rule = "xmag and ymag other than 0 and 0 <= znear < zfar";
                return Err(fault(place(), format!("has {found}; it must have {rule}")));
            }
            Lens::Orthographic { half_width: o.xmag, half_height: o.ymag, near: o.znear, far: o.zfar }
        }
        _ => {
            let rule = "is neither perspective nor orthographic; it must have a type and that type's values";
            return Err(fault(place(), rule));
        }
    };
    let extras = document.extras(&json.extras, place)?;
    Ok(NodeCamera { name: json.name.clone().unwrap_or_default(), extras, lens })
}
