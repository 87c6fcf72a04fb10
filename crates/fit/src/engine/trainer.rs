//! The trainer: one loop for all models. Phases, schedule, looks at held-out views, best state, patience, checkpoints,
//! progress and cancellation.
//!
//! What is saved when a fit is stopped is what an undisturbed one has at that step: looks happen at fixed steps only, and
//! the last look of a stopped fit goes into its result, not into its checkpoint.

use super::checkpoint::{self, Course, Digest, Saved};
use super::model::{Group, Model};
use super::pool::{Batches, Pool};
use super::reference::Reference;
use super::views::{Sampling, Set, Shot, Views};
use crate::{FitError, Progress};
use photofit_image::psnr_from_mse;
use photofit_optim::{Optimizer, Rows, Schedule, clamp_channels, normalize_vectors};
use photofit_raster::loss::Loss;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Views of the early stop, where pictures are not small.
pub(crate) const HELD_OUT: u64 = 5;
/// Steps between two looks at the held-out views.
const LOOK_EVERY: u64 = 25;
/// Looks without progress after which a phase ends.
const PATIENCE: usize = 6;

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

/// Where and how a fit keeps its state.
#[derive(Clone, Debug, Default)]
pub struct Keeping {
    /// Folder of the checkpoint.
    pub checkpoint: Option<PathBuf>,
    /// Goes on from the checkpoint, if there is one.
    pub resume: bool,
    /// Ends the fit early; what is reached counts.
    pub time_limit: Option<Duration>,
}

/// What a fit is made of beside its model and phases.
pub struct Job<'a> {
    /// What the model is compared with.
    pub reference: &'a dyn Reference,
    /// From where.
    pub views: &'a dyn Views,
    /// Views that the fit is judged by and never moved by.
    pub held_out: &'a HeldOut,
    /// How the candidate is sampled.
    pub sampling: Sampling,
    /// How pictures are compared.
    pub loss: Loss,
    /// Seed of the draws.
    pub seed: u64,
    /// Pictures of a step.
    pub batch: usize,
    /// Steps of all phases.
    pub steps: u64,
    /// Checkpoints and limits.
    pub keeping: &'a Keeping,
    /// The options that steer the fit, as text: a checkpoint of other ones is refused.
    pub options: String,
}

impl std::fmt::Debug for Job<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Job").field("options", &self.options).finish_non_exhaustive()
    }
}

/// Makes new values for a group out of the best state so far.
pub type Remake<'a, M> = &'a dyn Fn(&M) -> Result<Vec<f32>, FitError>;

/// A stretch of the fit with rates of its own.
pub struct Phase<'a, M> {
    /// What it does, for people.
    pub name: &'static str,
    /// Its first step.
    pub first: u64,
    /// Its number of steps.
    pub steps: u64,
    /// Pictures are smaller by this factor.
    pub shrink: usize,
    /// Peak rate of each group, in the order of the model's; 0 freezes it.
    pub rates: Vec<f64>,
    /// At its beginning the fit goes back to the best state, and this group gets values made anew out of it, unless they
    /// look worse.
    pub renewal: Option<(usize, Remake<'a, M>)>,
}

impl<M> std::fmt::Debug for Phase<'_, M> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Phase")
            .field("name", &self.name)
            .field("first", &self.first)
            .field("steps", &self.steps)
            .field("shrink", &self.shrink)
            .field("rates", &self.rates)
            .field("renews", &self.renewal.as_ref().map(|r| r.0))
            .finish()
    }
}

impl<M> Phase<'_, M> {
    fn end(&self) -> u64 {
        self.first + self.steps
    }
}

/// The end of a fit.
#[derive(Debug)]
pub struct Trained<M> {
    /// The best state seen on the held-out views.
    pub model: M,
    /// The course of the fit.
    pub history: Vec<HistoryPoint>,
    /// Steps made.
    pub steps: u64,
    /// Million samples per second, forward and backward.
    pub mpix_per_s: f64,
    /// Ended by the user or the time limit.
    pub stopped: bool,
}

/// The views of the early stop.
#[derive(Clone, Debug)]
pub struct HeldOut {
    /// With their reference pictures.
    pub shots: Vec<Shot>,
    /// Mean relative noise of these pictures.
    pub noise: f64,
}

