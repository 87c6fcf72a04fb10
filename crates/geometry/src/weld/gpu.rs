//! [`Weld::expand`](super::Weld::expand) and its adjoint on a device.

use crate::incidence::gpu::{LISTS, Lists};
use photofit_gpu::{Buffer, GpuError, INDEX, Kernel, Recorder};

const SOURCE: &[&str] = &[INDEX, LISTS, include_str!("weld.wgsl")];
pub(crate) const EXPAND: Kernel = Kernel { name: "weld.expand", source: SOURCE, entry: "expand" };
pub(crate) const EXPAND_VJP: Kernel = Kernel { name: "weld.expand_vjp", source: SOURCE, entry: "expand_vjp" };

/// Copies welded vectors to the vertices.
///
/// # Errors
/// If the device refuses a kernel.
pub fn expand(
    r: &mut Recorder,
    lists: &Lists,
    welded: &Buffer<f32>,
    vertices: &Buffer<f32>,
) -> Result<(), GpuError> {
    r.dispatch(&EXPAND, &lists.params, &[lists.bind(), welded.bind(), vertices.bind()], lists.vertices())?;
    Ok(())
}

/// Adds to `d_welded` the sums of `d_vertices` over the vertices of each welded id, in ascending order.
///
/// # Errors
/// If the device refuses a kernel.
pub fn expand_vjp(
    r: &mut Recorder,
    lists: &Lists,
    d_vertices: &Buffer<f32>,
    d_welded: &Buffer<f32>,
) -> Result<(), GpuError> {
    let buffers = [lists.bind(), d_vertices.bind(), d_welded.bind()];
    r.dispatch(&EXPAND_VJP, &lists.params, &buffers, lists.welds())?;
    Ok(())
}
