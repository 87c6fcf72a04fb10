//! Variance of a guide and of the scattering function, each by the paths of both.
//!
//! A path that one of them chose tells what it would have brought and how likely it would have been if the other had chosen
//! its directions, so that both second moments are sums over the paths of both, weighted by the balance heuristic (Veach
//! 1997). Light that the scattering function alone meets once in a million paths is no part of the variance of few of its
//! own paths; those of a guide that looks for it tell it.

use photofit_image::luminance;
use photofit_pathtrace::{Contribution, Found, PathVertex, Renderer, Sink};
use photofit_sampling::{DirectionSample, DirectionSampler, Scattering, Vertex};
use photofit_scalar::Vec3f;
use rayon::prelude::*;
use std::cell::Cell;

/// Pixels along the side of a block whose mean luminance scales the variance of its pixels.
const BLOCK: usize = 4;
/// Share of the mean luminance of the picture added to that of a block: darkness may be noisier.
const DARKNESS: f64 = 0.1;
/// Bounds of the ratio of the densities of a path: more and less make no difference, and could overflow along it.
const RATIO: [f64; 2] = [1e-30, 1e30];
/// Part of the second moment below which a variance is rounding.
const ROUNDING: f64 = 1e-9;

/// Who chooses directions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Chooser {
    /// The scattering function.
    Scattering,
    /// Guide and scattering function, as in the picture.
    Guide,
}

/// Paths that one of them chose, pixel by pixel.
#[derive(Clone, Debug, Default)]
pub(super) struct Trial {
    pub(super) paths: u64,
    /// Path vertices, and rays without one.
    pub(super) work: u64,
    pub(super) columns: usize,
    pub(super) pixels: Vec<Sums>,
    /// Whether any of them brought light.
    pub(super) found_light: bool,
}

/// Sums over the paths of a pixel. With `p` and `q` for the densities of a path without the guide and with it, `f / p` for the
/// luminance that it brings without:
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sums {
    paths: f64,
    /// Of `m = f / (p + q)`: by the paths of both this is the mean.
    mean: f64,
    /// Of `m^2`.
    squares: f64,
    /// Of `(f / p)^2 p / (p + q)` and `(f / q)^2 q / (p + q)`: the second moments.
    second: [f64; 2],
}

impl Sums {
    fn add(&mut self, path: &Path) {
        let [plain, guided] = path.values;
        let share = [1.0 / (1.0 + path.ratio), path.ratio / (1.0 + path.ratio)];
        let mean = plain * share[0];
        self.paths += 1.0;
        self.mean += mean;
        self.squares += mean * mean;
        self.second[0] += plain * plain * share[0];
        self.second[1] += guided * guided * share[1];
    }

    /// The square of the mean of `m`, without bias.
    fn squared_mean(&self) -> f64 {
        (self.mean * self.mean - self.squares) / (self.paths * (self.paths - 1.0)).max(1.0)
    }

    /// Those of a pixel of this mean and these variances, split evenly between the paths of both.
    #[cfg(test)]
    pub(super) fn of(mean: f64, variances: [f64; 2]) -> Self {
        let square = mean * mean;
        Self { paths: 2.0, mean, squares: 0.5 * square, second: variances.map(|v| v + square) }
    }
}

/// Of a pixel, by the paths of both: its mean, the square of it, and the second moments of both; without bias.
fn moments(plain: &Sums, guided: &Sums) -> (f64, f64, [f64; 2]) {
    let of = |v: &Sums, sum: f64| sum / v.paths.max(1.0);
    let [a, b] = [of(plain, plain.mean), of(guided, guided.mean)];
    let square = plain.squared_mean() + guided.squared_mean() + 2.0 * a * b;
    let second = [0, 1].map(|k| of(plain, plain.second[k]) + of(guided, guided.second[k]));
    (a + b, square, second)
}