impl HeldOut {
    /// Pictures of the reference from `count` held-out views.
    ///
    /// # Errors
    /// If a picture cannot be made.
    pub fn new(
        reference: &dyn Reference,
        views: &dyn Views,
        sampling: Sampling,
        count: u64,
        seed: u64,
    ) -> Result<Self, FitError> {
        let mut out = Self { shots: Vec::new(), noise: 0.0 };
        for index in 0..count {
            let s = views.setup(Set::HeldOut, index, count);
            let picture = reference.picture(&s)?;
            out.noise += picture.noise / count as f64;
            out.shots.push(Shot::new(&s, &picture.image, sampling, seed ^ 0x5eed, index));
        }
        Ok(out)
    }

    /// PSNR (sRGB, foreground) of pictures of these views.
    pub fn psnr(&self, pictures: &[Vec<[f32; 4]>]) -> f64 {
        let (mut squares, mut count) = (0.0, 0.0);
        for (shot, picture) in self.shots.iter().zip(pictures) {
            for (c, r) in picture.iter().zip(&shot.reference) {
                if c[3] > 0.0 || r[3] > 0.0 {
                    let e = |x: f32| photofit_image::srgb_encode(x.clamp(0.0, 1.0));
                    squares += (0..3).map(|k| f64::from(e(c[k]) - e(r[k])).powi(2)).sum::<f64>() / 3.0;
                    count += 1.0;
                }
            }
        }
        psnr_from_mse(squares / f64::max(count, 1.0))
    }
}

struct Trainer<'a, M: Model> {
    job: &'a Job<'a>,
    model: M,
    groups: Vec<Group>,
    gradients: M::Gradients,
    optimizers: Vec<Optimizer<f32>>,
    /// Best values of each group.
    best: Vec<Vec<f32>>,
    course: Course,
    pool: Pool,
    fingerprint: String,
    /// Step of the checkpoint that stands in the folder.
    saved: Option<u64>,
    /// The last refusal to save that the user was told of.
    refusal: String,
    samples: f64,
    render_seconds: f64,
    start: Instant,
    /// Seconds of the runs before this one.
    earlier: f64,
}

/// Runs a fit of `model`; `phases` lays out its phases, given the PSNR of the held-out views at the start.
///
/// # Errors
/// If a picture cannot be made, a checkpoint belongs to another fit, or a value is not finite; what was saved stays.
pub fn train<'p, M: Model + 'p>(
    model: M,
    job: &Job<'_>,
    phases: impl FnOnce(f64) -> Vec<Phase<'p, M>>,
    progress: &dyn Progress,
) -> Result<Trained<M>, FitError> {
    let groups = model.groups();
    let optimizers = groups.iter().map(|g| model.optimizer(g)).collect::<Result<_, _>>()?;
    let best = (0..groups.len()).map(|g| model.values(g).to_vec()).collect();
    let fingerprint = fingerprint(job, &model, groups.len());
    let mut t = Trainer {
        job,
        gradients: model.gradients(),
        model,
        groups,
        optimizers,
        best,
        course: Course { best_psnr: f64::NEG_INFINITY, ..Course::default() },
        pool: Pool::default(),
        fingerprint,
        saved: None,
        refusal: String::new(),
        samples: 0.0,
        render_seconds: 0.0,
        start: Instant::now(),
        earlier: 0.0,
    };
    t.restore(progress)?;
    let start = match t.course.history.first() {
        Some(first) => first.held_out_psnr,
        None => t.look(progress),
    };
    progress.report("fit", t.course.step, job.steps, &format!("{start:.2} dB"));
    let mut stopped = false;
    for (k, phase) in phases(start).iter().enumerate() {
        if t.course.step >= phase.end() {
            continue;
        }
        stopped = (t.course.begun <= k && t.begin(k, phase, progress)?) || t.run(phase, progress)?;
        if stopped {
            break;
        }
    }
    if stopped {
        t.save(progress);
        if t.course.history.last().is_none_or(|h| h.step != t.course.step) {
            t.look(progress);
        }
    }
    t.go_to_best();
    Ok(Trained {
        model: t.model,
        history: t.course.history,
        steps: t.course.step,
        mpix_per_s: t.samples / 1e6 / t.render_seconds.max(1e-9),
        stopped,
    })
}

