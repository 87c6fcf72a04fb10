//! The node hierarchy of an asset: what a flat list of placed meshes forgets.

use crate::animation::Animation;
use crate::error::{Fault, fault};
use crate::skin::{Bind, Skin};
use crate::{PunctualLight, Scene};
use glam::{Affine3A, Quat, Vec3};
use serde_json::Value;

/// Nodes with what hangs on them, in the order of the file.
///
/// [`Scene::primitives`], [`Scene::instances`], [`Scene::cameras`] and [`Scene::lights`] are this hierarchy in its default
/// pose; [`Scene::pose`] gives other poses. Every index is in range (loaders check it, [`Scene::validate`] checks
/// hierarchies made by hand).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hierarchy {
    /// All nodes of the file: they form trees.
    pub nodes: Vec<Node>,
    /// The nodes that the default scene lists; what does not hang on them is not shown.
    pub roots: Vec<usize>,
    /// Meshes of the nodes that are shown.
    pub meshes: Vec<NodeMesh>,
    /// Skins.
    pub skins: Vec<Skin>,
    /// Animations.
    pub animations: Vec<Animation>,
    /// Cameras in the frames of their nodes.
    pub cameras: Vec<NodeCamera>,
    /// Lights in the frames of their nodes.
    pub lights: Vec<NodeLight>,
    /// Where each of the first [`Scene::instances`] comes from; instances beyond these were added by hand.
    pub placements: Vec<Placement>,
}

/// A node.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Node {
    /// Name in the file.
    pub name: String,
    /// Application data of the file.
    pub extras: Option<Value>,
    /// Indices into [`Hierarchy::nodes`].
    pub children: Vec<usize>,
    /// Own frame to the parent's.
    pub transform: NodeTransform,
    /// Index into [`Hierarchy::meshes`].
    pub mesh: Option<usize>,
    /// Index into [`Hierarchy::skins`].
    pub skin: Option<usize>,
    /// Weights of morph targets in place of the mesh's own; empty where the mesh's count.
    pub weights: Vec<f32>,
    /// Index into [`Hierarchy::cameras`].
    pub camera: Option<usize>,
    /// Index into [`Hierarchy::lights`].
    pub light: Option<usize>,
}

/// How a node stands in its parent's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NodeTransform {
    /// Scale, then rotation, then translation; only these can be animated.
    Parts {
        /// Translation in the parent's units.
        translation: Vec3,
        /// Rotation as in the file: a quaternion of length 0.5 to 2, normalised where it is used.
        rotation: Quat,
        /// Scale along the node's axes.
        scale: Vec3,
    },
    /// A matrix.
    Matrix(Affine3A),
}

impl Default for NodeTransform {
    fn default() -> Self {
        Self::Parts { translation: Vec3::ZERO, rotation: Quat::IDENTITY, scale: Vec3::ONE }
    }
}

impl NodeTransform {
    /// Own frame to the parent's.
    pub fn affine(&self) -> Affine3A {
        match *self {
            Self::Matrix(m) => m,
            Self::Parts { translation, rotation, scale } => {
                let unit = rotation / rotation.length();
                Affine3A::from_scale_rotation_translation(scale, unit, translation)
            }
        }
    }

    fn check(&self) -> Result<(), String> {
        if let Self::Parts { rotation, .. } = self {
            let length = rotation.length();
            if !(length > 0.5 && length < 2.0) {
                return Err(format!("rotation has length {length}; it must be a unit quaternion"));
            }
        }
        if self.affine().is_finite() {
            Ok(())
        } else {
            Err("the transform is not finite; all its numbers must be".into())
        }
    }
}

/// A mesh as nodes share it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NodeMesh {
    /// Name in the file.
    pub name: String,
    /// Application data of the file; by convention `targetNames` lists the morph targets.
    pub extras: Option<Value>,
    /// Weights of the morph targets; empty where all are zero.
    pub weights: Vec<f32>,
    /// Its parts, each with one material.
    pub primitives: Vec<NodePrimitive>,
}

impl NodeMesh {
    /// Number of morph targets.
    pub fn targets(&self) -> usize {
        self.primitives.iter().filter_map(|p| p.bind.as_ref()).map(|b| b.targets.len()).max().unwrap_or(0)
    }

