//! Ray hierarchies: closest hit, occlusion, all hits along a ray, and closest point on a triangle mesh; the zero level of a
//! grid of signed distances.
//!
//! ```
//! use photofit_rays::{Accel, Ray};
//! use photofit_scalar::vec3;
//! let positions = [vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0)];
//! let accel = Accel::build(&positions, &[[0, 1, 2]])?;
//! let hit = accel.closest_hit(&Ray::new(vec3(0.25, 0.5, 2.0), vec3(0.0, 0.0, -1.0))).expect("aims at the triangle");
//! assert!((hit.t - 2.0).abs() < 1e-6 && (hit.u - 0.25).abs() < 1e-6 && (hit.v - 0.5).abs() < 1e-6 && hit.front);
//! # Ok::<(), photofit_rays::AccelError>(())
//! ```
//!
//! A binary tree, split by the surface area heuristic (`binary`) or clustered by obvhs (`ploc`), is collapsed to eight children a node with their
//! boxes side by side (`wide`); each leaf is one packet of at most four triangles (`triangle`), so that every step of a
//! traversal (`walk`) is a handful of vector instructions. Trees over boxes are built by obvhs (`boxes`).
//!
//! - Where the machine has AVX2, a step takes vectors of eight numbers, elsewhere two of four (`width`): the same
//!   operations, hence the same bits.
//! - The triangle test is watertight (Woop, Benthin, Wald 2013, "Watertight Ray/Triangle Intersection", JCGT 2(1)):
//!   a ray that crosses a closed surface at a shared edge or vertex hits at least one of the triangles there. The box
//!   test is widened by more than the rounding of the triangle test, so that the tree never loses such a hit.
//! - Along each axis on which all of the geometry is far from 0 it is moved to the middle of its box, and all is scaled by a
//!   power of two to unit size, so that no digit of a coordinate is lost: an offset of 1e6, a scale of 1e-6 or a far part costs
//!   no accuracy beyond that of the coordinates.
//! - Equal distances are resolved to the lower triangle index: the answer does not depend on the shape of the tree.

mod binary;
mod boxes;
mod buffer;
mod build;
mod distance_grid;
mod nearest;
mod ploc;
mod stack;
mod traverse;
mod triangle;
mod walk;
mod wide;
mod width;

#[cfg(test)]
mod tests;

use photofit_scalar::Vec3f;

pub use boxes::{BoxRay, BoxTree, FrameRay};
pub use build::exact_center;
pub use distance_grid::{DistanceGrid, DistanceGridError, DistanceHit};
pub use nearest::NearestPoint;
pub use traverse::Ray;

/// Largest coordinate that [`Accel::build`] accepts.
pub const MAX_COORDINATE: f32 = 1e18;

/// Why an acceleration structure cannot be built.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AccelError {
    /// A vertex with NaN or infinity.
    #[error("vertex {vertex}: position is not finite")]
    NonFinite {
        /// Index of the vertex.
        vertex: usize,
    },
    /// A vertex beyond [`MAX_COORDINATE`].
    #[error("vertex {vertex}: a coordinate exceeds 1e18")]
    TooFar {
        /// Index of the vertex.
        vertex: usize,
    },
    /// A triangle that names no vertex.
    #[error("triangle {triangle}: vertex index {index} is out of range, there are {vertices} vertices")]
    Index {
        /// Index of the triangle.
        triangle: usize,
        /// The offending vertex index.
        index: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// More than 2^30 triangles.
    #[error("{triangles} triangles: at most 2^30 are supported")]
    TooMany {
        /// Number of triangles.
        triangles: usize,
    },
}

/// How the binary tree under the eight-wide one is built; answers are the same with each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Builder {
    /// From the top, by the surface area heuristic over bins.
    #[default]
    Binned,
    /// By obvhs: parallel locally-ordered clustering. Trees that become too deep are built as [`Self::Binned`].
    Clustered,
    /// As [`Self::Clustered`], improved by reinsertion.
    Reinserted,
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray, in lengths of its direction.
    pub t: f32,
    /// Index of the triangle.
    pub triangle: u32,
    /// Barycentric weight of the second vertex.
    pub u: f32,
    /// Barycentric weight of the third vertex.
    pub v: f32,
    /// True when the ray meets the counter-clockwise side.
    pub front: bool,
}

/// A triangle mesh prepared for ray casting.
#[derive(Clone, Debug)]
pub struct Accel {
    /// Nodes of the tree, the root first; empty without triangles.
    nodes: buffer::Buffer<wide::Node>,
    /// The leaves.
    packets: buffer::Buffer<triangle::Packet>,
    /// Subtracted from everything: the centre of the geometry along axes on which it is far from 0.
    center: [f64; 3],
    /// Power of two that brings the geometry to about unit size.
    scale: f64,
    /// The inverse of `scale`.
    back: f32,
    /// Largest absolute coordinate after moving and scaling.
    extent: f32,
    triangles: usize,
}

impl Accel {
    /// Builds the structure over `triangles` that index `positions`.
    ///
    /// Degenerate triangles are allowed (they are never hit, but count for [`Self::closest_point`]); vertices that no
    /// triangle names are ignored.
    ///
    /// # Errors
    /// A named vertex that is not finite or has a coordinate above [`MAX_COORDINATE`], a triangle with an index out of
    /// range, or more than 2^30 triangles.
    pub fn build(positions: &[Vec3f], triangles: &[[u32; 3]]) -> Result<Self, AccelError> {
        Self::build_with(positions, triangles, Builder::default())
    }

    /// As [`Self::build`], with a given builder.
    ///
    /// # Errors
    /// As [`Self::build`].
    pub fn build_with(
        positions: &[Vec3f],
        triangles: &[[u32; 3]],
        builder: Builder,
    ) -> Result<Self, AccelError> {
        build::build(positions, triangles, builder)
    }

    /// Nodes and leaves that a random line through the box of the mesh is expected to meet (the surface area heuristic): how
    /// good the tree is, the lower the better. Not numbers without triangles.
    pub fn cost(&self) -> [f64; 2] {
        let mut met = [0.0; 2];
        for (child, area) in self.nodes.iter().flat_map(wide::Node::children) {
            met[usize::from(child & wide::LEAF != 0)] += f64::from(area);
        }
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let [lo, hi] = self.nodes.first().map_or([0.0; 2], |root| root.range(axis));
            f64::from(hi - lo)
        });
        let whole = x * y + y * z + z * x;
        [1.0 + met[0] / whole, met[1] / whole]
    }

    /// Number of triangles.
    pub fn triangles(&self) -> usize {
        self.triangles
    }

    /// A point in the structure's own frame.
    #[inline(always)]
    fn local(&self, p: Vec3f) -> glam::Vec3 {
        glam::vec3(
            ((f64::from(p.x) - self.center[0]) * self.scale) as f32,
            ((f64::from(p.y) - self.center[1]) * self.scale) as f32,
            ((f64::from(p.z) - self.center[2]) * self.scale) as f32,
        )
    }
}
