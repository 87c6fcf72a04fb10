//! How noisy each pixel is: from the picture alone, from moments over time, from two halves.

use super::window::blur_mean;
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};

/// High-pass taps of Daubechies' wavelet with two vanishing moments (db2).
const DB2: [f32; 4] = [-0.129_409_52, -0.224_143_87, 0.836_516_3, -0.482_962_9];

/// Half the window of the local median, in coefficients.
const REACH: usize = 4;

/// Standard deviation of the noise of one plane (Donoho and Johnstone 1994): `median |HH| / 0.6745` of the finest diagonal band of
/// the db2 wavelets over 9 x 9 coefficients (about 16 pixels), interpolated to the pixels.
///
/// For Gaussian noise; the heavy tails of Monte Carlo noise hardly move a median, so it measures their core.
///
/// # Panics
/// If the length is not `width * height`, or there are no pixels.
pub fn mad_sigma(plane: &[f32], width: usize, height: usize) -> Vec<f32> {
    assert_eq!(plane.len(), height * width, "one value per pixel");
    assert!(!plane.is_empty(), "pixels");
    let (hr, hc) = (height.div_ceil(2), width.div_ceil(2));
    let mirror = |i: usize, n: usize| {
        let i = i % (2 * n);
        if i < n { i } else { 2 * n - 1 - i }
    };
    let mut band = vec![0.0_f32; hr * hc];
    band.par_chunks_mut(hc).enumerate().with_min_len(8).for_each(|(y, out)| {
        let mut column = vec![0.0; width];
        for (k, t) in DB2.iter().enumerate() {
            let row = &plane[mirror(2 * y + k, height) * width..][..width];
            column.iter_mut().zip(row).for_each(|(c, v)| *c += t * v);
        }
        for (x, o) in out.iter_mut().enumerate() {
            let s: f32 = DB2.iter().enumerate().map(|(k, t)| t * column[mirror(2 * x + k, width)]).sum();
            *o = s.abs();
        }
    });
    // Medians at every second coefficient; they overlap by 7 of 9.
    let (mr, mc) = (hr.div_ceil(2), hc.div_ceil(2));
    let mut medians = vec![0.0_f32; mr * mc];
    medians.par_chunks_mut(mc).enumerate().for_each(|(y, out)| {
        let mut window = Vec::with_capacity((2 * REACH + 1).pow(2));
        let reach = |c: usize, n: usize| (2 * c).saturating_sub(REACH)..(2 * c + REACH + 1).min(n);
        for (x, o) in out.iter_mut().enumerate() {
            window.clear();
            for i in reach(y, hr) {
                window.extend_from_slice(&band[i * hc..][reach(x, hc)]);
            }
            let middle = window.len() / 2;
            *o = *window.select_nth_unstable_by(middle, f32::total_cmp).1 / 0.6745;
        }
    });
    enlarge(&medians, [mc, mr], width, height)
}

/// Bilinear interpolation of values at every fourth pixel.
fn enlarge(small: &[f32], [mc, mr]: [usize; 2], width: usize, height: usize) -> Vec<f32> {
    let place = |i: usize, n: usize| {
        let at = ((i as f32 - 1.5) / 4.0).clamp(0.0, (n - 1) as f32);
        (at as usize, (at as usize + 1).min(n - 1), at.fract())
    };
    let mut out = vec![0.0; height * width];
    out.par_chunks_mut(width).enumerate().with_min_len(8).for_each(|(y, out)| {
        let (y0, y1, fy) = place(y, mr);
        for (x, o) in out.iter_mut().enumerate() {
            let (x0, x1, fx) = place(x, mc);
            let mix = |y: usize| small[y * mc + x0] * (1.0 - fx) + small[y * mc + x1] * fx;
            *o = mix(y0) * (1.0 - fy) + mix(y1) * fy;
        }
    });
    out
}

/// Deviation of `log(1 + mean)` per pixel from linear moments: `sqrt(Var)/(1 + m1)`, the variance of the mean blurred
/// with sigma 2 first. (Moments of logarithms underestimate the noise.)
///
/// `variance` is that of the mean, for accumulated frames `(m2 - m1^2) S/(1-S)` with `S` the sum of the squared
/// weights, see [`super::Accumulator::variance`]; `weight` is 0 at holes.
///
/// # Panics
/// If the lengths differ.
pub fn log_sigma(mean: &[f32], variance: &[f32], weight: &[f32], width: usize) -> Vec<f32> {
    assert!(mean.len() == variance.len() && mean.len() == weight.len(), "one value per pixel");
    let blurred = blur_mean(variance, weight, width, 2.0);
    blurred.iter().zip(mean).map(|(v, m)| v.max(0.0).sqrt() / (1.0 + m.max(0.0))).collect()
}

/// Variance of the mean of two halves with equally many samples, averaged over the three channels:
/// `(A - B)^2 / 4` per sample.
pub(crate) fn half_variance(a: &[f32], b: &[f32]) -> Vec<f32> {
    let n = a.len() / 3;
    let square = |i: usize| 0.25 * (a[i] - b[i]) * (a[i] - b[i]);
    (0..n).map(|i| (square(i) + square(n + i) + square(2 * n + i)) * (1.0 / 3.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::Rng;

    #[test]
    fn mad_measures_gaussian_noise_on_a_picture_with_edges() {
        let (width, height) = (256, 192);
        let mut rng = Rng::new(5, 0);
        for sigma in [0.01_f32, 0.05, 0.2] {
            let plane: Vec<f32> = (0..height * width)
                .map(|i| {
                    let (x, y) = (i % width, i / width);
                    let edge = if x > y { 0.4 } else { 0.0 };
                    0.3 + edge + 0.1 * (x as f32 * 0.05).sin() + sigma * rng.normal()
                })
                .collect();
            let map = mad_sigma(&plane, width, height);
            let mut sorted = map.clone();
            sorted.sort_unstable_by(f32::total_cmp);
            let median = sorted[sorted.len() / 2];
            assert!((median / sigma - 1.0).abs() < 0.05, "{median} against {sigma}");
        }
        for (height, width) in [(1, 1), (1, 7), (5, 1), (3, 3)] {
            assert_eq!(mad_sigma(&vec![2.0; height * width], width, height).len(), height * width);
        }
    }
}
