//! Textures and volumes found again through the path tracer: errors of parameters and pictures against steps and time, by
//! first-order optimizers with and without filters over space (the experiments of the bilateral optimizer's paper, on scenes
//! of our own).

pub(super) mod cloud;
pub(super) mod mesh;
pub(super) mod plate;
pub(super) mod smoothing;
pub(super) mod steps;

use std::time::Instant;

use anyhow::{Context as _, Result};
use photofit_fit::engine::loss::PictureLoss;
use photofit_image::{Image, contact_sheet, write_png};
use photofit_optim::{
    Bilateral, Grid, GridBilateral, GuideMap, Optimizer, Placement, Sigma, Source, Temporal,
};
use photofit_pathtrace::{Adjoint, GradientSamples, Parameter, RenderOptions, Renderer, View, World};
use photofit_sampling::hash;

use crate::context::Context;
use crate::plot::Axis;
use crate::timing::Timing;

/// Samples per pixel of targets, and of the pictures that errors are measured on.
const TARGET_SPP: u32 = 512;
const JUDGE_SPP: u32 = 64;
/// Where scenes and pictures are written.
const FOLDER: &str = "out/bench/recover";

/// A group of values to be found.
struct Unknown {
    name: &'static str,
    parameter: Parameter,
    grid: Grid,
    channels: usize,
    range: [f32; 2],
    start: Vec<f32>,
    truth: Vec<f32>,
    /// Values that errors are measured on: those that pictures show.
    counts: Vec<bool>,
    /// Learning rates relative to that of the method.
    rate: f32,
}

/// Something to be found from pictures.
struct Task {
    name: &'static str,
    world: World,
    options: RenderOptions,
    gradient_spp: u32,
    unknowns: Vec<Unknown>,
    /// Cameras with their pictures, `batch` of which make a step.
    views: Vec<(View, Image)>,
    batch: usize,
    /// Cameras with pictures that no step sees; none where there is one camera alone.
    held_out: Vec<(View, Image)>,
    /// Learning rates are halved after each of these many steps.
    half_life: Option<u64>,
}

/// An optimizer with its settings.
#[derive(Clone)]
struct Method {
    name: String,
    rate: f64,
    /// The rate falls to 0 over the run, as a cosine; else it stays, or is that of [`Task::half_life`].
    falls: bool,
    /// The filter loses a level after equal parts of the run, and has none in the last one.
    narrows: bool,
    betas: [f64; 2],
    filter: Option<(Bilateral, Placement)>,
    /// Widths of range weights, one for each unknown, where they are not those of `filter`.
    sigmas: Vec<f64>,
}

impl Method {
    fn adam(rate: f64, beta1: f64) -> Self {
        let name = format!("Adam, rate {rate}, b1 {beta1}");
        Self {
            name,
            rate,
            falls: false,
            narrows: false,
            betas: [beta1, 0.999],
            filter: None,
            sigmas: Vec::new(),
        }
    }

    fn filtered(name: &str, rate: f64, filter: Bilateral, placement: Placement) -> Self {
        let filter = Some((filter, placement));
        Self {
            name: name.into(),
            rate,
            falls: false,
            narrows: false,
            betas: [0.2, 0.999],
            filter,
            sigmas: Vec::new(),
        }
    }

    /// The same under another name.
    fn named(&self, name: &str) -> Self {
        Self { name: name.into(), ..self.clone() }
    }

    /// The same with the `b2` that belongs to its `b1` (the paper's methods): [`Temporal::paired`].
    fn paired(&self) -> Self {
        let [b1, _] = self.betas;
        Self {
            name: format!("{}, paired", self.name),
            betas: [b1, Temporal::adam().paired(b1).beta2],
            ..self.clone()
        }
    }

    /// The same with a rate that falls to 0.
    fn falling(&self) -> Self {
        Self { name: format!("{}, falling", self.name), falls: true, ..self.clone() }
    }

