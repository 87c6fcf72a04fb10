//! Image losses on a device: value and gradient of pictures of four channels.

mod similarity;

use super::Loss;
use super::ssim::RADIUS;
use photofit_gpu::{Buffer, Gpu, GpuError, INDEX, Kernel, Recorder, Recording, Slot};
pub(crate) use similarity::KERNELS as SIMILARITY;
use similarity::{Planes, SimilarityParams};
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
    /// Pixels that count: from one up to another.
    from: u32,
    to: u32,
    pad: [u32; 2],
}

/// The rows that are drawn of a picture, and those of them that count: the rows around those are what filters and windows
/// reach. Values and gradients of parts that count each row once add up to those of the picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    /// Columns and rows that are drawn.
    pub size: [usize; 2],
    /// Which of the drawn rows count.
    pub counted: Range<usize>,
    /// Rows of the whole picture.
    pub rows: usize,
}

impl Part {
    /// Drawn rows on either side of those that count, where the picture has them, that any loss reaches.
    pub const REACH: usize = RADIUS;

    /// A whole picture of some columns and rows.
    pub fn whole([width, height]: [usize; 2]) -> Self {
        Self { size: [width, height], counted: 0..height, rows: height }
    }
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
    /// Number of the kernel that sums terms of one sample each; `None` for a loss with a window.
    fn kind(&self) -> Option<u32> {
        match self.loss {
            Loss::LogSrgbL1 => Some(0),
            Loss::LogSrgbL2 => Some(1),
            Loss::Mse => Some(2),
            Loss::Smape => Some(3),
            Loss::RelativeL2 => Some(4),
            Loss::Ssim => None,
        }
    }

    /// The parameters for a part of a picture.
    fn params(&self, part: &Part, weighted: bool, place: usize) -> LossParams {
        let Range { start, end } = self.read;
        assert!(start < end && end <= 4, "a range of existing channels");
        let Part { size: [width, height], counted, rows } = part;
        assert!(counted.start <= counted.end && counted.end <= *height, "rows that are drawn count");
        let (pixels, whole) = (width * height, width * rows);
        LossParams {
            pixels: pixels as u32,
            kind: self.kind().unwrap_or_default(),
            first: start as u32,
            end: end as u32,
            scale: (self.factor / (whole.max(1) * (end - start)) as f64) as f32,
            weighted: u32::from(weighted),
            accumulates: u32::from(self.accumulates),
            place: place as u32,
            from: (counted.start * width) as u32,
            to: (counted.end * width) as u32,
            pad: [0; 2],
        }
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
    planes: Option<Planes>,
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
            planes: None,
        })
    }

    /// The same with what a loss needs besides, for pictures of at most `pixels` pixels.
    ///
    /// # Errors
    /// If the device cannot hold a buffer.
    pub fn serving(mut self, gpu: &Gpu, loss: Loss, pixels: usize) -> Result<Self, GpuError> {
        if loss == Loss::Ssim && self.planes.as_ref().is_none_or(|p| p.pixels() < pixels) {
            self.planes = Some(Planes::new(gpu, pixels)?);
        }
        Ok(self)
    }
}

/// A recorded loss, whose parameters can be changed.
#[derive(Clone, Debug)]
pub struct RecordedLoss {
    /// Those that take [`LossParams`], and those that take [`SimilarityParams`].
    slots: Vec<Slot>,
    window: Vec<Slot>,
    weighted: bool,
    place: usize,
}

impl RecordedLoss {
    /// Sets the loss and the part of a picture for the next run.
    ///
    /// # Panics
    /// If the channels do not exist, or it was recorded for [`Loss::Ssim`] and that is another loss, or the other way round.
    pub fn set(&self, recording: &mut Recording, term: &Term, part: &Part) {
        assert_eq!(term.kind().is_none(), !self.window.is_empty(), "a loss of the kind that was recorded");
        let params = term.params(part, self.weighted, self.place);
        self.slots.iter().for_each(|slot| recording.set(*slot, &params));
        let params = SimilarityParams::new(&params, part.size);
        self.window.iter().for_each(|slot| recording.set(*slot, &params));
    }
}

/// Records [`Loss::value_and_gradient`] of `x` against `buffers.reference`, for at most `pixels` pixels: `gradient` and
/// `buffers.values[place]`.
///
/// # Errors
/// If a dispatch does not fit.
///
/// # Panics
/// If the channels do not exist, or the buffers do not serve the loss ([`LossBuffers::serving`]).
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
    let params = term.params(&Part::whole([pixels, 1]), weighted, place);
    let LossBuffers { reference, weights, values, partial, planes } = buffers;
    let (mut slots, mut window) = (Vec::new(), Vec::new());
    if term.kind().is_some() {
        let bound = [x.bind(), reference.bind(), weights.bind(), gradient.bind(), partial.bind()];
        slots.push(r.dispatch(&TERMS, &params, &bound, pixels)?);
    } else {
        let planes = planes.as_ref().expect("buffers that serve the loss");
        let params = SimilarityParams::new(&params, [pixels, 1]);
        window = planes.record(r, &params, [x, reference, gradient], [weights, partial], pixels)?;
    }
    slots.push(r.dispatch(&FINISH, &params, &[partial.bind(), values.bind()], LANES)?);
    Ok(RecordedLoss { slots, window, weighted, place })
}

#[cfg(test)]
mod tests;
