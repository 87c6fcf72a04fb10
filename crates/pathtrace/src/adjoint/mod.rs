//! Derivatives of pictures by path replay: gradients of a loss with respect to materials, textures and lights.
//!
//! [`Adjoint::render`] makes a picture; [`Adjoint::render_vjp`] takes the gradient of a loss with respect to its pixels
//! and gives the gradient with respect to the parameters. Memory does not grow with the length of paths: a path is
//! walked twice with the same random numbers (Vicini, Speierer and Jakob 2021, "Path Replay Backpropagation"); what is
//! short is walked once, and its second walk told from memory. The walk is that of the renderer; only its sinks differ.
//!
//! - Picture and gradient take different random numbers. With the same ones, the gradient of a loss that is not linear in
//!   the picture would be biased by the covariance of the two.
//! - Where pixel filters overlap, a sample counts for every pixel that its place is in the reach of.
//! - Derivatives are those of the radiance that surfaces send out: what moves edges (positions, coverage) has none.
//! - Media are differentiated by what they let through and by what they scatter, each where its density is small as well
//!   as where it is large (`volume`).
//! - A colour channel of a surface that is exactly 0 hides light found by scattering from its own derivative: use a small number.

mod accumulate;
mod layout;
mod parameter;
mod range;
mod replay;
mod surface;
mod tape;
mod values;
mod volume;

pub use parameter::{MaterialValue, Parameter};

use crate::PathtraceError;
use crate::camera::View;
use crate::error::invalid;
use crate::film::TILE;
use crate::integrator::PathOptions;
use crate::integrator::path::walk;
use crate::plan::{self, Features};
use crate::random::{PathRandom, PixelRandom};
use crate::render::{RenderOptions, Renderer, film_point, ray_through};
use crate::world::{World, WorldRay};
use accumulate::{Accumulator, Sparse, larger};
use layout::Layout;
use photofit_image::Image;
use photofit_sampling::{DirectionSampler, ScatteringSampler, hash};
use photofit_scalar::Vec3f;
use rayon::prelude::*;
use replay::{Replay, Total};
use std::borrow::Cow;
use std::sync::{Mutex, PoisonError};
use tape::Recorder;

/// Samples of a pixel in one task, and tasks between two reductions: bounds on what waits to be summed.
const SAMPLES: u32 = 8;
const TASKS: usize = 32;
/// Independent estimates behind a standard error.
const REPLICATES: u32 = 16;
/// Tells the random numbers of gradients from those of pictures.
const GRADIENT_KEY: u64 = 0x6772_6164;

/// How many samples a gradient takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GradientSamples {
    /// Samples per pixel, at least 1.
    pub spp: u32,
    /// Their seed; `None`: one that follows from the picture's, and differs from it.
    pub seed: Option<u64>,
}

impl GradientSamples {
    /// Independent estimates behind a standard error, at most 16, and samples per pixel of each: together at least
    /// [`Self::spp`].
    pub fn estimates(self) -> [u32; 2] {
        let count = self.spp.clamp(1, REPLICATES);
        [count, self.spp.div_ceil(count)]
    }
}

/// Gradients of a loss.
#[derive(Clone, Debug, PartialEq)]
pub struct Gradient {
    /// One per parameter, in the order of [`Adjoint::new`].
    pub parameters: Vec<ParameterGradient>,
    /// Largest part of a path's light that was left over at its end: rounding, else a fault of the replay.
    pub residual: f64,
    /// Contributions that were left out because they were not finite.
    pub not_finite: u64,
}

/// Gradient with respect to one parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterGradient {
    /// Channels of every value: 1 or 3.
    pub channels: usize,
    /// The channels of all values, value by value.
    pub values: Vec<f64>,
}

impl ParameterGradient {
    /// The first `count` of the channels of all values, value by value.
    ///
    /// # Panics
    /// If there are fewer.
    pub fn first_channels(&self, count: usize) -> Cow<'_, [f64]> {
        assert!((1..=self.channels).contains(&count), "{count} of {} channels", self.channels);
        if count == self.channels {
            return Cow::Borrowed(&self.values);
        }
        self.values.chunks_exact(self.channels).flat_map(|v| &v[..count]).copied().collect()
    }
}

