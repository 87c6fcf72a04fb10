//! The trainer: one loop for all models. Phases, schedule, evaluation of held-out views, best state, patience, checkpoints,
//! progress and cancellation.
//!
//! What is saved when a fit is stopped is what an undisturbed one has at that step: evaluations happen at fixed steps only, and
//! the last evaluation of a stopped fit goes into its result, not into its checkpoint.

mod held_out;

pub use super::pool::Batch;
pub use held_out::{HeldOut, Measure, relative_error};

use super::checkpoint::{self, Course, Digest, Saved};
use super::fingerprint::Fingerprint;
use super::loss::PictureLoss;
use super::model::{Group, GroupName, Model, ModelError, Snapshot};
use super::pool::{Batches, Pool};
use super::reference::Reference;
use super::views::{Sampling, Views};
use crate::{FitError, Progress};
use photofit_optim::Schedule;
use photofit_raster::deferred::Masks;
use std::borrow::Cow;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Views of the early stop, where pictures are not small.
pub(crate) const HELD_OUT: u64 = 5;
/// Steps between two evaluations of the held-out views.
const EVALUATE_EVERY: u64 = 25;
/// Evaluations without progress after which a phase goes on to its end, in which rates fall, or ends there.
const PATIENCE: usize = 6;
/// A fit is far behind its rival where it would be by more than this, in dB, if it gained as much in each step to come as in the
/// mean of those made. Fits gain less and less; what is left is for phases that show more at once.
const FAR_BEHIND: f64 = 3.0;
/// Steps before which that cannot be told.
const LEAST_TOLD: u64 = 100;

/// One evaluation of the held-out views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HistoryPoint {
    /// Steps made.
    pub step: u64,
    /// Wall time since the start of the fit.
    pub seconds: f64,
    /// Mean training loss since the last evaluation.
    pub loss: f64,
    /// Quality of the pictures of the held-out views, dB: what their [`Measure`] says.
    pub quality: f64,
}

impl HistoryPoint {
    /// The mean training loss since the last evaluation; `None` where no step was made since.
    pub fn training_loss(&self) -> Option<f64> {
        // The sum of no losses is -0.
        self.loss.is_sign_positive().then_some(self.loss)
    }
}

/// Where and how a fit keeps its state.
#[derive(Clone, Debug, Default)]
pub struct Checkpointing {
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
    pub loss: PictureLoss,
    /// Seed of the draws.
    pub seed: u64,
    /// Pictures of a step.
    pub batch: Batch,
    /// Steps of all phases.
    pub steps: u64,
    /// Quality, in the held-out views, of what is there without a fit: one that is far behind ends, after 100 steps and a tenth of
    /// all at the earliest.
    pub rival: Option<f64>,
    /// Checkpoints and limits.
    pub checkpointing: &'a Checkpointing,
    /// The options that the result depends on: a checkpoint of other ones is refused.
    pub fingerprint: Fingerprint,
}

impl std::fmt::Debug for Job<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Job").field("fingerprint", &self.fingerprint).finish_non_exhaustive()
    }
}

/// Computes new values of groups, one after the other, from the best state so far.
pub type Initialiser<'a, A> = &'a dyn Fn(&A) -> Result<Vec<f32>, FitError>;

/// A stretch of the fit of an asset with rates of its own.
pub struct Phase<'a, A> {
    /// What it does, for people.
    pub name: &'static str,
    /// Its first step.
    pub first: u64,
    /// Its number of steps.
    pub steps: u64,
    /// Pictures are smaller by this factor.
    pub shrink: usize,
    /// Groups that move, by their names, with their peak rates; the others are frozen.
    pub rates: Vec<(GroupName, f64)>,
    /// Slopes of alpha masks, which fade in its steps ([`Masks::Faded`]), at its first step and after its last one; `None`:
    /// masks are cut. Evaluations always cut them.
    pub fade: Option<[f32; 2]>,
    /// At its beginning the fit goes back to the best state, and these groups are initialised again from it, unless that looks
    /// worse.
    pub reinitialised: Option<(Vec<GroupName>, Initialiser<'a, A>)>,
}

impl<A> std::fmt::Debug for Phase<'_, A> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Phase")
            .field("name", &self.name)
            .field("first", &self.first)
            .field("steps", &self.steps)
            .field("shrink", &self.shrink)
            .field("rates", &self.rates)
            .field("fade", &self.fade)
            .field("reinitialised", &self.reinitialised.as_ref().map(|r| &r.0))
            .finish()
    }
}

