//! Diffusion over the edges of a mesh by a cached sparse Cholesky factorisation, and the filters made from it.

mod edge_aware;
mod large_steps;
mod sampled_normals;
mod screened;
mod solve;

pub use edge_aware::EdgeAware;
pub use large_steps::LargeSteps;
pub use sampled_normals::{SampledNormals, SampledNormalsConfig};

#[cfg(test)]
mod tests;
