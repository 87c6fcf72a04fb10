//! Light that the features do not explain, where the noise is not known pixel by pixel: from halves, from a history, from one sample.
//!
//! The residual is smoothed by Gaussians from wide to narrow. Of each mean `m` the share `1 - k v / e` is added to the estimate and
//! taken from the residual: `e` is the local mean of `m^2`, `v` that of the variance which the noise alone gives `m` (Wiener's
//! filter with a local estimate of the signal [@lee1980]). The noise is what a Gaussian mean leaves of the residual, or what
//! the frames of a history differ by where that is more.

use super::window::{blur_sums, gaussian_taps};

/// Deviations of the Gaussians in pixels.
const SIGMAS: [f32; 2] = [2.0, 1.0];
/// Deviation of the window of `e` and `v` over that of the Gaussian.
const WINDOW: f32 = 3.0;
/// `k`.
const FACTOR: f32 = 1.5;

/// What is significant in a residual (3 planes, 0 at holes; `known` is 0 there and 1 elsewhere), and the mean share of the
/// narrowest mean. `noise` is the variance of each pixel where it is known by other means: pixels of a history that was moved between
/// pixels hang together, and differ from their mean by less than their noise.
pub(crate) fn significant(
    mut residual: Vec<f32>,
    known: &[f32],
    noise: Option<&[f32]>,
    width: usize,
) -> (Vec<f32>, f32) {
    let n = known.len();
    let (mut added, mut share) = (vec![0.0; 3 * n], 0.0);
    for sigma in SIGMAS {
        let taps = gaussian_taps(sigma);
        let total = blur_sums(known, width, &taps);
        let mut means: Vec<f32> = residual.chunks(n).flat_map(|r| blur_sums(r, width, &taps)).collect();
        means.iter_mut().enumerate().for_each(|(i, m)| *m *= known[i % n] / total[i % n].max(1e-6));
        let own = |i: usize| {
            let square = |c: usize| (residual[c * n + i] - means[c * n + i]).powi(2);
            known[i] * (square(0) + square(1) + square(2)) * (1.0 / 3.0)
        };
        let noise: Vec<f32> = (0..n).map(|i| noise.map_or(0.0, |v| known[i] * v[i]).max(own(i))).collect();
        let squares: Vec<f32> = taps.iter().map(|t| t * t).collect();
        let mut variance = blur_sums(&noise, width, &squares);
        variance.iter_mut().zip(&total).zip(known).for_each(|((v, t), k)| *v *= k / t.max(1e-6).powi(2));
        let window = gaussian_taps(WINDOW * sigma);
        let square = |i: usize| means[i].powi(2) + means[n + i].powi(2) + means[2 * n + i].powi(2);
        let signal: Vec<f32> = (0..n).map(|i| known[i] * square(i) * (1.0 / 3.0)).collect();
        let (signal, noise) = (blur_sums(&signal, width, &window), blur_sums(&variance, width, &window));
        let mut gains = 0.0_f64;
        for i in (0..n).filter(|i| known[*i] > 0.0 && signal[*i] > 0.0) {
            let gain = (1.0 - FACTOR * noise[i] / signal[i]).clamp(0.0, 1.0);
            gains += f64::from(gain);
            for k in [i, n + i, 2 * n + i] {
                added[k] += gain * means[k];
                residual[k] -= gain * means[k];
            }
        }
        share = (gains / n as f64) as f32;
    }
    (added, share)
}
