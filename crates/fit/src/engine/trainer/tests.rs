//! The loop, run on a model of one picture whose pixels are the parameters.

use super::*;
use crate::Silent;
use crate::engine::cpu::{Chain, Cpu};
use crate::engine::reference::{ReferenceKind, ReferencePicture};
use crate::engine::views::{Lighting, Moment, Orbit, Setup, Shot, Sphere};
use photofit_image::Image;
use photofit_optim::{Optimizer, Temporal};
use photofit_raster::loss::Loss;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Width and height of the pictures.
const SIDE: usize = 3;
const STEPS: u64 = 90;

/// Grey pictures, each a little brighter or darker.
struct Greys;

impl Reference for Greys {
    fn kind(&self) -> ReferenceKind {
        ReferenceKind::GIVEN
    }

    fn picture(&self, s: &Setup) -> Result<ReferencePicture, FitError> {
        let grey = |x: usize, y: usize| 0.3 + 0.05 * (x + y) as f32 + 0.02 * s.camera.pinhole().eye.x.sin();
        Ok(ReferencePicture::clean(Image::from_fn(s.width, s.height, 4, |x, y, k| {
            if k < 3 { grey(x, y) } else { 1.0 }
        })))
    }

    fn bounds(&self, _: Moment) -> Sphere {
        Sphere::UNIT
    }
}

/// One picture; red and green in one group, blue in the other.
#[derive(Clone, Debug)]
struct Pixels {
    groups: [Vec<f32>; 2],
    /// Gradients turn into NaN at this step of the optimizer.
    breaks_at: Option<usize>,
    steps: std::sync::Arc<AtomicUsize>,
}

impl Pixels {
    fn new() -> Self {
        let n = SIDE * SIDE;
        Self { groups: [vec![0.8; 2 * n], vec![0.1; n]], breaks_at: None, steps: std::sync::Arc::default() }
    }

    fn pixel(&self, i: usize) -> [f32; 4] {
        [self.groups[0][2 * i], self.groups[0][2 * i + 1], self.groups[1][i], 1.0]
    }
}

impl Chain for Pixels {
    type Gradients = [Vec<f32>; 2];

    fn groups(&self) -> Vec<Group> {
        let rows = SIDE * SIDE;
        let group = |name: &'static str, columns: usize, rates| Group {
            name: name.into(),
            rows,
            columns,
            ranges: vec![[0.0, 1.0]; columns],
            unit: None,
            rates,
        };
        vec![group("red green", 2, vec![1.0, 0.5]), group("blue", 1, Vec::new())]
    }

    fn optimizer(&self, group: &Group) -> Result<Optimizer<f32>, FitError> {
        Optimizer::new(&group.name, group.rows * group.columns, Temporal::adam())
            .map_err(FitError::Preconditioner)
    }

    fn values(&self, group: usize) -> &[f32] {
        &self.groups[group]
    }

    fn values_mut(&mut self, group: usize) -> &mut [f32] {
        &mut self.groups[group]
    }

    fn changed(&mut self, _: usize) -> Result<(), ModelError> {
        Ok(())
    }

    fn gradients(&self) -> Self::Gradients {
        self.groups.clone()
    }

    fn moved<'a>(&'a mut self, gradients: &'a Self::Gradients, group: usize) -> (&'a mut [f32], &'a [f32]) {
        (&mut self.groups[group], &gradients[group])
    }

    fn step(
        &self,
        shots: &[Shot],
        _: PictureLoss,
        _: &[bool],
        g: &mut Self::Gradients,
    ) -> Result<f64, ModelError> {
        g.iter_mut().for_each(|g| g.fill(0.0));
        let mut loss = 0.0;
        for shot in shots {
            for (i, r) in shot.over_noise().reference.iter().enumerate() {
                let x = self.pixel(i);
                let e = [0, 1, 2].map(|k| x[k] - r[k]);
                loss += e.iter().map(|e| f64::from(e * e)).sum::<f64>();
                g[0][2 * i] += e[0];
                g[0][2 * i + 1] += e[1];
                g[1][i] += e[2];
            }
        }
        if self.breaks_at == Some(self.steps.fetch_add(1, Ordering::Relaxed)) {
            g[1][4] = f32::NAN;
        }
        Ok(loss)
    }

    fn pictures(&self, shots: &[Shot]) -> Result<Vec<Vec<[f32; 4]>>, ModelError> {
        Ok(shots.iter().map(|s| (0..s.width * s.height).map(|i| self.pixel(i)).collect()).collect())
    }
}

