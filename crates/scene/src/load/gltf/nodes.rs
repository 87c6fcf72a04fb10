//! The node hierarchy: a forest, walked without recursion.

use crate::Camera;
use crate::error::{Fault, fault};
use glam::{Affine3A, Mat4, Quat, Vec3};
use gltf::json;
use gltf::json::validation::Checked;

/// World transforms of all nodes.
#[derive(Debug)]
pub(super) struct Nodes {
    world: Vec<Affine3A>,
    has_parent: Vec<bool>,
}

impl Nodes {
    /// Checks that nodes form a forest and composes their transforms.
    pub(super) fn new(root: &json::Root) -> Result<Self, Fault> {
        let count = root.nodes.len();
        let mut parent = vec![usize::MAX; count];
        for (i, node) in root.nodes.iter().enumerate() {
            for child in children(node) {
                let Some(p) = parent.get_mut(child) else {
                    return Err(fault(format!("node {i}"), format!("child {child} is one of {count} nodes")));
                };
                if *p != usize::MAX {
                    let rule = format!("has one parent, found {p} and {i}: nodes form trees");
                    return Err(fault(format!("node {child}"), rule));
                }
                *p = i;
            }
        }
        let mut world = vec![Affine3A::IDENTITY; count];
        let mut reached = vec![false; count];
        let mut stack: Vec<usize> = (0..count).filter(|&i| parent[i] == usize::MAX).collect();
        while let Some(i) = stack.pop() {
            reached[i] = true;
            let local = local(&root.nodes[i], i)?;
            world[i] = if parent[i] == usize::MAX { local } else { world[parent[i]] * local };
            stack.extend(children(&root.nodes[i]));
        }
        if let Some(i) = reached.iter().position(|r| !r) {
            return Err(fault(format!("node {i}"), "nodes form trees: this one is part of a cycle"));
        }
        Ok(Self { world, has_parent: parent.iter().map(|&p| p != usize::MAX).collect() })
    }

    pub(super) fn world(&self, node: usize) -> Affine3A {
        self.world[node]
    }

    pub(super) fn len(&self) -> usize {
        self.world.len()
    }

    /// The nodes of the default scene, parents before children.
    pub(super) fn of_scene(
        &self,
        root: &json::Root,
        warnings: &mut Vec<String>,
    ) -> Result<Vec<usize>, Fault> {
        let roots: Vec<usize> = match root.scene.map(|s| s.value()).or((!root.scenes.is_empty()).then_some(0))
        {
            None => {
                warnings.push("the file has no scene: all nodes are loaded".into());
                (0..self.len()).filter(|&i| !self.has_parent[i]).collect()
            }
            Some(s) => {
                let count = root.scenes.len();
                let scene = root
                    .scenes
                    .get(s)
                    .ok_or_else(|| fault("scene", format!("{s} is one of {count} scenes")))?;
                scene.nodes.iter().map(|n| n.value()).collect()
            }
        };
        if root.scenes.len() > 1 {
            warnings.push(format!("{} scenes besides the default one are ignored", root.scenes.len() - 1));
        }
        let mut order = Vec::new();
        let mut reached = vec![false; self.len()];
        let mut stack: Vec<usize> = roots.into_iter().rev().collect();
        while let Some(i) = stack.pop() {
            match reached.get_mut(i) {
                None => return Err(fault("scene", format!("node {i} is one of {} nodes", self.len()))),
                Some(true) => return Err(fault("scene", format!("node {i} is listed once"))),
                Some(r) => *r = true,
            }
            order.push(i);
            let from = stack.len();
            stack.extend(children(&root.nodes[i]));
            stack[from..].reverse();
        }
        Ok(order)
    }
}

fn children(node: &json::Node) -> impl Iterator<Item = usize> + '_ {
    node.children.iter().flatten().map(|c| c.value())
}

fn local(node: &json::Node, i: usize) -> Result<Affine3A, Fault> {
    let transform = match &node.matrix {
        Some(m) => Affine3A::from_mat4(Mat4::from_cols_array(m)),
        None => {
            let q = Quat::from_array(node.rotation.unwrap_or_default().0);
            let length = q.length();
            if !(length.is_finite() && (length > 0.5 && length < 2.0)) {
                return Err(fault(format!("node {i}"), "rotation is a unit quaternion"));
            }
            Affine3A::from_scale_rotation_translation(
                Vec3::from_array(node.scale.unwrap_or([1.0; 3])),
                q / length,
                Vec3::from_array(node.translation.unwrap_or_default()),
            )
        }
    };
    if transform.is_finite() {
        Ok(transform)
    } else {
        Err(fault(format!("node {i}"), "the transform is finite"))
    }
}

/// A perspective camera placed by `world`; orthographic ones are left out.
pub(super) fn camera(
    root: &json::Root,
    c: usize,
    world: Affine3A,
    node: usize,
) -> Result<Option<Camera>, Fault> {
    let count = root.cameras.len();
    let json = root
        .cameras
        .get(c)
        .ok_or_else(|| fault(format!("node {node}"), format!("camera {c} is one of {count}")))?;
    let (Checked::Valid(json::camera::Type::Perspective), Some(p)) = (json.type_, &json.perspective) else {
        return Ok(None);
    };
    let positive = |x: f32| x.is_finite() && x > 0.0;
    let far = p.zfar.unwrap_or(p.znear * 1e6);
    let aspect = p.aspect_ratio.unwrap_or(1.0);
    if ![p.znear, far - p.znear, aspect, p.yfov].into_iter().all(positive) || p.yfov >= std::f32::consts::PI {
        let rule = "0 < znear < zfar, 0 < yfov < pi and 0 < aspectRatio";
        return Err(fault(format!("camera {c}"), rule));
    }
    let eye = world.translation.into();
    let forward = world.transform_vector3(Vec3::NEG_Z);
    let up = world.transform_vector3(Vec3::Y);
    let target = eye + forward.try_normalize().unwrap_or(Vec3::NEG_Z);
    Ok(Some(Camera::look_at(eye, target, up, p.yfov, aspect, p.znear, far)))
}
