//! Light that the features do not explain, brought back from what the regression left over: shadows, reflections.
//!
//! With `u` the estimate and `y` the noisy irradiance, the residual `r = (y - u) / level` is averaged over the pixels around
//! whose features and whose residual, smoothed by a Gaussian, are alike ([`Bilateral`]). Of no mean at all, that of a narrow and
//! that of a wide window, each pixel takes the one whose squared difference from the residual of the pixel itself, which has no
//! part in it, is least around it: the difference is the error plus a noise that is common to all three. Of the noise `v`
//! the share `1 - v / e` of the rest is added, `e` the mean square of that rest around the pixel (Wiener's filter with a
//! local estimate of the signal [@lee1980]). Relative residuals keep what is bright from reaching into what is dark.
//! Where the noise is not known pixel by pixel, Gaussian means take the place of the bilateral ones ([`significant`]).

use super::bilateral::{Bilateral, PLANES};
use super::gaussian::significant;
use super::regression::RELATIVE_FLOOR;
use super::window::blur_mean;

/// Largest residual, in levels and in means of the residuals around (within a Gaussian of the deviation `USUAL`, pixels): what is
/// beyond is a rare sample.
const MOST: [f32; 2] = [4.0, 3.0];
const USUAL: f32 = 4.0;
/// Variance over the squared value above which it may be one.
const SINGLE: f32 = 0.25;
/// Deviation of the Gaussian that pools the noise of pixels.
const POOL: f32 = 2.0;
/// Deviation of the Gaussian that smooths the residual for the likeness.
const GUIDE: f32 = 1.4;
/// Least variance of a residual.
const LEAST: f32 = 1e-4;
/// Deviation of the window in which errors are compared, and of that which smooths the choice.
const COMPARED: f32 = 3.0;
const CHOICE: f32 = 2.0;
/// Deviations of the windows in which a pixel's own noise is judged; the larger noise counts.
const OWN: [f32; 2] = [1.0, 2.0];

/// What is known of the picture.
pub(crate) struct Detail<'a> {
    pub(crate) width: usize,
    /// 3 planes.
    pub(crate) irradiance: &'a [f32],
    /// 0 at pixels without a sample, which stay.
    pub(crate) weight: &'a [f32],
    /// Of the irradiance, mean over the channels; `None` where it is not known pixel by pixel.
    pub(crate) variance: Option<&'a [f32]>,
    /// Planes and the factors of their squared differences in the exponent of a likeness.
    pub(crate) features: &'a [(&'a [f32], f32)],
}

/// What was added.
pub(crate) enum Shares {
    /// Where the noise is not known: the mean share of the narrowest Gaussian mean.
    Gaussian(f32),
    /// The share of the pixels that took no mean, the narrow and the wide one, and the mean share of a pixel's own residual.
    Bilateral { means: [f32; 3], own: f32 },
}

/// Adds to `estimate` (3 planes) what is significant in `irradiance - estimate`.
pub(crate) fn restore_detail(detail: &Detail<'_>, estimate: &mut [f32]) -> Shares {
    let (n, width) = (detail.weight.len(), detail.width);
    let level: Vec<f32> = (0..n).map(|i| mean(estimate, i) + RELATIVE_FLOOR).collect();
    let known: Vec<f32> = detail.weight.iter().map(|w| if *w > 0.0 { 1.0 } else { 0.0 }).collect();
    let mut residual: Vec<f32> =
        (0..3 * n).map(|i| known[i % n] * (detail.irradiance[i] - estimate[i]) / level[i % n]).collect();
    let Some(variance) = detail.variance else {
        let (added, share) = significant(residual, &known, width);
        add(estimate, &added, &level, &known);
        return Shares::Gaussian(share);
    };
    bound(&mut residual, &known, width, |i| variance[i] > SINGLE * mean(detail.irradiance, i).powi(2));
    let own: Vec<f32> = (0..n).map(|i| known[i] * variance[i] / level[i].powi(2)).collect();
    let noise = blur_mean(&own, &known, width, POOL);
    let guide = blur_mean(&(0..n).map(|i| mean(&residual, i)).collect::<Vec<_>>(), &known, width, GUIDE);
    // Half the squared difference over twice the variance of the smoothed residual.
    let pixels = 4.0 * std::f32::consts::PI * GUIDE * GUIDE;
    let precision: Vec<f32> = noise.iter().map(|v| 0.25 * pixels / v.max(LEAST)).collect();
    let means = Bilateral {
        width,
        features: detail.features,
        guide: &guide,
        precision: &precision,
        known: &known,
        values: &residual,
    }
    .means();
    let (mut chosen, shares) = choose(&means, &residual, &known, width);
    let own = add_own(&mut chosen, &residual, &known, &own, width);
    add(estimate, &chosen, &level, &known);
    Shares::Bilateral { means: shares, own }
}

