//! In which order assets come: by few views, and by more where these leave it open.

use super::{Drawn, Stage, after_stop, view_quality};
use crate::engine::light_asset::LightAsset;
use crate::engine::reference::{Rasterized, Reference, ReferencePicture};
use crate::engine::views::{Set, Setup, Views};
use crate::{FitError, Progress};

/// The views that stages are put in order by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Count {
    /// So many.
    Exactly(u64),
    /// So many. While another stage than the best may be better yet, twice as many others of the two, and then four times as many.
    AtLeast(u64),
}

/// Rounds of views, each of twice as many as that before.
const ROUNDS: u32 = 3;
/// A stage may be better yet where its mean difference from the best is smaller than so many standard errors.
const STANDARD_ERRORS: f64 = 2.0;
/// Unless all that could be gained is less than this, a score that nobody sees (.12 dB of PSNR, and 1.5% of FLIP).
const UNSEEN: f64 = 0.25;

/// How good the pictures of each stage are in `count` held-out views, drawn by the rasterizer with `samples` samples
/// per axis of a pixel: the mean over the views, after the work was stopped over the first two of them, of PSNR and
/// FLIP, both in decibels. Of a stage that was seen in fewer views than the best one it is what the best one has, less
/// the mean of the differences in these views.
///
/// # Errors
/// If a picture of the reference cannot be made.
pub fn scores(
    light: &LightAsset,
    reference: &dyn Reference,
    stages: &[Stage],
    views: &dyn Views,
    count: Count,
    samples: usize,
    progress: &dyn Progress,
) -> Result<Vec<f64>, FitError> {
    let drawn: Vec<Drawn<'_>> = stages.iter().map(|s| s.drawn(light)).collect();
    let drawn: Vec<Rasterized<'_>> = drawn.iter().map(|d| d.sampled(samples)).collect();
    let drawn: Vec<&dyn Reference> = drawn.iter().map(|d| d as &dyn Reference).collect();
    scored(reference, &drawn, views, count, progress)
}

/// Scores of pictures of several against those of a reference.
pub(super) fn scored(
    reference: &dyn Reference,
    stages: &[&dyn Reference],
    views: &dyn Views,
    count: Count,
    progress: &dyn Progress,
) -> Result<Vec<f64>, FitError> {
    let (least, rounds) = match count {
        Count::Exactly(n) => (n, 1),
        Count::AtLeast(n) => (n, ROUNDS),
    };
    let even_after_stop = after_stop(stages);
    let mut seen = Seen(vec![Vec::new(); stages.len()]);
    for round in 0..rounds {
        let open = if round == 0 { (0..stages.len()).collect() } else { seen.open() };
        if round > 0 && open.len() < 2 {
            break;
        }
        let count = least << round;
        for i in 0..count {
            progress.report("choose", i, count, "");
            let stop = || (round > 0 || i >= even_after_stop) && progress.is_cancelled();
            // A view that was stopped half way counts for none.
            let of = |s: &Setup| scores_in(s, reference, open.iter().map(|k| stages[*k]), &stop);
            let found = if stop() { None } else { of(&views.setup(Set::HeldOut, i, count))? };
            let Some(found) = found else { return Ok(seen.scores()) };
            open.iter().zip(found).for_each(|(k, score)| seen.0[*k].push(score));
        }
    }
    Ok(seen.scores())
}

/// Scores in one view; `None` where it was stopped.
fn scores_in<'a>(
    setup: &Setup,
    reference: &dyn Reference,
    stages: impl Iterator<Item = &'a dyn Reference>,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Option<Vec<f64>>, FitError> {
    let Some(ReferencePicture { image, .. }) = reference.picture_unless(setup, stop)? else {
        return Ok(None);
    };
    let of = |p: ReferencePicture| {
        let q = view_quality(&image, &p.image).quality;
        q.psnr - 20.0 * q.flip.max(1e-6).log10()
    };
    stages.map(|c| Ok(c.picture_unless(setup, stop)?.map(of))).collect()
}

/// Scores of each stage in the views that it was seen in: the first ones of all.
struct Seen(Vec<Vec<f64>>);

impl Seen {
    /// The best of the stages that were seen in all views; the first wins a tie.
    fn best(&self) -> usize {
        let views = self.0.iter().map(Vec::len).max().unwrap_or(0);
        let of = |k: &usize| mean(&self.0[*k]);
        let all = (0..self.0.len()).filter(|k| self.0[*k].len() == views);
        all.reduce(|best, k| if of(&k) > of(&best) { k } else { best }).unwrap_or(0)
    }

    /// By how much the best one is better in each view of another one.
    fn behind(&self, k: usize, best: usize) -> Vec<f64> {
        self.0[best].iter().zip(&self.0[k]).map(|(b, other)| b - other).collect()
    }

