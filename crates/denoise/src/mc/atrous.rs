//! Edge-stopping a-trous wavelets guided by the variance (SVGF) [@schied2017; @dammertz2010]: the baseline that the
//! other models are compared with.

use super::frame::Features;
use super::window::blur_mean;
use crate::Shape;
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};

/// Levels; the last reaches 2 * 2^4 pixels to each side.
const LEVELS: usize = 5;
/// Taps of the cubic B-spline.
const SPLINE: [f32; 3] = [3.0 / 8.0, 1.0 / 4.0, 1.0 / 16.0];
/// Strictness of the luminance, in standard deviations.
const SIGMA_LUMINANCE: f32 = 4.0;

/// Filters 3 planes of irradiance with the variance of their mean over the channels (1 plane). Pixels of weight 0 take
/// no part and are filled where a neighbour does.
pub(crate) fn atrous(
    shape: Shape,
    features: &Features<'_>,
    irradiance: &[f32],
    variance: &[f32],
    weight: &[f32],
) -> Vec<f32> {
    let n = shape.pixels();
    let mut state =
        State { color: irradiance.to_vec(), variance: variance.to_vec(), weight: weight.to_vec() };
    for level in 0..LEVELS {
        let deviation: Vec<f32> = blur_mean(&state.variance, weight, shape.width, 0.8)
            .into_iter()
            .map(|v| v.max(0.0).sqrt())
            .collect();
        state = state.level(shape, features, &deviation, 1 << level);
    }
    for i in (0..n).filter(|i| state.weight[*i] == 0.0) {
        (0..3).for_each(|c| state.color[c * n + i] = 0.0);
    }
    state.color
}

struct State {
    color: Vec<f32>,
    variance: Vec<f32>,
    weight: Vec<f32>,
}

impl State {
    fn level(&self, shape: Shape, features: &Features<'_>, deviation: &[f32], step: usize) -> Self {
        let (n, width) = (shape.pixels(), shape.width);
        // Colour, variance and weight of a pixel side by side, so that rows can be filled in parallel.
        let mut out = vec![[0.0_f32; 5]; n];
        out.par_chunks_mut(width).enumerate().with_min_len(4).for_each(|(y, out)| {
            for (x, o) in out.iter_mut().enumerate() {
                *o = self.filter(shape, features, deviation, step, y, x);
            }
        });
        let plane = |c: usize| out.iter().map(move |p| p[c]);
        Self {
            color: (0..3).flat_map(plane).collect(),
            variance: plane(3).collect(),
            weight: plane(4).collect(),
        }
    }

    fn filter(
        &self,
        shape: Shape,
        features: &Features<'_>,
        deviation: &[f32],
        step: usize,
        y: usize,
        x: usize,
    ) -> [f32; 5] {
        let (n, height, width) = (shape.pixels(), shape.height as isize, shape.width as isize);
        let at = |plane: &[f32], i: usize| -> [f32; 3] { [plane[i], plane[n + i], plane[2 * n + i]] };
        let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let level = |i: usize| (self.color[i] + self.color[n + i] + self.color[2 * n + i]) * (1.0 / 3.0);
        let i = y * shape.width + x;
        let luminance = 1.0 / (SIGMA_LUMINANCE * deviation[i] + 1e-6);
        let (own, known) = (level(i), self.weight[i] > 0.0);
        let slope = features.depth.as_ref().map(|z| {
            let d = |a: usize, b: usize| z[a] - z[b];
            let right = if x + 1 < shape.width {
                d(i + 1, i)
            } else if x > 0 {
                d(i, i - 1)
            } else {
                0.0
            };
            let below = if y + 1 < shape.height {
                d(i + shape.width, i)
            } else if y > 0 {
                d(i, i - shape.width)
            } else {
                0.0
            };
            [right, below]
        });
        let (mut sum, mut total, mut squares) = ([0.0_f32; 3], 0.0_f32, 0.0_f32);
        for dy in -2_isize..=2 {
            for dx in -2_isize..=2 {
                let (qy, qx) = (y as isize + dy * step as isize, x as isize + dx * step as isize);
                if qy < 0 || qx < 0 || qy >= height || qx >= width {
                    continue;
                }
                let q = (qy * width + qx) as usize;
                let mut exponent = if known { (level(q) - own).abs() * luminance } else { 0.0 };
                if let (Some(z), Some(slope)) = (&features.depth, slope) {
                    let expected =
                        (slope[0] * (qx - x as isize) as f32 + slope[1] * (qy - y as isize) as f32).abs();
                    exponent += (z[q] - z[i]).abs() / (expected + 1e-3 * z[i].abs() + 1e-12);
                } else if let (Some(p), Some(m)) = (&features.position, &features.normal) {
                    let (a, b) = (at(p, i), at(p, q));
                    let d = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
                    exponent += dot(d, at(m, i)).abs() / (0.05 * dot(d, d).sqrt() + 1e-6);
                }
                let mut w = SPLINE[dx.unsigned_abs()] * SPLINE[dy.unsigned_abs()] * (-exponent).exp();
                if let Some(m) = &features.normal {
                    let (a, b) = (at(m, i), at(m, q));
                    // Where the ray meets nothing the normal is 0: such pixels belong together.
                    let cosine = if dot(a, a) + dot(b, b) == 0.0 { 1.0 } else { dot(a, b).clamp(0.0, 1.0) };
                    w *= cosine.powi(64);
                }
                w *= self.weight[q];
                let color = at(&self.color, q);
                (0..3).for_each(|c| sum[c] += w * color[c]);
                total += w;
                squares += w * w * self.variance[q];
            }
        }
        if total <= 1e-12 {
            return [
                self.color[i],
                self.color[n + i],
                self.color[2 * n + i],
                self.variance[i],
                self.weight[i],
            ];
        }
        let k = 1.0 / total;
        [sum[0] * k, sum[1] * k, sum[2] * k, squares * k * k, 1.0]
    }
}

/// Variance of the mean over the channels from the 7 x 7 neighbourhood of each pixel, for pictures without history.
pub(crate) fn spatial_variance(shape: Shape, irradiance: &[f32], weight: &[f32]) -> Vec<f32> {
    let n = shape.pixels();
    let level: Vec<f32> =
        (0..n).map(|i| (irradiance[i] + irradiance[n + i] + irradiance[2 * n + i]) * (1.0 / 3.0)).collect();
    let square: Vec<f32> = level.iter().map(|v| v * v).collect();
    let mean = blur_mean(&level, weight, shape.width, 2.0);
    let second = blur_mean(&square, weight, shape.width, 2.0);
    second.iter().zip(mean).map(|(s, m)| (s - m * m).max(0.0)).collect()
}