    /// A low-pass filter of gradients.
    fn low_pass(rate: f64) -> Self {
        Self::filtered(&format!("low-pass, rate {rate}"), rate, Bilateral::low_pass(3), Placement::PRE)
    }

    /// Guided by the gradients themselves.
    fn plain(rate: f64) -> Self {
        let filter = Bilateral {
            levels: 3,
            sigma: Sigma::Fixed(1.0),
            map: GuideMap::Log,
            source: Source::Gradients,
            ..Bilateral::default()
        };
        Self::filtered("bilateral, guided by gradients", rate, filter, Placement::BOTH)
    }

    /// The same with a filter that narrows.
    fn narrowing(&self) -> Self {
        Self { name: format!("{}, narrowing", self.name), narrows: true, ..self.clone() }
    }

    /// Levels of its filter at a share of the run.
    fn levels(&self, share: f64) -> u32 {
        let levels = self.filter.map_or(0, |f| f.0.levels);
        if self.narrows { levels - (share * f64::from(levels + 1)) as u32 } else { levels }
    }

    fn optimizer(&self, unknown: &Unknown, index: usize, levels: u32) -> Result<Optimizer<f32>> {
        let temporal = Temporal::adam().betas(self.betas[0], self.betas[1]);
        let made = Optimizer::new(unknown.name, unknown.truth.len(), temporal)?;
        let Some((filter, placement)) = self.filter.filter(|_| levels > 0) else { return Ok(made) };
        let filter = Bilateral { levels, ..filter };
        let sigma = self.sigmas.get(index).map_or(filter.sigma, |s| Sigma::Fixed(*s));
        let filter =
            GridBilateral::new(unknown.name, unknown.grid, unknown.channels, Bilateral { sigma, ..filter })?;
        Ok(made.with_filter(placement, filter)?)
    }
}

/// A run: what was reached after some steps, and the values of each unknown at its end.
struct Course {
    looks: Vec<Look>,
    values: Vec<Vec<f32>>,
}

impl Course {
    /// The loss at its end.
    fn loss(&self) -> f64 {
        self.looks.last().map_or(f64::INFINITY, |l| l.loss)
    }
}

/// What a run had reached after some steps.
struct Look {
    step: u64,
    /// Of all steps so far.
    seconds: f64,
    /// Relative squared error of the pictures.
    loss: f64,
    /// Root mean square error of each unknown.
    errors: Vec<f64>,
}