/// A picture of a world as a function of parameters, with its derivatives.
///
/// ```
/// use photofit_image::Image;
/// use photofit_pathtrace::{Adjoint, EnvironmentMap, GradientSamples, Parameter, Parts, RenderOptions, View, World};
/// use photofit_scalar::Vec3;
/// use photofit_scene::Camera;
/// let mut parts = Parts::default();
/// parts.environment = Some(EnvironmentMap::constant(Vec3::splat(0.5)));
/// let world = World::new(parts)?;
/// let camera = Camera::look_at(glam::Vec3::Z, glam::Vec3::ZERO, glam::Vec3::Y, 0.8, 1.0, 0.1, 10.0);
/// let options = RenderOptions { width: 8, height: 8, spp: 4, ..RenderOptions::default() };
/// let adjoint = Adjoint::new(&world, &View::pinhole(&camera), options, &[Parameter::Environment])?;
/// // The loss is the sum of the red of all pixels.
/// let loss = Image::from_fn(8, 8, 3, |_, _, c| if c == 0 { 1.0 } else { 0.0 });
/// let gradient = adjoint.render_vjp(&loss, GradientSamples { spp: 1, seed: None })?;
/// assert!((gradient.parameters[0].values[0] - 64.0).abs() < 1e-9);
/// # Ok::<(), photofit_pathtrace::PathtraceError>(())
/// ```
#[derive(Debug)]
pub struct Adjoint<'a> {
    world: &'a World,
    view: View,
    options: RenderOptions,
    layout: Layout,
    kernel: ReplayKernel,
    /// There are media.
    volumes: bool,
    /// Reports of a path that are kept for its replay ([`tape`]).
    pub(crate) kept: usize,
}

