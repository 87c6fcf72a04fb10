//! Light that the features do not explain, brought back from what the regression left over: shadows, reflections.
//!
//! With `u` the estimate and `y` the noisy irradiance, the residual `r = (y - u) / level` is smoothed by Gaussians from wide to
//! narrow, at last by none. Of each mean `m` the share `1 - k v / e` is added to the estimate and taken from the residual:
//! `e` is the local mean of `m^2`, `v` that of the variance which the noise alone gives `m` (Wiener's filter with a local
//! estimate of the signal [@lee1980]). Relative residuals keep what is bright from reaching into what is dark.

use super::regression::RELATIVE_FLOOR;
use super::window::{blur_sums, gaussian_taps};

/// Deviations of the Gaussians in pixels; 0 is the pixel by itself, where the noise is known.
const SIGMAS: [f32; 3] = [2.0, 1.0, 0.0];
/// Deviation of the window of `e` and `v` over that of the Gaussian, and its least, pixels. One value where the noise is
/// known, one where it is estimated from the residual.
const WINDOW: [f32; 2] = [1.5, 3.0];
const LEAST_WINDOW: f32 = 0.7;
/// `k`, for the same two.
const FACTOR: [f32; 2] = [1.0, 1.5];

/// Adds to `estimate` (3 planes) what is significant in `irradiance - estimate`; pixels of `weight` 0 have no sample and
/// stay. `variance` is that of the irradiance, mean over the channels. Returns the mean share that was added of the
/// narrowest residual.
pub(crate) fn restore_detail(
    width: usize,
    irradiance: &[f32],
    weight: &[f32],
    variance: Option<&[f32]>,
    estimate: &mut [f32],
) -> f32 {
    let n = weight.len();
    let mean = |v: &[f32], i: usize| (v[i] + v[n + i] + v[2 * n + i]) * (1.0 / 3.0);
    let level: Vec<f32> = (0..n).map(|i| mean(estimate, i) + RELATIVE_FLOOR).collect();
    let known: Vec<f32> = weight.iter().map(|w| if *w > 0.0 { 1.0 } else { 0.0 }).collect();
    // Not bounded: where light is sparse, its few bright samples are all there is of it.
    let relative = |i: usize| known[i % n] * (irradiance[i] - estimate[i]) / level[i % n];
    let residual = (0..3 * n).map(relative).collect();
    let noise = variance.map(|v| (0..n).map(|i| known[i] * v[i] / level[i].powi(2)).collect::<Vec<f32>>());
    let mut work = Residual { width, known, residual, added: vec![0.0; 3 * n], share: 0.0 };
    for sigma in SIGMAS {
        match &noise {
            _ if sigma > 0.0 => work.smoothed(sigma, noise.as_deref()),
            Some(noise) => work.alone(noise),
            None => {}
        }
    }
    for (i, u) in estimate.iter_mut().enumerate() {
        *u = (*u + work.added[i] * level[i % n]).max(0.0);
    }
    work.share
}

struct Residual {
    width: usize,
    /// 1 at samples, 0 at holes.
    known: Vec<f32>,
    /// 3 planes, relative; 0 at holes.
    residual: Vec<f32>,
    added: Vec<f32>,
    /// Mean share of the last step.
    share: f32,
}

impl Residual {
    /// Takes over the significant part of the residual smoothed with deviation `sigma`.
    fn smoothed(&mut self, sigma: f32, noise: Option<&[f32]>) {
        let n = self.known.len();
        let taps = gaussian_taps(sigma);
        let total = blur_sums(&self.known, self.width, &taps);
        let mut means: Vec<f32> =
            self.residual.chunks(n).flat_map(|r| blur_sums(r, self.width, &taps)).collect();
        means.iter_mut().enumerate().for_each(|(i, m)| *m *= self.known[i % n] / total[i % n].max(1e-6));
        let own = |i: usize| {
            let square = |c: usize| (self.residual[c * n + i] - means[c * n + i]).powi(2);
            self.known[i] * (square(0) + square(1) + square(2)) * (1.0 / 3.0)
        };
        let estimated = noise.is_none().then(|| (0..n).map(own).collect::<Vec<f32>>());
        let noise = noise.or(estimated.as_deref()).unwrap_or_default();
        let squares: Vec<f32> = taps.iter().map(|t| t * t).collect();
        let mut variance = blur_sums(noise, self.width, &squares);
        variance.iter_mut().zip(&total).for_each(|(v, t)| *v /= t.max(1e-6).powi(2));
        self.take(&means, &variance, sigma, usize::from(estimated.is_some()));
    }

