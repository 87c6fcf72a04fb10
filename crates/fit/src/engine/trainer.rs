//! The fit: steps of gradient descent on positions and maps.

use super::checkpoint::{self, Checkpoint};
use super::plan::Plan;
use super::pool::Pool;
use super::reference::Painter;
use crate::bake::Reference;
use crate::candidate::{Candidate, ParameterGradients, average};
use crate::simplify::SimplifyOptions;
use crate::simplify::prepare::{Start, bake_candidate};
use crate::views::{Set, Shot, setup};
use crate::visibility::Visibility;
use crate::{FitError, Progress};
use photofit_image::psnr_from_mse;
use photofit_optim::{
    LargeSteps, Optimizer, Placement, Rows, Schedule, Temporal, clamp_channels, normalize_vectors,
};
use photofit_raster::deferred::Passes;
use photofit_raster::loss::Loss;
use photofit_raster::{CHANNELS, channel};
use photofit_scalar::Vec3f;
use std::time::Instant;

/// Views of the early stop.
const HELD_OUT: u64 = 5;
/// Steps between two looks at the held-out views.
const EVALUATE_EVERY: u64 = 25;
/// Looks without progress after which a phase ends.
const PATIENCE: usize = 6;
/// Samples per axis that the candidate takes of a pixel: with one, its texture filter would be fitted to that of the
/// reference, and the result be too sharp in any renderer that takes more.
const SAMPLES: usize = 2;
/// Step of the maps, relative to the error of the start.
const MAP_RATE: f64 = 0.04;
/// Step of the positions, relative to the distance between the start and the reference.
const POSITION_RATE: f64 = 1.0;
/// Smoothness of the preconditioner.
const LAMBDA: f64 = 0.3;

/// One look at the held-out views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HistoryPoint {
    /// Steps made.
    pub step: u64,
    /// Wall time since the start of the fit.
    pub seconds: f64,
    /// Mean training loss since the last look.
    pub loss: f64,
    /// PSNR (sRGB, foreground) of the held-out views.
    pub held_out_psnr: f64,
}

/// The end of a fit.
#[derive(Debug)]
pub struct Trained {
    /// The best state seen on the held-out views.
    pub candidate: Candidate,
    /// The course of the fit.
    pub history: Vec<HistoryPoint>,
    /// Steps made.
    pub steps: u64,
    /// Million pixels per second, forward and backward.
    pub mpix_per_s: f64,
    /// Ended by the user or the time limit.
    pub stopped: bool,
}

/// Which parameters a phase of the fit moves, and how fast.
#[derive(Clone, Copy, Debug)]
struct Phase {
    first: u64,
    steps: u64,
    /// Pictures are smaller by this factor.
    shrink: usize,
    position_rate: f64,
    map_rate: f64,
}

/// Learning rates of a texel's samples, relative to the phase's.
fn channel_rates(plan: &Plan) -> [f32; CHANNELS] {
    let mut r = plan.fitted.map(|f| if f { 1.0 } else { 0.0 });
    r[channel::METALLIC] *= 0.5;
    r
}

struct Trainer<'a> {
    painter: &'a Painter<'a>,
    options: &'a SimplifyOptions,
    plan: &'a Plan,
    candidate: Candidate,
    gradients: ParameterGradients,
    shape: Optimizer<f32>,
    maps: Optimizer<f32>,
    pool: Pool,
    held_out: Vec<Shot>,
    best: (f64, Vec<Vec3f>, photofit_raster::Maps),
    history: Vec<HistoryPoint>,
    passes: Passes,
    pixels: f64,
    render_seconds: f64,
    start: Instant,
    step: u64,
    loss: Vec<f64>,
    /// Of the fit, for its checkpoints.
    fingerprint: String,
}

