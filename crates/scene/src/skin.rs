//! Skins and morph targets: how the vertices of a mesh move.

use crate::load::flat_normals;
use glam::Affine3A;
use photofit_geometry::Mesh;
use photofit_geometry::skinning::{Affine, Deformation, blend, morph};
use photofit_scalar::{Vec3f, Vec4f};
use rayon::prelude::*;
use serde_json::Value;

/// Joints that move a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Skin {
    /// Name in the file.
    pub name: String,
    /// Application data of the file.
    pub extras: Option<Value>,
    /// Indices into [`crate::Hierarchy::nodes`].
    pub joints: Vec<usize>,
    /// The frame of the bind pose to the frame of each joint: one for each joint, finite. A singular one
    /// collapses what follows its joint.
    pub inverse_binds: Vec<Affine3A>,
    /// The node that the file calls the root of the skeleton; it has no part in posing.
    pub skeleton: Option<usize>,
}

impl Skin {
    /// Joint matrices: bind pose to world.
    ///
    /// # Panics
    /// If a joint is not one of the nodes of `world`.
    pub fn matrices(&self, world: &[Affine3A]) -> Vec<Affine3A> {
        self.joints.iter().zip(&self.inverse_binds).map(|(&j, bind)| world[j] * *bind).collect()
    }

    pub(crate) fn check(&self, nodes: usize) -> Result<(), String> {
        if let Some(j) = self.joints.iter().chain(&self.skeleton).find(|&&j| j >= nodes) {
            return Err(format!("names the joint {j}; there are {nodes} nodes"));
        }
        if self.inverse_binds.len() != self.joints.len() {
            let (joints, binds) = (self.joints.len(), self.inverse_binds.len());
            return Err(format!(
                "has {binds} inverse bind matrices; it must have one for each of {joints} joints"
            ));
        }
        match self.inverse_binds.iter().position(|m| !m.is_finite()) {
            Some(k) => Err(format!("the inverse bind matrix {k} is not finite; it must be")),
            None => Ok(()),
        }
    }
}

/// Four joints of each vertex, as places in [`Skin::joints`], and their weights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Influences {
    /// Joints; 0 where the weight is 0.
    pub joints: Vec<[u32; 4]>,
    /// Weights, finite and not negative. Over all sets they are divided by their sum where they are used; vertices
    /// without any follow the first joint.
    pub weights: Vec<[f32; 4]>,
}

/// What a morph target of weight 1 adds; an empty list adds nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MorphTarget {
    /// Added to positions.
    pub positions: Vec<Vec3f>,
    /// Added to normals.
    pub normals: Vec<Vec3f>,
    /// Added to the directions of tangents.
    pub tangents: Vec<Vec3f>,
}

/// A part of a mesh before it is deformed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bind {
    /// The geometry in the bind pose. Without normals those of every pose are flat.
    pub mesh: Mesh,
    /// Joints and weights in sets of four.
    pub influences: Vec<Influences>,
    /// Morph targets.
    pub targets: Vec<MorphTarget>,
}

impl Bind {
    /// The geometry under weights of the morph targets (missing ones are zero) and joint matrices; without these it
    /// stays in its own frame, with them it stands in the world.
    ///
    /// Positions and normals go by [`Self::deformation`], tangents by the linear part of its maps. Every vertex is computed
    /// alone: the bits do not depend on threads.
    ///
    /// # Panics
    /// If a joint of a weight other than zero has no matrix.
    pub fn posed(&self, weights: &[f32], joints: Option<&[Affine3A]>) -> Mesh {
        let deformation = self.deformation(weights, joints);
        let mut mesh = self.mesh.clone();
        mesh.positions = deformation.positions(&mesh.positions);
        if mesh.normals.is_empty() {
            return flat_normals(&mesh);
        }
        mesh.normals = deformation.normals(&mesh.normals);
        let added = self.added(weights, mesh.tangents.len(), |t| &t.tangents);
        for (v, t) in mesh.tangents.iter_mut().enumerate() {
            let d = added.get(v).map_or(t.xyz(), |a| t.xyz() + *a);
            let d = deformation.moves.get(v).map_or(d, |m| m.direction(d));
            *t = unit_tangent(d.extend(t.w), mesh.normals[v]);
        }
        mesh
    }

