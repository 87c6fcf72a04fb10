//! Vertex tangents on a device.

use super::UvFrames;
use crate::angle::ANGLE;
use crate::incidence::gpu::{LISTS, Lists};
use photofit_gpu::{Buffer, Gpu, GpuError, INDEX, Kernel, Recorder};

const SOURCE: &[&str] = &[INDEX, LISTS, ANGLE, include_str!("tangents.wgsl")];
pub(crate) const FORWARD: Kernel = Kernel { name: "tangents", source: SOURCE, entry: "forward" };
pub(crate) const VJP_SUMS: Kernel = Kernel { name: "tangents.vjp_sums", source: SOURCE, entry: "vjp_sums" };
pub(crate) const VJP: Kernel = Kernel { name: "tangents.vjp", source: SOURCE, entry: "vjp" };

/// [`vertex_tangents`](super::vertex_tangents) and its adjoint.
#[derive(Clone, Debug)]
pub struct VertexTangents {
    lists: Lists,
    frames: Buffer<f32>,
    d_sums: Buffer<f32>,
}

impl VertexTangents {
    /// For the topology of `lists` and the frames of its uvs.
    ///
    /// # Errors
    /// If the device cannot hold them.
    ///
    /// # Panics
    /// When `frames` was made for another topology.
    pub fn new(gpu: &Gpu, lists: &Lists, frames: &UvFrames) -> Result<Self, GpuError> {
        assert_eq!(frames.faces.len(), lists.params.triangles as usize, "frames of the same triangles");
        assert_eq!(frames.handedness.len(), lists.welds(), "frames of the same weld");
        let faces = frames.faces.iter().flat_map(|f| [f.edges[0], f.edges[1], f32::from(f.handedness)]);
        let all: Vec<f32> = faces.chain(frames.handedness.iter().map(|h| f32::from(*h))).collect();
        Ok(Self {
            lists: lists.clone(),
            frames: gpu.upload("uv frames", &all)?,
            d_sums: gpu.zeros("gradients of sums of tangents", 3 * lists.welds())?,
        })
    }

    /// Writes `tangents` (rows of four samples) from `positions` and unit `normals`, one of each per vertex.
    ///
    /// # Errors
    /// If the device refuses a kernel.
    pub fn forward(
        &self,
        r: &mut Recorder,
        positions: &Buffer<f32>,
        normals: &Buffer<f32>,
        tangents: &Buffer<[f32; 4]>,
    ) -> Result<(), GpuError> {
        let Self { lists, frames, .. } = self;
        let buffers = [lists.bind(), positions.bind(), normals.bind(), frames.bind(), tangents.bind()];
        r.dispatch(&FORWARD, &lists.params, &buffers, lists.vertices())?;
        Ok(())
    }

    /// Adds to `d_positions` and `d_normals` the gradient of `sum_v d_tangents[v] . tangents[v].xyz`. The rows of
    /// `d_tangents` have three samples.
    ///
    /// # Errors
    /// If the device refuses a kernel.
    pub fn vjp(
        &self,
        r: &mut Recorder,
        positions: &Buffer<f32>,
        normals: &Buffer<f32>,
        d_tangents: &Buffer<f32>,
        d_positions: &Buffer<f32>,
        d_normals: &Buffer<f32>,
    ) -> Result<(), GpuError> {
        let Self { lists, frames, d_sums } = self;
        let [topology, positions, normals, frames, d_sums] =
            [lists.bind(), positions.bind(), normals.bind(), frames.bind(), d_sums.bind()];
        let common = [topology, positions, normals, frames];
        let buffers = [&common[..], &[d_tangents.bind(), d_sums.clone()]].concat();
        r.dispatch(&VJP_SUMS, &lists.params, &buffers, lists.welds())?;
        let buffers = [&common[..], &[d_sums, d_positions.bind(), d_normals.bind()]].concat();
        r.dispatch(&VJP, &lists.params, &buffers, lists.vertices())?;
        Ok(())
    }
}