/// What must agree between the run that wrote a checkpoint and the one that reads it: the options that steer the fit,
/// the values it starts from (which follow from the asset), and a held-out view (which follows from the asset and the
/// light).
fn fingerprint<M: Model>(job: &Job<'_>, model: &M, groups: usize) -> String {
    let mut digest = Digest::new();
    (0..groups).for_each(|g| digest.add(model.values(g)));
    digest.add(job.held_out.shots[0].reference.as_flattened());
    let Job { options, batch, steps, loss, sampling, .. } = job;
    format!("{options} {batch} {steps} {loss:?} {sampling:?} {:016x}", digest.value())
}

impl<M: Model> Trainer<'_, M> {
    /// What happens once at the beginning of a phase; true when the user stopped it, which leaves the state before it.
    fn begin(
        &mut self,
        number: usize,
        phase: &Phase<'_, M>,
        progress: &dyn Progress,
    ) -> Result<bool, FitError> {
        match &phase.renewal {
            None => {
                if self.course.history.last().is_none_or(|h| h.step != self.course.step) {
                    self.look(progress);
                }
            }
            Some((group, make)) => {
                let before: Vec<Vec<f32>> =
                    (0..self.groups.len()).map(|g| self.model.values(g).to_vec()).collect();
                self.go_to_best();
                let made = match make(&self.model) {
                    Err(FitError::Interrupted) => {
                        self.set(&before);
                        return Ok(true);
                    }
                    made => made?,
                };
                self.model.values_mut(*group).copy_from_slice(&made);
                self.model.changed(*group);
                let best = self.course.best_psnr;
                if self.look(progress) < best {
                    self.model.values_mut(*group).copy_from_slice(&self.best[*group]);
                    self.model.changed(*group);
                }
                self.optimizers[*group] = self.model.optimizer(&self.groups[*group])?;
            }
        }
        self.course.begun = number + 1;
        Ok(false)
    }

    /// Runs a phase to its end; true when the user or the time limit stopped it.
    fn run(&mut self, phase: &Phase<'_, M>, progress: &dyn Progress) -> Result<bool, FitError> {
        while self.course.step < phase.end() {
            let over = self.job.keeping.time_limit.is_some_and(|l| self.start.elapsed() >= l);
            if over || progress.is_cancelled() {
                return Ok(true);
            }
            if self.is_stale(phase) {
                self.course.step = phase.end();
                break;
            }
            self.one_step(phase)?;
            if self.course.step.is_multiple_of(LOOK_EVERY) || self.course.step == phase.end() {
                self.look(progress);
                self.save(progress);
            }
        }
        Ok(false)
    }

    /// Whether the last looks of a phase brought nothing.
    fn is_stale(&self, phase: &Phase<'_, M>) -> bool {
        let history = &self.course.history;
        let looks: Vec<f64> =
            history.iter().filter(|h| h.step >= phase.first).map(|h| h.held_out_psnr).collect();
        let best = looks.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        looks.iter().rev().take_while(|l| **l < best).count() >= PATIENCE
    }

    fn one_step(&mut self, phase: &Phase<'_, M>) -> Result<(), FitError> {
        let job = self.job;
        let step = self.course.step;
        let from = Batches {
            reference: job.reference,
            views: job.views,
            seed: job.seed,
            size: job.batch as u64,
            sampling: job.sampling,
        };
        let shots = self.pool.batch(&from, (phase.first, step), phase.shrink)?;
        let moving: Vec<bool> = phase.rates.iter().map(|r| *r > 0.0).collect();
        let began = Instant::now();
        let value = self.model.step(&shots, job.loss, &moving, &mut self.gradients);
        self.render_seconds += began.elapsed().as_secs_f64();
        let per_pixel = job.sampling.per_axis.pow(2);
        self.samples += shots.iter().map(|s| (s.width * s.height * per_pixel) as f64).sum::<f64>();
        if !value.is_finite() {
            return Err(FitError::Loss { step, value, kept: self.kept() });
        }
        self.course.loss.push(value);
        let schedule = Schedule::WarmupCosine { warmup: 10, total: phase.steps, floor: 0.05 };
        let factor = schedule.factor(step - phase.first);
        for (k, group) in self.groups.iter().enumerate().filter(|(k, _)| moving[*k]) {
            let (x, g) = self.model.moved(&self.gradients, k);
            let rate = phase.rates[k] * factor;
            let moved = if group.rates.is_empty() {
                self.optimizers[k].step(x, g, rate as f32)
            } else {
                let rates: Vec<f32> = group.rates.iter().map(|r| r * rate as f32).collect();
                self.optimizers[k].step_rows(x, g, &Rows { rates: &rates, touched: None })
            };
            if let Err(source) = moved {
                return Err(FitError::Optim { step, source, kept: self.kept() });
            }
            if !group.ranges.is_empty() {
                clamp_channels(x, &group.ranges);
            }
            if let Some(at) = group.unit {
                normalize_vectors(x, group.columns, at);
            }
            self.model.changed(k);
        }
        self.course.step += 1;
        Ok(())
    }

    /// PSNR of the held-out views; keeps the best state.
    fn look(&mut self, progress: &dyn Progress) -> f64 {
        let psnr = self.job.held_out.psnr(&self.model.pictures(&self.job.held_out.shots));
        let course = &mut self.course;
        let loss = course.loss.iter().sum::<f64>() / course.loss.len().max(1) as f64;
        course.loss.clear();
        let seconds = self.earlier + self.start.elapsed().as_secs_f64();
        course.history.push(HistoryPoint { step: course.step, seconds, loss, held_out_psnr: psnr });
        progress.report("fit", course.step, self.job.steps, &format!("{psnr:.2} dB"));
        if psnr > course.best_psnr {
            course.best_psnr = psnr;
            for (k, best) in self.best.iter_mut().enumerate() {
                best.copy_from_slice(self.model.values(k));
            }
        }
        psnr
    }

    fn set(&mut self, values: &[Vec<f32>]) {
        for (k, values) in values.iter().enumerate() {
            self.model.values_mut(k).copy_from_slice(values);
            self.model.changed(k);
        }
    }

    fn go_to_best(&mut self) {
        let best = std::mem::take(&mut self.best);
        self.set(&best);
        self.best = best;
    }

    /// Writes a checkpoint if one is wanted. A disk that refuses it does not end the fit: the user is told, and the next
    /// one is tried.
    fn save(&mut self, progress: &dyn Progress) {
        let Some(folder) = &self.job.keeping.checkpoint else { return };
        progress.report("checkpoint", self.course.step, self.job.steps, "");
        let saved: Vec<Saved<'_>> = self
            .groups
            .iter()
            .enumerate()
            .map(|(k, group)| Saved {
                group,
                values: self.model.values(k),
                best: &self.best[k],
                optimizer: self.optimizers[k].state(),
            })
            .collect();
        match checkpoint::save(folder, &self.course, &saved, &self.fingerprint) {
            Ok(()) => self.saved = Some(self.course.step),
            Err(e) => {
                let refusal = e.to_string();
                if refusal != self.refusal {
                    progress.warn(&format!("the checkpoint could not be saved, the fit goes on: {refusal}"));
                    self.refusal = refusal;
                }
            }
        }
    }

    /// What remains when the fit breaks.
    fn kept(&self) -> String {
        match (self.saved, &self.job.keeping.checkpoint) {
            (Some(step), Some(folder)) => {
                format!("the checkpoint of step {step} in {} is unchanged", folder.display())
            }
            _ => "no checkpoint was kept".into(),
        }
    }

    /// Goes on from the checkpoint, if the job asks for it and there is one.
    fn restore(&mut self, progress: &dyn Progress) -> Result<(), FitError> {
        let keeping = self.job.keeping;
        let Some(folder) = keeping.checkpoint.as_ref().filter(|_| keeping.resume) else { return Ok(()) };
        let Some((course, groups)) = checkpoint::load(folder, &self.groups, &self.fingerprint)? else {
            progress.warn(&format!("{}: no checkpoint is there; the fit begins anew", folder.display()));
            return Ok(());
        };
        for (k, loaded) in groups.into_iter().enumerate() {
            self.optimizers[k].restore(loaded.optimizer).map_err(|e| FitError::Checkpoint {
                path: folder.join(checkpoint::FILE),
                rule: e.to_string(),
            })?;
            self.model.values_mut(k).copy_from_slice(&loaded.values);
            self.model.changed(k);
            self.best[k] = loaded.best;
        }
        self.earlier = course.history.last().map_or(0.0, |h| h.seconds);
        self.saved = Some(course.step);
        self.course = course;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
