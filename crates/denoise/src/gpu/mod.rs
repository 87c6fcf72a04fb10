//! What this crate has on a device: its kernels, and the tests of them against the CPU.
//!
//! Kernels and what records them stand beside the operations: the linear step in `transform`, the splitting in `admm`, the way
//! back from logarithms in `mc`.

use crate::{admm, mc, transform};
use photofit_gpu::Kernel;

/// All kernels of this crate.
pub const KERNELS: &[Kernel] = &[
    transform::gpu::SHORT_ROWS,
    transform::gpu::LONG_ROWS,
    transform::gpu::PART_ENDS,
    transform::gpu::SEPARATORS,
    transform::gpu::PART_INSIDES,
    admm::gpu::GRADIENT,
    admm::gpu::RIGHT_HAND_SIDES,
    admm::gpu::BEGIN,
    admm::gpu::UNPACK,
    mc::gpu::EXPONENTIAL,
    mc::gpu::MEAN_ROWS,
    mc::gpu::MEAN_COLUMNS,
];

#[cfg(test)]
mod tests;
