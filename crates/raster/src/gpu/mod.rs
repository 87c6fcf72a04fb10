//! Pictures that stay on a device: the twins of [`crate::deferred`].
//!
//! A picture is recorded once, for the largest size that it will have, and run again and again with other parameters:
//! [`render`] and [`render_vjp`] put the kernels of all operations into a recording, in the order of the CPU's; what gives
//! fragments their colours is a [`Shading`]. [`draw`] is for pictures without gradients.

mod buffers;
mod frame;
mod params;
mod shading;
mod steps;

pub use crate::rasterize::gpu::BinBuffers;
pub use buffers::{
    GradientBuffers, LayerBuffers, MeshBuffers, PictureBuffers, TriangleSurface, VERTEX_SUMS, vertex_sum,
};
pub use frame::{draw, render, render_vjp};
pub use params::{FrameParams, Shot};
pub use shading::{Shading, ShadingVjp, Work};
pub use steps::{Slots, Steps};

use crate::{antialias, deferred, deferred::composite, loss, project, rasterize};
use photofit_gpu::Kernel;

/// Parameters of all kernels of a picture, and the numbers of its samples.
pub(crate) const FRAME: &str = include_str!("frame.wgsl");

/// The kernels of this crate.
pub const KERNELS: &[Kernel] = &[
    project::gpu::PROJECT,
    project::gpu::GATHER,
    rasterize::gpu::BIN,
    rasterize::gpu::EMPTY,
    rasterize::gpu::COUNT,
    rasterize::gpu::SMALL,
    rasterize::gpu::MEDIUM,
    rasterize::gpu::LARGE,
    antialias::gpu::FOLD,
    antialias::gpu::SILHOUETTES,
    antialias::gpu::BLEND,
    antialias::gpu::REVERSE,
    deferred::gpu::KERNELS[0],
    deferred::gpu::KERNELS[1],
    deferred::gpu::KERNELS[2],
    deferred::gpu::KERNELS[3],
    deferred::gpu::KERNELS[4],
    deferred::gpu::KERNELS[5],
    deferred::gpu::KERNELS[6],
    deferred::gpu::KERNELS[7],
    deferred::gpu::KERNELS[8],
    composite::BLEND,
    composite::BLEND_VJP,
    composite::TRANSPARENT_PART,
    composite::AVERAGE,
    composite::MAGNIFY,
    composite::LAY_BEHIND,
    composite::RESOLVE,
    loss::gpu::TERMS,
    loss::gpu::FINISH,
    loss::gpu::SIMILARITY[0],
    loss::gpu::SIMILARITY[1],
    loss::gpu::SIMILARITY[2],
    loss::gpu::SIMILARITY[3],
    loss::gpu::SIMILARITY[4],
];

#[cfg(test)]
pub(crate) mod tests;
#[cfg(test)]
pub(crate) mod tolerances;