/// A path under both samplers.
#[derive(Clone, Copy, Debug)]
struct Path {
    /// Luminance without the guide and with it.
    values: [f64; 2],
    /// Density with the guide over that without.
    ratio: f64,
}

impl Default for Path {
    fn default() -> Self {
        Self { values: [0.0; 2], ratio: 1.0 }
    }
}

/// The last densities with the guide over those without.
#[derive(Debug)]
struct Densities {
    /// Of the direction that was chosen last.
    chosen: Cell<f64>,
    /// Of the direction of the light that was connected last.
    light: Cell<f64>,
}

/// Directions of one chooser, with an eye on the other.
struct Watched<'a, D> {
    guide: &'a D,
    chooser: Chooser,
    densities: &'a Densities,
}

impl<D: DirectionSampler> DirectionSampler for Watched<'_, D> {
    type Local = D::Local;

    #[inline]
    fn local<S: Scattering>(&self, at: &Vertex<'_, S>) -> Self::Local {
        self.guide.local(at)
    }

    #[inline]
    fn sample<S: Scattering>(
        &self,
        at: &Vertex<'_, S>,
        local: &Self::Local,
        lobe: f32,
        u: [f32; 2],
    ) -> Option<DirectionSample> {
        let (sample, ratio) = match self.chooser {
            Chooser::Guide => {
                let sample = self.guide.sample(at, local, lobe, u)?;
                (sample, f64::from(sample.preference))
            }
            Chooser::Scattering => {
                let sample = at.scattering.sample(lobe, u)?;
                let other = || f64::from(self.guide.eval_pdf(at, local, sample.wi).1);
                (sample, if sample.delta { 1.0 } else { other() / f64::from(sample.pdf) })
            }
        };
        self.densities.chosen.set(ratio);
        Some(sample)
    }

    #[inline]
    fn eval_pdf<S: Scattering>(&self, at: &Vertex<'_, S>, local: &Self::Local, wi: Vec3f) -> (Vec3f, f32) {
        let guided = self.guide.eval_pdf(at, local, wi);
        let plain = at.scattering.eval_pdf(wi);
        self.densities.light.set(f64::from(guided.1) / f64::from(plain.1));
        match self.chooser {
            Chooser::Scattering => plain,
            Chooser::Guide => guided,
        }
    }

    #[inline]
    fn has_lobes<S: Scattering>(&self, at: &Vertex<'_, S>) -> bool {
        match self.chooser {
            Chooser::Scattering => at.scattering.has_lobes(),
            Chooser::Guide => self.guide.has_lobes(at),
        }
    }
}

/// Follows a path under both samplers.
struct Follower<'a> {
    chooser: Chooser,
    densities: &'a Densities,
    path: Path,
    /// Of the last direction.
    last: f64,
    vertices: u64,
}

impl Follower<'_> {
    fn begin(&mut self) {
        (self.path, self.last) = (Path::default(), 1.0);
        self.densities.chosen.set(1.0);
        self.densities.light.set(1.0);
    }
}

impl Sink for Follower<'_> {
    fn vertex(&mut self, _: &PathVertex) {
        self.vertices += 1;
        // Phase functions choose directions in media.
        let ratio = usable(self.densities.chosen.replace(1.0));
        self.densities.light.set(1.0);
        self.last = ratio;
        self.path.ratio = (self.path.ratio * ratio).clamp(RATIO[0], RATIO[1]);
    }

    fn contribution(&mut self, light: &Contribution) {
        let value = f64::from(luminance(light.value.to_array()));
        let [own, other] = match self.chooser {
            Chooser::Scattering => [0, 1],
            Chooser::Guide => [1, 0],
        };
        // Densities of the chooser over those of the other.
        let over = |ratio: f64| if self.chooser == Chooser::Guide { ratio } else { 1.0 / ratio };
        let met = match light.found {
            Found::NextEvent => 1.0 / over(usable(self.densities.light.replace(1.0))),
            Found::Emission | Found::Environment | Found::Medium => over(self.last),
        };
        // The weight of the other for this light over that of the chooser, by the power heuristic.
        let weight = f64::from(light.weight);
        let change = 1.0 / (weight + met * met * (1.0 - weight));
        self.path.values[own] += value;
        self.path.values[other] += value * over(self.path.ratio) * change;
    }
}