    /// The best stage, and those seen in as many views that may be better yet by more than is unseen.
    fn open(&self) -> Vec<usize> {
        let best = self.best();
        let may_gain = |k: usize| {
            let behind = self.behind(k, best);
            let (n, mean) = (behind.len() as f64, mean(&behind));
            let squares: f64 = behind.iter().map(|d| (d - mean) * (d - mean)).sum();
            STANDARD_ERRORS * (squares / ((n - 1.0).max(1.0) * n)).sqrt() - mean
        };
        let seen = |k: usize| self.0[k].len() == self.0[best].len();
        (0..self.0.len()).filter(|k| *k == best || seen(*k) && may_gain(*k) > UNSEEN).collect()
    }

    fn scores(&self) -> Vec<f64> {
        if self.0.is_empty() {
            return Vec::new();
        }
        let best = self.best();
        let of_best = mean(&self.0[best]);
        (0..self.0.len()).map(|k| of_best - mean(&self.behind(k, best))).collect()
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
mod tests {
    use super::*;
    use crate::Silent;
    use crate::engine::reference::ReferenceKind;
    use crate::engine::views::{Lighting, Moment, Orbit, Sphere};
    use photofit_image::Image;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// Grey pictures, brighter than those of the reference by what the number of the picture says; how many there were.
    struct Grey(fn(usize) -> f32, AtomicUsize);

    impl Grey {
        fn new(excess: fn(usize) -> f32) -> Self {
            Self(excess, AtomicUsize::new(0))
        }
    }

    impl Reference for Grey {
        fn kind(&self) -> ReferenceKind {
            ReferenceKind::RASTERIZED
        }

        fn picture(&self, _: &Setup) -> Result<ReferencePicture, FitError> {
            let value = 0.2 + (self.0)(self.1.fetch_add(1, Ordering::Relaxed));
            Ok(ReferencePicture::clean(Image::from_data(4, 4, 4, [value, value, value, 1.0].repeat(16))))
        }

        fn bounds(&self, _: Moment) -> Sphere {
            Sphere::UNIT
        }
    }

    /// Scores, and how many pictures of each there were.
    fn seen(stages: &[fn(usize) -> f32], count: Count) -> (Vec<f64>, Vec<usize>) {
        let stages: Vec<Grey> = stages.iter().map(|s| Grey::new(*s)).collect();
        let drawn: Vec<&dyn Reference> = stages.iter().map(|s| s as &dyn Reference).collect();
        let views = Orbit::new(0, &Lighting::Mixed, 4);
        let scores = scored(&Grey::new(|_| 0.0), &drawn, &views, count, &Silent).unwrap();
        (scores, stages.iter().map(|s| s.1.load(Ordering::Relaxed)).collect())
    }

    /// Bad in one of the first four views, in no other; and good in three of them, in no other.
    const MOSTLY_GOOD: fn(usize) -> f32 = |i| if i == 0 { 0.1 } else { 0.02 };
    const SELDOM_GOOD: fn(usize) -> f32 = |i| if i < 3 { 0.015 } else { 0.04 };

    #[test]
    fn what_few_views_leave_open_more_views_decide() {
        let stages = [SELDOM_GOOD, MOSTLY_GOOD, |_| 0.2];
        let (few, drawn) = seen(&stages, Count::Exactly(4));
        assert_eq!((highest(&few), &drawn[..]), (0, &[4, 4, 4][..]), "{few:?}");
        let (more, drawn) = seen(&stages, Count::AtLeast(4));
        assert_eq!((highest(&more), drawn[2]), (1, 4), "{more:?}");
        assert!(drawn[0] == drawn[1] && [12, 28].contains(&drawn[0]), "{drawn:?}");
        // What is out keeps its distance in the views that it was seen in.
        let behind = |s: &[f64]| s[1] - s[2];
        assert!((behind(&more) - behind(&few)).abs() < 1e-9, "{few:?} {more:?}");
    }

    #[test]
    fn what_is_clear_or_as_good_is_seen_in_no_more_views() {
        let clear = seen(&[|_| 0.2, |i| 0.02 + 0.01 * (i % 2) as f32], Count::AtLeast(4));
        assert_eq!((highest(&clear.0), &clear.1[..]), (1, &[4, 4][..]));
        let nearly = seen(&[|_| 0.02, |i| 0.02 + 1e-4 * (i % 2) as f32], Count::AtLeast(4));
        assert_eq!((highest(&nearly.0), &nearly.1[..]), (0, &[4, 4][..]));
        assert_eq!(seen(&[MOSTLY_GOOD], Count::AtLeast(4)).1, [4]);
        assert!(seen(&[], Count::AtLeast(4)).0.is_empty());
    }
}
