//! A tree over boxes, and rays in the frame of a structure: the parts of a two-level traversal.

use super::binary::{Binary, Set};
use super::buffer::Buffer;
use super::traverse::Local;
use super::walk::{PAD, Slabs};
use super::wide::{self, Node};
#[cfg(target_arch = "x86_64")]
use super::width::Avx2;
use super::width::{Portable, Width};
use super::{Accel, Hit};
use glam::{DAffine3, DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use photofit_scalar::Vec3f;

/// A tree over axis-aligned boxes: which of many structures a ray may meet.
#[derive(Clone, Debug, Default)]
pub struct BoxTree {
    nodes: Vec<Node>,
    /// Largest absolute coordinate.
    extent: f32,
}

impl BoxTree {
    /// Builds the tree over boxes, given by their lower and upper corners, which are finite.
    pub fn build(boxes: &[[DVec3; 2]]) -> Self {
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
        let set = |node: &Bvh2Node| Set {
            lo: node.aabb().min.to_array(),
            hi: node.aabb().max.to_array(),
            first: node.first_index,
            count: if node.is_leaf() { 1 } else { u32::MAX },
        };
        // The children of a node follow one another, at the index that it names.
        let halves =
            Buffer::from_fn(tree.nodes.len() - 1, |i| [set(&tree.nodes[i]), set(&tree.nodes[i + 1])]);
        let binary = Binary { root: set(&tree.nodes[0]), halves };
        let wide = wide::collapse(&binary);
        let entry = |leaf: usize| tree.primitive_indices[wide.leaves[leaf].first as usize];
        Self { nodes: wide.nodes.into_iter().map(|node| node.with_leaves(entry)).collect(), extent }
    }

    /// Visits the boxes that the ray passes before `limit`, near ones first; `visit` gets the index of the box and the
    /// limit so far and returns the new limit, or ends the walk.
    #[inline(always)]
    pub fn walk(&self, ray: &BoxRay, limit: f32, visit: impl FnMut(u32, f32) -> Option<f32>) {
        #[cfg(target_arch = "x86_64")]
        if let Some(width) = Avx2::detect() {
            return self.walk_with(width, ray, limit, visit);
        }
        self.walk_with(Portable, ray, limit, visit);
    }

    /// [`Self::walk`] with given instructions.
    #[inline(always)]
    pub(crate) fn walk_with(
        &self,
        width: impl Width,
        ray: &BoxRay,
        limit: f32,
        visit: impl FnMut(u32, f32) -> Option<f32>,
    ) {
        if !self.nodes.is_empty() {
            width.walk_near::<()>(&self.nodes, &[], &ray.0, limit.min(f32::MAX), visit);
        }
    }

    /// Bytes of the nodes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.nodes.as_slice())
    }
}

/// A ray for a [`BoxTree`].
#[derive(Debug)]
pub struct BoxRay(Slabs);

impl BoxRay {
    /// `direction` is finite and not zero.
    #[inline(always)]
    pub fn new(tree: &BoxTree, origin: Vec3f, direction: Vec3f) -> Self {
        let (o, d) = (Vec3A::from_array(origin.to_array()), Vec3A::from_array(direction.to_array()));
        let pad = (o.abs().max_element() + tree.extent) * PAD;
        Self(Slabs::new(o, d, d.abs().max_element(), pad, 0.0))
    }
}

/// A ray in an [`Accel`]'s own frame.
#[derive(Debug)]
pub struct FrameRay(Local);

impl FrameRay {
    /// `t` counts lengths of `direction`, from 0 to `t_max`.
    #[inline(always)]
    pub fn new(accel: &Accel, origin: Vec3, direction: Vec3, t_max: f32) -> Self {
        let t_max = t_max.min(f32::MAX);
        Self(Local::in_frame(accel, origin.into(), direction.into(), 0.0, t_max))
    }
}

impl Accel {
    /// From the frame of the positions to the frame of [`FrameRay`].
    pub fn frame(&self) -> DAffine3 {
        DAffine3::from_scale(DVec3::splat(self.scale))
            * DAffine3::from_translation(-DVec3::from_array(self.center))
    }

    /// The box of the triangles, in the frame of the positions.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        if let Some(root) = self.nodes.first() {
            for k in 0..3 {
                let [least, largest] = root.range(k).map(f64::from);
                lo[k] = least / self.scale + self.center[k];
                hi[k] = largest / self.scale + self.center[k];
            }
        }
        (lo, hi)
    }

    /// Memory of the nodes and the triangles, in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.nodes) + size_of_val(&*self.packets)
    }

    /// Calls `found` with hits and the limit so far; it returns the new limit, or ends the walk.
    #[inline(always)]
    pub fn candidates(&self, ray: &FrameRay, found: impl FnMut(Hit, f32) -> Option<f32>) {
        #[cfg(target_arch = "x86_64")]
        if let Some(width) = Avx2::detect() {
            return self.candidates_with(width, ray, found);
        }
        self.candidates_with(Portable, ray, found);
    }

    /// [`Self::candidates`] with given instructions.
    #[inline(always)]
    pub(crate) fn candidates_with(
        &self,
        width: impl Width,
        ray: &FrameRay,
        mut found: impl FnMut(Hit, f32) -> Option<f32>,
    ) {
        let mut limit = ray.0.t_max();
        self.traverse(width, &ray.0, |packet, hits| {
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