impl<A> Phase<'_, A> {
    fn end(&self) -> u64 {
        self.first + self.steps
    }

    /// The step at which its last quarter begins. Rates are low there, and show what the noise of higher ones hid: a phase without
    /// progress goes on with it.
    fn falling(&self) -> u64 {
        self.end() - self.steps / 4
    }

    /// Where a phase goes on that makes no progress at `step`.
    fn next_stretch(&self, step: u64) -> u64 {
        if step < self.falling() { self.falling() } else { self.end() }
    }

    /// Peak rate of a group.
    pub fn rate(&self, group: &str) -> f64 {
        self.rates.iter().find(|(name, _)| name == group).map_or(0.0, |(_, rate)| *rate)
    }

    /// How alpha masks are drawn in a step.
    fn masks(&self, step: u64) -> Masks {
        self.fade.map_or(Masks::Cut, |[first, last]| {
            let share = (step - self.first) as f32 / self.steps.max(1) as f32;
            Masks::Faded { slope: first * (last / first).powf(share) }
        })
    }

    /// Whether all groups that it names are there.
    fn check(&self, groups: &[Group]) -> Result<(), FitError> {
        let again = self.reinitialised.iter().flat_map(|(names, _)| names);
        let mut named = self.rates.iter().map(|(name, _)| name).chain(again);
        match named.find(|name| position(groups, name).is_none()) {
            None => Ok(()),
            Some(name) => {
                let rule =
                    format!("{:?} names the group {name:?}; the model has none of this name", self.name);
                Err(FitError::Setting { field: "phases", rule })
            }
        }
    }
}

/// Number of the group of a name.
fn position(groups: &[Group], name: &str) -> Option<usize> {
    groups.iter().position(|g| g.name == name)
}

/// The end of a fit.
#[derive(Debug)]
pub struct Trained<A> {
    /// The best state seen on the held-out views.
    pub model: A,
    /// The course of the fit.
    pub history: Vec<HistoryPoint>,
    /// Steps made.
    pub steps: u64,
    /// Steps that were made before this run: those of its checkpoint.
    pub resumed: u64,
    /// Million samples per second of the steps.
    pub mpix_per_s: f64,
    /// Ended by the user or the time limit.
    pub stopped: bool,
    /// By how many dB it was behind its rival when it ended early for that.
    pub behind: Option<f64>,
}

impl<A> Trained<A> {
    /// The step up to which it came, those counted that phases left out when they ended early: phases that begin before it ran.
    pub(crate) fn reached(&self) -> u64 {
        self.history.last().map_or(0, |h| h.step)
    }

    /// Whether a step came to something better than the start, in the held-out views: the best state is another one then.
    pub(crate) fn gained(&self) -> bool {
        let first = self.history.first().map_or(f64::INFINITY, |h| h.quality);
        self.history.iter().any(|h| h.quality > first)
    }
}

struct Trainer<'a, M: Model> {
    job: &'a Job<'a>,
    model: M,
    groups: Vec<Group>,
    course: Course,
    pool: Pool,
    fingerprint: Fingerprint,
    /// Step of the checkpoint that stands in the folder.
    saved: Option<u64>,
    /// The last refusal to save that the user was told of.
    refusal: String,
    samples: f64,
    step_seconds: f64,
    /// By how many dB it is behind its rival, once it ended for that.
    behind: Option<f64>,
    start: Instant,
    /// Seconds of the runs before this one.
    earlier: f64,
}