/// 1 where a density is 0 or not a number: nothing is scattered there.
fn usable(ratio: f64) -> f64 {
    if ratio > 0.0 && ratio.is_finite() { ratio } else { 1.0 }
}

impl Trial {
    /// So many samples of every pixel; rows run on all threads and are joined in order.
    pub(super) fn run<D: DirectionSampler + Sync>(
        renderer: &Renderer<'_>,
        samples: u32,
        guide: &D,
        chooser: Chooser,
    ) -> Self {
        let options = renderer.options();
        let (columns, rows) = (options.width, options.height);
        let row = |y: usize| Self::row(renderer, (y, columns), samples, guide, chooser);
        let parts: Vec<Self> = (0..rows).into_par_iter().map(row).collect();
        parts.into_iter().fold(Self { columns, ..Self::default() }, Self::beside)
    }

    fn row<D: DirectionSampler>(
        renderer: &Renderer<'_>,
        (y, columns): (usize, usize),
        samples: u32,
        guide: &D,
        chooser: Chooser,
    ) -> Self {
        let densities = Densities { chosen: Cell::new(1.0), light: Cell::new(1.0) };
        let sampler = Watched { guide, chooser, densities: &densities };
        let mut sink =
            Follower { chooser, densities: &densities, path: Path::default(), last: 1.0, vertices: 0 };
        let mut out = Self { columns, ..Self::default() };
        for x in 0..columns {
            let mut sums = Sums::default();
            for sample in 0..samples {
                sink.begin();
                renderer.walk([x, y], sample, &sampler, &mut sink);
                out.found_light |= sink.path.values != [0.0; 2];
                sums.add(&sink.path);
            }
            out.pixels.push(sums);
        }
        out.paths = columns as u64 * u64::from(samples);
        out.work = out.paths + sink.vertices;
        out
    }

    /// Both, of pictures of one width: the rows of the other follow.
    pub(super) fn beside(mut self, other: Self) -> Self {
        self.pixels.extend(other.pixels);
        self.paths += other.paths;
        self.work += other.work;
        self.found_light |= other.found_light;
        self
    }
}

/// Variance of single samples without the guide and with it, by trials of as many samples of both: the mean over the pixels,
/// relative to the squared luminance around.
pub(super) fn variances(plain: &Trial, guided: &Trial) -> [f64; 2] {
    let pixels: Vec<_> = plain.pixels.iter().zip(&guided.pixels).map(|(a, b)| moments(a, b)).collect();
    let n = pixels.len().max(1) as f64;
    let mean = pixels.iter().map(|p| p.0).sum::<f64>() / n;
    let columns = plain.columns.max(1);
    let width = columns.div_ceil(BLOCK);
    let block = |i: usize| i / columns / BLOCK * width + i % columns / BLOCK;
    let mut blocks = vec![[0.0_f64; 2]; width * (pixels.len() / columns).div_ceil(BLOCK)];
    for (i, pixel) in pixels.iter().enumerate() {
        let sum = &mut blocks[block(i)];
        *sum = [sum[0] + pixel.0, sum[1] + 1.0];
    }
    let (mut squares, mut seconds) = (0.0, [0.0; 2]);
    for (i, (_, square, second)) in pixels.into_iter().enumerate() {
        let [sum, count] = blocks[block(i)];
        let scale = (sum / count + DARKNESS * mean).powi(2).recip();
        squares += scale * square;
        (0..2).for_each(|k| seconds[k] += scale * second[k]);
    }
    seconds.map(|m| if m - squares > ROUNDING * m { (m - squares) / n } else { 0.0 })
}

#[cfg(test)]
mod tests;
