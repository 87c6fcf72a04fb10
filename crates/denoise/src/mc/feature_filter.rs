//! Noise of the features, smoothed out of them: depth of field, media.
//!
//! Where [`noise_share`] finds noise, and the variance of the radiance says that it is none of a fine texture, each feature is averaged over the pixels around, by a bilateral filter whose likeness
//! compares not the features but their Gaussian means: these are nearly equal where the features are noise, and differ
//! across edges, along which they are averaged. The range follows from the variance that the noise around leaves in such a mean.

use super::demodulate::ALBEDO_FLOOR;
use super::feature_noise::noise_share;
use super::frame::Features;
use super::window::blur_mean;
use crate::Shape;
use rayon::prelude::{IndexedParallelIterator, IntoParallelIterator, ParallelIterator};

/// Deviation in pixels of the Gaussian whose means are compared, and of the average; pixels on each side of that.
const GUIDE: f32 = 1.5;
const SIGMA: f32 = 2.0;
const REACH: usize = 5;
/// Deviation of the window in which the noise around is measured, and least range.
const POOL: f32 = 2.0;
const LEAST: f32 = 0.01;
/// Normals count half: they are up to 2 apart, reflectances up to 1.
const NORMAL: f32 = 0.5;
/// Variance over half the squared difference of neighbours from which on the radiance begins to be noise, and wholly is; deviation of
/// the window in which both are compared.
const EXPLAINED: [f32; 2] = [0.85, 1.0];
const NOISE: f32 = 2.5;
/// Where black and other pixels are mixed: deviations of the windows that compare the variance around the mean with that of
/// the mean, and the share of the first at which the mixture begins to be noise, and wholly is.
const MIXED: f32 = 2.0;
const SPREAD: f32 = 3.0;
const RANGE: [f32; 2] = [0.5, 0.8];

/// The share of noise in albedo and normal per pixel, between 0 and 1; `None` without noise.
pub(crate) fn share_of_noise(features: &Features<'_>, shape: Shape) -> Option<Vec<f32>> {
    let (n, width) = (shape.pixels(), shape.width);
    let judged = [features.albedo.as_deref(), features.normal.as_deref()];
    let shares = judged.into_iter().flatten().filter_map(|f| noise_share(f, n, width));
    shares.reduce(|a, b| a.iter().zip(b).map(|(a, b)| a.max(b)).collect())
}

/// Smooths the noise out of the features in place, where the radiance `color` (3 planes) of `variance` is noise as well, and not a
/// texture of single pixels. Returns the share of the pixels that changed.
pub(crate) fn smooth_features(
    features: &mut Features<'_>,
    shape: Shape,
    color: &[f32],
    variance: &[f32],
) -> f32 {
    let Some(mut share) = share_of_noise(features, shape) else { return 0.0 };
    let noise = share_of_variance(color, variance, shape.width);
    share.iter_mut().zip(noise).for_each(|(s, n)| *s *= n);
    if share.iter().all(|s| *s == 0.0) {
        return 0.0;
    }
    let means = Means::of(features, &share, shape.width);
    for feature in [&mut features.albedo, &mut features.normal, &mut features.position].into_iter().flatten()
    {
        *feature = means.smooth(feature).into();
    }
    means.share.iter().sum::<f32>() / share.len() as f32
}