/// Runs a fit of `model`; `phases` lays out its phases, given the quality of the held-out views at the start.
///
/// # Errors
/// If a picture cannot be made, a checkpoint belongs to another fit, or a value is not finite; what was saved stays.
pub fn train<'p, M: Model>(
    model: M,
    job: &Job<'_>,
    phases: impl FnOnce(f64) -> Vec<Phase<'p, M::Asset>>,
    progress: &dyn Progress,
) -> Result<Trained<M::Asset>, FitError>
where
    M::Asset: 'p,
{
    let groups = model.groups().to_vec();
    let fingerprint = fingerprint(job, &model, groups.len()).map_err(|b| fit_error(b, 0, String::new()))?;
    let mut t = Trainer {
        job,
        model,
        groups,
        course: Course { best_quality: f64::NEG_INFINITY, ..Course::default() },
        pool: Pool::default(),
        fingerprint,
        saved: None,
        refusal: String::new(),
        samples: 0.0,
        step_seconds: 0.0,
        behind: None,
        start: Instant::now(),
        earlier: 0.0,
    };
    t.restore(progress)?;
    let resumed = t.course.step - t.course.skipped;
    let start = match t.course.history.first() {
        Some(first) => first.quality,
        None => t.evaluate(progress)?,
    };
    progress.report("fit", t.course.step, job.steps, &job.held_out.measure.told(start));
    let mut stopped = false;
    let phases = phases(start);
    phases.iter().try_for_each(|p| p.check(&t.groups))?;
    for (k, phase) in phases.iter().enumerate() {
        if t.course.step >= phase.end() {
            continue;
        }
        stopped = (t.course.begun <= k && t.begin(k, phase, progress)?) || t.run(phase, progress)?;
        if stopped {
            break;
        }
    }
    if stopped {
        t.save(progress)?;
        if t.course.history.last().is_none_or(|h| h.step != t.course.step) {
            t.evaluate(progress)?;
        }
    }
    t.go_to_best()?;
    let kept = t.kept();
    let steps = t.course.step - t.course.skipped;
    Ok(Trained {
        model: t.model.into_asset().map_err(|b| fit_error(b, t.course.step, kept))?,
        history: t.course.history,
        steps,
        resumed,
        mpix_per_s: t.samples / 1e6 / t.step_seconds.max(1e-9),
        stopped,
        behind: t.behind.filter(|_| !stopped),
    })
}

/// What must agree between the run that wrote a checkpoint and the one that reads it: the options that the result depends on,
/// the values it starts from, and the pictures of the held-out views. What else a model holds belongs into the options.
fn fingerprint<M: Model>(job: &Job<'_>, model: &M, groups: usize) -> Result<Fingerprint, ModelError> {
    let mut digest = Digest::new();
    for g in 0..groups {
        digest.add(&model.values(g)?);
    }
    let mut picture = Digest::new();
    job.held_out.references().iter().for_each(|r| picture.add(r.as_flattened()));
    let Job { fingerprint, batch, steps, loss, sampling, .. } = job;
    let options = fingerprint
        .clone()
        .option("pictures of a step", batch.pictures())
        .option("new pictures", batch.fresh())
        .option("steps", steps);
    let options = options.option("sampling", format!("{sampling:?}"));
    let options = options.digest("what the fit starts from", digest);
    // The loss is no option here: where none was asked for, it follows from the pictures.
    Ok(options.digest("what its pictures show", picture).digest("the loss", loss.name()))
}

/// The error of a fit whose model fails at a step, with what remains.
fn fit_error(error: ModelError, step: u64, kept: String) -> FitError {
    match error {
        ModelError::Loss(value) => FitError::Loss { step, value, kept },
        ModelError::Optim { ago, source } => FitError::Optim { step: step.saturating_sub(ago), source, kept },
        ModelError::Device(source) => FitError::Device { step, source, kept },
        ModelError::Picture(source) => FitError::Picture { step, source, kept },
    }
}

