//! Skins in their default pose.

use super::accessor::Need;
use super::document::Document;
use super::nodes::Nodes;
use crate::error::{Fault, fault};
use glam::{Affine3A, Mat4};
use photofit_geometry::Mesh;
use photofit_scalar::Vec3f;

/// The joint matrices of a skin: joint to world times inverse bind.
#[derive(Debug)]
pub(super) struct Skin {
    joints: Vec<Affine3A>,
}

/// Four joints and their weights per vertex.
pub(super) type InfluenceSet = (Vec<[u32; 4]>, Vec<[f32; 4]>);

/// Joints and weights of the vertices of a primitive.
#[derive(Debug)]
pub(super) struct Influences {
    pub(super) sets: Vec<InfluenceSet>,
}

impl Skin {
    pub(super) fn new(document: &Document<'_>, nodes: &Nodes, s: usize, node: usize) -> Result<Self, Fault> {
        let count = document.root.skins.len();
        let skin = document
            .root
            .skins
            .get(s)
            .ok_or_else(|| fault(format!("node {node}"), format!("skin {s} is one of {count}")))?;
        let place = format!("skin {s}");
        let bind: Vec<[f32; 16]> = match skin.inverse_bind_matrices {
            Some(a) => document.floats(a.value(), &place, Need::First(skin.joints.len()))?,
            None => vec![Mat4::IDENTITY.to_cols_array(); skin.joints.len()],
        };
        let joints: Result<Vec<_>, Fault> = skin
            .joints
            .iter()
            .zip(&bind)
            .map(|(joint, bind)| {
                if joint.value() >= nodes.len() {
                    let rule = format!("joint {joint} is one of {} nodes", nodes.len());
                    return Err(fault(&place, rule));
                }
                let m = nodes.world(joint.value()) * Affine3A::from_mat4(Mat4::from_cols_array(bind));
                if m.is_finite() { Ok(m) } else { Err(fault(&place, "joint matrices are finite")) }
            })
            .collect();
        Ok(Self { joints: joints? })
    }

    /// Moves positions, normals and tangents to the world by linear blending.
    pub(super) fn apply(&self, mesh: &mut Mesh, influences: &Influences, place: &str) -> Result<(), Fault> {
        for v in 0..mesh.positions.len() {
            let m = self.blend(influences, v, place)?;
            mesh.positions[v] = from_glam(m.transform_point3(to_glam(mesh.positions[v])));
            if let Some(n) = mesh.normals.get_mut(v) {
                *n = crate::flat::Normals::of(&m).apply(*n);
            }
            if let Some(t) = mesh.tangents.get_mut(v) {
                let moved = from_glam(m.transform_vector3(to_glam(t.xyz()))).normalize_or_zero();
                *t = moved.extend(t.w);
            }
        }
        Ok(())
    }

    fn blend(&self, influences: &Influences, v: usize, place: &str) -> Result<Affine3A, Fault> {
        let (mut sum, mut total) = (Mat4::ZERO, 0.0);
        for (joints, weights) in &influences.sets {
            for (&j, &w) in joints[v].iter().zip(&weights[v]) {
                if w == 0.0 {
                    continue;
                }
                let Some(m) = self.joints.get(j as usize) else {
                    let rule = format!("joint {j} of vertex {v} is one of {}", self.joints.len());
                    return Err(fault(place, rule));
                };
                if !(w.is_finite() && w > 0.0) {
                    return Err(fault(place, format!("weights of vertex {v} are finite and not negative")));
                }
                sum += Mat4::from(*m) * w;
                total += w;
            }
        }
        // A vertex without weights stays where the first joint puts it, as in common viewers.
        if total == 0.0 {
            return Ok(self.joints.first().copied().unwrap_or(Affine3A::IDENTITY));
        }
        Ok(Affine3A::from_mat4(sum * (1.0 / total)))
    }
}

fn to_glam(v: Vec3f) -> glam::Vec3 {
    glam::vec3(v.x, v.y, v.z)
}

fn from_glam(v: glam::Vec3) -> Vec3f {
    photofit_scalar::vec3(v.x, v.y, v.z)
}
