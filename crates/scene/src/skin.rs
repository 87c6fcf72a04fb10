//! Skins and morph targets: how the vertices of a mesh move.

use crate::flat::Normals;
use crate::load::flat_normals;
use glam::{Affine3A, Mat4};
use photofit_geometry::Mesh;
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
    /// The frame of the bind pose to the frame of each joint: one for each joint, invertible.
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
        match self.inverse_binds.iter().position(|m| !invertible(m)) {
            Some(k) => {
                Err(format!("the inverse bind matrix {k} is singular; it must be invertible and finite"))
            }
            None => Ok(()),
        }
    }
}

/// The axes are finite and span a volume, relative to their lengths.
fn invertible(m: &Affine3A) -> bool {
    let m3 = m.matrix3;
    let unit = [m3.x_axis, m3.y_axis, m3.z_axis].map(|a| a.as_dvec3().normalize_or_zero());
    m.is_finite() && unit[0].cross(unit[1]).dot(unit[2]).abs() > 1e-6
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
    /// Morph targets are added first, then positions go by the mean of the joint matrices, normals by its inverse
    /// transpose, tangents by its linear part. Every vertex is computed alone: the bits do not depend on threads.
    ///
    /// # Panics
    /// If a joint of a weight other than zero has no matrix.
    pub fn posed(&self, weights: &[f32], joints: Option<&[Affine3A]>) -> Mesh {
        let mut mesh = self.mesh.clone();
        for (target, &w) in self.targets.iter().zip(weights).filter(|(_, w)| **w != 0.0) {
            add(&mut mesh.positions, &target.positions, w);
            add(&mut mesh.normals, &target.normals, w);
            for (t, d) in mesh.tangents.iter_mut().zip(&target.tangents) {
                *t += d.extend(0.0) * w;
            }
        }
        if let Some(joints) = joints {
            let moves: Vec<Affine3A> =
                (0..mesh.positions.len()).into_par_iter().map(|v| self.blend(joints, v)).collect();
            mesh.positions.par_iter_mut().zip(&moves).for_each(|(p, m)| {
                let q = m.transform_point3a(glam::vec3a(p.x, p.y, p.z));
                *p = photofit_scalar::vec3(q.x, q.y, q.z);
            });
            mesh.normals.par_iter_mut().zip(&moves).for_each(|(n, m)| *n = Normals::of(m).apply(*n));
            mesh.tangents.par_iter_mut().zip(&moves).for_each(|(t, m)| {
                let d = m.transform_vector3a(glam::vec3a(t.x, t.y, t.z));
                *t = photofit_scalar::vec4(d.x, d.y, d.z, t.w);
            });
        }
        if mesh.normals.is_empty() {
            return flat_normals(&mesh);
        }
        // What a pose flattens keeps its direction of the bind pose.
        for (n, bind) in mesh.normals.iter_mut().zip(&self.mesh.normals) {
            let unit = n.normalize_or_zero();
            *n = if unit == Vec3f::zero() { *bind } else { unit };
        }
        for (t, n) in mesh.tangents.iter_mut().zip(&mesh.normals) {
            *t = unit_tangent(*t, *n);
        }
        mesh
    }

    /// Vertices of [`Self::posed`].
    pub(crate) fn posed_vertices(&self) -> usize {
        if self.mesh.normals.is_empty() { self.mesh.triangles.len() * 3 } else { self.mesh.positions.len() }
    }

    /// The weighted mean of the joint matrices of vertex `v`.
    fn blend(&self, joints: &[Affine3A], v: usize) -> Affine3A {
        let (mut sum, mut total) = (Mat4::ZERO, 0.0);
        for set in &self.influences {
            for (&j, &w) in set.joints[v].iter().zip(&set.weights[v]).filter(|(_, w)| **w != 0.0) {
                sum += Mat4::from(joints[j as usize]) * w;
                total += w;
            }
        }
        // A vertex without weights stays where the first joint puts it, as in common viewers.
        if total == 0.0 {
            return joints.first().copied().unwrap_or(Affine3A::IDENTITY);
        }
        Affine3A::from_mat4(sum * (1.0 / total))
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

fn add(to: &mut [Vec3f], deltas: &[Vec3f], weight: f32) {
    to.iter_mut().zip(deltas).for_each(|(p, d)| *p += *d * weight);
}

/// A tangent of unit length; where it has no direction any one across the normal.
pub(crate) fn unit_tangent(t: Vec4f, n: Vec3f) -> Vec4f {
    let direction = t.xyz().normalize_or_zero();
    let direction = if direction == Vec3f::zero() { n.orthonormal_pair().0 } else { direction };
    direction.extend(if t.w < 0.0 { -1.0 } else { 1.0 })
}