impl<M: Model> Trainer<'_, M> {
    /// What happens once at the beginning of a phase; true when the user stopped it, which leaves the state before it.
    fn begin(
        &mut self,
        number: usize,
        phase: &Phase<'_, M::Asset>,
        progress: &dyn Progress,
    ) -> Result<bool, FitError> {
        match &phase.reinitialised {
            None => {
                if self.course.history.last().is_none_or(|h| h.step != self.course.step) {
                    self.evaluate(progress)?;
                }
            }
            Some((names, make)) => {
                let named = names.iter().map(|name| position(&self.groups, name).expect("checked"));
                let again: Vec<usize> = named.collect();
                let copy = |g| self.model.values(g).map(Cow::into_owned);
                let before: Result<Vec<Vec<f32>>, ModelError> = (0..self.groups.len()).map(copy).collect();
                let before = self.at_step(before)?;
                self.go_to_best()?;
                let asset = self.model.asset().map(make);
                let made = match self.at_step(asset)? {
                    Err(FitError::Interrupted) => {
                        for (g, values) in before.iter().enumerate() {
                            let set = self.model.set(g, values);
                            self.at_step(set)?;
                        }
                        return Ok(true);
                    }
                    made => made?,
                };
                let mut rest = &made[..];
                for g in &again {
                    let (values, others) = rest.split_at(self.groups[*g].len());
                    let set = self.model.set(*g, values);
                    self.at_step(set)?;
                    rest = others;
                }
                let best = self.course.best_quality;
                let is_worse = self.evaluate(progress)? < best;
                for g in again {
                    if is_worse {
                        let back = self.model.go_to_best(g);
                        self.at_step(back)?;
                    }
                    self.model.reset_optimizer(g)?;
                }
            }
        }
        self.course.begun = number + 1;
        Ok(false)
    }

    /// Runs a phase to its end; true when the user or the time limit stopped it.
    fn run(&mut self, phase: &Phase<'_, M::Asset>, progress: &dyn Progress) -> Result<bool, FitError> {
        while self.course.step < phase.end() {
            let over = self.job.checkpointing.time_limit.is_some_and(|l| self.start.elapsed() >= l);
            if over || progress.is_cancelled() {
                return Ok(true);
            }
            self.behind = self.far_behind();
            let end = match self.behind {
                Some(_) => self.job.steps,
                None if self.is_stale(phase) => phase.next_stretch(self.course.step),
                None => self.course.step,
            };
            if end > self.course.step {
                self.course.skipped += end - self.course.step;
                self.course.step = end;
                continue;
            }
            self.one_step(phase)?;
            if self.course.step.is_multiple_of(EVALUATE_EVERY) || self.course.step == phase.end() {
                self.evaluate(progress)?;
                self.save(progress)?;
            }
        }
        Ok(false)
    }

    /// Whether the last evaluations of a stretch of a phase brought nothing better.
    fn is_stale(&self, phase: &Phase<'_, M::Asset>) -> bool {
        let here: Vec<&HistoryPoint> = self.course.history.iter().filter(|h| h.step >= phase.first).collect();
        let best = here.iter().map(|h| h.quality).fold(f64::NEG_INFINITY, f64::max);
        let Some(first) = here.iter().position(|h| h.quality >= best) else { return false };
        let since = if self.course.step < phase.falling() { 0 } else { phase.falling() };
        here[first + 1..].iter().filter(|h| h.step > since).count() >= PATIENCE
    }

    /// By how many dB the best state is behind the rival where that was looked at just now, and where no fit is expected to make it
    /// up.
    fn far_behind(&self) -> Option<f64> {
        let (course, job) = (&self.course, self.job);
        let (first, rival) = (course.history.first()?.quality, job.rival?);
        let made = course.step - course.skipped;
        if course.history.last()?.step != course.step || made < LEAST_TOLD.max(job.steps / 10) {
            return None;
        }
        let best = course.best_quality;
        let gain = (best - first) / made as f64 * (job.steps - course.step) as f64;
        (best + gain + FAR_BEHIND < rival).then_some(rival - best)
    }

    fn one_step(&mut self, phase: &Phase<'_, M::Asset>) -> Result<(), FitError> {
        let job = self.job;
        let step = self.course.step;
        let from = Batches {
            reference: job.reference,
            views: job.views,
            seed: job.seed,
            size: job.batch.pictures() as u64,
            fresh: job.batch.fresh() as u64,
            sampling: job.sampling,
        };
        let shots = self.pool.batch(&from, (phase.first, step), phase.shrink);
        let shots = shots.map_err(|e| e.at_step(step, || self.kept()))?;
        let schedule = Schedule::WarmupCosine { warmup: 10, total: phase.steps, floor: 0.05 };
        let factor = schedule.factor(step - phase.first);
        let rates: Vec<f64> = self.groups.iter().map(|g| phase.rate(&g.name) * factor).collect();
        self.model.step_masks(phase.masks(step));
        self.model.phase_share((step - phase.first) as f64 / phase.steps.max(1) as f64)?;
        let began = Instant::now();
        let made = self.model.step(&shots, job.loss, &rates);
        self.at_step(made)?;
        self.step_seconds += began.elapsed().as_secs_f64();
        let per_pixel = job.sampling.per_axis.pow(2);
        self.samples += shots.iter().map(|s| (s.width * s.height * per_pixel) as f64).sum::<f64>();
        self.course.step += 1;
        Ok(())
    }

    /// The error of the fit where the model fails at this step.
    fn at_step<A>(&self, result: Result<A, ModelError>) -> Result<A, FitError> {
        result.map_err(|b| fit_error(b, self.course.step, self.kept()))
    }

    /// Takes the losses that the model has not told yet.
    fn take_losses(&mut self) -> Result<(), FitError> {
        let began = Instant::now();
        let losses = self.model.losses();
        self.step_seconds += began.elapsed().as_secs_f64();
        let latest = self.course.step.saturating_sub(1);
        let losses = losses.map_err(|b| fit_error(b, latest, self.kept()))?;
        let first = self.course.step - losses.len() as u64;
        if let Some((i, value)) = losses.iter().enumerate().find(|(_, l)| !l.is_finite()) {
            return Err(FitError::Loss { step: first + i as u64, value: *value, kept: self.kept() });
        }
        self.course.loss.extend(losses);
        Ok(())
    }

    /// Quality of the held-out views; keeps the best state.
    fn evaluate(&mut self, progress: &dyn Progress) -> Result<f64, FitError> {
        self.take_losses()?;
        self.model.notes().iter().for_each(|note| progress.note(note));
        let pictures = self.model.pictures(self.job.held_out.shots());
        let held_out = self.job.held_out;
        let quality = held_out.quality(&self.at_step(pictures)?);
        let course = &mut self.course;
        let loss = course.loss.iter().sum::<f64>() / course.loss.len().max(1) as f64;
        course.loss.clear();
        let seconds = self.earlier + self.start.elapsed().as_secs_f64();
        course.history.push(HistoryPoint { step: course.step, seconds, loss, quality });
        progress.report("fit", course.step, self.job.steps, &held_out.measure.told(quality));
        if quality > course.best_quality {
            course.best_quality = quality;
            let kept = self.model.keep_best();
            self.at_step(kept)?;
        }
        Ok(quality)
    }

    fn go_to_best(&mut self) -> Result<(), FitError> {
        for g in 0..self.groups.len() {
            let gone = self.model.go_to_best(g);
            self.at_step(gone)?;
        }
        Ok(())
    }

    /// Writes a checkpoint if one is wanted. A disk that refuses it does not end the fit: the user is told, and the next
    /// one is tried.
    fn save(&mut self, progress: &dyn Progress) -> Result<(), FitError> {
        let Some(folder) = &self.job.checkpointing.checkpoint else { return Ok(()) };
        self.take_losses()?;
        progress.report("checkpoint", self.course.step, self.job.steps, "");
        let snapshots = (0..self.groups.len()).map(|g| self.model.snapshot(g)).collect::<Result<Vec<_>, _>>();
        let snapshots = self.at_step(snapshots)?;
        let saved: Vec<Saved<'_>> = self
            .groups
            .iter()
            .zip(&snapshots)
            .map(|(group, s)| Saved { group, values: &s.values, best: &s.best, optimizer: &s.optimizer })
            .collect();
        let refusal = match checkpoint::save(folder, &self.course, &saved, &self.fingerprint) {
            Ok(()) => {
                self.saved = Some(self.course.step);
                return Ok(());
            }
            Err(e) => e.to_string(),
        };
        if refusal != self.refusal {
            progress.warn(&format!("the checkpoint could not be saved, the fit goes on: {refusal}"));
            self.refusal = refusal;
        }
        Ok(())
    }

    /// What remains when the fit breaks.
    fn kept(&self) -> String {
        match (self.saved, &self.job.checkpointing.checkpoint) {
            (Some(step), Some(folder)) => {
                format!("the checkpoint of step {step} in {} is unchanged", folder.display())
            }
            _ => "no checkpoint was kept".into(),
        }
    }

    /// Goes on from the checkpoint, if the job asks for it and there is one.
    fn restore(&mut self, progress: &dyn Progress) -> Result<(), FitError> {
        let checkpointing = self.job.checkpointing;
        let Some(folder) = &checkpointing.checkpoint else { return Ok(()) };
        if !checkpointing.resume {
            checkpoint::set_aside(folder, progress);
            return Ok(());
        }
        let Some((course, groups)) = checkpoint::load(folder, &self.groups, &self.fingerprint)? else {
            progress.warn(&format!("{}: no checkpoint is there; the fit begins anew", folder.display()));
            return Ok(());
        };
        for (k, loaded) in groups.into_iter().enumerate() {
            let (values, best) = (loaded.values.into(), loaded.best.into());
            let saved = Snapshot { values, best, optimizer: Cow::Owned(loaded.optimizer) };
            match self.model.restore(k, saved) {
                Err(ModelError::Optim { source, .. }) => {
                    let (path, rule) = (folder.join(checkpoint::FILE), source.to_string());
                    return Err(FitError::Checkpoint { path, rule });
                }
                restored => self.at_step(restored)?,
            }
        }
        self.earlier = course.history.last().map_or(0.0, |h| h.seconds);
        self.saved = Some(course.step);
        progress.note(&format!("resuming at step {} of {}", course.step, self.job.steps));
        self.course = course;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
