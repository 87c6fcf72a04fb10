//! Variance of a guide and of the scattering function, each by the paths of both.
//!
//! A path that one of them chose tells what it would have brought and how likely it would have been if the other had chosen
//! its directions, so that both second moments are sums over the paths of both, weighted by the balance heuristic (Veach
//! 1997). Light that the scattering function alone meets once in a million paths is no part of the variance of few of its
//! own paths; those of a guide that looks for it tell it.

use photofit_flow::{Guide, Guided};
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
/// Part of the second moment below which a variance is rounding: values of paths are in single precision.
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
#[derive(Debug, Default)]
pub(super) struct Trial {
    pub(super) paths: u64,
    /// Path vertices, and rays without one.
    pub(super) work: u64,
    /// Columns and rows of a picture; there may be several.
    pub(super) size: [usize; 2],
    pub(super) pixels: Vec<Sums>,
    /// Whether any of them brought light.
    pub(super) found_light: bool,
}

/// Sums over the paths of a pixel, whose densities are `p` without the guide and `q` with it, and which bring `x` without it and `y` with
/// it (in this order).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sums {
    paths: f64,
    /// Of the weights `p / (p + q)` and `q / (p + q)`, which are 1 over the paths of both.
    weight: [f64; 2],
    /// Of `x` and `y` times their weight: the mean, twice.
    mean: [f64; 2],
    /// Of `x^2` and `y^2` times their weight: the second moments.
    second: [f64; 2],
}

impl Sums {
    fn add(&mut self, path: &Path) {
        let weight = [1.0 / (1.0 + path.ratio), path.ratio / (1.0 + path.ratio)];
        self.paths += 1.0;
        for k in 0..2 {
            self.weight[k] += weight[k];
            self.mean[k] += path.values[k] * weight[k];
            self.second[k] += path.values[k] * path.values[k] * weight[k];
        }
    }

    /// Those of a pixel of this mean and these variances, split evenly between the paths of both.
    #[cfg(test)]
    pub(super) fn of(mean: f64, variances: [f64; 2]) -> Self {
        let second = variances.map(|v| v + mean * mean);
        Self { paths: 2.0, weight: [1.0; 2], mean: [mean; 2], second }
    }
}

/// Of a pixel, by the paths of both: its mean, and the second moments of both around it and around 0.
fn moments(plain: &Sums, guided: &Sums) -> (f64, [f64; 2], [f64; 2]) {
    let of = |sums: fn(&Sums) -> [f64; 2]| {
        let [a, b] = [plain, guided].map(|s| sums(s).map(|v| v / s.paths.max(1.0)));
        [a[0] + b[0], a[1] + b[1]]
    };
    let (weights, means, second) = (of(|s| s.weight), of(|s| s.mean), of(|s| s.second));
    let mean = 0.5 * (means[0] + means[1]);
    // Sums of squares, so that what hardly varies is not the difference of two noisy numbers.
    let around = [0, 1].map(|k| second[k] + mean * (mean * weights[k] - 2.0 * means[k]));
    (mean, around, second)
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
struct Watched<'a, G> {
    guide: &'a G,
    chooser: Chooser,
    densities: &'a Densities,
}

