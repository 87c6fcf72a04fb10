//! Structural similarity on a device: the window along and across the rows, and the same in reverse.

use super::LossParams;
use crate::loss::ssim::{TAPS, taps};
use photofit_gpu::{Buffer, Gpu, GpuError, INDEX, Kernel, Recorder, Slot};

const SOURCE: &[&str] = &[INDEX, include_str!("../curve.wgsl"), include_str!("../ssim.wgsl")];

/// In the order in which they run.
pub(crate) const KERNELS: [Kernel; 5] = [
    Kernel { name: "ssim.tones", source: SOURCE, entry: "tones" },
    Kernel { name: "ssim.rows", source: SOURCE, entry: "rows" },
    Kernel { name: "ssim.similarity", source: SOURCE, entry: "similarity" },
    Kernel { name: "ssim.columns", source: SOURCE, entry: "columns" },
    Kernel { name: "ssim.collect", source: SOURCE, entry: "collect" },
];

/// Parameters of all of them (`ssim.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct SimilarityParams {
    size: [u32; 2],
    first: u32,
    end: u32,
    scale: f32,
    weighted: u32,
    accumulates: u32,
    from: u32,
    to: u32,
    pad: [u32; 3],
    taps: [f32; 12],
}

impl SimilarityParams {
    pub(super) fn new(loss: &LossParams, size: [usize; 2]) -> Self {
        let mut padded = [0.0; 12];
        padded[..TAPS].copy_from_slice(&taps().map(|t| t as f32));
        Self {
            size: size.map(|n| n as u32),
            first: loss.first,
            end: loss.end,
            scale: loss.scale,
            weighted: loss.weighted,
            accumulates: loss.accumulates,
            from: loss.from,
            to: loss.to,
            pad: [0; 3],
            taps: padded,
        }
    }
}

/// What is kept between the kernels.
#[derive(Clone, Debug)]
pub(super) struct Planes {
    /// Tone of the candidate, its slope, tone of the reference.
    tones: Buffer<[[f32; 4]; 3]>,
    /// Moments along the rows.
    rows: Buffer<[[f32; 4]; 5]>,
    /// Derivatives by the means under the window.
    derivatives: Buffer<[[f32; 4]; 3]>,
    /// The same filtered across the rows.
    columns: Buffer<[[f32; 4]; 3]>,
}

impl Planes {
    pub(super) fn new(gpu: &Gpu, pixels: usize) -> Result<Self, GpuError> {
        Ok(Self {
            tones: gpu.zeros("tones", pixels)?,
            rows: gpu.zeros("moments along rows", pixels)?,
            derivatives: gpu.zeros("derivatives of similarity", pixels)?,
            columns: gpu.zeros("derivatives across rows", pixels)?,
        })
    }

    pub(super) fn pixels(&self) -> usize {
        self.tones.len()
    }

    /// Records the gradient, and the sums of workgroups.
    pub(super) fn record(
        &self,
        r: &mut Recorder,
        params: &SimilarityParams,
        [x, y, gradient]: [&Buffer<[f32; 4]>; 3],
        [weights, partial]: [&Buffer<f32>; 2],
        pixels: usize,
    ) -> Result<Vec<Slot>, GpuError> {
        let (tones, rows) = (self.tones.bind(), self.rows.bind());
        let (derivatives, columns) = (self.derivatives.bind(), self.columns.bind());
        let bound = [
            vec![x.bind(), y.bind(), tones.clone()],
            vec![tones.clone(), rows.clone()],
            vec![rows, weights.bind(), derivatives.clone(), partial.bind()],
            vec![derivatives, columns.clone()],
            vec![columns, tones, gradient.bind()],
        ];
        KERNELS.iter().zip(bound).map(|(kernel, bound)| r.dispatch(kernel, params, &bound, pixels)).collect()
    }
}