impl Task {
    /// Runs `method` from the start, and looks at what it has reached after each of `looks`.
    fn run(&mut self, method: &Method, looks: &[u64]) -> Result<Course> {
        let mut values: Vec<Vec<f32>> = self.unknowns.iter().map(|u| u.start.clone()).collect();
        for (unknown, values) in self.unknowns.iter().zip(&values) {
            set(&mut self.world, unknown, values)?;
        }
        let mut optimizers: Vec<Optimizer<f32>> = self
            .unknowns
            .iter()
            .enumerate()
            .map(|(k, u)| method.optimizer(u, k, method.levels(0.0)))
            .collect::<Result<_>>()?;
        let places: Vec<Parameter> = self.unknowns.iter().map(|u| u.parameter.clone()).collect();
        let mut seconds = 0.0;
        let mut found = vec![self.look(0, seconds, &values)?];
        let steps = looks.last().copied().unwrap_or(0);
        for step in 0..steps {
            let began = Instant::now();
            let mut gradients: Vec<Vec<f32>> = values.iter().map(|v| vec![0.0; v.len()]).collect();
            for k in 0..self.batch as u64 {
                let number = step * self.batch as u64 + k;
                let (view, target) = &self.views[number as usize % self.views.len()];
                let options = RenderOptions { seed: hash(1, 0, number), ..self.options.clone() };
                let shown = picture(&self.world, view, &options)?;
                let (_, weights) = compare(&shown, target);
                let adjoint = Adjoint::new(&self.world, view, options, &places)?;
                let seed = Some(hash(2, 0, number));
                let found = adjoint.render_vjp(&weights, GradientSamples { spp: self.gradient_spp, seed })?;
                for ((sum, one), unknown) in gradients.iter_mut().zip(&found.parameters).zip(&self.unknowns) {
                    let one = one.first_channels(unknown.channels);
                    sum.iter_mut().zip(one.iter()).for_each(|(s, v)| *s += (v / self.batch as f64) as f32);
                }
            }
            let halved = self.half_life.map_or(1.0, |h| 0.5_f64.powi((step / h) as i32));
            let cosine = || 0.5 + 0.5 * (std::f64::consts::PI * (step as f64 + 0.5) / steps as f64).cos();
            let fall = if method.falls { cosine() } else { halved };
            let levels = method.levels(step as f64 / steps as f64);
            let fewer = step > 0 && levels < method.levels((step - 1) as f64 / steps as f64);
            for (k, unknown) in self.unknowns.iter().enumerate() {
                if fewer {
                    let state = optimizers[k].state().clone();
                    optimizers[k] = method.optimizer(unknown, k, levels)?;
                    optimizers[k].restore(state)?;
                }
                let rate = (method.rate * fall) as f32 * unknown.rate;
                optimizers[k].step(&mut values[k], &gradients[k], rate)?;
                let [low, high] = unknown.range;
                values[k].iter_mut().for_each(|v| *v = v.clamp(low, high));
                set(&mut self.world, unknown, &values[k])?;
            }
            seconds += began.elapsed().as_secs_f64();
            if looks.contains(&(step + 1)) {
                found.push(self.look(step + 1, seconds, &values)?);
            }
        }
        Ok(Course { looks: found, values })
    }

    /// A sentence on the loss and the errors of the start, and on the loss that noise alone leaves to the truth.
    fn ends(&mut self) -> Result<String> {
        let mut found = Vec::new();
        let starts: Vec<Vec<f32>> = self.unknowns.iter().map(|u| u.start.clone()).collect();
        let truths = self.unknowns.iter().map(|u| u.truth.clone()).collect();
        for values in [starts, truths] {
            for (unknown, values) in self.unknowns.iter().zip(&values) {
                set(&mut self.world, unknown, values)?;
            }
            found.push(self.look(0, 0.0, &values)?);
        }
        let errors: Vec<String> =
            self.unknowns.iter().zip(&found[0].errors).map(|(u, e)| format!("{} {e:.4}", u.name)).collect();
        Ok(format!(
            "Start: loss {:.4}, {}; loss of the truth: {:.4}.",
            found[0].loss,
            errors.join(", "),
            found[1].loss
        ))
    }

    fn look(&self, step: u64, seconds: f64, values: &[Vec<f32>]) -> Result<Look> {
        let judged = if self.held_out.is_empty() { &self.views } else { &self.held_out };
        let options = RenderOptions { spp: JUDGE_SPP, seed: hash(3, 0, 0), ..self.options.clone() };
        let mut loss = 0.0;
        for (view, target) in judged {
            loss += compare(&picture(&self.world, view, &options)?, target).0 / judged.len() as f64;
        }
        let errors = self.unknowns.iter().zip(values).map(|(u, v)| u.error(v)).collect();
        Ok(Look { step, seconds, loss, errors })
    }
}

impl Unknown {
    /// Root mean square error over what counts.
    fn error(&self, values: &[f32]) -> f64 {
        let (mut sum, mut count) = (0.0, 0_usize);
        for (i, (a, b)) in values.iter().zip(&self.truth).enumerate() {
            if self.counts[i / self.channels] {
                sum += f64::from(a - b).powi(2);
                count += 1;
            }
        }
        (sum / count.max(1) as f64).sqrt()
    }
}

/// Sets the values of an unknown.
fn set(world: &mut World, unknown: &Unknown, values: &[f32]) -> Result<()> {
    Ok(world.spread_parameter(&unknown.parameter, unknown.channels, values)?)
}