    /// Names of the morph targets, where [`Self::extras`] hold some: those that are text.
    pub fn target_names(&self) -> impl Iterator<Item = &str> {
        let names = self.extras.as_ref().and_then(|extras| extras.get("targetNames")?.as_array());
        names.into_iter().flatten().filter_map(Value::as_str).take(self.targets())
    }
}

/// A part of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NodePrimitive {
    /// Index into [`Scene::primitives`]: the part itself where it is rigid, else its first pose, whose material counts.
    pub primitive: usize,
    /// The part before it is deformed; `None` for rigid parts.
    pub bind: Option<Bind>,
    /// Application data of the file.
    pub extras: Option<Value>,
}

/// Where an instance comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Placement {
    /// Index into [`Hierarchy::nodes`].
    pub node: usize,
    /// Index into [`NodeMesh::primitives`] of the node's mesh.
    pub part: usize,
}

/// A camera in the frame of its node: it looks down -z.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeCamera {
    /// Name in the file.
    pub name: String,
    /// Application data of the file.
    pub extras: Option<Value>,
    /// What it sees.
    pub lens: Lens,
}

/// What a camera of a file sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lens {
    /// A pinhole.
    Perspective {
        /// Vertical angle of view, radians.
        fov_y: f32,
        /// Width over height; the picture's where it is absent.
        aspect: Option<f32>,
        /// Distance of the near plane.
        near: f32,
        /// Distance of the far plane; none where it is absent.
        far: Option<f32>,
    },
    /// Parallel rays.
    Orthographic {
        /// Half of the width.
        half_width: f32,
        /// Half of the height.
        half_height: f32,
        /// Distance of the near plane.
        near: f32,
        /// Distance of the far plane.
        far: f32,
    },
}

/// A light in the frame of its node.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeLight {
    /// At the origin, along -z.
    pub light: PunctualLight,
    /// Application data of the file.
    pub extras: Option<Value>,
}

/// What a file says about itself.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AssetInfo {
    /// Copyright notice of the asset.
    pub copyright: String,
    /// Name of the default scene.
    pub scene: String,
    /// Application data of `asset`.
    pub asset_extras: Option<Value>,
    /// Application data of the whole file.
    pub root_extras: Option<Value>,
    /// Application data of the default scene.
    pub scene_extras: Option<Value>,
}

impl Hierarchy {
    /// World transforms of all nodes from transforms to their parents', one for each node.
    ///
    /// # Panics
    /// If there are fewer `local` transforms than nodes.
    pub fn worlds(&self, local: &[Affine3A]) -> Vec<Affine3A> {
        let mut world = local.to_vec();
        for (parent, child) in self.parents_first() {
            world[child] = world[parent] * local[child];
        }
        world
    }

    /// Transforms of all nodes to their parents' frames in the default pose.
    pub fn locals(&self) -> Vec<Affine3A> {
        self.nodes.iter().map(|n| n.transform.affine()).collect()
    }

    /// Pairs of parent and child, each node before its children.
    fn parents_first(&self) -> Vec<(usize, usize)> {
        let parents = self.parents();
        let mut stack: Vec<usize> = (0..parents.len()).filter(|&i| parents[i].is_none()).collect();
        let mut out = Vec::with_capacity(self.nodes.len());
        while let Some(i) = stack.pop() {
            out.extend(self.nodes[i].children.iter().map(|&c| (i, c)));
            stack.extend(&self.nodes[i].children);
        }
        out
    }

    /// The parent of each node.
    pub fn parents(&self) -> Vec<Option<usize>> {
        let mut out = vec![None; self.nodes.len()];
        for (i, node) in self.nodes.iter().enumerate() {
            node.children.iter().for_each(|&c| out[c] = Some(i));
        }
        out
    }

    /// The nodes that are shown, parents before children, in the order of the file.
    pub fn shown(&self) -> Vec<usize> {
        let mut order = Vec::new();
        let mut stack: Vec<usize> = self.roots.iter().rev().copied().collect();
        while let Some(i) = stack.pop() {
            order.push(i);
            stack.extend(self.nodes[i].children.iter().rev());
        }
        order
    }

    /// Index of the first animation of this name.
    pub fn animation(&self, name: &str) -> Option<usize> {
        self.animations.iter().position(|a| a.name == name)
    }