    /// Takes over the significant part of each pixel's own residual.
    fn alone(&mut self, noise: &[f32]) {
        let taps = gaussian_taps(1.0);
        let (sum, total) = (blur_sums(noise, self.width, &taps), blur_sums(&self.known, self.width, &taps));
        let around = sum.iter().zip(total).map(|(s, t)| s / t.max(1e-6));
        // A few samples that agree by chance look as if they had no noise.
        let variance: Vec<f32> = around.zip(noise).map(|(a, v)| a.max(*v)).collect();
        let means = self.residual.clone();
        self.take(&means, &variance, 0.0, 0);
    }

    fn take(&mut self, means: &[f32], variance: &[f32], sigma: f32, kind: usize) {
        let n = self.known.len();
        let taps = gaussian_taps((WINDOW[kind] * sigma).max(LEAST_WINDOW));
        let square = |i: usize| means[i].powi(2) + means[n + i].powi(2) + means[2 * n + i].powi(2);
        let signal: Vec<f32> = (0..n).map(|i| self.known[i] * square(i) * (1.0 / 3.0)).collect();
        let noise: Vec<f32> = variance.iter().zip(&self.known).map(|(v, w)| v * w).collect();
        let (signal, noise) = (blur_sums(&signal, self.width, &taps), blur_sums(&noise, self.width, &taps));
        let mut total = 0.0_f64;
        for i in (0..n).filter(|i| self.known[*i] > 0.0 && signal[*i] > 0.0) {
            let gain = (1.0 - FACTOR[kind] * noise[i] / signal[i]).clamp(0.0, 1.0);
            total += f64::from(gain);
            for k in [i, n + i, 2 * n + i] {
                self.added[k] += gain * means[k];
                self.residual[k] -= gain * means[k];
            }
        }
        self.share = (total / n as f64) as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::Rng;

    #[test]
    fn a_shadow_comes_back_and_noise_stays_out() {
        let (width, height, sigma) = (96, 64, 0.2_f32);
        let n = width * height;
        let truth: Vec<f32> = (0..3 * n).map(|i| if i % width < 40 { 0.5 } else { 1.0 }).collect();
        let mut rng = Rng::new(3, 0);
        let noisy: Vec<f32> = truth.iter().map(|t| t + sigma * rng.normal()).collect();
        let rms = |u: &[f32], v: &[f32]| {
            (u.iter().zip(v).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / (3 * n) as f64).sqrt()
        };
        let (flat, weight, variance) = (vec![0.8; 3 * n], vec![1.0; n], vec![sigma * sigma; n]);
        for variance in [Some(&variance[..]), None] {
            let mut u = flat.clone();
            restore_detail(width, &noisy, &weight, variance, &mut u);
            assert!(rms(&u, &truth) < 0.3 * rms(&flat, &truth), "{} {variance:?}", rms(&u, &truth));
            // Nothing is missing from the truth: the noise must not come in.
            let mut u = truth.clone();
            restore_detail(width, &noisy, &weight, variance, &mut u);
            assert!(rms(&u, &truth) < 0.35 * f64::from(sigma), "{}", rms(&u, &truth));
        }
        // Holes stay, and have no part in what is around.
        let mut holed = noisy.clone();
        let hole = 20 * width + 20;
        (0..3).for_each(|c| holed[c * n + hole] = 1e6);
        let mut weight = weight;
        weight[hole] = 0.0;
        let mut u = flat.clone();
        restore_detail(width, &holed, &weight, Some(&variance), &mut u);
        assert!(u[hole] == 0.8 && (u[hole + 1] - 0.5).abs() < 0.2, "{} {}", u[hole], u[hole + 1]);
    }
}