/// Runs the fit.
pub(crate) fn train(
    painter: &Painter<'_>,
    reference: &Reference<'_>,
    start: Start,
    held_out: Vec<Shot>,
    seen: &Visibility,
    plan: &Plan,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Trained, FitError> {
    let Start { candidate, distance } = start;
    let large_steps = LargeSteps::new(candidate.positions.len(), &candidate.edges, LAMBDA)
        .map_err(FitError::Preconditioner)?;
    let optim = |source| FitError::Optim { step: 0, source, kept: "nothing was written".into() };
    let shape =
        Optimizer::new("positions", candidate.positions.len() * 3, Temporal::uniform_adam().betas(0.9, 0.99))
            .and_then(|shape| shape.with_filter(Placement::VARIABLE, large_steps))
            .map_err(optim)?;
    let texels = candidate.maps.levels[0].texels.len();
    let maps = Optimizer::new(
        "maps",
        texels * CHANNELS,
        Temporal { beta1: 0.8, beta2: 0.98, relative_epsilon: 0.5, ..Temporal::adam() },
    )
    .map_err(optim)?;
    let best = (f64::NEG_INFINITY, candidate.positions.clone(), candidate.maps.levels[0].clone());
    let mut t = Trainer {
        painter,
        options,
        plan,
        gradients: candidate.gradients(),
        candidate,
        shape,
        maps,
        pool: Pool::default(),
        held_out,
        best,
        history: Vec::new(),
        passes: plan.passes(),
        pixels: 0.0,
        render_seconds: 0.0,
        start: Instant::now(),
        step: 0,
        loss: Vec::new(),
        fingerprint: String::new(),
    };
    t.fingerprint = checkpoint::fingerprint(options, &t.candidate, &t.held_out[0]);
    let mut stopped = false;
    if let Some(c) = checkpoint::load(options, &t.candidate, &t.fingerprint)? {
        t.restore(c)?;
    }
    let first = t.history.first().map(|h| h.held_out_psnr);
    let start_psnr = first.unwrap_or_else(|| t.look(progress));
    progress.report("fit", t.step, options.steps, &format!("{start_psnr:.2} dB"));
    for (k, phase) in phases(options, distance, start_psnr).iter().enumerate() {
        if t.step >= phase.first + phase.steps {
            continue;
        }
        if t.step == phase.first && k > 0 {
            t.rebake(reference, seen, progress)?;
        }
        stopped = t.run(phase, progress)?;
        if stopped {
            break;
        }
    }
    let (_, positions, maps) = t.best;
    t.candidate.positions = positions;
    t.candidate.set_maps(maps);
    Ok(Trained {
        candidate: t.candidate,
        history: t.history,
        steps: t.step,
        mpix_per_s: t.pixels / 1e6 / t.render_seconds.max(1e-9),
        stopped,
    })
}

/// Coarse to fine: half resolution, then, with maps baked anew on the moved shape, full resolution.
fn phases(options: &SimplifyOptions, distance: f64, start_psnr: f64) -> Vec<Phase> {
    let n = options.steps;
    let a = n * 4 / 10;
    let rate = (POSITION_RATE * distance).clamp(1e-4, 1.5e-2);
    let map_rate = (MAP_RATE * 10f64.powf(-start_psnr / 20.0)).clamp(2e-4, 5e-3);
    let shrink = if options.resolution.is_multiple_of(2) && options.resolution >= 256 { 2 } else { 1 };
    vec![
        Phase { first: 0, steps: a, shrink, position_rate: rate, map_rate },
        Phase { first: a, steps: n - a, shrink: 1, position_rate: 0.4 * rate, map_rate },
    ]
}

/// Width and height of the pictures, made smaller by `shrink`.
fn picture_size(options: &SimplifyOptions, shrink: usize) -> usize {
    (options.resolution / (SAMPLES * shrink)).max(1)
}

/// The views of the early stop.
pub(crate) fn held_out(painter: &Painter<'_>, options: &SimplifyOptions) -> Result<Vec<Shot>, FitError> {
    let shot = |index| {
        let s = setup(Set::HeldOut, index, HELD_OUT, options.seed, &options.lighting);
        let picture = painter.picture(&s, picture_size(options, 1))?;
        Ok(Shot::new(&s, &picture, SAMPLES, options.seed ^ 0x5eed, index))
    };
    (0..HELD_OUT).map(shot).collect()
}

/// The start that looks best in the views of the early stop; the first wins a tie.
pub(crate) fn best_start<'a>(starts: &'a [Start], held_out: &[Shot]) -> &'a Start {
    let quality = |s: &Start| psnr(&s.candidate, held_out, &Passes::default());
    match starts {
        [first, second] if quality(second) > quality(first) => second,
        _ => &starts[0],
    }
}

