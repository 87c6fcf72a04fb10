//! Variance of a guide and of the scattering function, each by the paths of both.
//!
//! A path that one of them chose tells what it would have brought and how likely it would have been if the other had chosen
//! its directions, so that both second moments are sums over the paths of both, weighted by the balance heuristic (Veach
//! 1997). Light that the scattering function alone meets once in a million paths is no part of the variance of few of its
//! own paths; those of a guide that looks for it tell it.

use photofit_flow::{Guide, Guided};
use photofit_image::luminance;
use photofit_pathtrace::{Contribution, Found, PathVertex, Renderer, Sink};
use photofit_sampling::{DirectionSample, DirectionSampler, Scattering, Vertex, hash};
use photofit_scalar::Vec3f;
use rayon::prelude::*;
use std::cell::Cell;

/// Pixels along the side of a block whose mean luminance scales the variance of its pixels.
const BLOCK: usize = 4;
/// Share of the mean luminance of the picture added to that of a block: darkness may be noisier.
const DARKNESS: f64 = 0.1;
/// Tells the numbers of its paths from those of pictures.
const SEED: u64 = 0x9170;
/// Bounds of the ratio of the densities of a path: more and less make no difference, and could overflow along it.
const RATIO: [f64; 2] = [1e-30, 1e30];
/// Part of the second moment below which a variance is rounding: values of paths are in single precision.
const ROUNDING: f64 = 1e-12;

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
    /// Path vertices, and rays without one.
    pub(super) work: u64,
    /// Columns and rows of a picture; there may be several.
    pub(super) size: [usize; 2],
    /// Those of a pixel follow each other, as many of each.
    pub(super) paths: Vec<Path>,
    /// Paths of a pixel.
    pub(super) each: usize,
    /// Whether any of them brought light.
    pub(super) found_light: bool,
}

/// What paths of a pixel add to its mean ([`Path::told`]).
#[derive(Clone, Copy, Debug, Default)]
struct Told {
    paths: f64,
    sum: f64,
    squares: f64,
}

impl Told {
    fn of(paths: &[Path]) -> Self {
        paths.iter().fold(Self::default(), |all, path| all.with(path.told(), 1.0))
    }

    /// With so many more paths that bring `light`; without one where it is -1.
    fn with(self, light: f64, more: f64) -> Self {
        let Self { paths, sum, squares } = self;
        Self { paths: paths + more, sum: sum + more * light, squares: squares + more * light * light }
    }

    fn mean(&self) -> f64 {
        self.sum / self.paths.max(1.0)
    }

    /// Variance of the mean; 0 where too few paths tell it.
    fn uncertainty(&self) -> f64 {
        let Self { paths: n, sum, squares } = *self;
        if n > 1.0 { (squares - sum * sum / n).max(0.0) / (n * (n - 1.0)) } else { 0.0 }
    }
}

/// Of a pixel, by its paths of both: its mean, and the second moments of both samplers around it and around 0.
///
/// Each path is held against the mean that the others tell, whose own variance is taken off: against a mean that it is part of, a
/// path of the sampler that found light would vary less than it does.
fn moments(trials: [&[Path]; 2]) -> (f64, [f64; 2], [f64; 2]) {
    let all = trials.map(Told::of);
    let (mut around, mut second) = ([0.0; 2], [0.0; 2]);
    for (of, paths) in trials.into_iter().enumerate() {
        for path in paths {
            let others = [all[of].with(path.told(), -1.0), all[1 - of]];
            let mean: f64 = others.iter().map(Told::mean).sum();
            let spread: f64 = others.iter().map(Told::uncertainty).sum();
            let weight = path.weights();
            for k in 0..2 {
                let share = weight[k] / all[of].paths;
                around[k] += share * ((path.values[k] - mean).powi(2) - spread);
                second[k] += share * path.values[k].powi(2);
            }
        }
    }
    (all.iter().map(Told::mean).sum(), around, second)
}

/// A path under both samplers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Path {
    /// Luminance without the guide and with it.
    pub(super) values: [f64; 2],
    /// Density with the guide over that without.
    pub(super) ratio: f64,
}

