//! Image losses on a device: value and gradient of the losses that are a sum of terms of one sample each, of pictures of
//! four channels.

use super::Loss;
use photofit_gpu::{Buffer, Gpu, GpuError, INDEX, Kernel, Recorder, Recording, Slot};
use std::ops::Range;

const SOURCE: &[&str] = &[INDEX, include_str!("curve.wgsl"), include_str!("pointwise.wgsl")];

/// Terms, their gradients, and their sums by workgroups.
pub(crate) const TERMS: Kernel = Kernel { name: "loss", source: SOURCE, entry: "terms" };
/// The sum of these sums.
pub(crate) const FINISH: Kernel = Kernel { name: "loss_sum", source: SOURCE, entry: "finish" };

/// Lanes of a workgroup.
const LANES: usize = 256;

/// Parameters of a loss (`pointwise.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
struct LossParams {
    pixels: u32,
    kind: u32,
    first: u32,
    end: u32,
    scale: f32,
    weighted: u32,
    accumulates: u32,
    place: u32,
}

/// A loss of pictures of four channels.
#[derive(Clone, Debug, PartialEq)]
pub struct Term {
    /// Which loss.
    pub loss: Loss,
    /// Channels that are read.
    pub read: Range<usize>,
    /// What value and gradient are multiplied by.
    pub factor: f64,
    /// Adds to the gradient and the value; else they are overwritten.
    pub accumulates: bool,
}

impl Term {
    /// The parameters for a picture of some pixels; `None` for a loss that has no twin.
    fn params(&self, pixels: usize, weighted: bool, place: usize) -> Option<LossParams> {
        let Range { start, end } = self.read;
        assert!(start < end && end <= 4, "a range of existing channels");
        let kind = match self.loss {
            Loss::LogSrgbL1 => 0,
            Loss::LogSrgbL2 => 1,
            Loss::Mse => 2,
            Loss::Smape => 3,
            Loss::RelativeL2 => 4,
            Loss::Ssim => return None,
        };
        Some(LossParams {
            pixels: pixels as u32,
            kind,
            first: start as u32,
            end: end as u32,
            scale: (self.factor / (pixels.max(1) * (end - start)) as f64) as f32,
            weighted: u32::from(weighted),
            accumulates: u32::from(self.accumulates),
            place: place as u32,
        })
    }
}

/// Buffers of a loss.
#[derive(Clone, Debug)]
pub struct LossBuffers {
    /// What the candidate is compared with, one per pixel.
    pub reference: Buffer<[f32; 4]>,
    /// Weights of the pixels; empty: all count alike.
    pub weights: Buffer<f32>,
    /// Values, one per place.
    pub values: Buffer<f32>,
    partial: Buffer<f32>,
}

impl LossBuffers {
    /// Room for pictures of at most `pixels` pixels, with weights if wanted, and for the values of `places` pictures.
    ///
    /// # Errors
    /// If the device cannot hold a buffer.
    pub fn new(gpu: &Gpu, pixels: usize, weighted: bool, places: usize) -> Result<Self, GpuError> {
        Ok(Self {
            reference: gpu.zeros("reference", pixels)?,
            weights: gpu.zeros("weights", if weighted { pixels } else { 0 })?,
            values: gpu.zeros("losses", places)?,
            partial: gpu.zeros("partial losses", pixels.div_ceil(LANES))?,
        })
    }
}

/// A recorded loss, whose parameters can be changed.
#[derive(Clone, Debug)]
pub struct RecordedLoss {
    slots: [Slot; 2],
    weighted: bool,
    place: usize,
}

impl RecordedLoss {
    /// Sets the loss and the number of pixels for the next run.
    ///
    /// # Panics
    /// If the channels do not exist, or the loss has no twin.
    pub fn set(&self, recording: &mut Recording, term: &Term, pixels: usize) {
        let params = term.params(pixels, self.weighted, self.place).expect("the loss has a twin");
        self.slots.iter().for_each(|slot| recording.set(*slot, &params));
    }
}

/// Records [`Loss::value_and_gradient`] of `x` against `buffers.reference`, for at most `pixels` pixels: `gradient` and
/// `buffers.values[place]`.
///
/// # Errors
/// If the loss has no twin ([`Loss::Ssim`]), or a dispatch does not fit.
///
/// # Panics
/// If the channels do not exist.
pub fn value_and_gradient(
    r: &mut Recorder,
    term: &Term,
    pixels: usize,
    x: &Buffer<[f32; 4]>,
    buffers: &LossBuffers,
    gradient: &Buffer<[f32; 4]>,
    place: usize,
) -> Result<RecordedLoss, GpuError> {
    let weighted = !buffers.weights.is_empty();
    let params = term.params(pixels, weighted, place).ok_or_else(|| GpuError::Dispatch {
        kernel: TERMS.name.into(),
        rule: format!("{:?} runs on the CPU only", term.loss),
    })?;
    let LossBuffers { reference, weights, values, partial } = buffers;
    let bound = [x.bind(), reference.bind(), weights.bind(), gradient.bind(), partial.bind()];
    let terms = r.dispatch(&TERMS, &params, &bound, pixels)?;
    let sum = r.dispatch(&FINISH, &params, &[partial.bind(), values.bind()], LANES)?;
    Ok(RecordedLoss { slots: [terms, sum], weighted, place })
}

#[cfg(test)]
mod tests;
