//! Chains of fits: coarse to fine, or level after level, each part with a checkpoint of its own.
//!
//! The first part keeps its checkpoint in the folder of the chain, where a single fit would, the others in `part1`, `part2`
//! and so on inside of it. A chain that begins anew sets all of them aside, so that none that is stopped and goes on later
//! meets what another one left. A time limit is for the fits of all parts together.

use super::checkpoint;
use super::trainer::{Checkpointing, HistoryPoint};
use crate::{FitError, Progress};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Most parts of a chain.
pub const MOST_PARTS: usize = 8;

/// The folder of the checkpoint of a part, of which the first is 0, in that of its chain.
pub fn part_folder(chain: &Path, part: usize) -> PathBuf {
    if part == 0 { chain.to_owned() } else { chain.join(format!("part{part}")) }
}

/// The files of checkpoints of a chain of `parts` parts, as paths in its folder.
pub fn checkpoint_files(parts: usize) -> Vec<String> {
    let file = |part| part_folder(Path::new(""), part).join(checkpoint::FILE);
    (0..parts).map(|part| file(part).to_string_lossy().into_owned()).collect()
}

/// A chain on its way.
#[derive(Debug)]
pub(crate) struct FitChain<'a> {
    checkpointing: &'a Checkpointing,
    /// Parts that are done.
    part: usize,
    /// What is left of the time limit.
    left: Option<Duration>,
    /// When the part at work began.
    began: Instant,
    /// Steps of the schedules of the parts that are done.
    steps: u64,
    /// The course of all parts.
    history: Vec<HistoryPoint>,
}

impl<'a> FitChain<'a> {
    /// A chain at its start. Unless it goes on from checkpoints, those of all parts but the first are set aside; the first
    /// one is by its fit.
    pub(crate) fn new(checkpointing: &'a Checkpointing, progress: &dyn Progress) -> Self {
        if let Some(folder) = checkpointing.checkpoint.as_ref().filter(|_| !checkpointing.resume) {
            (1..MOST_PARTS).for_each(|part| checkpoint::set_aside(&part_folder(folder, part), progress));
        }
        let (left, began) = (checkpointing.time_limit, Instant::now());
        Self { checkpointing, part: 0, left, began, steps: 0, history: Vec::new() }
    }

    /// Fits the next part by `fit`, which may take a `share`-th of the time that is left; all but the first by
    /// [`fit_after_another`].
    ///
    /// # Errors
    /// Those of `fit`.
    pub(crate) fn fit<T>(
        &mut self,
        share: usize,
        progress: &dyn Progress,
        mut fit: impl FnMut(&Checkpointing) -> Result<T, FitError>,
    ) -> Result<T, FitError> {
        self.began = Instant::now();
        let checkpoint = self.checkpointing.checkpoint.as_ref().map(|folder| part_folder(folder, self.part));
        let time_limit = self.left.map(|l| l / share.max(1) as u32);
        let checkpointing = Checkpointing { checkpoint, resume: self.checkpointing.resume, time_limit };
        if self.part == 0 { fit(&checkpointing) } else { fit_after_another(checkpointing, progress, fit) }
    }

    /// Adds the course of the part that [`Self::fit`] gave, whose schedule has `steps` steps.
    pub(crate) fn add(&mut self, history: &[HistoryPoint], steps: u64) {
        self.spend(history.last().map_or(0.0, |h| h.seconds));
        let before = self.history.last().map_or(0.0, |h| h.seconds);
        let told =
            |h: &HistoryPoint| HistoryPoint { step: self.steps + h.step, seconds: before + h.seconds, ..*h };
        let told: Vec<HistoryPoint> = history.iter().map(told).collect();
        self.history.extend(told);
        self.steps += steps;
        self.part += 1;
    }

    /// Takes what else the part that [`Self::fit`] gave took off the time that is left, seconds.
    pub(crate) fn spend(&mut self, seconds: f64) {
        // What earlier runs took is in a history too; this run cannot have taken longer than it lasts.
        let spent = Duration::try_from_secs_f64(seconds)
            .map_or(self.began.elapsed(), |s| s.min(self.began.elapsed()));
        self.left = self.left.map(|l| l.saturating_sub(spent));
    }

    /// Steps of the schedules of the parts that are done.
    pub(crate) fn steps(&self) -> u64 {
        self.steps
    }

    /// The course of all parts: steps of the schedule and seconds since the start of the first.
    pub(crate) fn into_history(self) -> Vec<HistoryPoint> {
        self.history
    }
}

/// Progress of a part as that of the whole.
pub(crate) struct OfPart<'a> {
    pub(crate) progress: &'a dyn Progress,
    /// Steps of the parts before, and of all.
    pub(crate) done: u64,
    pub(crate) steps: u64,
    /// What the part is, for people.
    pub(crate) name: String,
    /// Warnings that were told: what is wrong with the pictures is so for all parts.
    pub(crate) told: &'a Mutex<BTreeSet<String>>,
}

