//! Light that no linear model follows: highlights a few cells wide.
//!
//! Beside a highlight the model that fits one cell falls below all that is around, to 0 at last, and the cell shows as a
//! dark block. Around cells between which the means differ severalfold a small blur of the samples is taken
//! instead, which stops at edges of the features: there is much light and so little relative noise.

use super::basis::Basis;
use super::regression::{Samples, cell_before};
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};

/// Largest over least mean around a cell at which the blur begins to replace the model, and does so wholly.
const CONTRAST: [f32; 2] = [3.0, 6.0];
/// Pixels to each side that are averaged, and the deviation of the Gaussian.
const REACH: usize = 6;
const SIGMA: f32 = 2.5;
/// Difference of a feature that counts as another surface, in its deviations over the picture.
const FEATURE: f32 = 0.5;

/// Replaces `estimate` (3 planes) around cells with a large `contrast`, the largest over the least mean around each cell.
pub(crate) fn replace_peaks(samples: &Samples<'_>, basis: &Basis, contrast: &[f32], estimate: &mut [f32]) {
    let [low, high] = CONTRAST;
    let failed = largest_around(samples.cells, contrast);
    let failed: Vec<f32> = failed.iter().map(|c| ((c - low) / (high - low)).clamp(0.0, 1.0)).collect();
    if failed.iter().all(|f| *f == 0.0) {
        return;
    }
    let (n, width) = (samples.shape.pixels(), samples.shape.width);
    let gauss: Vec<f32> = (0..=REACH).map(|d| (-0.5 * (d as f32 / SIGMA).powi(2)).exp()).collect();
    let (r, rest) = estimate.split_at_mut(n);
    let (g, b) = rest.split_at_mut(n);
    let rows = r.par_chunks_mut(width).zip(g.par_chunks_mut(width)).zip(b.par_chunks_mut(width));
    rows.enumerate().with_min_len(4).for_each_init(Vec::new, |line, (y, ((r, g), b))| {
        samples.between(&failed, 1, y, line);
        if line.iter().all(|f| *f == 0.0) {
            return;
        }
        for x in 0..width {
            let (left, f) = cell_before(x, line.len());
            let right = (left + 1).min(line.len() - 1);
            let share = line[left] + f * (line[right] - line[left]);
            if share > 0.0
                && (samples.fill || samples.weight[y * width + x] > 0.0)
                && let Some(mean) = blurred(samples, basis, &gauss, x, y)
            {
                for (out, mean) in [&mut r[x], &mut g[x], &mut b[x]].into_iter().zip(mean) {
                    *out += share * (mean - *out);
                }
            }
        }
    });
}

/// The largest value of each cell and its neighbours.
fn largest_around([ch, cw]: [usize; 2], values: &[f32]) -> Vec<f32> {
    let around = |c: usize, n: usize| c.saturating_sub(1)..(c + 2).min(n);
    let of = |cell: usize| {
        let cells = around(cell / cw, ch).flat_map(|y| around(cell % cw, cw).map(move |x| y * cw + x));
        cells.map(|k| values[k]).fold(0.0, f32::max)
    };
    (0..ch * cw).map(of).collect()
}

/// The mean of the samples around a pixel that have its features.
fn blurred(samples: &Samples<'_>, basis: &Basis, gauss: &[f32], x: usize, y: usize) -> Option<[f32; 3]> {
    let (n, width, height) = (samples.shape.pixels(), samples.shape.width, samples.shape.height);
    let own = y * width + x;
    let (mut sum, mut total) = ([0.0_f32; 3], 0.0_f32);
    for v in y.saturating_sub(REACH)..(y + REACH + 1).min(height) {
        for u in x.saturating_sub(REACH)..(x + REACH + 1).min(width) {
            let i = v * width + u;
            if samples.weight[i] <= 0.0 {
                continue;
            }
            let distance: f32 = basis.planes.iter().map(|p| (p[i] - p[own]).powi(2)).sum();
            let near = 1.0 / (1.0 + (distance / (FEATURE * FEATURE)).powi(2));
            let weight = samples.weight[i] * gauss[v.abs_diff(y)] * gauss[u.abs_diff(x)] * near;
            total += weight;
            (0..3).for_each(|c| sum[c] += weight * samples.irradiance[c * n + i]);
        }
    }
    (total > 0.05).then(|| sum.map(|s| s / total))
}