/// The replay of one path.
type ReplayKernel = fn(&World, &WorldRay, &PathRandom, &PathOptions, &mut Replay<'_>);

impl<'a> Adjoint<'a> {
    /// A differentiable picture of `world`.
    ///
    /// # Errors
    /// As [`Renderer::new`]; if a parameter is not there, is given twice, or has no derivatives (positions, transmitting
    /// and anisotropic library materials).
    pub fn new(
        world: &'a World,
        view: &View,
        options: RenderOptions,
        parameters: &[Parameter],
    ) -> Result<Self, PathtraceError> {
        let layout = Layout::new(world, parameters)?.with_media(world, parameters);
        let plan = *Renderer::new(world, view, options.clone())?.plan();
        let absorption = if layout.absorption { plan::ABSORPTION } else { 0 };
        let needs = Features(plan.needs.0 | absorption | options.further.0);
        let set = REPLAYS.iter().find(|(set, _)| Features(*set).contains(needs));
        let kernel = set.map_or(replay_scattering::<{ plan::ALL }> as ReplayKernel, |s| s.1);
        let volumes = needs.contains(Features(plan::VOLUMES));
        Ok(Self { world, view: *view, options, layout, kernel, volumes, kept: tape::LENGTH })
    }

    /// Sums parameters of more than `most` cells in pages, and others densely; the parameters are its own.
    #[cfg(test)]
    pub(crate) fn sum_densely_up_to(&mut self, most: usize, parameters: &[Parameter]) {
        let layout = Layout::with_most_dense(self.world, parameters, [most; 2]).expect("they were taken");
        self.layout = layout.with_media(self.world, parameters);
    }

    /// The picture: linear colour with alpha, premultiplied.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn render(&self) -> Result<Image, PathtraceError> {
        let mut renderer = Renderer::new(self.world, &self.view, self.options.clone())?;
        renderer.finish();
        Ok(renderer.picture())
    }

    /// Adjoint of [`Self::render`]: the gradient of a loss with respect to the parameters, from that with respect to the
    /// colour of the pixels (`loss`, three channels; of more the first three count).
    ///
    /// # Errors
    /// If the image has another size than the picture, fewer channels, or values that are not finite, or no sample is
    /// wanted.
    pub fn render_vjp(&self, loss: &Image, samples: GradientSamples) -> Result<Gradient, PathtraceError> {
        self.check(loss, samples, 1)?;
        let seed = self.seed(samples);
        Ok(self.estimate(loss, samples.spp, seed, self.kernel))
    }

    /// As [`Self::render_vjp`], with directions of `sampler` at surfaces, as [`Renderer::pass_with`] makes pictures: gradients
    /// have the same expectation, and less noise where the sampler knows where light comes from.
    ///
    /// # Errors
    /// As [`Self::render_vjp`].
    pub fn render_vjp_with<D: DirectionSampler + Sync>(
        &self,
        sampler: &D,
        loss: &Image,
        samples: GradientSamples,
    ) -> Result<Gradient, PathtraceError> {
        self.check(loss, samples, 1)?;
        let seed = self.seed(samples);
        if self.volumes {
            let kernel = |world: &World,
                          ray: &WorldRay,
                          random: &PathRandom,
                          options: &PathOptions,
                          out: &mut Replay<'_>| {
                replay::<{ plan::ALL }, D>(world, ray, random, options, sampler, out);
            };
            return Ok(self.estimate(loss, samples.spp, seed, kernel));
        }
        let kernel = |world: &World,
                      ray: &WorldRay,
                      random: &PathRandom,
                      options: &PathOptions,
                      out: &mut Replay<'_>| {
            replay::<{ plan::ALL & !plan::VOLUMES }, D>(world, ray, random, options, sampler, out);
        };
        Ok(self.estimate(loss, samples.spp, seed, kernel))
    }

    /// As [`Self::render_vjp`], with the standard error of every value from independent estimates of equal size; `spp`
    /// is at least 2 and rounded up to a multiple of their number, at most 16.
    ///
    /// # Errors
    /// As [`Self::render_vjp`].
    pub fn render_vjp_with_error(
        &self,
        loss: &Image,
        samples: GradientSamples,
    ) -> Result<(Gradient, Gradient), PathtraceError> {
        self.check(loss, samples, 2)?;
        let seed = self.seed(samples);
        let [count, each] = samples.estimates();
        let estimate =
            |k: u32| self.estimate(loss, each, hash(seed, GRADIENT_KEY, u64::from(k)), self.kernel);
        let mut mean = estimate(0);
        let mut error = mean.clone();
        error.parameters.iter_mut().for_each(|p| p.values.fill(0.0));
        for k in 1..count {
            let one = estimate(k);
            mean.residual = larger(mean.residual, one.residual);
            mean.not_finite += one.not_finite;
            // Welford's recurrence.
            let n = f64::from(k + 1);
            for ((m, s), p) in mean.parameters.iter_mut().zip(&mut error.parameters).zip(&one.parameters) {
                for ((m, s), v) in m.values.iter_mut().zip(&mut s.values).zip(&p.values) {
                    let d = v - *m;
                    *m += d / n;
                    *s += d * (v - *m);
                }
            }
        }
        let n = f64::from(count);
        for p in &mut error.parameters {
            p.values.iter_mut().for_each(|s| *s = (*s / (n * (n - 1.0))).sqrt());
        }
        Ok((mean, error))
    }

    fn seed(&self, samples: GradientSamples) -> u64 {
        samples.seed.unwrap_or_else(|| hash(self.options.seed, GRADIENT_KEY, 0))
    }

    fn check(&self, loss: &Image, samples: GradientSamples, least: u32) -> Result<(), PathtraceError> {
        let (w, h) = (self.options.width, self.options.height);
        if (loss.width, loss.height) != (w, h) || loss.channels < 3 {
            let found = format!("{} x {} x {}", loss.width, loss.height, loss.channels);
            return Err(invalid(
                "weights",
                format!("are {found}; they must be {w} x {h} with three channels"),
            ));
        }
        if let Some((x, y, value)) = loss.find(|v| !v.is_finite()) {
            let place = format!("weights, pixel ({x}, {y})");
            return Err(invalid(place, format!("is {value}; it must be finite")));
        }
        if samples.spp < least {
            let rule = format!("are {} per pixel; they must be at least {least}", samples.spp);
            return Err(invalid("samples", rule));
        }
        Ok(())
    }

    /// The gradient with the samples of one seed.
    fn estimate(
        &self,
        loss: &Image,
        spp: u32,
        seed: u64,
        kernel: impl Fn(&World, &WorldRay, &PathRandom, &PathOptions, &mut Replay<'_>) + Sync,
    ) -> Gradient {
        let (w, h) = (self.options.width, self.options.height);
        let columns = w.div_ceil(TILE);
        let tiles = columns * h.div_ceil(TILE);
        let count = tiles as u64 * u64::from(spp.div_ceil(SAMPLES));
        let task = |i: u64| {
            let (tile, first) = ((i % tiles as u64) as usize, (i / tiles as u64) as u32 * SAMPLES);
            Task { x: tile % columns * TILE, y: tile / columns * TILE, first }
        };
        let camera = self.view.prepare(self.world);
        let alone = !self.options.filter.is_shared();
        let trace = |replay: &mut Replay<'_>, place: [usize; 2], own: Vec3f, random: &PathRandom| {
            let numbers = random.camera();
            let at = film_point(&self.options, place, &numbers);
            let weight = if alone { own } else { self.options.filter.shared(loss, at) };
            replay.loss = weight * (1.0 / spp as f32);
            if replay.loss != Vec3f::zero() {
                let ray = ray_through(&self.options, &camera, at, &numbers);
                kernel(self.world, &ray, random, &self.options.path, replay);
            }
        };
        let ranges = &self.layout.ranges;
        let mut totals: Vec<Vec<f64>> = ranges.iter().map(|r| vec![0.0; r.cells * r.channels]).collect();
        // Memory of tasks that have ended, used again by those that follow: as much as for one on every thread.
        let unused = Mutex::new(Vec::new());
        let (mut residual, mut not_finite) = (0.0_f64, 0);
        for start in (0..count).step_by(TASKS) {
            let run = |i: u64| {
                let task = task(i);
                let sparse = unused.lock().unwrap_or_else(PoisonError::into_inner).pop();
                let Layout { dense_end, single_end, cells, .. } = self.layout;
                let sparse = sparse.unwrap_or_else(|| Sparse::new(dense_end..single_end, single_end..cells));
                let mut out = Accumulator::new(dense_end, sparse);
                let last = task.first.saturating_add(SAMPLES).min(spp);
                let mut replay = Replay::new(self.world, &self.layout, &mut out, self.kept);
                for y in task.y..(task.y + TILE).min(h) {
                    for x in task.x..(task.x + TILE).min(w) {
                        let own = loss.pixel(x, y);
                        let own = Vec3f { x: own[0], y: own[1], z: own[2] };
                        if alone && own == Vec3f::zero() {
                            continue;
                        }
                        let mut pixel = PixelRandom::new(seed, (y * w + x) as u64);
                        for sample in task.first..last {
                            trace(&mut replay, [x, y], own, &pixel.sample(sample));
                        }
                    }
                }
                let sparse = out.finish();
                unused.lock().unwrap_or_else(PoisonError::into_inner).push(sparse);
                out
            };
            let batch = start..(start + TASKS as u64).min(count);
            let done: Vec<Accumulator> = batch.into_par_iter().map(run).collect();
            Accumulator::reduce(&done, ranges, &mut totals);
            for task in &done {
                residual = larger(residual, task.residual);
                not_finite += task.not_finite;
            }
        }
        let parameter =
            |(r, values): (&layout::Range, Vec<f64>)| ParameterGradient { channels: r.channels, values };
        let parameters = ranges.iter().zip(totals).map(parameter).collect();
        Gradient { parameters, residual, not_finite }
    }
}