impl Path {
    /// Weights of the balance heuristic for what it brings without the guide and with it. The mean of each over the paths of one chooser and
    /// that over those of the other sum to 1.
    fn weights(&self) -> [f64; 2] {
        [1.0 / (1.0 + self.ratio), self.ratio / (1.0 + self.ratio)]
    }

    /// What it adds to the mean of its pixel, which is that over the paths of one chooser and that over those of the other together: half of
    /// what it brings without the guide and with it, each by its weight.
    fn told(&self) -> f64 {
        let weight = self.weights();
        0.5 * (weight[0] * self.values[0] + weight[1] * self.values[1])
    }

    /// Paths of a pixel of this mean and these variances, of both trials, told exactly: none moves the mean. Where one variance alone is 0, the
    /// other is told more or less.
    #[cfg(test)]
    pub(super) fn varied(mean: f64, variances: [f64; 2]) -> Vec<Self> {
        let ratio = variances[0] / variances[1];
        if !(ratio.is_finite() && ratio > 0.0) {
            let path = |sign: f64| Self { values: variances.map(|v| mean + sign * v.sqrt()), ratio: 1.0 };
            return vec![path(1.0), path(-1.0), path(1.0), path(-1.0)];
        }
        let off = (variances[0] * (1.0 + ratio)).sqrt();
        let path = |sign: f64| Self { values: [mean + sign * off, mean - sign * off / ratio], ratio };
        let even = Self { values: [mean; 2], ratio: ratio.recip() };
        vec![path(1.0), path(-1.0), even, even]
    }
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
        let (columns, each) = (renderer.options().width, samples as usize);
        let mut out = Self { each, ..Self::default() };
        for x in 0..columns {
            let pixel = (y * columns + x) as u64;
            for sample in 0..samples {
                // Not the first ones of a pixel, which are stratified together: each is to tell of single ones.
                let number = (hash(SEED, pixel, u64::from(sample)) >> 32) as u32;
                let path = follower.follow(renderer, guide, [x, y], number);
                out.found_light |= path.values != [0.0; 2];
                out.paths.push(path);
            }
        }
        out.work = out.paths.len() as u64 + follower.vertices;
        out
    }

    /// Both, of pictures of one size: the rows of the other follow.
    pub(super) fn beside(mut self, other: Self) -> Self {
        debug_assert!(self.paths.is_empty() || self.each == other.each, "as many paths of each pixel");
        self.paths.extend(other.paths);
        self.each = other.each;
        self.work += other.work;
        self.found_light |= other.found_light;
        self
    }
}

/// Variance of single samples without the guide and with it, by trials of as many samples of both: of what [`told`] says that by which the
/// guide pays less. Noise in the dark does not make up for noise in the bright, nor the other way round. 0 where nothing varies
/// beyond what is uncertain of it.
pub(super) fn variances(plain: &Trial, guided: &Trial) -> [f64; 2] {
    let varying = told(plain, guided).into_iter().filter(|v| v[0] > 0.0 || v[1] > 0.0);
    varying.reduce(|a, b| if b[0] * a[1] < a[0] * b[1] { b } else { a }).unwrap_or_default()
}

/// Variances without the guide and with it, means over the pixels: relative to the squared luminance around, and as they are.
fn told(plain: &Trial, guided: &Trial) -> [[f64; 2]; 2] {
    let [without, with] = [plain, guided].map(|trial| trial.paths.chunks(trial.each.max(1)));
    let pixels: Vec<_> = without.zip(with).map(|(a, b)| moments([a, b])).collect();
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
    let around = |i: usize| {
        let [sum, count] = blocks[block(i)];
        (sum / count + DARKNESS * mean).powi(2).recip()
    };
    let over = |scale: &dyn Fn(usize) -> f64| {
        let (mut found, mut seconds) = ([0.0; 2], [0.0; 2]);
        for (i, (_, around, second)) in pixels.iter().enumerate() {
            let scale = scale(i);
            for k in 0..2 {
                found[k] += scale * around[k];
                seconds[k] += scale * second[k];
            }
        }
        [0, 1].map(|k| if found[k] > ROUNDING * seconds[k] { found[k] / n } else { 0.0 })
    };
    [over(&around), over(&|_| 1.0)]
}

#[cfg(test)]
mod tests;
