//! Weights of the pixels of a picture by the mean light around them: twin of `relative_weights`.

use crate::engine::loss::ASIDE;
use photofit_gpu::{Buffer, GpuError, INDEX, Kernel, Recorder, Recording, Slot};

const SOURCE: &[&str] = &[INDEX, include_str!("weights.wgsl")];

/// Means along the rows, then across them.
pub(super) const KERNELS: [Kernel; 2] = [
    Kernel { name: "fit.mean_along_rows", source: SOURCE, entry: "along" },
    Kernel { name: "fit.relative_weights", source: SOURCE, entry: "weigh" },
];

/// Columns and rows of the picture, and pixels on either side (`weights.wgsl`).
type Params = [u32; 4];

fn params([width, height]: [usize; 2]) -> Params {
    [width as u32, height as u32, ASIDE as u32, 0]
}

/// Recorded weights of one picture.
#[derive(Debug)]
pub(super) struct RelativeWeights([Slot; 2]);

impl RelativeWeights {
    /// Records the weights of a picture; `rows` is memory between both kernels.
    pub(super) fn record(
        r: &mut Recorder,
        picture: &Buffer<[f32; 4]>,
        rows: &Buffer<f32>,
        weights: &Buffer<f32>,
    ) -> Result<Self, GpuError> {
        let (pixels, unset) = (picture.len(), params([picture.len(), 1]));
        let along = r.dispatch(&KERNELS[0], &unset, &[picture.bind(), rows.bind()], pixels)?;
        let weigh = r.dispatch(&KERNELS[1], &unset, &[rows.bind(), weights.bind()], pixels)?;
        Ok(Self([along, weigh]))
    }

    /// Sets columns and rows of the picture of the next run.
    pub(super) fn set(&self, recording: &mut Recording, size: [usize; 2]) {
        self.0.iter().for_each(|slot| recording.set(*slot, &params(size)));
    }
}
