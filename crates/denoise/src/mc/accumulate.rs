//! Temporal accumulation by reprojection [@schied2017].
//!
//! Each pixel's surface point is looked up in the previous frame; of the four pixels around it those that show the
//! same surface are averaged, weighted by what they hold, and the new sample of weight `w` is mixed in with
//! `max(w/(count + w), minimum w)`, where `count` is the sum of the weights so far. Sums are linear in the
//! radiance: logarithms are taken afterwards, for the mean of logarithms is darker than the logarithm of the mean.

use super::camera::Camera;
use super::window::{blur_sums, gaussian_taps};
use crate::DenoiseError;
use rayon::prelude::{
    IndexedParallelIterator, IntoParallelIterator, IntoParallelRefIterator, IntoParallelRefMutIterator,
    ParallelIterator,
};

/// When history is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TemporalSettings {
    /// Smallest weight of a new frame; 0 averages all frames of a static view.
    pub minimum: f32,
    /// Largest distance of the earlier point from the tangent plane, as a share of the depth.
    pub plane: f32,
    /// Smallest cosine between the normals.
    pub normal: f32,
    /// Standard errors by which the light around a pixel may differ from its history before the history counts less:
    /// reflections and shadows move over their surfaces. Infinity trusts every history.
    pub change: f32,
}

impl Default for TemporalSettings {
    fn default() -> Self {
        Self { minimum: 0.05, plane: 0.02, normal: 0.9, change: 3.5 }
    }
}

/// What is known of a pixel.
#[derive(Clone, Copy, Debug, Default)]
struct Pixel {
    mean: [f32; 3],
    /// The mean over the channels, and the mean over the channels of the squares.
    moments: [f32; 2],
    /// Sum of the weights of the frames, and the sum of their squared shares of the mean.
    count: f32,
    squares: f32,
}

/// The running means of a sequence.
#[derive(Clone, Debug)]
pub struct Accumulator {
    width: usize,
    height: usize,
    settings: TemporalSettings,
    pixels: Vec<Pixel>,
    normal: Vec<f32>,
    position: Vec<f32>,
    camera: Option<Camera>,
}

/// One frame for [`Accumulator::add`].
#[derive(Clone, Copy, Debug)]
pub struct TemporalFrame<'a> {
    /// 3 planes, demodulated, linear, finite.
    pub irradiance: &'a [f32],
    /// One value per pixel, at most 1: how far the sample can be trusted; 0 is a hole.
    pub weight: &'a [f32],
    /// 3 planes; 0 where the ray meets nothing.
    pub normal: &'a [f32],
    /// 3 planes of world positions.
    pub position: &'a [f32],
    /// The projection.
    pub camera: Camera,
}

impl Accumulator {
    /// Without history.
    pub fn new(width: usize, height: usize, settings: TemporalSettings) -> Self {
        let pixels = vec![Pixel::default(); height * width];
        Self { width, height, settings, pixels, normal: Vec::new(), position: Vec::new(), camera: None }
    }

    /// Adds a frame; returns the number of pixels whose history was dropped (all of the first frame).
    ///
    /// # Errors
    /// If a plane has a wrong length.
    pub fn add(&mut self, frame: &TemporalFrame<'_>) -> Result<usize, DenoiseError> {
        let n = self.height * self.width;
        let shape = crate::Shape::new(self.width, self.height, 3);
        for (name, plane, channels) in [
            ("the irradiance", frame.irradiance, 3),
            ("the weight", frame.weight, 1),
            ("the normal", frame.normal, 3),
            ("the position", frame.position, 3),
        ] {
            DenoiseError::length(name, plane.len(), channels * n, shape)?;
        }
        let old = |i: usize| self.history(frame, i).unwrap_or_default();
        let mut pixels: Vec<Pixel> = (0..n).into_par_iter().with_min_len(1 << 12).map(old).collect();
        if self.camera.is_some() && self.settings.change.is_finite() {
            forget_changes(frame, self.width, self.settings.change, &mut pixels);
        }
        pixels
            .par_iter_mut()
            .enumerate()
            .with_min_len(1 << 12)
            .for_each(|(i, p)| *p = self.mixed(frame, i, *p));
        self.pixels = pixels;
        self.normal.clear();
        self.normal.extend_from_slice(frame.normal);
        self.position.clear();
        self.position.extend_from_slice(frame.position);
        self.camera = Some(frame.camera);
        Ok(self.pixels.iter().filter(|p| p.squares >= 1.0 || p.count == 0.0).count())
    }

    /// The history `old` of a pixel with its new sample.
    fn mixed(&self, frame: &TemporalFrame<'_>, i: usize, old: Pixel) -> Pixel {
        let n = self.pixels.len();
        if frame.weight[i] == 0.0 {
            return old;
        }
        let now: [f32; 3] = std::array::from_fn(|c| frame.irradiance[c * n + i]);
        let level = frame.level(i);
        let square = (now[0] * now[0] + now[1] * now[1] + now[2] * now[2]) * (1.0 / 3.0);
        let weight = frame.weight[i];
        let count = old.count + weight;
        let a = (weight / count).max(self.settings.minimum * weight).min(1.0);
        let mix = |old: f32, new: f32| old + a * (new - old);
        Pixel {
            mean: std::array::from_fn(|c| mix(old.mean[c], now[c])),
            moments: [mix(old.moments[0], level), mix(old.moments[1], square)],
            count,
            squares: (1.0 - a) * (1.0 - a) * old.squares + a * a,
        }
    }