/// Some samples of a tile.
struct Task {
    x: usize,
    y: usize,
    first: u32,
}

/// The compiled replays, the smallest first.
const REPLAYS: [(u32, ReplayKernel); 3] = {
    const STANDARD: u32 = plan::TEXTURES | plan::ENVIRONMENT | plan::SOURCES | plan::EMITTERS;
    [
        (STANDARD, replay_scattering::<STANDARD>),
        (plan::ALL & !plan::VOLUMES, replay_scattering::<{ plan::ALL & !plan::VOLUMES }>),
        (plan::ALL, replay_scattering::<{ plan::ALL }>),
    ]
};

/// [`replay`] with the scattering functions' own sampling.
fn replay_scattering<const F: u32>(
    world: &World,
    ray: &WorldRay,
    random: &PathRandom,
    options: &PathOptions,
    out: &mut Replay<'_>,
) {
    replay::<F, ScatteringSampler>(world, ray, random, options, &ScatteringSampler, out);
}

/// Walks a path for its light, and again for the gradients, with directions of a sampler.
#[inline(always)]
fn replay<const F: u32, D: DirectionSampler>(
    world: &World,
    ray: &WorldRay,
    random: &PathRandom,
    options: &PathOptions,
    sampler: &D,
    replay: &mut Replay<'_>,
) {
    let mut tape = std::mem::take(&mut replay.tape);
    tape.begin();
    replay.before.clear();
    let before = &mut replay.before;
    let light = Total { world, layout: replay.layout, radiance: [0.0; 3], before };
    let total = if tape.is_whole() {
        let sink = Recorder { light, tape: &mut tape, surfaces: &mut replay.surfaces };
        walk::<F, _, _>(world, ray, random, options, sampler, sink).1.light.radiance
    } else {
        walk::<F, _, _>(world, ray, random, options, sampler, light).1.radiance
    };
    replay.begin(total, random);
    if tape.is_whole() {
        tape.play(replay);
    } else {
        // Those of a tape that was cut.
        replay.surfaces.clear();
        walk::<F, _, _>(world, ray, random, options, sampler, &mut *replay);
    }
    replay.end();
    replay.tape = tape;
    if F & plan::VOLUMES != 0 && replay.layout.media {
        replay.scattered_anew::<F, D>(random, options, sampler);
    }
}
