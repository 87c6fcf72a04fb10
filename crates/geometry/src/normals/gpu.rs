//! Vertex normals weighted by angles, on a device.

use crate::angle::ANGLE;
use crate::incidence::gpu::{LISTS, Lists};
use photofit_gpu::{Buffer, Gpu, GpuError, INDEX, Kernel, Recorder};

const SOURCE: &[&str] = &[INDEX, LISTS, ANGLE, include_str!("normals.wgsl")];
pub(crate) const FORWARD: Kernel = Kernel { name: "normals", source: SOURCE, entry: "forward" };
pub(crate) const VJP_SUMS: Kernel = Kernel { name: "normals.vjp_sums", source: SOURCE, entry: "vjp_sums" };
pub(crate) const VJP: Kernel = Kernel { name: "normals.vjp", source: SOURCE, entry: "vjp" };

/// [`vertex_normals`](super::vertex_normals) with [`Weighting::Angle`](super::Weighting::Angle) and its adjoint.
#[derive(Clone, Debug)]
pub struct VertexNormals {
    lists: Lists,
    d_sums: Buffer<f32>,
}

impl VertexNormals {
    /// For the topology of `lists`.
    ///
    /// # Errors
    /// If the device cannot hold the scratch.
    pub fn new(gpu: &Gpu, lists: &Lists) -> Result<Self, GpuError> {
        let d_sums = gpu.zeros("gradients of sums of normals", 3 * lists.welds())?;
        Ok(Self { lists: lists.clone(), d_sums })
    }

    /// Writes `normals` from `positions`, one of each per vertex.
    ///
    /// # Errors
    /// If the device refuses a kernel.
    pub fn forward(
        &self,
        r: &mut Recorder,
        positions: &Buffer<f32>,
        normals: &Buffer<f32>,
    ) -> Result<(), GpuError> {
        let buffers = [self.lists.bind(), positions.bind(), normals.bind()];
        r.dispatch(&FORWARD, &self.lists.params, &buffers, self.lists.vertices())?;
        Ok(())
    }

    /// Adds to `d_positions` the gradient of `sum_v d_normals[v] . normals[v]`.
    ///
    /// # Errors
    /// If the device refuses a kernel.
    pub fn vjp(
        &self,
        r: &mut Recorder,
        positions: &Buffer<f32>,
        d_normals: &Buffer<f32>,
        d_positions: &Buffer<f32>,
    ) -> Result<(), GpuError> {
        let Self { lists, d_sums } = self;
        let buffers = [lists.bind(), positions.bind(), d_normals.bind(), d_sums.bind()];
        r.dispatch(&VJP_SUMS, &lists.params, &buffers, lists.welds())?;
        let buffers = [lists.bind(), positions.bind(), d_sums.bind(), d_positions.bind()];
        r.dispatch(&VJP, &lists.params, &buffers, lists.vertices())?;
        Ok(())
    }
}
