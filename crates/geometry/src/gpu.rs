//! Twins of mesh operations on a device: what a fit needs, forward and vector-Jacobian product, as gathers.
//!
//! Buffers of vectors are packed, three samples a row, unless it says otherwise. Subnormal numbers may count as zero.

pub use crate::incidence::gpu::Lists;
pub use crate::normals::gpu::VertexNormals;
pub use crate::tangents::gpu::VertexTangents;
pub use crate::weld::gpu::{expand, expand_vjp};

use photofit_gpu::Kernel;

/// All kernels of this crate.
pub const KERNELS: &[Kernel] = &[
    crate::weld::gpu::EXPAND,
    crate::weld::gpu::EXPAND_VJP,
    crate::normals::gpu::FORWARD,
    crate::normals::gpu::VJP_SUMS,
    crate::normals::gpu::VJP,
    crate::tangents::gpu::FORWARD,
    crate::tangents::gpu::VJP_SUMS,
    crate::tangents::gpu::VJP,
];

#[cfg(test)]
mod tests;
