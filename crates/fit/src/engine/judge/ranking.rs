//! In which order stages come: by few views, and by more where these leave it open.

use super::{Drawn, Stage, after_stop, picture_quality};
use crate::engine::light_asset::LightAsset;
use crate::engine::reference::{Rasterized, Reference, ReferencePicture};
use crate::engine::views::{Set, Setup, Views};
use crate::{FitError, Progress};
use std::ops::Range;

/// A stage is better than another one where its PSNR is higher by more than this, in decibels, and its FLIP lower: the views of a
/// choice are others than those of a report, and differences below are noise between the two.
pub(crate) const CLEAR_GAIN: f64 = 0.1;
/// What PSNR and FLIP in decibels make of a gain of [`CLEAR_GAIN`] in both: gains of less are not worth more views.
const LEAST_GAIN: f64 = 2.0 * CLEAR_GAIN;
/// Rounds of views, each of twice as many as that before; fewer where pictures are path traced, which takes long.
const ROUNDS: u32 = 3;
const ROUNDS_TRACED: u32 = 2;
/// Quantiles .975 of Student's distribution for 1, 2, ... degrees of freedom; the last one is taken for all that follow.
const STUDENT: [f64; 12] = [12.71, 4.30, 3.18, 2.78, 2.57, 2.45, 2.36, 2.31, 2.26, 2.23, 2.20, 2.18];

/// Scores of stages in held-out views: of PSNR and FLIP, both in decibels, the sum. Those that may be the best are seen in more views.
#[derive(Clone, Debug, PartialEq)]
pub struct Ranking {
    /// Of each stage in the views that it was seen in, the first ones of all.
    scores: Vec<Vec<f64>>,
}

/// How sure a choice is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Certainty {
    /// Views in which it was made.
    pub views: u64,
    /// Whether something else may be better in more of them.
    pub close: bool,
}

/// How good the pictures of each stage are in `count` held-out views, drawn by the rasterizer with `samples` samples
/// per axis of a pixel: the mean over the views, after the work was stopped over the first two of them, of PSNR and
/// FLIP, both in decibels.
///
/// # Errors
/// If a picture of the reference cannot be made.
pub fn scores(
    light: &LightAsset,
    reference: &dyn Reference,
    stages: &[Stage],
    views: &dyn Views,
    count: u64,
    samples: usize,
    progress: &dyn Progress,
) -> Result<Vec<f64>, FitError> {
    let ranked = |drawn: &[&dyn Reference]| ranked(reference, drawn, views, (count, 1), progress);
    let ranking = with_drawn(light, stages, samples, ranked)?;
    Ok(ranking.scores.iter().map(|s| mean(s)).collect())
}

/// As [`scores`], to find the best: after `count` views those stages that may still be the best are seen in twice as many further ones, and
/// then in four times as many.
///
/// # Errors
/// As [`scores`].
pub fn ranking(
    light: &LightAsset,
    reference: &dyn Reference,
    stages: &[Stage],
    views: &dyn Views,
    count: u64,
    samples: usize,
    progress: &dyn Progress,
) -> Result<Ranking, FitError> {
    let ranked = |drawn: &[&dyn Reference]| all_rounds(reference, drawn, views, count, progress);
    with_drawn(light, stages, samples, ranked)
}

fn with_drawn<R>(
    light: &LightAsset,
    stages: &[Stage],
    samples: usize,
    with: impl FnOnce(&[&dyn Reference]) -> R,
) -> R {
    let drawn: Vec<Drawn<'_>> = stages.iter().map(|s| s.drawn(light)).collect();
    let drawn: Vec<Rasterized<'_>> = drawn.iter().map(|d| d.sampled(samples)).collect();
    with(&drawn.iter().map(|d| d as &dyn Reference).collect::<Vec<_>>())
}

/// The ranking of pictures of several by those of a reference.
pub(super) fn all_rounds(
    reference: &dyn Reference,
    stages: &[&dyn Reference],
    views: &dyn Views,
    count: u64,
    progress: &dyn Progress,
) -> Result<Ranking, FitError> {
    let traced = stages.iter().copied().chain([reference]).any(|r| r.kind().spp.is_some());
    let rounds = if traced { ROUNDS_TRACED } else { ROUNDS };
    ranked(reference, stages, views, (count, rounds), progress)
}