/// Adds a relative residual at pixels with a sample.
fn add(estimate: &mut [f32], residual: &[f32], level: &[f32], known: &[f32]) {
    for (i, (u, r)) in estimate.iter_mut().zip(residual).enumerate() {
        let i = i % level.len();
        *u = (*u + known[i] * r * level[i]).max(0.0);
    }
}

/// Mean over the channels.
fn mean(planes: &[f32], i: usize) -> f32 {
    let n = planes.len() / 3;
    (planes[i] + planes[n + i] + planes[2 * n + i]) * (1.0 / 3.0)
}

/// Cuts residuals that stand out, where the noise says that a pixel has most of its light from one sample.
fn bound(residual: &mut [f32], known: &[f32], width: usize, rare: impl Fn(usize) -> bool) {
    let n = known.len();
    let size = |i: usize| {
        let sum = residual[i].abs() + residual[n + i].abs() + residual[2 * n + i].abs();
        (sum * (1.0 / 3.0)).min(MOST[0])
    };
    let usual = blur_mean(&(0..n).map(size).collect::<Vec<_>>(), known, width, USUAL);
    for i in (0..n).filter(|i| rare(*i)) {
        let limit = MOST[0].min(MOST[1] * usual[i]);
        for k in [i, n + i, 2 * n + i] {
            residual[k] = residual[k].clamp(-limit, limit);
        }
    }
}

/// Of no mean, the narrow and the wide one that of least error; the shares of the three.
fn choose(means: &[f32], residual: &[f32], known: &[f32], width: usize) -> (Vec<f32>, [f32; 3]) {
    let n = known.len();
    let at = |k: usize, c: usize, i: usize| match k {
        0 => 0.0,
        _ => means[(i / width * PLANES + 3 * (k - 1) + c) * width + i % width],
    };
    let error = |k: usize| {
        let square = |i: usize| (0..3).map(|c| (at(k, c, i) - residual[c * n + i]).powi(2)).sum::<f32>();
        blur_mean(&(0..n).map(square).collect::<Vec<_>>(), known, width, COMPARED)
    };
    let errors = [0, 1, 2].map(error);
    let best = |i: usize| (1..3).fold(0, |best, k| if errors[k][i] < errors[best][i] { k } else { best });
    let best: Vec<usize> = (0..n).map(best).collect();
    let share = |k: usize| {
        let taken: Vec<f32> = best.iter().map(|b| if *b == k { 1.0 } else { 0.0 }).collect();
        blur_mean(&taken, known, width, CHOICE)
    };
    let shares = [1, 2].map(share);
    let mut out = vec![0.0; 3 * n];
    for (j, o) in out.iter_mut().enumerate() {
        let (c, i) = (j / n, j % n);
        *o = shares[0][i] * at(1, c, i) + shares[1][i] * at(2, c, i);
    }
    let mean = |k: usize| best.iter().filter(|b| **b == k).count() as f32 / n as f32;
    (out, [0, 1, 2].map(mean))
}

