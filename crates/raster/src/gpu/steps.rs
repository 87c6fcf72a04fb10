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
#[derive(Clone, Debug, Default)]
pub struct Slots(Vec<Step>);

impl Slots {
    /// Sets the parameters of all kernels for the next run. The size of the picture must not exceed the one that was
    /// recorded.
    pub fn set(&self, recording: &mut Recording, params: &FrameParams) {
        for s in &self.0 {
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
    slots: Slots,
}

impl<'a> Steps<'a> {
    /// Begins with the parameters of the largest picture.
    pub fn new(recorder: &'a mut Recorder, params: &FrameParams) -> Self {
        Self { recorder, params: *params, slots: Slots::default() }
    }

    /// The parameters.
    pub fn params(&self) -> &FrameParams {
        &self.params
    }

    /// Samples of the largest picture.
    pub fn samples(&self) -> usize {
        self.params.width as usize * self.params.height as usize
    }

    /// Pixels of the largest picture.
    pub fn pixels(&self) -> usize {
        self.samples() / (self.params.side * self.params.side) as usize
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
        self.slots.0.push(Step { slot, layer: params.layer, mode });
        Ok(())
    }

    /// The kernels that were added.
    pub fn finish(self) -> Slots {
        self.slots
    }
}