/// Says stop at the n-th question, and keeps the warnings.
#[derive(Default)]
struct Counting {
    asked: AtomicUsize,
    stop_at: Option<usize>,
    warnings: Mutex<Vec<String>>,
    notes: Mutex<Vec<String>>,
}

impl Progress for Counting {
    fn report(&self, _: &'static str, _: u64, _: u64, _: &str) {}

    fn is_cancelled(&self) -> bool {
        Some(self.asked.fetch_add(1, Ordering::Relaxed)) >= self.stop_at && self.stop_at.is_some()
    }

    fn warn(&self, text: &str) {
        self.warnings.lock().unwrap().push(text.into());
    }

    fn note(&self, text: &str) {
        self.notes.lock().unwrap().push(text.into());
    }
}

/// A phase in which these groups move at a rate of .02 and .03.
fn phase<'a>(name: &'static str, first: u64, steps: u64, groups: &[&'static str]) -> Phase<'a, Pixels> {
    let rate = |name: &&'static str| ((*name).into(), if *name == "blue" { 0.03 } else { 0.02 });
    let rates = groups.iter().map(rate).collect();
    Phase { name, first, steps, shrink: 1, rates, fade: None, reinitialised: None }
}

fn fit(
    model: Pixels,
    checkpointing: &Checkpointing,
    progress: &dyn Progress,
) -> Result<Trained<Pixels>, FitError> {
    // The second phase begins with blue made anew, and asks as long work does whether to stop.
    let renew = |m: &Pixels| {
        if progress.is_cancelled() {
            return Err(FitError::Interrupted);
        }
        Ok(m.groups[1].iter().map(|b| 0.5 * b + 0.2).collect())
    };
    let all = ["red green", "blue"];
    let mut phases = vec![
        phase("first", 0, 37, &all),
        phase("second", 37, 30, &all),
        phase("third", 67, STEPS - 67, &all),
    ];
    phases[1].reinitialised = Some((vec!["blue".into()], &renew as Initialiser<'_, Pixels>));
    fit_in(phases, model, checkpointing, progress)
}

fn fit_in(
    phases: Vec<Phase<'_, Pixels>>,
    model: Pixels,
    checkpointing: &Checkpointing,
    progress: &dyn Progress,
) -> Result<Trained<Pixels>, FitError> {
    fit_against(None, phases, model, checkpointing, progress)
}

fn fit_against(
    rival: Option<f64>,
    phases: Vec<Phase<'_, Pixels>>,
    model: Pixels,
    checkpointing: &Checkpointing,
    progress: &dyn Progress,
) -> Result<Trained<Pixels>, FitError> {
    let views = Orbit::new(0, &Lighting::Point, SIDE);
    let held_out = HeldOut::new(&Greys, &views, Sampling::SUPERSAMPLED, HELD_OUT, 0).unwrap();
    let job = Job {
        reference: &Greys,
        views: &views,
        held_out: &held_out,
        sampling: Sampling::SUPERSAMPLED,
        loss: Loss::Mse.into(),
        seed: 0,
        batch: Batch::new(2, 1),
        steps: phases.iter().map(|p| p.steps).sum(),
        rival,
        checkpointing,
        fingerprint: Fingerprint::default().option("model", "greys"),
    };
    train(Cpu::new(model)?, &job, |_| phases, progress)
}

/// What a fit gives, without times.
fn result(t: &Trained<Pixels>) -> (Vec<u32>, Vec<(u64, u64, u64)>, u64) {
    let bits = t.model.groups.iter().flatten().map(|x| x.to_bits()).collect();
    let evaluations = t.history.iter().map(|h| (h.step, h.loss.to_bits(), h.quality.to_bits())).collect();
    (bits, evaluations, t.steps)
}

fn checkpointing(folder: &Path, resume: bool) -> Checkpointing {
    Checkpointing { checkpoint: Some(folder.into()), resume, time_limit: None }
}

#[test]
fn a_fit_stopped_anywhere_resumes_to_the_same_bits() {
    let whole = result(&fit(Pixels::new(), &Checkpointing::default(), &Silent).unwrap());
    for stop_at in 0..STEPS as usize + 3 {
        let dir = tempfile::tempdir().unwrap();
        let progress = Counting { stop_at: Some(stop_at), ..Counting::default() };
        let stopped = fit(Pixels::new(), &checkpointing(dir.path(), false), &progress).unwrap();
        assert_eq!(stopped.stopped, stop_at <= STEPS as usize, "{stop_at}");
        let told = Counting::default();
        let resumed = fit(Pixels::new(), &checkpointing(dir.path(), true), &told).unwrap();
        assert!(result(&resumed) == whole, "stopped at question {stop_at}");
        if stopped.stopped {
            let line = format!("resuming at step {} of {STEPS}", stopped.steps);
            assert_eq!(told.notes.into_inner().unwrap(), [line]);
        }
        assert!(!resumed.stopped);
    }
}

#[test]
fn a_fit_may_be_stopped_many_times() {
    let whole = result(&fit(Pixels::new(), &Checkpointing::default(), &Silent).unwrap());
    let dir = tempfile::tempdir().unwrap();
    for _ in 0..200 {
        let progress = Counting { stop_at: Some(3), ..Counting::default() };
        let t = fit(Pixels::new(), &checkpointing(dir.path(), true), &progress).unwrap();
        if !t.stopped {
            assert!(result(&t) == whole);
            return;
        }
    }
    panic!("it never came to its end");
}

#[test]
fn a_stopped_fit_gives_its_latest_state_where_that_is_best() {
    let progress = Counting { stop_at: Some(30), ..Counting::default() };
    let t = fit(Pixels::new(), &Checkpointing::default(), &progress).unwrap();
    assert!(t.stopped && t.steps == 30);
    let last = t.history.last().unwrap();
    assert_eq!(last.step, 30, "it was evaluated where it stopped");
    assert!(last.quality > t.history[t.history.len() - 2].quality);
}

#[test]
fn a_folder_that_cannot_be_written_ends_no_fit() {
    let dir = tempfile::tempdir().unwrap();
    // A file stands where the folder would be made.
    let blocked = dir.path().join("state");
    std::fs::write(&blocked, b"x").unwrap();
    let progress = Counting::default();
    let whole = result(&fit(Pixels::new(), &Checkpointing::default(), &Silent).unwrap());
    let t = fit(Pixels::new(), &checkpointing(&blocked, false), &progress).unwrap();
    assert!(result(&t) == whole);
    let warnings = progress.warnings.into_inner().unwrap();
    assert_eq!(warnings.len(), 1, "told once: {warnings:?}");
    assert!(warnings[0].contains("goes on") && warnings[0].contains("state"), "{}", warnings[0]);
}

#[test]
fn a_value_that_is_not_finite_names_step_group_and_what_is_kept() {
    let dir = tempfile::tempdir().unwrap();
    let broken = Pixels { breaks_at: Some(60), ..Pixels::new() };
    let error = fit(broken, &checkpointing(dir.path(), false), &Silent).unwrap_err().to_string();
    for part in ["step 60", "blue", "NaN", "checkpoint of step 50"] {
        assert!(error.contains(part), "{part:?} in {error}");
    }
    // What was kept is good.
    let resumed = fit(Pixels::new(), &checkpointing(dir.path(), true), &Silent).unwrap();
    assert!(result(&resumed) == result(&fit(Pixels::new(), &Checkpointing::default(), &Silent).unwrap()));
}

#[test]
fn a_fit_beats_its_start() {
    let t = fit(Pixels::new(), &Checkpointing::default(), &Silent).unwrap();
    let best = t.history.iter().map(|h| h.quality).fold(f64::NEG_INFINITY, f64::max);
    assert!(best > t.history[0].quality + 10.0, "{:?}", t.history);
}

#[test]
fn a_phase_without_progress_ends_early_and_what_it_left_out_is_counted() {
    let phases = || vec![phase("frozen", 0, 400, &[]), phase("moving", 400, 50, &["red green", "blue"])];
    let t = fit_in(phases(), Pixels::new(), &Checkpointing::default(), &Silent).unwrap();
    // The start is the best of the first phase, and six evaluations after it are none better: its last quarter follows, which runs
    // whole.
    let evaluated: Vec<u64> = t.history.iter().map(|h| h.step).collect();
    assert_eq!(evaluated[..7], [0, 25, 50, 75, 100, 125, 150]);
    assert_eq!(evaluated[7..], [325, 350, 375, 400, 425, 450]);
    assert_eq!((t.steps, t.reached(), t.stopped), (300, 450, false));
    // A longer one ends in its last quarter, too: at 600, then 150 steps later.
    let long = fit_in(vec![phase("frozen", 0, 800, &[])], Pixels::new(), &Checkpointing::default(), &Silent)
        .unwrap();
    let evaluated: Vec<u64> = long.history.iter().map(|h| h.step).collect();
    assert_eq!(evaluated[6..], [150, 625, 650, 675, 700, 725, 750]);
    assert_eq!((long.steps, long.reached()), (300, 750));
    // Stopped in the second phase, and gone on with.
    let dir = tempfile::tempdir().unwrap();
    let progress = Counting { stop_at: Some(270), ..Counting::default() };
    let stopped = fit_in(phases(), Pixels::new(), &checkpointing(dir.path(), false), &progress).unwrap();
    assert_eq!((stopped.steps, stopped.reached(), stopped.stopped), (269, 419, true));
    let resumed = fit_in(phases(), Pixels::new(), &checkpointing(dir.path(), true), &Silent).unwrap();
    assert!(result(&resumed) == result(&t));
    assert_eq!(resumed.reached(), 450);
}

#[test]
fn a_fit_far_behind_its_rival_ends_early() {
    let all = ["red green", "blue"];
    let phases = || vec![phase("first", 0, 300, &all), phase("second", 300, 100, &all)];
    let fit = |rival, folder: &Checkpointing, progress: &dyn Progress| {
        fit_against(rival, phases(), Pixels::new(), folder, progress).unwrap()
    };
    let alone = fit(None, &Checkpointing::default(), &Silent);
    let quality = |t: &Trained<Pixels>| t.history.iter().map(|h| h.quality).fold(f64::NEG_INFINITY, f64::max);
    let best = quality(&alone);
    assert!(alone.behind.is_none() && best > alone.history[0].quality + 3.0, "{:?}", alone.history);
    // A rival within reach costs no step, though the fit starts far below it.
    let near = fit(Some(best), &Checkpointing::default(), &Silent);
    assert!(result(&near) == result(&alone) && near.behind.is_none());
    // One out of reach ends it at the first evaluation at which that can be told, in all its phases.
    let rival = best + 1000.0;
    let far = fit(Some(rival), &Checkpointing::default(), &Silent);
    let evaluated: Vec<u64> = far.history.iter().map(|h| h.step).collect();
    assert_eq!(
        (&evaluated[..], far.steps, far.reached(), far.stopped),
        (&[0, 25, 50, 75, 100][..], 100, 100, false)
    );
    assert_eq!(far.behind.map(f64::to_bits), Some((rival - quality(&far)).to_bits()));
    // Out of reach: more than 3 dB above what it came to with as much in each of the 300 steps to come.
    let best_at_100 = alone.history[..5].iter().map(|h| h.quality).fold(f64::NEG_INFINITY, f64::max);
    let bound = best_at_100 + 3.0 * (best_at_100 - alone.history[0].quality) + 3.0;
    let steps = |rival| fit(Some(rival), &Checkpointing::default(), &Silent).steps;
    assert!(steps(bound + 0.01) == 100 && steps(bound - 0.01) > 100, "{bound}");
    // The same where it was stopped before that, and gone on with; and where it is gone on with after its end.
    let dir = tempfile::tempdir().unwrap();
    let progress = Counting { stop_at: Some(30), ..Counting::default() };
    let stopped = fit(Some(rival), &checkpointing(dir.path(), false), &progress);
    assert!(stopped.stopped && stopped.steps < 50 && stopped.behind.is_none());
    for _ in 0..2 {
        let resumed = fit(Some(rival), &checkpointing(dir.path(), true), &Silent);
        assert!(result(&resumed) == result(&far) && resumed.behind == far.behind);
    }
}
