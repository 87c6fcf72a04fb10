//! Rare samples of huge value, pulled down to what their neighbourhood makes plausible.

use super::window::separable_median;
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};

/// Largest value over the local median.
const OVER_MEDIAN: f32 = 8.0;

/// Scales pixels whose mean over the channels exceeds `8 median + 0.5`, where the median is that of the 7 x 7
/// neighbourhood, down to it; the hue stays. Units: exposure. Returns how many were scaled.
pub(crate) fn clamp_fireflies(irradiance: &mut [f32], cols: usize) -> usize {
    let n = irradiance.len() / 3;
    let (r, rest) = irradiance.split_at_mut(n);
    let (g, b) = rest.split_at_mut(n);
    let mean: Vec<f32> = r.iter().zip(&*g).zip(&*b).map(|((r, g), b)| (r + g + b) * (1.0 / 3.0)).collect();
    let median = separable_median(&mean, cols);
    let mut changed = vec![0_usize; n.div_ceil(cols)];
    let rows = r.par_chunks_mut(cols).zip(g.par_chunks_mut(cols)).zip(b.par_chunks_mut(cols));
    rows.zip(&mut changed).enumerate().with_min_len(16).for_each(|(y, (((r, g), b), changed))| {
        let row = y * cols..y * cols + r.len();
        for (x, (mean, median)) in mean[row.clone()].iter().zip(&median[row]).enumerate() {
            let limit = OVER_MEDIAN * median.max(0.0) + 0.5;
            if *mean > limit {
                let scale = limit / mean;
                r[x] *= scale;
                g[x] *= scale;
                b[x] *= scale;
                *changed += 1;
            }
        }
    });
    changed.iter().sum()
}