    /// Nodes form trees, and the roots name each shown node once.
    pub(crate) fn check_trees(&self) -> Result<(), Fault> {
        let count = self.nodes.len();
        let mut parent = vec![None; count];
        for (i, node) in self.nodes.iter().enumerate() {
            node.transform.check().map_err(|rule| fault(format!("node {i}"), rule))?;
            for &child in &node.children {
                let Some(slot) = parent.get_mut(child) else {
                    return Err(missing(format!("node {i}"), "child", child, "nodes", count));
                };
                if let Some(p) = slot {
                    let rule =
                        format!("has the parents {p} and {i}; it must have one parent: nodes form trees");
                    return Err(fault(format!("node {child}"), rule));
                }
                *slot = Some(i);
            }
        }
        let mut reached = vec![false; count];
        let mut stack: Vec<usize> = (0..count).filter(|&i| parent[i].is_none()).collect();
        while let Some(i) = stack.pop() {
            reached[i] = true;
            stack.extend(&self.nodes[i].children);
        }
        if let Some(i) = reached.iter().position(|r| !r) {
            return Err(fault(format!("node {i}"), "is part of a cycle; nodes must form trees"));
        }
        // Trees are finite from here on; a root may still hang on another.
        let mut listed = vec![false; count];
        let mut stack = self.roots.clone();
        while let Some(i) = stack.pop() {
            match listed.get_mut(i) {
                None => return Err(missing("scene", "node", i, "nodes", count)),
                Some(true) => {
                    let rule = format!("shows node {i} twice; it must list each node once");
                    return Err(fault("scene", rule));
                }
                Some(l) => *l = true,
            }
            stack.extend(&self.nodes[i].children);
        }
        Ok(())
    }

    /// Every rule of this type.
    pub(crate) fn check(&self, scene: &Scene) -> Result<(), Fault> {
        self.check_trees()?;
        for (i, node) in self.nodes.iter().enumerate() {
            let lists = [
                ("mesh", node.mesh, self.meshes.len()),
                ("skin", node.skin, self.skins.len()),
                ("camera", node.camera, self.cameras.len()),
                ("light", node.light, self.lights.len()),
            ];
            for (what, index, count) in lists {
                if let Some(index) = index.filter(|&k| k >= count) {
                    return Err(missing(format!("node {i}"), what, index, "of these", count));
                }
            }
            if !node.weights.iter().all(|w| w.is_finite()) {
                return Err(fault(format!("node {i}"), "weights are not finite; they must be"));
            }
            let Some(mesh) = node.mesh.map(|m| &self.meshes[m]) else { continue };
            let Some(joints) = node.skin.map(|s| self.skins[s].joints.len()) else { continue };
            for (p, part) in mesh.primitives.iter().enumerate() {
                let place = || format!("node {i} primitive {p}");
                let Some(bind) = part.bind.as_ref().filter(|b| !b.influences.is_empty()) else {
                    return Err(fault(
                        place(),
                        "has a skin without JOINTS_0 and WEIGHTS_0; it must have both",
                    ));
                };
                bind.check_joints(joints).map_err(|rule| fault(place(), rule))?;
            }
        }
        for (m, mesh) in self.meshes.iter().enumerate() {
            for (p, part) in mesh.primitives.iter().enumerate() {
                let place = || format!("mesh {m} primitive {p}");
                if part.primitive >= scene.primitives.len() {
                    return Err(missing(place(), "primitive", part.primitive, "", scene.primitives.len()));
                }
                if let Some(bind) = &part.bind {
                    bind.check().map_err(|rule| fault(place(), rule))?;
                }
            }
        }
        for (s, skin) in self.skins.iter().enumerate() {
            skin.check(self.nodes.len()).map_err(|rule| fault(format!("skin {s}"), rule))?;
        }
        for (a, animation) in self.animations.iter().enumerate() {
            animation.check(self).map_err(|f| fault(format!("animation {a} {}", f.place), f.rule))?;
        }
        for (i, placement) in self.placements.iter().enumerate() {
            let mesh = self.nodes.get(placement.node).and_then(|n| n.mesh);
            if mesh.is_none_or(|m| placement.part >= self.meshes[m].primitives.len()) {
                let rule = format!("part {} of node {} does not exist", placement.part, placement.node);
                return Err(fault(format!("placement {i}"), rule));
            }
        }
        Ok(())
    }
}

fn missing(place: impl Into<String>, what: &str, index: usize, of: &str, count: usize) -> Fault {
    fault(place, format!("names {what} {index}; there are {count} {of}").trim_end())
}