fn ranked(
    reference: &dyn Reference,
    stages: &[&dyn Reference],
    views: &dyn Views,
    (least, rounds): (u64, u32),
    progress: &dyn Progress,
) -> Result<Ranking, FitError> {
    let mut ranking = Ranking { scores: vec![Vec::new(); stages.len()] };
    let even_after_stop = after_stop(stages);
    for round in 0..rounds {
        let open = if round == 0 { (0..stages.len()).collect() } else { ranking.open() };
        if open.len() < if round == 0 { 1 } else { 2 } {
            break;
        }
        let (before, count) = (ranking.views(), least << round);
        let note = if round == 0 { "" } else { "more views: it is close" };
        for i in 0..count {
            progress.report("choose", before + i, before + count, note);
            let stop = || (round > 0 || i >= even_after_stop) && progress.is_cancelled();
            let shown = |s: &Setup| in_view(s, reference, open.iter().map(|k| stages[*k]), &stop);
            // Numbers from `count` on are others than those of the rounds before.
            let number = if round == 0 { i } else { count + i };
            let found = if stop() { None } else { shown(&views.setup(Set::HeldOut, number, count))? };
            let Some(found) = found else {
                // A view that was stopped half way counts for none; further views show all sides, or none.
                if round > 0 {
                    ranking.scores.iter_mut().for_each(|s| s.truncate(before as usize));
                }
                return Ok(ranking);
            };
            open.iter().zip(found).for_each(|(k, score)| ranking.scores[*k].push(score));
        }
    }
    Ok(ranking)
}

/// Scores in one view; `None` where it was stopped.
fn in_view<'a>(
    setup: &Setup,
    reference: &dyn Reference,
    stages: impl Iterator<Item = &'a dyn Reference>,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Option<Vec<f64>>, FitError> {
    let Some(seen) = reference.picture_unless(setup, stop)? else { return Ok(None) };
    let of = |p: ReferencePicture| {
        let q = picture_quality(&seen, &p).quality;
        q.psnr - 20.0 * q.flip.max(1e-6).log10()
    };
    stages.map(|c| Ok(c.picture_unless(setup, stop)?.map(of))).collect()
}

impl Ranking {
    /// Index of the best stage.
    ///
    /// # Panics
    /// If there is none.
    pub fn best(&self) -> usize {
        self.best_of(0..self.scores.len())
    }

    /// Index of the best of some stages: of those that were seen in the most views the one with the highest mean; the first wins a tie.
    /// Others were found worse than one that was seen as often as they were.
    ///
    /// # Panics
    /// If there is none.
    pub fn best_of(&self, some: Range<usize>) -> usize {
        let views = some.clone().map(|k| self.scores[k].len()).max();
        let often = some.filter(|k| Some(self.scores[*k].len()) == views);
        let better = |best: usize, k: usize| {
            if mean(&self.scores[k]) > mean(&self.scores[best]) { k } else { best }
        };
        often.reduce(better).expect("something to choose from")
    }

    /// Views in which the best stage was seen.
    pub fn views(&self) -> u64 {
        self.scores.iter().map(Vec::len).max().unwrap_or(0) as u64
    }

    /// How sure the best stage is.
    pub fn certainty(&self) -> Certainty {
        Certainty { views: self.views(), close: self.open().len() > 1 }
    }

    /// The best stage, and those seen as often that stay open: by the 95% confidence interval of their mean difference from the best one they
    /// may gain more than [`LEAST_GAIN`].
    fn open(&self) -> Vec<usize> {
        if self.scores.is_empty() {
            return Vec::new();
        }
        let best = self.best();
        let may_gain = |k: usize| {
            let behind: Vec<f64> =
                self.scores[best].iter().zip(&self.scores[k]).map(|(b, other)| b - other).collect();
            let (n, mean) = (behind.len(), mean(&behind));
            let squares: f64 = behind.iter().map(|d| (d - mean) * (d - mean)).sum();
            // One view tells nothing about the next.
            let Some(free) = n.checked_sub(1).filter(|f| *f > 0) else { return f64::INFINITY };
            STUDENT[free.min(STUDENT.len()) - 1] * (squares / (free * n) as f64).sqrt() - mean
        };
        let as_often = |k: usize| self.scores[k].len() == self.scores[best].len();
        let is_open = |k: &usize| *k == best || as_often(*k) && may_gain(*k) > LEAST_GAIN;
        (0..self.scores.len()).filter(is_open).collect()
    }
}

/// Zero of nothing.
fn mean(of: &[f64]) -> f64 {
    of.iter().sum::<f64>() / (of.len() as f64).max(1.0)
}

/// Index of the highest score; the first wins a tie.
///
/// # Panics
/// If there is none.
pub fn highest(scores: &[f64]) -> usize {
    let better = |best: usize, k: usize| if scores[k] > scores[best] { k } else { best };
    assert!(!scores.is_empty(), "something to choose from");
    (0..scores.len()).fold(0, better)
}

#[cfg(test)]
mod tests;
