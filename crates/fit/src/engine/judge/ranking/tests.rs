//! Which stages are seen in more views, and which comes first.

use super::*;
use crate::Silent;
use crate::engine::reference::ReferenceKind;
use crate::engine::views::{Lighting, Moment, Orbit, Sphere};
use photofit_image::Image;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Grey pictures, brighter than those of the reference by what the number of the picture says; how many there were.
struct Grey(fn(usize) -> f32, AtomicUsize, ReferenceKind);

impl Grey {
    fn new(excess: fn(usize) -> f32) -> Self {
        Self(excess, AtomicUsize::new(0), ReferenceKind::RASTERIZED)
    }
}

impl Reference for Grey {
    fn kind(&self) -> ReferenceKind {
        self.2
    }

    fn picture(&self, _: &Setup) -> Result<ReferencePicture, FitError> {
        let value = 0.2 + (self.0)(self.1.fetch_add(1, Ordering::Relaxed));
        Ok(ReferencePicture::clean(Image::from_data(4, 4, 4, [value, value, value, 1.0].repeat(16))))
    }

    fn bounds(&self, _: Moment) -> Sphere {
        Sphere::UNIT
    }
}

/// Views that remember which were asked for.
struct Asked(Orbit, Mutex<Vec<(u64, u64)>>);

impl Asked {
    fn new() -> Self {
        Self(Orbit::new(0, &Lighting::Mixed, 4), Mutex::default())
    }
}

impl Views for Asked {
    fn setup(&self, set: Set, index: u64, count: u64) -> Setup {
        assert_eq!(set, Set::HeldOut);
        self.1.lock().unwrap().push((index, count));
        self.0.setup(set, index, count)
    }
}

type Excess = fn(usize) -> f32;

fn drawn(stages: &[Grey]) -> Vec<&dyn Reference> {
    stages.iter().map(|s| s as &dyn Reference).collect()
}

/// The ranking after four views or more, and how many pictures of each there were.
fn seen(stages: &[Excess]) -> (Ranking, Vec<usize>) {
    let stages: Vec<Grey> = stages.iter().map(|s| Grey::new(*s)).collect();
    let reference = Grey::new(|_| 0.0);
    let ranking = all_rounds(&reference, &drawn(&stages), &Asked::new(), 4, &Silent).unwrap();
    (ranking, stages.iter().map(|s| s.1.load(Ordering::Relaxed)).collect())
}

/// Bad in one of the first four views, in no other; good in three of them, in no other; and that with a little more error
/// in each.
const MOSTLY_GOOD: Excess = |i| if i == 0 { 0.1 } else { 0.02 };
const SELDOM_GOOD: Excess = |i| if i < 3 { 0.015 } else { 0.04 };
const ITS_TWIN: Excess = |i| if i < 3 { 0.016 } else { 0.042 };

#[test]
fn what_few_views_leave_open_more_views_decide() {
    let stages: [Excess; 3] = [SELDOM_GOOD, MOSTLY_GOOD, |_| 0.2];
    let few: Vec<Grey> = stages.iter().map(|s| Grey::new(*s)).collect();
    let few = ranked(&Grey::new(|_| 0.0), &drawn(&few), &Asked::new(), (4, 1), &Silent).unwrap();
    assert_eq!((few.best(), few.views(), few.certainty().close), (0, 4, true));
    let (ranking, drawn) = seen(&stages);
    assert_eq!((ranking.best(), ranking.views(), ranking.certainty().close), (1, 28, false), "{ranking:?}");
    assert_eq!(drawn, [28, 28, 4]);
}

/// What was worse than the best of its time is not the best because that one was found worse than another.
#[test]
fn what_is_out_does_not_come_back() {
    let (ranking, drawn) = seen(&[SELDOM_GOOD, MOSTLY_GOOD, ITS_TWIN]);
    assert!(drawn[2] == 4 && drawn[1] > 4, "{drawn:?}");
    assert_eq!((ranking.best(), ranking.best_of(0..2), ranking.best_of(2..3)), (1, 1, 2), "{ranking:?}");
    // Among some: who was seen longest.
    let (ranking, drawn) = seen(&[ITS_TWIN, SELDOM_GOOD, MOSTLY_GOOD]);
    assert_eq!((drawn[0], ranking.best(), ranking.best_of(0..2)), (4, 2, 1), "{ranking:?}");
}