impl<G: Guide> DirectionSampler for Watched<'_, G> {
    type Local = Option<G::Local>;

    const COSTLY: bool = true;

    #[inline]
    fn local<S: Scattering>(&self, at: &Vertex<'_, S>) -> Self::Local {
        Guided(self.guide).local(at)
    }

    #[inline]
    fn sample<S: Scattering>(
        &self,
        at: &Vertex<'_, S>,
        local: &Self::Local,
        lobe: f32,
        u: [f32; 2],
    ) -> Option<DirectionSample> {
        let guided = Guided(self.guide);
        let sample = match self.chooser {
            Chooser::Guide => guided.sample(at, local, lobe, u),
            Chooser::Scattering => at.scattering.sample(lobe, u),
        };
        let ratio = match (local, &sample) {
            (None, _) => 1.0,
            (Some(_), Some(sample)) if !sample.delta => {
                let [with, without] = match self.chooser {
                    Chooser::Guide => [sample.pdf, at.scattering.eval_pdf(sample.wi).1],
                    Chooser::Scattering => [guided.pdf(at, local, sample.wi, sample.pdf), sample.pdf],
                };
                f64::from(with) / f64::from(without)
            }
            // Delta lobes, and no direction at all: both are the scattering function's, for guides on the hemisphere and lobes
            // always have a direction.
            (Some(local), _) => 1.0 - f64::from(self.guide.share(local)),
        };
        self.densities.chosen.set(ratio);
        sample
    }

    #[inline]
    fn pdf<S: Scattering>(&self, at: &Vertex<'_, S>, local: &Self::Local, wi: Vec3f, own: f32) -> f32 {
        let guided = Guided(self.guide).pdf(at, local, wi, own);
        self.densities.light.set(f64::from(guided) / f64::from(own));
        match self.chooser {
            Chooser::Scattering => own,
            Chooser::Guide => guided,
        }
    }

    #[inline]
    fn has_lobes<S: Scattering>(&self, at: &Vertex<'_, S>) -> bool {
        match self.chooser {
            Chooser::Scattering => at.scattering.has_lobes(),
            Chooser::Guide => Guided(self.guide).has_lobes(at),
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

impl<'a> Follower<'a> {
    fn new(chooser: Chooser, densities: &'a Densities) -> Self {
        Self { chooser, densities, path: Path::default(), last: 1.0, vertices: 0 }
    }

    /// The path of a sample of a pixel.
    fn follow<G: Guide>(
        &mut self,
        renderer: &Renderer<'_>,
        guide: &G,
        pixel: [usize; 2],
        sample: u32,
    ) -> Path {
        (self.path, self.last) = (Path::default(), 1.0);
        self.densities.chosen.set(1.0);
        self.densities.light.set(1.0);
        let sampler = Watched { guide, chooser: self.chooser, densities: self.densities };
        renderer.walk(pixel, sample, &sampler, self);
        self.chosen();
        self.path
    }

    /// Counts the last direction, also where the path ends with it: the other may never have chosen it.
    fn chosen(&mut self) {
        // Phase functions choose directions in media.
        self.last = usable(self.densities.chosen.replace(1.0));
        self.path.ratio = (self.path.ratio * self.last).clamp(RATIO[0], RATIO[1]);
    }
}

impl Sink for Follower<'_> {
    fn vertex(&mut self, _: &PathVertex) {
        self.vertices += 1;
        self.densities.light.set(1.0);
        self.chosen();
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

/// Within bounds; 1 where neither density is known.
fn usable(ratio: f64) -> f64 {
    if ratio.is_nan() { 1.0 } else { ratio.clamp(RATIO[0], RATIO[1]) }
}

impl Trial {
    /// So many samples of every pixel; rows run on all threads and are joined in order.
    pub(super) fn run<G: Guide + Sync>(
        renderer: &Renderer<'_>,
        samples: u32,
        guide: &G,
        chooser: Chooser,
    ) -> Self {
        let options = renderer.options();
        let size = [options.width, options.height];
        let row = |y: usize| Self::row(renderer, y, samples, guide, chooser);
        let parts: Vec<Self> = (0..options.height).into_par_iter().map(row).collect();
        parts.into_iter().fold(Self { size, ..Self::default() }, Self::beside)
    }

    fn row<G: Guide>(renderer: &Renderer<'_>, y: usize, samples: u32, guide: &G, chooser: Chooser) -> Self {
        let densities = Densities { chosen: Cell::new(1.0), light: Cell::new(1.0) };
        let mut follower = Follower::new(chooser, &densities);
        let (mut out, columns) = (Self::default(), renderer.options().width);
        for x in 0..columns {
            let mut sums = Sums::default();
            for sample in 0..samples {
                let path = follower.follow(renderer, guide, [x, y], sample);
                out.found_light |= path.values != [0.0; 2];
                sums.add(&path);
            }
            out.pixels.push(sums);
        }
        out.paths = columns as u64 * u64::from(samples);
        out.work = out.paths + follower.vertices;
        out
    }

    /// Both, of pictures of one size: the rows of the other follow.
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
    let [columns, rows] = plain.size.map(|n| n.max(1));
    let [across, down] = [columns, rows].map(|n| n.div_ceil(BLOCK));
    let block = |i: usize| {
        let (picture, i) = (i / (columns * rows), i % (columns * rows));
        (picture * down + i / columns / BLOCK) * across + i % columns / BLOCK
    };
    let mut blocks = vec![[0.0_f64; 2]; pixels.len().div_ceil(columns * rows) * across * down];
    for (i, pixel) in pixels.iter().enumerate() {
        let sum = &mut blocks[block(i)];
        *sum = [sum[0] + pixel.0, sum[1] + 1.0];
    }
    let (mut found, mut seconds) = ([0.0; 2], [0.0; 2]);
    for (i, (_, around, second)) in pixels.into_iter().enumerate() {
        let [sum, count] = blocks[block(i)];
        let scale = (sum / count + DARKNESS * mean).powi(2).recip();
        for k in 0..2 {
            found[k] += scale * around[k];
            seconds[k] += scale * second[k];
        }
    }
    [0, 1].map(|k| if found[k] > ROUNDING * seconds[k] { found[k] / n } else { 0.0 })
}

#[cfg(test)]
mod tests;