    /// What a pose does to positions and normals: morph targets are added, then the mean of the joint matrices of each
    /// vertex, without these in the frame of the mesh.
    ///
    /// # Panics
    /// If a joint of a weight other than zero has no matrix.
    pub fn deformation(&self, weights: &[f32], joints: Option<&[Affine3A]>) -> Deformation {
        let moves = joints.map_or_else(Vec::new, |joints| {
            let joints: Vec<Affine> = joints.iter().map(|j| (*j).into()).collect();
            let of = |set: &Influences, v: usize| set.joints[v].into_iter().zip(set.weights[v]);
            let blended = |v: usize| {
                let influences = self.influences.iter().flat_map(|set| of(set, v));
                blend(influences, &joints)
            };
            (0..self.mesh.positions.len()).into_par_iter().map(blended).collect()
        });
        Deformation {
            positions: self.added(weights, self.mesh.positions.len(), |t| &t.positions),
            normals: self.added(weights, self.mesh.normals.len(), |t| &t.normals),
            moves,
        }
    }

    /// What morph targets of these weights add to `count` vertices.
    fn added(&self, weights: &[f32], count: usize, of: fn(&MorphTarget) -> &Vec<Vec3f>) -> Vec<Vec3f> {
        if count == 0 {
            return Vec::new();
        }
        morph(count, self.targets.iter().map(|t| of(t).as_slice()).zip(weights.iter().copied()))
    }

    /// Vertices of [`Self::posed`].
    pub(crate) fn posed_vertices(&self) -> usize {
        if self.mesh.normals.is_empty() { self.mesh.triangles.len() * 3 } else { self.mesh.positions.len() }
    }

    pub(crate) fn check(&self) -> Result<(), String> {
        crate::model::check_mesh(&self.mesh)?;
        let n = self.mesh.positions.len();
        for (s, set) in self.influences.iter().enumerate() {
            for (name, length) in [("joints", set.joints.len()), ("weights", set.weights.len())] {
                if length != n {
                    return Err(format!(
                        "has {length} {name} in set {s}; it must have one for each of {n} vertices"
                    ));
                }
            }
            let bad = set.weights.iter().position(|w| !w.iter().all(|w| w.is_finite() && *w >= 0.0));
            if let Some(v) = bad {
                let w = set.weights[v];
                return Err(format!("weights of vertex {v} are {w:?}; they must be finite and not negative"));
            }
        }
        for (t, target) in self.targets.iter().enumerate() {
            for list in [&target.positions, &target.normals, &target.tangents] {
                if !(list.is_empty() || list.len() == n) {
                    return Err(format!("target {t} has {} elements; it must have none or {n}", list.len()));
                }
                if let Some(v) = list.iter().position(|d| !d.is_finite()) {
                    return Err(format!("target {t} is not finite at vertex {v}; it must be"));
                }
            }
        }
        Ok(())
    }

    /// Joints of weights other than zero are below `count`.
    pub(crate) fn check_joints(&self, count: usize) -> Result<(), String> {
        for set in &self.influences {
            for (v, (joints, weights)) in set.joints.iter().zip(&set.weights).enumerate() {
                let bad = joints.iter().zip(weights).find(|(j, w)| **w != 0.0 && **j as usize >= count);
                if let Some((j, _)) = bad {
                    return Err(format!("names joint {j} of vertex {v}; the skin has {count} joints"));
                }
            }
        }
        Ok(())
    }
}

/// A tangent of unit length; where it has no direction any one across the normal.
pub(crate) fn unit_tangent(t: Vec4f, n: Vec3f) -> Vec4f {
    let direction = t.xyz().normalize_or_zero();
    let direction = if direction == Vec3f::zero() { n.orthonormal_pair().0 } else { direction };
    direction.extend(if t.w < 0.0 { -1.0 } else { 1.0 })
}
