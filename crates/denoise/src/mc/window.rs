//! Separable filters of planes: Gaussian blur with renormalised borders, and the 7-wide separable median.

use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSlice, ParallelSliceMut};

/// The taps `0..=radius` of a Gaussian cut at 2.5 sigma (at least one neighbour), not normalised.
pub(crate) fn gaussian_taps(sigma: f32) -> Vec<f32> {
    let radius = (2.5 * sigma).ceil().max(1.0) as usize;
    (0..=radius).map(|k| (-0.5 * (k as f32 / sigma).powi(2)).exp()).collect()
}

/// Blurs a plane by taps `[centre, +-1, +-2, ...]`; what lies outside the plane is zero.
pub(crate) fn blur_sums(plane: &[f32], cols: usize, taps: &[f32]) -> Vec<f32> {
    blur_columns(&blur_rows(plane, cols, taps), cols, taps)
}

/// Blurs each run of `cols` values by itself.
pub(crate) fn blur_rows(plane: &[f32], cols: usize, taps: &[f32]) -> Vec<f32> {
    let mut out = vec![0.0; plane.len()];
    out.par_chunks_mut(cols).zip(plane.par_chunks(cols)).with_min_len(16).for_each(|(out, row)| {
        for (o, v) in out.iter_mut().zip(row) {
            *o = taps[0] * *v;
        }
        for (k, t) in taps.iter().enumerate().skip(1).filter(|(k, _)| *k < cols) {
            for (o, v) in out[k..].iter_mut().zip(row) {
                *o += *t * *v;
            }
            for (o, v) in out.iter_mut().zip(&row[k..]) {
                *o += *t * *v;
            }
        }
    });
    out
}

/// Blurs across runs of `cols` values.
pub(crate) fn blur_columns(plane: &[f32], cols: usize, taps: &[f32]) -> Vec<f32> {
    let rows = plane.len() / cols.max(1);
    let mut out = vec![0.0; plane.len()];
    out.par_chunks_mut(cols).enumerate().for_each(|(y, out)| {
        for (k, t) in taps.iter().enumerate() {
            let mut add = |row: &[f32]| {
                for (o, v) in out.iter_mut().zip(row) {
                    *o += *t * *v;
                }
            };
            if y + k < rows {
                add(&plane[(y + k) * cols..][..cols]);
            }
            if k > 0 && y >= k {
                add(&plane[(y - k) * cols..][..cols]);
            }
        }
    });
    out
}

/// Gaussian mean of a plane over the pixels with `weight`; 0 where there are none.
pub(crate) fn blur_mean(plane: &[f32], weight: &[f32], cols: usize, sigma: f32) -> Vec<f32> {
    let taps = gaussian_taps(sigma);
    let weighted: Vec<f32> = plane.iter().zip(weight).map(|(v, w)| v * w).collect();
    let (mut sum, total) = (blur_sums(&weighted, cols, &taps), blur_sums(weight, cols, &taps));
    for (s, t) in sum.iter_mut().zip(total) {
        *s = if t > 1e-6 { *s / t } else { 0.0 };
    }
    sum
}

/// Median of seven by a network of exchanges without branches.
#[inline]
fn median7(mut p: [f32; 7]) -> f32 {
    const NETWORK: [(usize, usize); 13] = [
        (0, 5),
        (0, 3),
        (1, 6),
        (2, 4),
        (0, 1),
        (3, 5),
        (2, 6),
        (2, 3),
        (3, 6),
        (4, 5),
        (1, 4),
        (1, 3),
        (3, 4),
    ];
    for (a, b) in NETWORK {
        let (x, y) = (p[a], p[b]);
        p[a] = if x < y { x } else { y };
        p[b] = if x < y { y } else { x };
    }
    p[3]
}

/// Median of the columns of the medians of the rows of a 7 x 7 window; borders repeat.
pub(crate) fn separable_median(plane: &[f32], cols: usize) -> Vec<f32> {
    let rows = plane.len() / cols.max(1);
    let mut across = vec![0.0; plane.len()];
    let scratch = || vec![0.0; cols + 6];
    let chunks = across.par_chunks_mut(cols).zip(plane.par_chunks(cols)).with_min_len(16);
    chunks.for_each_init(scratch, |padded, (out, row)| {
        padded[3..3 + cols].copy_from_slice(row);
        padded[..3].fill(row[0]);
        padded[3 + cols..].fill(row[cols - 1]);
        let at: [&[f32]; 7] = std::array::from_fn(|k| &padded[k..k + cols]);
        for (x, o) in out.iter_mut().enumerate() {
            *o = median7(std::array::from_fn(|k| at[k][x]));
        }
    });
    let mut out = vec![0.0; plane.len()];
    out.par_chunks_mut(cols).enumerate().with_min_len(16).for_each(|(y, out)| {
        let at: [&[f32]; 7] =
            std::array::from_fn(|k| &across[(y + k).saturating_sub(3).min(rows - 1) * cols..][..cols]);
        for (x, o) in out.iter_mut().enumerate() {
            *o = median7(std::array::from_fn(|k| at[k][x]));
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_network_finds_the_median_of_all_zero_one_inputs() {
        for bits in 0_u32..128 {
            let p = std::array::from_fn(|k| (bits >> k & 1) as f32);
            let expected = if bits.count_ones() >= 4 { 1.0 } else { 0.0 };
            assert_eq!(median7(p), expected, "{bits:07b}");
        }
    }

    #[test]
    fn blurred_means_keep_constants_and_ignore_holes() {
        let (cols, mut plane, mut weight) = (9, vec![3.0; 63], vec![1.0; 63]);
        plane[31] = 1e9;
        weight[31] = 0.0;
        assert!(blur_mean(&plane, &weight, cols, 2.0).iter().all(|v| (v - 3.0).abs() < 1e-5));
        assert_eq!(blur_mean(&[5.0], &[0.0], 1, 2.0), [0.0]);
    }

    #[test]
    fn the_median_drops_spikes_and_keeps_edges() {
        let cols = 20;
        let mut plane: Vec<f32> = (0..400).map(|i| if i % cols < 10 { 1.0 } else { 2.0 }).collect();
        let clean = plane.clone();
        plane[205] = 100.0;
        plane[47] = -50.0;
        assert_eq!(separable_median(&plane, cols), clean);
        assert_eq!(separable_median(&[1.0, 9.0], 2).len(), 2);
    }
}
