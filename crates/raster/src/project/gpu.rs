//! Projection on a device.

use crate::gpu::{FRAME, GradientBuffers, MeshBuffers, PictureBuffers, Steps, Work};
use photofit_gpu::{FIXED_READ, GpuError, INDEX, Kernel};

const SOURCE: &[&str] = &[INDEX, FIXED_READ, FRAME, include_str!("project.wgsl")];

/// Positions to clip space.
pub(crate) const PROJECT: Kernel = Kernel { name: "project", source: SOURCE, entry: "forward" };
/// The adjoint, from sums to gradients.
pub(crate) const GATHER: Kernel = Kernel { name: "project_vjp", source: SOURCE, entry: "gather" };

/// Records [`super::project`]: `mesh.positions` to `picture.clip`.
///
/// # Errors
/// If a dispatch does not fit.
pub fn project(s: &mut Steps<'_>, mesh: &MeshBuffers, picture: &PictureBuffers) -> Result<(), GpuError> {
    let buffers = [mesh.positions.bind(), picture.clip.bind()];
    s.dispatch(&PROJECT, 0, 0, &buffers, Work::Threads(mesh.vertices()))
}

/// Records the end of a picture's reverse pass: adds the sums of vertices to the gradients, those of clip-space positions
/// by [`super::project_vjp`], and keeps in `g.status` whether a term was lost.
///
/// # Errors
/// If a dispatch does not fit.
pub fn gather(s: &mut Steps<'_>, mesh: &MeshBuffers, g: &GradientBuffers) -> Result<(), GpuError> {
    let buffers = [g.sums.bind(), g.positions.bind(), g.normals.bind(), g.tangents.bind(), g.status.bind()];
    s.dispatch(&GATHER, 0, 0, &buffers, Work::Threads(mesh.vertices()))
}

#[cfg(test)]
mod tests;