impl Progress for OfPart<'_> {
    fn report(&self, stage: &'static str, done: u64, _: u64, note: &str) {
        let note = format!("{}{}{note}", self.name, if note.is_empty() { "" } else { ", " });
        self.progress.report(stage, self.done + done, self.steps, &note);
    }

    fn warn(&self, text: &str) {
        if self.told.lock().is_ok_and(|mut told| told.insert(text.to_owned())) {
            self.progress.warn(text);
        }
    }

    fn note(&self, text: &str) {
        self.progress.note(text);
    }

    fn is_cancelled(&self) -> bool {
        self.progress.is_cancelled()
    }
}

/// Fits by `fit` what follows from another fit. What was not begun before has nothing to go on from; what cannot be gone on
/// from, since the fit before ended at other values than then, begins anew.
///
/// # Errors
/// Those of `fit`.
pub(crate) fn fit_after_another<T>(
    checkpointing: Checkpointing,
    progress: &dyn Progress,
    mut fit: impl FnMut(&Checkpointing) -> Result<T, FitError>,
) -> Result<T, FitError> {
    let begun =
        checkpointing.checkpoint.as_ref().is_some_and(|folder| folder.join(checkpoint::FILE).exists());
    let checkpointing = Checkpointing { resume: checkpointing.resume && begun, ..checkpointing };
    match fit(&checkpointing) {
        Err(e @ (FitError::Checkpoint { .. } | FitError::OtherFit { .. })) if checkpointing.resume => {
            progress.warn(&format!("{e}; this part of the fit begins anew"));
            fit(&Checkpointing { resume: false, ..checkpointing })
        }
        result => result,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Silent;

    fn point(step: u64, seconds: f64) -> HistoryPoint {
        HistoryPoint { step, seconds, loss: 0.5, quality: 20.0 }
    }

    #[test]
    fn histories_go_on_in_steps_and_seconds() {
        let checkpointing =
            Checkpointing { time_limit: Some(Duration::from_secs(100)), ..Checkpointing::default() };
        let mut chain = FitChain::new(&checkpointing, &Silent);
        chain.add(&[point(0, 0.5), point(25, 2.0)], 40);
        chain.add(&[point(0, 0.25), point(25, 1.0)], 60);
        assert!(chain.left.is_some_and(|l| l > Duration::from_secs(96)), "{:?}", chain.left);
        assert_eq!(chain.steps(), 100);
        let told: Vec<(u64, f64)> = chain.into_history().iter().map(|h| (h.step, h.seconds)).collect();
        assert_eq!(told, [(0, 0.5), (25, 2.0), (40, 2.25), (65, 3.0)]);
    }

    #[test]
    fn a_fresh_chain_sets_aside_what_another_left() {
        let dir = tempfile::tempdir().unwrap();
        let file = |part| part_folder(dir.path(), part).join(checkpoint::FILE);
        for part in 0..3 {
            std::fs::create_dir_all(part_folder(dir.path(), part)).unwrap();
            std::fs::write(file(part), "old").unwrap();
        }
        let mut checkpointing =
            Checkpointing { checkpoint: Some(dir.path().into()), resume: true, time_limit: None };
        FitChain::new(&checkpointing, &Silent);
        assert!((0..3).all(|k| file(k).exists()), "a chain that goes on keeps them");
        checkpointing.resume = false;
        FitChain::new(&checkpointing, &Silent);
        assert_eq!([0, 1, 2].map(|k| file(k).exists()), [true, false, false]);
        assert_eq!(checkpoint_files(3), ["fit.ckpt", "part1/fit.ckpt", "part2/fit.ckpt"]);
    }

    #[test]
    fn a_part_goes_on_only_from_what_it_left() {
        let dir = tempfile::tempdir().unwrap();
        let checkpointing =
            Checkpointing { checkpoint: Some(dir.path().into()), resume: true, time_limit: None };
        let mut chain = FitChain::new(&checkpointing, &Silent);
        let resumes = |chain: &mut FitChain<'_>| chain.fit(1, &Silent, |k| Ok(k.resume)).unwrap();
        assert!(resumes(&mut chain), "a user who asks for it is told that there is nothing");
        chain.add(&[], 1);
        std::fs::create_dir_all(part_folder(dir.path(), 1)).unwrap();
        assert!(!resumes(&mut chain), "a folder alone is no checkpoint");
        std::fs::write(part_folder(dir.path(), 1).join(checkpoint::FILE), "state").unwrap();
        assert!(resumes(&mut chain));
        let mut asked = Vec::new();
        let refused = |k: &Checkpointing| {
            asked.push(k.resume);
            let rule = "it is damaged".into();
            if k.resume { Err(FitError::Checkpoint { path: dir.path().into(), rule }) } else { Ok(()) }
        };
        chain.fit(1, &Silent, refused).unwrap();
        assert_eq!(asked, [true, false], "it begins anew");
    }
}