/// Adds of each pixel's own residual what its noise does not explain; the mean share.
fn add_own(chosen: &mut [f32], residual: &[f32], known: &[f32], noise: &[f32], width: usize) -> f32 {
    let n = known.len();
    let square =
        |i: usize| (0..3).map(|c| (residual[c * n + i] - chosen[c * n + i]).powi(2)).sum::<f32>() / 3.0;
    let left = blur_mean(&(0..n).map(square).collect::<Vec<_>>(), known, width, OWN[0]);
    // A few samples that agree by chance look as if they had no noise.
    let [near, far] = OWN.map(|sigma| blur_mean(noise, known, width, sigma));
    let mut total = 0.0_f64;
    for i in (0..n).filter(|i| known[*i] > 0.0 && left[*i] > 0.0) {
        let gain = (1.0 - near[i].max(far[i]) / left[i]).max(0.0);
        total += f64::from(gain);
        for k in [i, n + i, 2 * n + i] {
            chosen[k] += gain * (residual[k] - chosen[k]);
        }
    }
    (total / n as f64) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::Rng;

    const WIDTH: usize = 96;
    const N: usize = WIDTH * 64;

    fn rms(u: &[f32], v: &[f32]) -> f64 {
        (u.iter().zip(v).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / u.len() as f64).sqrt()
    }

    fn restored(noisy: &[f32], weight: &[f32], variance: Option<&[f32]>, start: &[f32]) -> Vec<f32> {
        let detail = Detail { width: WIDTH, irradiance: noisy, weight, variance, features: &[] };
        let mut u = start.to_vec();
        let shares = restore_detail(&detail, &mut u);
        match shares {
            Shares::Gaussian(share) => assert!(variance.is_none() && (0.0..=1.0).contains(&share)),
            Shares::Bilateral { means, .. } => assert!((means.iter().sum::<f32>() - 1.0).abs() < 1e-4),
        }
        u
    }

    #[test]
    fn a_shadow_comes_back_and_noise_stays_out() {
        let sigma = 0.2_f32;
        let truth: Vec<f32> = (0..3 * N).map(|i| if i % WIDTH < 40 { 0.5 } else { 1.0 }).collect();
        let mut rng = Rng::new(3, 0);
        let noisy: Vec<f32> = truth.iter().map(|t| t + sigma * rng.normal()).collect();
        let (flat, mut weight, variance) = (vec![0.8; 3 * N], vec![1.0; N], vec![sigma * sigma; N]);
        for variance in [Some(&variance[..]), None] {
            let u = restored(&noisy, &weight, variance, &flat);
            println!("shadow {:.4} of {:.4}", rms(&u, &truth), rms(&flat, &truth));
            assert!(rms(&u, &truth) < 0.3 * rms(&flat, &truth), "{} {variance:?}", rms(&u, &truth));
            // Nothing is missing from the truth: the noise must not come in.
            let u = restored(&noisy, &weight, variance, &truth);
            println!("noise {:.4} of {sigma}", rms(&u, &truth));
            assert!(rms(&u, &truth) < 0.35 * f64::from(sigma), "{}", rms(&u, &truth));
        }
        // Holes stay, and have no part in what is around.
        let mut holed = noisy;
        let hole = 20 * WIDTH + 20;
        (0..3).for_each(|c| holed[c * N + hole] = 1e6);
        weight[hole] = 0.0;
        let u = restored(&holed, &weight, Some(&variance), &flat);
        assert!(u[hole] == 0.8 && (u[hole + 1] - 0.5).abs() < 0.2, "{} {}", u[hole], u[hole + 1]);
    }

    #[test]
    fn a_pixel_of_many_samples_is_its_own() {
        // Texture of single pixels, which no mean shows, with noise far below it.
        let mut rng = Rng::new(5, 0);
        let truth: Vec<f32> = (0..3 * N).map(|i| 0.8 + 0.3 * ((i % N) as f32 * 2.4).sin()).collect();
        let noisy: Vec<f32> = truth.iter().map(|t| t + 0.01 * rng.normal()).collect();
        let u = restored(&noisy, &vec![1.0; N], Some(&vec![1e-4; N]), &vec![0.8; 3 * N]);
        assert!(rms(&u, &truth) < 0.015, "{}", rms(&u, &truth));
    }
}