#[test]
fn what_is_clear_or_as_good_is_seen_in_no_more_views() {
    let (clear, drawn) = seen(&[|_| 0.2, |i| 0.02 + 0.001 * (i % 2) as f32]);
    assert_eq!((clear.best(), &drawn[..]), (1, &[4, 4][..]));
    let (nearly, drawn) = seen(&[|_| 0.02, |i| 0.02 + 1e-5 * (i % 2) as f32]);
    assert_eq!((nearly.best(), nearly.certainty().close, &drawn[..]), (0, false, &[4, 4][..]));
    assert_eq!(seen(&[MOSTLY_GOOD]).1, [4]);
    let (none, _) = seen(&[]);
    assert_eq!((none.views(), none.certainty().close), (0, false));
}

/// Rounds are of twice as many views each, all of them others; path traced there are fewer.
#[test]
fn further_views_are_others() {
    let tied: [Excess; 2] =
        [|i| if i % 2 == 0 { 0.02 } else { 0.06 }, |i| if i % 2 == 1 { 0.02 } else { 0.06 }];
    let views = Asked::new();
    let stages = tied.map(Grey::new);
    let ranking = all_rounds(&Grey::new(|_| 0.0), &drawn(&stages), &views, 4, &Silent).unwrap();
    let asked = views.1.into_inner().unwrap();
    let wanted = [(0, 4, 4), (8, 16, 8), (16, 32, 16)];
    let wanted: Vec<(u64, u64)> =
        wanted.iter().flat_map(|(a, b, count)| (*a..*b).map(|i| (i, *count))).collect();
    assert_eq!(asked, wanted);
    assert!(ranking.certainty().close && ranking.views() == 28);
    let setups: Vec<Setup> = asked.iter().map(|(i, n)| views.0.setup(Set::HeldOut, *i, *n)).collect();
    for (a, s) in setups.iter().enumerate() {
        for t in &setups[..a] {
            assert_ne!(format!("{:?}", s.lights), format!("{:?}", t.lights), "{a}");
        }
    }
    let traced = Grey(|_| 0.0, AtomicUsize::new(0), ReferenceKind::path_traced(4));
    let stages = tied.map(Grey::new);
    assert_eq!(all_rounds(&traced, &drawn(&stages), &Asked::new(), 4, &Silent).unwrap().views(), 12);
}

/// Stops once so many views have been begun.
struct StopsAfter(u64, AtomicUsize);

impl Progress for StopsAfter {
    fn report(&self, _: &'static str, done: u64, _: u64, _: &str) {
        self.1.store(done as usize, Ordering::Relaxed);
    }

    fn is_cancelled(&self) -> bool {
        self.1.load(Ordering::Relaxed) as u64 >= self.0
    }
}

#[test]
fn a_stop_drops_the_further_views_of_its_round() {
    let stages: [Excess; 2] = [SELDOM_GOOD, MOSTLY_GOOD];
    let of = |after: u64| {
        let stages = stages.map(Grey::new);
        let stop = StopsAfter(after, AtomicUsize::new(0));
        all_rounds(&Grey::new(|_| 0.0), &drawn(&stages), &Asked::new(), 4, &stop).unwrap()
    };
    // The first two views are always finished.
    assert_eq!([0, 3].map(|after| of(after).views()), [2, 3]);
    let whole = of(u64::MAX);
    for after in [4, 5, 11] {
        let stopped = of(after);
        assert_eq!((stopped.views(), stopped.certainty().close), (4, true), "after {after}");
        assert_eq!(stopped.scores[0], whole.scores[0][..4]);
    }
    let after = whole.views() - 1;
    assert_eq!(of(after).views(), if whole.views() == 28 { 12 } else { 4 });
}