pub(super) fn picture(world: &World, view: &View, options: &RenderOptions) -> Result<Image> {
    let mut renderer = Renderer::new(world, view, options.clone())?;
    renderer.finish();
    Ok(renderer.picture())
}

/// Mean of `(I - R)^2 / (m^2 + .01)`, where `m` is the mean of `R` around a pixel, and its gradient with respect to the colours of `I`.
fn compare(shown: &Image, target: &Image) -> (f64, Image) {
    let colors =
        |i: &Image| -> Vec<[f32; 4]> { i.data.chunks_exact(4).map(|p| [p[0], p[1], p[2], 1.0]).collect() };
    let (a, b) = (colors(shown), colors(target));
    let mut gradient = vec![[0.0; 4]; a.len()];
    let (w, h) = (shown.width, shown.height);
    let loss = PictureLoss::RELATIVE_SQUARES.value_and_gradient((w, h), &a, &b, 1.0, &mut gradient);
    (loss, Image::from_fn(w, h, 3, |x, y, c| gradient[y * w + x][c]))
}

/// Runs methods and records their figures.
fn race(ctx: &mut Context, task: &mut Task, methods: &[Method], looks: &[u64]) -> Result<Vec<Course>> {
    let mut all = Vec::new();
    for method in methods {
        let found = task.run(method, looks)?;
        for look in &found.looks[1..] {
            let each = look.seconds / look.step as f64;
            let timing = Timing { median: each, spread: 0.0, runs: look.step as usize };
            let mut figures = vec![("loss", look.loss)];
            figures.extend(task.unknowns.iter().zip(&look.errors).map(|(u, e)| (u.name, *e)));
            let case = format!("{}, {} steps", task.name, look.step);
            ctx.record(&method.name, &case, look.step as usize, timing, figures);
        }
        all.push(found);
    }
    Ok(all)
}

/// Plots the courses of some methods: the loss, and the error of the first unknown.
fn plot(ctx: &mut Context, task: &Task, methods: &[Method], courses: &[Course]) -> Result<()> {
    let ending = task.name.replace(' ', "-");
    let first = task.unknowns[0].name;
    type Of = fn(&Look) -> f64;
    for (what, of) in [("loss", (|l| l.loss) as Of), (first, |l| l.errors[0])] {
        let curve = |(m, c): (&Method, &Course)| {
            (m.name.clone(), c.looks[1..].iter().map(|l| (l.seconds, of(l))).collect())
        };
        let curves: Vec<_> = methods.iter().zip(courses).map(curve).collect();
        let title = format!("{}: {what} against time", task.name);
        let ending = format!("{ending}-{}", what.replace(' ', "-"));
        ctx.plot(&ending, &title, [Axis("seconds of the steps"), Axis(what)], &curves)?;
    }
    Ok(())
}

/// The method of some with the lowest last loss.
fn best<'a>(methods: &'a [Method], courses: &[Course]) -> &'a Method {
    let at = (0..methods.len()).min_by(|a, b| courses[*a].loss().total_cmp(&courses[*b].loss())).unwrap_or(0);
    &methods[at]
}

/// Writes what the methods found of an unknown as one sheet: the truth, the start, and every method in order. `shown` is the picture of values.
fn sheet(task: &Task, courses: &[Course], unknown: usize, shown: impl Fn(&[f32]) -> Image) -> Result<()> {
    let u = &task.unknowns[unknown];
    let found = courses.iter().map(|c| &c.values[unknown]);
    let images: Vec<Image> = [&u.truth, &u.start].into_iter().chain(found).map(|v| shown(v)).collect();
    std::fs::create_dir_all(FOLDER).with_context(|| format!("{FOLDER}: cannot create"))?;
    let name = format!("{FOLDER}/{}-{}.png", task.name, u.name.replace(' ', "-"));
    let refs: Vec<&Image> = images.iter().collect();
    Ok(write_png(name, &contact_sheet(&refs, 4, 4))?)
}