/// Whether the radiance around a pixel differs from pixel to pixel as its variance says (1), or more, as textures and edges do (0).
fn share_of_variance(color: &[f32], variance: &[f32], width: usize) -> Vec<f32> {
    let n = color.len() / 3;
    let level = |i: usize| (color[i] + color[n + i] + color[2 * n + i]) * (1.0 / 3.0);
    let level: Vec<f32> = (0..n).map(level).map(|v| if v.is_finite() { v.abs() } else { 0.0 }).collect();
    let ones = vec![1.0; n];
    let usual = blur_mean(&level, &ones, width, 2.0 * POOL);
    let least = 1e-3 * level.iter().sum::<f32>() / n as f32 + f32::MIN_POSITIVE;
    // In units of the level around, so that bright pixels do not stand for dark ones.
    let relative = |i: usize, v: f32| if v.is_finite() { v / (usual[i] + least).powi(2) } else { 0.0 };
    let apart = |i: usize| {
        let (x, mut sum, mut count) = (i % width, 0.0_f32, 0.0_f32);
        let beside = [(x > 0, i.wrapping_sub(1)), (x + 1 < width, i + 1)];
        let above = [(i >= width, i.wrapping_sub(width)), (i + width < n, i + width)];
        for k in beside.into_iter().chain(above).filter(|(inside, _)| *inside).map(|(_, k)| k) {
            sum += (0..3).map(|c| (color[c * n + i] - color[c * n + k]).powi(2)).sum::<f32>();
            count += 1.0;
        }
        relative(i, 0.5 * sum / count.max(1.0))
    };
    let own = |i: usize| relative(i, variance[i] + variance[n + i] + variance[2 * n + i]);
    let [apart, own] = [(0..n).map(apart).collect::<Vec<f32>>(), (0..n).map(own).collect()];
    let [apart, own] = [apart, own].map(|plane| blur_mean(&plane, &ones, width, NOISE));
    let [low, high] = EXPLAINED;
    let of = |(own, apart): (&f32, &f32)| ((own / apart.max(1e-12) - low) / (high - low)).clamp(0.0, 1.0);
    own.iter().zip(&apart).map(of).collect()
}

/// What the likeness of two pixels is judged by.
struct Means {
    width: usize,
    /// Gaussian means of the features.
    planes: Vec<Vec<f32>>,
    /// Squared range of each pixel.
    range: Vec<f32>,
    /// How much of the average each pixel takes.
    share: Vec<f32>,
}

impl Means {
    fn of(features: &Features<'_>, share: &[f32], width: usize) -> Self {
        let n = share.len();
        let ones = vec![1.0; n];
        let mut planes: Vec<Vec<f32>> = Vec::new();
        let mut black = None;
        if let Some(albedo) = features.albedo.as_deref() {
            planes.extend(albedo.chunks(n).map(<[f32]>::to_vec));
            let dark = |i: usize| (0..3).all(|c| albedo[c * n + i] <= ALBEDO_FLOOR);
            black = Some(planes.len());
            planes.push((0..n).map(|i| f32::from(dark(i))).collect());
        }
        if let Some(normal) = features.normal.as_deref() {
            planes.extend(normal.chunks(n).map(|p| p.iter().map(|v| NORMAL * v).collect::<Vec<_>>()));
        }
        let means: Vec<Vec<f32>> = planes.iter().map(|p| blur_mean(p, &ones, width, GUIDE)).collect();
        let pairs = || planes.iter().zip(&means);
        let rest: Vec<f32> = (0..n).map(|i| pairs().map(|(p, m)| (p[i] - m[i]).powi(2)).sum()).collect();
        let noise = blur_mean(&rest, &ones, width, POOL);
        let pixels = 4.0 * std::f32::consts::PI * GUIDE * GUIDE;
        let range = noise.iter().map(|v| v / pixels + LEAST * LEAST).collect();
        let share = match black {
            Some(black) => unmixed(share, &planes[black], &means, &rest, width),
            None => share.to_vec(),
        };
        Self { width, planes: means, range, share }
    }

    /// A feature with its noise averaged out.
    fn smooth(&self, feature: &[f32]) -> Vec<f32> {
        let n = self.range.len();
        let channels = feature.len() / n;
        let of = |i: usize| {
            let mut own = [0.0; 3];
            (0..channels).for_each(|c| own[c] = feature[c * n + i]);
            if self.share[i] > 0.0 {
                let mean = self.mean(feature, i);
                own.iter_mut().zip(mean).for_each(|(o, m)| *o += self.share[i] * (m - *o));
            }
            own
        };
        let pixels: Vec<[f32; 3]> = (0..n).into_par_iter().with_min_len(1 << 10).map(of).collect();
        (0..channels).flat_map(|c| pixels.iter().map(move |p| p[c])).collect()
    }

