//! [`clamp_channels`](crate::clamp_channels) and [`normalize_vectors`](crate::normalize_vectors) on a device.

use super::{COLUMNS, Columns};
use photofit_gpu::{Buffer, GpuError, INDEX, Kernel, Recorder};
use std::ops::Range;

pub(super) const CONSTRAIN: Kernel =
    Kernel { name: "constrain", source: &[INDEX, include_str!("../constrain.wgsl")], entry: "constrain" };

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Params {
    rows: u32,
    width: u32,
    clamps: u32,
    unit: u32,
    has_unit: u32,
    first: u32,
    unused: [u32; 2],
    lowest: Columns,
    highest: Columns,
}

/// Clamps each column of these rows of `width` samples to its range (none when `ranges` is empty), then makes the vector of
/// three from column `unit` on a unit vector.
///
/// # Errors
/// If the device refuses the kernel.
///
/// # Panics
/// When rows are missing or have more than 16 samples, `ranges` is not of their length, or the vector does not lie
/// inside a row.
pub fn constrain<P: bytemuck::Pod>(
    r: &mut Recorder,
    params: &Buffer<P>,
    (rows, width): (Range<usize>, usize),
    ranges: &[[f32; 2]],
    unit: Option<usize>,
) -> Result<(), GpuError> {
    assert!((1..=COLUMNS).contains(&width), "rows of at most 16 samples");
    assert!((rows.end * width * size_of::<f32>()) as u64 <= params.bytes(), "all rows are there");
    assert!(ranges.is_empty() || ranges.len() == width, "one range per column");
    assert!(unit.is_none_or(|at| at.saturating_add(3) <= width), "the vector lies inside a row");
    let mut p = Params {
        rows: rows.len() as u32,
        width: width as u32,
        clamps: u32::from(!ranges.is_empty()),
        unit: unit.unwrap_or(0) as u32,
        has_unit: u32::from(unit.is_some()),
        first: rows.start as u32,
        unused: [0; 2],
        lowest: [0.0; COLUMNS],
        highest: [0.0; COLUMNS],
    };
    for (k, [low, high]) in ranges.iter().enumerate() {
        (p.lowest[k], p.highest[k]) = (*low, *high);
    }
    r.dispatch(&CONSTRAIN, &p, &[params.bind()], rows.len())?;
    Ok(())
}
