//! What this crate has on a device: its kernels, and the tests of them against the CPU.
//!
//! Kernels and what records them stand beside the operations: the linear step in `transform`, the splitting in `admm`, the way
//! back from logarithms and the scores of strengths in `mc`.

use crate::{admm, mc, transform};
use photofit_gpu::{Buffer, Gpu, GpuError, Kernel};

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
    mc::gpu::SCORE,
];

/// A buffer of a length with whatever is in it: a former one of that length, or a new one.
pub(crate) fn room<T: bytemuck::Pod>(
    gpu: &Gpu,
    former: Option<&Buffer<T>>,
    name: &str,
    len: usize,
) -> Result<Buffer<T>, GpuError> {
    match former.filter(|b| b.len() == len) {
        Some(former) => Ok(former.clone()),
        None => gpu.zeros(name, len),
    }
}

/// A buffer with elements: a former one of that length, or a new one.
pub(crate) fn filled<T: bytemuck::Pod>(
    gpu: &Gpu,
    former: Option<&Buffer<T>>,
    name: &str,
    elements: &[T],
) -> Result<Buffer<T>, GpuError> {
    match former.filter(|b| b.len() == elements.len()) {
        Some(former) => gpu.write(former, elements).map(|()| former.clone()),
        None => gpu.upload(name, elements),
    }
}

#[cfg(test)]
mod tests;
