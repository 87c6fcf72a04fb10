//! Mesh operations with gradients, decimation and atlas.
//!
//! Meshes are indexed triangles ([`Mesh`]). Topology is taken on welded positions ([`weld`]), so that uv seams and hard
//! edges do not open the surface; [`adjacency`] finds edges, neighbours and one-rings; [`Incidence`] holds the gather
//! lists on which [`normals`] and [`tangents`] (forward and vector-Jacobian product) run deterministically for any
//! number of threads; [`skinning`] poses their results. With the feature `gpu` these have twins on a device.

mod angle;
mod error;
mod incidence;
mod mesh;
mod opposed;
mod split;

pub mod adjacency;
pub mod atlas;
pub mod csr;
pub mod decimate;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod laplacian;
pub mod normals;
pub mod shapes;
pub mod skinning;
pub mod subdivide;
pub mod tangents;
mod vertex_fit;
pub mod weld;

pub use adjacency::{Edges, NONE};
pub use csr::{Csr, CsrMatrix};
pub use error::{GeometryError, check_triangles};
pub use incidence::Incidence;
pub use mesh::Mesh;
pub use opposed::opposed;
pub use split::Split;
pub use vertex_fit::VertexFit;
pub use weld::Weld;