/// PSNR (sRGB, foreground) of a candidate over shots.
fn psnr(candidate: &Candidate, shots: &[Shot], passes: &Passes) -> f64 {
    let vertices = candidate.vertices();
    let (mut squares, mut count) = (0.0, 0.0);
    for shot in shots {
        let frame = candidate.render(&vertices, shot, passes);
        for (c, r) in average(&frame.color, shot).iter().zip(&shot.reference) {
            if c[3] > 0.0 || r[3] > 0.0 {
                let e = |x: f32| photofit_image::srgb_encode(x.clamp(0.0, 1.0));
                squares += (0..3).map(|k| f64::from(e(c[k]) - e(r[k])).powi(2)).sum::<f64>() / 3.0;
                count += 1.0;
            }
        }
    }
    psnr_from_mse(squares / f64::max(count, 1.0))
}

impl Trainer<'_> {
    /// Runs a phase to its end; true when the user or the time limit stopped it.
    fn run(&mut self, phase: &Phase, progress: &dyn Progress) -> Result<bool, FitError> {
        self.passes = Passes { position_gradients: phase.position_rate > 0.0, ..self.plan.passes() };
        if self.history.last().is_none_or(|h| h.step != self.step) {
            self.look(progress);
        }
        let end = phase.first + phase.steps;
        while self.step < end {
            let over = self.options.time_limit.is_some_and(|l| self.start.elapsed() >= l);
            if over || progress.is_cancelled() {
                self.look(progress);
                self.save(progress)?;
                return Ok(true);
            }
            if self.is_stale(phase) {
                self.step = end;
                break;
            }
            self.one_step(phase)?;
            if self.step.is_multiple_of(EVALUATE_EVERY) || self.step == end {
                self.look(progress);
                self.save(progress)?;
            }
        }
        Ok(false)
    }

    /// Whether the last looks of a phase brought nothing.
    fn is_stale(&self, phase: &Phase) -> bool {
        let looks: Vec<f64> =
            self.history.iter().filter(|h| h.step >= phase.first).map(|h| h.held_out_psnr).collect();
        let best = looks.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        looks.iter().rev().take_while(|l| **l < best).count() >= PATIENCE
    }

    fn one_step(&mut self, phase: &Phase) -> Result<(), FitError> {
        let size = picture_size(self.options, phase.shrink);
        let shots = self.pool.batch(self.painter, self.options, (phase.first, self.step), size, SAMPLES)?;
        let began = Instant::now();
        let value = self.candidate.step(&shots, Loss::LogSrgbL1, &self.passes, &mut self.gradients);
        self.render_seconds += began.elapsed().as_secs_f64();
        self.pixels += shots.iter().map(|s| (s.width * s.height * SAMPLES * SAMPLES) as f64).sum::<f64>();
        self.loss.push(value);
        let schedule = Schedule::WarmupCosine { warmup: 10, total: phase.steps, floor: 0.05 };
        let factor = schedule.factor(self.step - phase.first);
        let step = self.step;
        let fail = |source| FitError::Optim { step, source, kept: "the last checkpoint is unchanged".into() };
        if phase.position_rate > 0.0 {
            let x = bytemuck::cast_slice_mut(&mut self.candidate.positions);
            let g = bytemuck::cast_slice(&self.gradients.positions);
            self.shape.step(x, g, (phase.position_rate * factor) as f32).map_err(fail)?;
        }
        let rates = channel_rates(self.plan).map(|r| r * (phase.map_rate * factor) as f32);
        let base = &mut self.candidate.maps.levels[0].texels;
        let g = &self.gradients.rendered.maps.levels[0].texels;
        self.maps
            .step_rows(base.as_flattened_mut(), g.as_flattened(), &Rows { rates: &rates, touched: None })
            .map_err(fail)?;
        clamp_channels(base.as_flattened_mut(), &RANGES);
        normalize_vectors(base.as_flattened_mut(), CHANNELS, channel::NORMAL);
        self.candidate.maps.rebuild();
        self.step += 1;
        Ok(())
    }

    /// PSNR of the held-out views; keeps the best state.
    fn look(&mut self, progress: &dyn Progress) -> f64 {
        let psnr = psnr(&self.candidate, &self.held_out, &self.plan.passes());
        let loss = self.loss.iter().sum::<f64>() / self.loss.len().max(1) as f64;
        self.loss.clear();
        let seconds = self.start.elapsed().as_secs_f64();
        self.history.push(HistoryPoint { step: self.step, seconds, loss, held_out_psnr: psnr });
        progress.report("fit", self.step, self.options.steps, &format!("{psnr:.2} dB"));
        if psnr > self.best.0 {
            self.best = (psnr, self.candidate.positions.clone(), self.candidate.maps.levels[0].clone());
        }
        psnr
    }

    /// Puts the reference's surface on the fitted shape, whose texels have moved; keeps it if it is better.
    fn rebake(
        &mut self,
        reference: &Reference<'_>,
        seen: &Visibility,
        progress: &dyn Progress,
    ) -> Result<(), FitError> {
        self.candidate.positions.clone_from(&self.best.1);
        let (baked, _) = bake_candidate(reference, seen, &self.candidate, progress)?;
        self.candidate.set_maps(baked);
        let before = self.best.0;
        if self.look(progress) < before {
            self.candidate.set_maps(self.best.2.clone());
        }
        let texels = self.candidate.maps.levels[0].texels.len();
        let temporal = *self.maps.temporal();
        let fail = |source| FitError::Optim {
            step: self.step,
            source,
            kept: "the last checkpoint is unchanged".into(),
        };
        self.maps = Optimizer::new("maps", texels * CHANNELS, temporal).map_err(fail)?;
        Ok(())
    }

    fn save(&self, progress: &dyn Progress) -> Result<(), FitError> {
        let Some(folder) = &self.options.checkpoint else { return Ok(()) };
        progress.report("checkpoint", self.step, self.options.steps, "");
        checkpoint::save(
            folder,
            &Checkpoint {
                step: self.step,
                best_psnr: self.best.0,
                positions: &self.candidate.positions,
                maps: &self.candidate.maps.levels[0],
                best_positions: &self.best.1,
                best_maps: &self.best.2,
                shape: self.shape.state(),
                adam: self.maps.state(),
                history: &self.history,
                loss: &self.loss,
            },
            &self.fingerprint,
        )
    }

    fn restore(&mut self, c: checkpoint::Loaded) -> Result<(), FitError> {
        let step = c.step;
        let fail = |source| FitError::Optim { step, source, kept: "the checkpoint is unchanged".into() };
        self.shape.restore(c.shape).map_err(fail)?;
        self.maps.restore(c.adam).map_err(fail)?;
        self.step = c.step;
        self.candidate.positions = c.positions;
        self.candidate.set_maps(c.maps);
        self.best = (c.best_psnr, c.best_positions, c.best_maps);
        self.history = c.history;
        self.loss = c.loss;
        Ok(())
    }
}

/// Range of each sample of a texel.
const RANGES: [[f32; 2]; CHANNELS] = {
    let mut r = [[0.0, 1.0]; CHANNELS];
    r[channel::ROUGHNESS] = [0.03, 1.0];
    r[channel::NORMAL] = [-1.0, 1.0];
    r[channel::NORMAL + 1] = [-1.0, 1.0];
    r[channel::NORMAL + 2] = [0.02, 1.0];
    r[channel::EMISSIVE] = [0.0, 1e4];
    r[channel::EMISSIVE + 1] = [0.0, 1e4];
    r[channel::EMISSIVE + 2] = [0.0, 1e4];
    r
};