    /// The history of pixel `i` of the new frame.
    fn history(&self, frame: &TemporalFrame<'_>, i: usize) -> Option<Pixel> {
        let n = self.pixels.len();
        let at = |plane: &[f32], i: usize| -> [f32; 3] { std::array::from_fn(|c| plane[c * n + i]) };
        let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let camera = self.camera?;
        let (p, normal) = (at(frame.position, i), at(frame.normal, i));
        if dot(normal, normal) < 0.25 {
            return None;
        }
        let [x, y] = camera.project(p)?;
        let (x, y) = (x - 0.5, y - 0.5);
        let (width, height) = (self.width as f64, self.height as f64);
        if !(x > -1.0 && y > -1.0 && x < width && y < height) {
            return None;
        }
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = ((x - x0) as f32, (y - y0) as f32);
        let reach = self.settings.plane * camera.depth(p) as f32;
        let mut out = Pixel::default();
        let (mut total, mut covered) = (0.0, 0.0);
        for (dx, dy, w) in [
            (0, 0, (1.0 - fx) * (1.0 - fy)),
            (1, 0, fx * (1.0 - fy)),
            (0, 1, (1.0 - fx) * fy),
            (1, 1, fx * fy),
        ] {
            let (tx, ty) = (x0 as i64 + dx, y0 as i64 + dy);
            if tx < 0 || ty < 0 || tx >= self.width as i64 || ty >= self.height as i64 {
                continue;
            }
            let k = ty as usize * self.width + tx as usize;
            let (q, m, old) = (at(&self.position, k), at(&self.normal, k), &self.pixels[k]);
            let offset = dot([q[0] - p[0], q[1] - p[1], q[2] - p[2]], normal).abs();
            if old.count == 0.0 || offset > reach || dot(m, normal) < self.settings.normal {
                continue;
            }
            covered += w;
            out.count += w * old.count;
            let w = w * old.count;
            total += w;
            (0..3).for_each(|c| out.mean[c] += w * old.mean[c]);
            (0..2).for_each(|c| out.moments[c] += w * old.moments[c]);
            out.squares += w * old.squares;
        }
        if covered < 0.01 {
            return None;
        }
        let scale = 1.0 / total;
        out.mean.iter_mut().chain(&mut out.moments).for_each(|v| *v *= scale);
        out.count /= covered;
        out.squares *= scale;
        Some(out)
    }

    /// The mean, 3 planes.
    pub fn mean(&self) -> Vec<f32> {
        (0..3).flat_map(|c| self.pixels.iter().map(move |p| p.mean[c])).collect()
    }

    /// Sum of the weights in the mean of each pixel, the number of frames where all are 1; 0 at holes.
    pub fn counts(&self) -> Vec<f32> {
        self.pixels.iter().map(|p| p.count).collect()
    }

    /// Effective number of frames of each pixel, `1 / sum w^2`; 0 at holes.
    pub fn effective(&self) -> Vec<f32> {
        self.pixels.iter().map(|p| if p.squares > 0.0 { 1.0 / p.squares } else { 0.0 }).collect()
    }

    /// Variance of the mean, averaged over the channels, `(m2 - m1^2) S/(1-S)` with `S` the sum of the squared weights;
    /// `None` where a single frame was seen.
    pub fn variance(&self) -> Vec<Option<f32>> {
        let of = |p: &Pixel| {
            let [r, g, b] = p.mean;
            let spread = (p.moments[1] - (r * r + g * g + b * b) * (1.0 / 3.0)).max(0.0);
            (p.squares > 0.0 && p.squares < 0.999).then(|| spread * p.squares / (1.0 - p.squares))
        };
        self.pixels.iter().map(of).collect()
    }
}

impl TemporalFrame<'_> {
    /// Mean over the channels.
    fn level(&self, i: usize) -> f32 {
        let n = self.weight.len();
        (self.irradiance[i] + self.irradiance[n + i] + self.irradiance[2 * n + i]) * (1.0 / 3.0)
    }
}

/// Deviation in pixels of the window in which the new light is compared with the history.
const WINDOW: f32 = 4.0;
/// Pixels that a filter averages at least: a bias, unlike noise, is common to them.
const POOLED: f32 = 20.0;

/// Lowers the counts of histories that the new frame contradicts.
///
/// Around each pixel the mean difference `d` of the new samples from the history has the variance `s^2 / N`, `s^2` that of
/// the differences and `N = 4 pi sigma^2` the pixels of the window. What `d^2` has beyond `change^2` of it is a bias `b^2`,
/// and the history counts like samples of the variance `s^2 / count + 20 b^2`.
fn forget_changes(frame: &TemporalFrame<'_>, width: usize, change: f32, history: &mut [Pixel]) {
    let difference = |(i, p): (usize, &Pixel)| match frame.weight[i] > 0.0 && p.count > 0.0 {
        true => (1.0, frame.level(i) - p.moments[0]),
        false => (0.0, 0.0),
    };
    let differences = history.par_iter().enumerate().with_min_len(1 << 12).map(difference);
    let (known, difference): (Vec<f32>, Vec<f32>) = differences.unzip();
    let square = difference.iter().map(|d| d * d).collect();
    let taps = gaussian_taps(WINDOW);
    // Pixels of a window over the sum of its weights.
    let share = 4.0 * std::f32::consts::PI * (WINDOW / (2.0 * taps.iter().sum::<f32>() - taps[0])).powi(2);
    let [weight, first, second] = [known, difference, square].map(|plane| blur_sums(&plane, width, &taps));
    history.par_iter_mut().enumerate().with_min_len(1 << 12).for_each(|(i, p)| {
        if p.count == 0.0 || weight[i] <= 0.0 {
            return;
        }
        let (mean, square) = (first[i] / weight[i], second[i] / weight[i]);
        let variance = (square - mean * mean).max(1e-12);
        let bias = (mean * mean - change * change * variance / (share * weight[i])).max(0.0);
        p.count = 1.0 / (1.0 / p.count + POOLED * bias / variance);
    });
}
