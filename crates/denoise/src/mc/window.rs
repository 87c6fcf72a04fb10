//! Separable filters of planes: Gaussian blur with renormalised borders.

use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSlice, ParallelSliceMut};

/// The taps `0..=radius` of a Gaussian cut at 2.5 sigma (at least one neighbour), not normalised.
pub(crate) fn gaussian_taps(sigma: f32) -> Vec<f32> {
    let radius = (2.5 * sigma).ceil().max(1.0) as usize;
    (0..=radius).map(|k| (-0.5 * (k as f32 / sigma).powi(2)).exp()).collect()
}

/// Blurs a plane by taps `[centre, +-1, +-2, ...]`; what lies outside the plane is zero.
pub(crate) fn blur_sums(plane: &[f32], width: usize, taps: &[f32]) -> Vec<f32> {
    blur_columns(&blur_rows(plane, width, taps), width, taps)
}

/// Blurs each run of `width` values by itself.
pub(crate) fn blur_rows(plane: &[f32], width: usize, taps: &[f32]) -> Vec<f32> {
    let mut out = vec![0.0; plane.len()];
    out.par_chunks_mut(width).zip(plane.par_chunks(width)).with_min_len(16).for_each(|(out, row)| {
        for (o, v) in out.iter_mut().zip(row) {
            *o = taps[0] * *v;
        }
        for (k, t) in taps.iter().enumerate().skip(1).filter(|(k, _)| *k < width) {
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

/// Blurs across runs of `width` values.
pub(crate) fn blur_columns(plane: &[f32], width: usize, taps: &[f32]) -> Vec<f32> {
    let height = plane.len() / width.max(1);
    let mut out = vec![0.0; plane.len()];
    out.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        for (k, t) in taps.iter().enumerate() {
            let mut add = |row: &[f32]| {
                for (o, v) in out.iter_mut().zip(row) {
                    *o += *t * *v;
                }
            };
            if y + k < height {
                add(&plane[(y + k) * width..][..width]);
            }
            if k > 0 && y >= k {
                add(&plane[(y - k) * width..][..width]);
            }
        }
    });
    out
}

/// Gaussian mean of a plane over the pixels with `weight`; 0 where there are none.
pub(crate) fn blur_mean(plane: &[f32], weight: &[f32], width: usize, sigma: f32) -> Vec<f32> {
    let taps = gaussian_taps(sigma);
    let weighted: Vec<f32> = plane.iter().zip(weight).map(|(v, w)| v * w).collect();
    let (mut sum, total) = (blur_sums(&weighted, width, &taps), blur_sums(weight, width, &taps));
    for (s, t) in sum.iter_mut().zip(total) {
        *s = if t > 1e-6 { *s / t } else { 0.0 };
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blurred_means_keep_constants_and_ignore_holes() {
        let (width, mut plane, mut weight) = (9, vec![3.0; 63], vec![1.0; 63]);
        plane[31] = 1e9;
        weight[31] = 0.0;
        assert!(blur_mean(&plane, &weight, width, 2.0).iter().all(|v| (v - 3.0).abs() < 1e-5));
        assert_eq!(blur_mean(&[5.0], &[0.0], 1, 2.0), [0.0]);
    }
}
