//! A tree over boxes, and rays in the frame of a structure: the parts of a two-level traversal.

use super::traverse::{Local, Slabs, walk};
use super::wide::{self, Node};
use super::{Accel, Hit};
use glam::{DAffine3, DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use photofit_scalar::Vec3f;

/// A tree over boxes.
#[derive(Clone, Debug, Default)]
pub(crate) struct TopTree {
    nodes: Vec<Node>,
    /// Largest absolute coordinate.
    extent: f32,
}

impl TopTree {
    /// Builds the tree over boxes of finite corners.
    pub(crate) fn build(boxes: &[[DVec3; 2]]) -> Self {
        if boxes.is_empty() {
            return Self::default();
        }
        // Rounded outwards by more than the rounding to single precision.
        let outwards = |[lo, hi]: &[DVec3; 2]| {
            let pad = lo.abs().max(hi.abs()) * (2.0 * f64::from(f32::EPSILON));
            let corner = |p: DVec3| Vec3A::from(p.as_vec3());
            Aabb::new(corner(*lo - pad), corner(*hi + pad))
        };
        let boxes: Vec<Aabb> = boxes.iter().map(outwards).collect();
        let extent = boxes.iter().fold(0.0, |e, b| b.min.abs().max(b.max.abs()).max_element().max(e));
        let indices = (0..boxes.len() as u32).collect();
        let mut builder = PlocBuilder::with_capacity(boxes.len());
        let tree = builder.build(PlocSearchDistance::Medium, &boxes, indices, SortPrecision::U64, 3);
        Self { nodes: wide::collapse(&tree, |entries| entries[0]), extent }
    }

    /// Visits the entries whose boxes the ray passes, near ones first; `visit` gets the limit so far and returns the
    /// new one, or ends the walk.
    #[inline(always)]
    pub(crate) fn walk(&self, ray: &TopRay, limit: f32, visit: impl FnMut(u32, f32) -> Option<f32>) {
        if !self.nodes.is_empty() {
            walk(&self.nodes, &ray.0, limit.min(f32::MAX), visit);
        }
    }

    /// Bytes of the nodes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.nodes.as_slice())
    }
}

/// A ray for a [`TopTree`].
pub(crate) struct TopRay(Slabs);

impl TopRay {
    /// `direction` is finite and not zero.
    #[inline(always)]
    pub(crate) fn new(tree: &TopTree, origin: Vec3f, direction: Vec3f) -> Self {
        let (o, d) = (Vec3::from_array(origin.to_array()), Vec3::from_array(direction.to_array()));
        let pad = (o.abs().max_element() + tree.extent) * (8.0 * 0.5 * f32::EPSILON);
        Self(Slabs::new(o, d, pad, 0.0))
    }
}

/// A ray in an [`Accel`]'s own frame.
pub(crate) struct FrameRay(Local, f32);

impl FrameRay {
    /// `t` counts lengths of `direction`, from 0 to `t_max`; `None` for directions that hit nothing.
    #[inline(always)]
    pub(crate) fn new(accel: &Accel, origin: Vec3, direction: Vec3, t_max: f32) -> Option<Self> {
        let t_max = t_max.min(f32::MAX);
        Local::in_frame(accel, origin, direction, 0.0, t_max).map(|local| Self(local, t_max))
    }
}

impl Accel {
    /// From the frame of the positions to the frame of [`FrameRay`].
    pub(crate) fn frame(&self) -> DAffine3 {
        DAffine3::from_scale(DVec3::splat(self.scale))
            * DAffine3::from_translation(-DVec3::from_array(self.center))
    }

    /// The box of the triangles, in the frame of the positions.
    pub(crate) fn bounds(&self) -> (DVec3, DVec3) {
        let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        if let Some(root) = self.nodes.first() {
            for k in 0..3 {
                lo[k] = f64::from(root.lo[k].min_element()) / self.scale + self.center[k];
                hi[k] = f64::from(root.hi[k].max_element()) / self.scale + self.center[k];
            }
        }
        (lo, hi)
    }

    /// Bytes of nodes and triangles.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.nodes.as_slice()) + size_of_val(self.packets.as_slice())
    }

    /// Calls `found` with hits and the limit so far; it returns the new limit, or ends the walk.
    #[inline(always)]
    pub(crate) fn candidates(&self, ray: &FrameRay, mut found: impl FnMut(Hit, f32) -> Option<f32>) {
        let mut limit = ray.1;
        self.traverse(&ray.0, limit, |packet, hits| {
            let mut mask = hits.mask;
            while mask != 0 {
                let hit = hits.lane(packet, mask.trailing_zeros() as usize);
                mask &= mask - 1;
                if hit.t <= limit {
                    limit = found(hit, limit)?;
                }
            }
            Some(limit)
        });
    }
}
