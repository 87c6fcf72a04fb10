//! Mesh operations with gradients, decimation and atlas.

mod mesh;

pub use mesh::Mesh;
