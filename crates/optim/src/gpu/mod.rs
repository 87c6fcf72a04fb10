//! The optimizers of a fit on a device: Adam with rates per column, Adam with one second moment for all entries, diffusion
//! over a mesh, and constraints.
//!
//! They do what [`Optimizer`](crate::Optimizer) does, in single precision: sums run in a fixed order, so that results are
//! bitwise the same from run to run on one device. A gradient that is not finite halts a [`DeviceOptimizer`] on the device;
//! [`DeviceOptimizer::check`] tells it.

mod constrain;
mod large_steps;
mod optimizer;

pub use constrain::constrain;
pub use large_steps::LargeStepsSolver;
pub use optimizer::{DeviceOptimizer, Recorded};

use photofit_gpu::Kernel;

/// Most samples of a row.
const COLUMNS: usize = 16;

/// Samples of a row as a kernel takes them.
type Columns = [f32; COLUMNS];

/// All kernels of this crate.
pub const KERNELS: &[Kernel] = &[
    optimizer::CHUNK,
    optimizer::OBSERVE,
    optimizer::DENSE,
    optimizer::ACCUMULATE,
    optimizer::FACTOR,
    optimizer::MOVE,
    large_steps::ITERATE,
    large_steps::ITERATE_WEIGHTED,
    large_steps::WEIGH,
    constrain::CONSTRAIN,
];

#[cfg(test)]
mod tests;