    /// The average of up to three planes around pixel `i`.
    fn mean(&self, feature: &[f32], i: usize) -> [f32; 3] {
        let (n, width) = (self.range.len(), self.width);
        let (x, y, height) = (i % width, i / width, n / width);
        let (mut sum, mut total) = ([0.0_f32; 3], 0.0_f32);
        for v in y.saturating_sub(REACH)..(y + REACH + 1).min(height) {
            for u in x.saturating_sub(REACH)..(x + REACH + 1).min(width) {
                let k = v * width + u;
                let away = (u.abs_diff(x).pow(2) + v.abs_diff(y).pow(2)) as f32 / (2.0 * SIGMA * SIGMA);
                let apart: f32 = self.planes.iter().map(|p| (p[i] - p[k]).powi(2)).sum();
                let weight = (-away - apart / (self.range[i] + self.range[k])).exp();
                total += weight;
                sum.iter_mut().zip(feature.chunks(n)).for_each(|(s, plane)| *s += weight * plane[k]);
            }
        }
        sum.map(|s| s / total)
    }
}

/// The share without the outlines of lamps and mirrors: black and other pixels stay apart unless they are mixed all around.
fn unmixed(share: &[f32], black: &[f32], means: &[Vec<f32>], rest: &[f32], width: usize) -> Vec<f32> {
    let n = share.len();
    if !black.contains(&1.0) || !black.contains(&0.0) {
        return share.to_vec();
    }
    let ones = vec![1.0; n];
    let dark = blur_mean(black, &ones, width, MIXED);
    let rest = blur_mean(rest, &ones, width, SPREAD);
    let mut between = vec![0.0_f32; n];
    for plane in means {
        let mean = blur_mean(plane, &ones, width, SPREAD);
        let square = blur_mean(&plane.iter().map(|v| v * v).collect::<Vec<_>>(), &ones, width, SPREAD);
        between.iter_mut().zip(square.iter().zip(&mean)).for_each(|(b, (s, m))| *b += (s - m * m).max(0.0));
    }
    let [low, high] = RANGE;
    let of = |i: usize| {
        let mixed = (100.0 * dark[i] * (1.0 - dark[i])).clamp(0.0, 1.0);
        let noise = rest[i] / (rest[i] + between[i] + 1e-9);
        let noise = ((noise - low) / (high - low)).clamp(0.0, 1.0);
        share[i] * (1.0 - mixed * (1.0 - noise))
    };
    (0..n).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::Rng;

    #[test]
    fn noise_goes_and_the_edge_between_two_mixtures_stays() {
        // A reflectance that is .8 in a third of the pixels on the left and in all of those on the right.
        let (width, height) = (96, 72);
        let (n, mut rng) = (width * height, Rng::new(1, 0));
        let truth = |i: usize| if i % width < 48 { 0.4 } else { 0.8 };
        let plane: Vec<f32> = (0..n)
            .map(|i| if i % width >= 48 || rng.uniform(0.0, 1.0) < 1.0 / 3.0 { 0.8 } else { 0.2 })
            .collect();
        let albedo = plane.repeat(3);
        let shape = Shape::new(width, height, 3);
        let smoothed = |albedo: &[f32], variance: f32| {
            let mut features = Features { albedo: Some(albedo.to_vec().into()), ..Features::default() };
            let changed = smooth_features(&mut features, shape, albedo, &vec![variance; 3 * n]);
            (features.albedo.expect("an albedo").into_owned(), changed)
        };
        // White light: the radiance is the reflectance, and has its variance.
        let (found, changed) = smoothed(&albedo, 0.12);
        assert!((0.4..0.6).contains(&changed), "{changed}");
        let rms = |u: &[f32], from: usize, to: usize| {
            let squares = (0..n).filter(|i| (from..to).contains(&(i % width)));
            let squares: Vec<f32> = squares.map(|i| (u[i] - truth(i)).powi(2)).collect();
            (squares.iter().sum::<f32>() / squares.len() as f32).sqrt()
        };
        assert!(rms(&found, 4, 44) < 0.3 * rms(&albedo, 4, 44), "{}", rms(&found, 4, 44));
        assert!(rms(&found, 52, 96) < 0.02, "{}", rms(&found, 52, 96));
        // The same as a texture: pixels do not vary within.
        assert_eq!(smoothed(&albedo, 0.001), (albedo, 0.0));
        // Features of many samples stay to the bit.
        let smooth: Vec<f32> = (0..3 * n).map(|i| 0.5 + 0.3 * ((i % width) as f32 * 0.2).sin()).collect();
        assert_eq!(smoothed(&smooth, 0.1), (smooth, 0.0));
    }
}
