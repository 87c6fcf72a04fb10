//! How a picture asks for the colours of its fragments.

use super::buffers::{GradientBuffers, LayerBuffers, MeshBuffers, PictureBuffers};
use photofit_gpu::{Bind, Buffer, GpuError, Kernel, Recorder, Slot};

/// How many invocations a kernel over the samples of a layer gets.
#[derive(Clone, Copy, Debug)]
pub enum Work<'a> {
    /// As many as the picture has room for; kernels compare with the size in their parameters.
    Threads(usize),
    /// The workgroups, of 64 lanes, whose numbers stand in a buffer from this element on: none if the layer is skipped.
    Groups(&'a Buffer<u32>, usize),
}

impl Work<'_> {
    /// Adds a kernel with workgroups of 64 lanes.
    ///
    /// # Errors
    /// As [`Recorder::dispatch`].
    pub fn dispatch<P: bytemuck::Pod>(
        self,
        r: &mut Recorder,
        kernel: &Kernel,
        params: &P,
        buffers: &[Bind],
    ) -> Result<Slot, GpuError> {
        match self {
            Self::Threads(n) => r.dispatch(kernel, params, buffers, n),
            Self::Groups(groups, at) => r.dispatch_indirect(kernel, params, buffers, groups, at),
        }
    }
}

/// What gives the fragments of a layer their colours. Implementations keep the slots of their parameters, to set them for
/// the next picture.
pub trait Shading {
    /// Records the shading of a layer: from `layer.triangle` and `picture.clip` to radiance and drawn alpha in
    /// `layer.shaded`, at least where there is a triangle.
    ///
    /// # Errors
    /// If a dispatch does not fit.
    fn record(
        &mut self,
        r: &mut Recorder,
        mesh: &MeshBuffers,
        picture: &PictureBuffers,
        layer: &LayerBuffers,
        work: Work<'_>,
    ) -> Result<(), GpuError>;
}

/// Shading with an adjoint.
pub trait ShadingVjp: Shading {
    /// Records the adjoint of [`Shading::record`]: from `g.shaded` to the sums of vertices in `g.sums` and to the gradients of what the
    /// implementation reads besides, accumulating.
    ///
    /// # Errors
    /// If a dispatch does not fit.
    fn record_vjp(
        &mut self,
        r: &mut Recorder,
        mesh: &MeshBuffers,
        picture: &PictureBuffers,
        layer: &LayerBuffers,
        g: &GradientBuffers,
        work: Work<'_>,
    ) -> Result<(), GpuError>;
}
