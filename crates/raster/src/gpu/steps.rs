//! Recording kernels that share the parameters of a picture, and changing these parameters later.

use super::params::FrameParams;
use super::shading::Work;
use photofit_gpu::{Bind, GpuError, Kernel, Recorder, Recording, Slot};

/// A kernel in a recording, and the parameters that are its own.
#[derive(Clone, Copy, Debug)]
struct Step {
    slot: Slot,
    layer: u32,
    mode: u32,
}

/// The kernels of a picture in a recording.
#[derive(Clone, Debug)]
pub struct Slots {
    steps: Vec<Step>,
    largest: FrameParams,
}

impl Slots {
    /// Sets the parameters of all kernels for the next run.
    ///
    /// # Panics
    /// If the picture has more samples or pixels than the one that was recorded, or several samples per pixel where that
    /// one has not.
    pub fn set(&self, recording: &mut Recording, params: &FrameParams) {
        let (now, most) = (params, &self.largest);
        assert!(now.samples() <= most.samples() && now.pixels() <= most.pixels(), "room for the picture");
        assert!(now.side == 1 || most.side > 1, "recorded with several samples per pixel");
        assert_eq!(
            [now.vertices, now.triangles],
            [most.vertices, most.triangles],
            "the mesh that was recorded"
        );
        for s in &self.steps {
            recording.set(s.slot, &FrameParams { layer: s.layer, mode: s.mode, ..*params });
        }
    }
}

/// Adds kernels to a recording.
#[derive(Debug)]
pub struct Steps<'a> {
    /// The recording.
    pub recorder: &'a mut Recorder,
    params: FrameParams,
    steps: Vec<Step>,
}

impl<'a> Steps<'a> {
    /// Begins with the parameters of the largest picture.
    pub fn new(recorder: &'a mut Recorder, params: &FrameParams) -> Self {
        Self { recorder, params: *params, steps: Vec::new() }
    }

    /// The parameters.
    pub fn params(&self) -> &FrameParams {
        &self.params
    }

    /// Samples of the largest picture.
    pub fn samples(&self) -> usize {
        self.params.samples()
    }

    /// Pixels of the largest picture.
    pub fn pixels(&self) -> usize {
        self.params.pixels()
    }

    /// Adds a kernel of a layer.
    pub(crate) fn dispatch(
        &mut self,
        kernel: &Kernel,
        layer: usize,
        mode: u32,
        buffers: &[Bind],
        work: Work<'_>,
    ) -> Result<(), GpuError> {
        let params = FrameParams { layer: layer as u32, mode, ..self.params };
        let slot = work.dispatch(self.recorder, kernel, &params, buffers)?;
        self.steps.push(Step { slot, layer: params.layer, mode });
        Ok(())
    }

    /// The kernels that were added.
    pub fn finish(self) -> Slots {
        Slots { steps: self.steps, largest: self.params }
    }
}
