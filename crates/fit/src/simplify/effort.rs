//! How much time a simplification may take, in one word.

use super::{Mips, SimplifyOptions};

/// A preset of how much work a simplification does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Effort {
    /// A look at what can be had: fewer steps, a start, views and samples.
    Fast,
    /// What the others are measured by.
    #[default]
    Normal,
    /// Four times the steps of [`Self::Normal`].
    Best,
}

/// What an effort sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Work {
    /// Steps of the fit at most, over which its rates fall; the trainer goes on to the last quarter of a phase, or ends it there, where six
    /// evaluations, 150 steps, brought no better one.
    pub(super) steps: u64,
    /// Views by which the written asset is chosen, where pictures are not small; more, where they leave it open.
    pub(super) choice_views: u64,
    /// Views of the report.
    pub(super) report_views: u64,
    /// Divides the samples per axis of the fit's pictures of a rasterized reference, and of those of the choice.
    pub(super) coarser: usize,
    /// Whether the fit starts from the better of the decimated asset and the same drawn onto the asset's surface, or from the
    /// latter at once.
    pub(super) compares_starts: bool,
}

impl Effort {
    /// All of them, the cheapest first.
    pub const ALL: [Self; 3] = [Self::Fast, Self::Normal, Self::Best];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::Normal => "normal",
            Self::Best => "best",
        }
    }

    pub(super) fn work(self) -> Work {
        let normal =
            Work { steps: 1000, choice_views: 4, report_views: 8, coarser: 1, compares_starts: true };
        match self {
            Self::Fast => {
                Work { steps: 250, choice_views: 2, report_views: 4, coarser: 2, compares_starts: false }
            }
            Self::Normal => normal,
            Self::Best => Work { steps: 4000, ..normal },
        }
    }

    /// What it sets, in words.
    pub fn about(self) -> String {
        let Work { steps, compares_starts, .. } = self.work();
        let starts = if compares_starts { "the better of two starts" } else { "one start" };
        format!("{steps} steps at most, {starts}, {}", self.views_and_samples("the fit and the choice see"))
    }

    /// What it sets where nothing is fitted, in words.
    pub fn about_choice(self) -> String {
        self.views_and_samples("the choice sees")
    }

    fn views_and_samples(self, who: &str) -> String {
        let Work { choice_views, report_views, coarser, .. } = self.work();
        let samples = match coarser {
            1 => String::new(),
            n => format!(", 1/{n} of the samples per axis in pictures of the asset that {who}"),
        };
        format!(
            "{choice_views} views of the choice or more where it is close, {report_views} of the report{samples}"
        )
    }
}

impl SimplifyOptions {
    /// The same with another effort, which sets [`Self::steps`] and [`Self::report_views`]; what is set afterwards counts.
    #[must_use]
    pub fn with_effort(self, effort: Effort) -> Self {
        let Work { steps, report_views, .. } = effort.work();
        Self { effort, steps, report_views, ..self }
    }

    /// Samples per axis of a pixel in the fit's pictures of the asset.
    pub(super) fn reference_samples(&self) -> usize {
        (self.judge_samples()[0] / self.effort.work().coarser).max(1)
    }

    /// Samples per axis of a pixel of what is chosen from.
    pub(super) fn choice_samples(&self) -> usize {
        if self.mips == Mips::Free {
            return 1;
        }
        (self.judge_samples()[1] / self.effort.work().coarser).max(1)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{options, rock};
    use super::super::{Outcome, Written, simplify};
    use super::*;
    use crate::{FitError, Silent};

    #[test]
    fn a_fast_fit_has_one_start_few_views_and_a_checkpoint_of_its_own() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.glb");
        let run = |effort: Effort, resume: bool| {
            let asked = options().with_effort(effort);
            let checkpoint = Some(dir.path().join("state"));
            simplify(&rock(), &path, &SimplifyOptions { steps: 3, checkpoint, resume, ..asked }, &Silent)
        };
        // The written file has a stage of its own where it is not the fit.
        let stages = |o: &Outcome| {
            let mut stages: Vec<_> = o.stages.iter().map(|s| s.name).collect();
            if o.written != Written::Fitted {
                assert_eq!(stages.pop(), Some("file"));
            }
            stages
        };
        let fast = run(Effort::Fast, false).unwrap();
        assert_eq!(stages(&fast), ["decimated", "shrink-wrapped", "fitted"]);
        assert_eq!((fast.effort, fast.steps, fast.views.len()), (Effort::Fast, 3, 4));
        match run(Effort::Normal, true) {
            Err(FitError::OtherFit { differences, .. }) => {
                assert!(differences.iter().any(|d| d.field == "effort"), "{differences:?}");
            }
            other => panic!("the checkpoint of another effort is taken: {other:?}"),
        }
        let normal = run(Effort::Normal, false).unwrap();
        assert_eq!(stages(&normal), ["decimated", "baked", "shrink-wrapped", "fitted"]);
        assert_eq!((normal.effort, normal.views.len()), (Effort::Normal, 8));
    }

    #[test]
    fn an_effort_sets_what_is_not_set_by_itself() {
        let fast = SimplifyOptions::default().with_effort(Effort::Fast);
        let normal = SimplifyOptions::default();
        assert_eq!(normal.effort, Effort::Normal);
        assert_eq!((normal.steps, normal.report_views), (1000, 8), "the default is the normal effort");
        assert!(fast.steps * 4 <= normal.steps && fast.report_views < normal.report_views);
        assert!(fast.choice_views() < normal.choice_views());
        assert_eq!([fast.reference_samples(), fast.choice_samples()], [2, 2]);
        assert_eq!([normal.reference_samples(), normal.choice_samples()], [4, 4]);
        let best = normal.clone().with_effort(Effort::Best);
        assert_eq!((best.steps, best.reference_samples()), (4000, 4));
        let explicit = SimplifyOptions { steps: 7, ..fast.clone() };
        assert_eq!((explicit.effort, explicit.steps), (Effort::Fast, 7));
        // On a small screen the pictures keep one sample at least, and both options hold.
        let small = fast.for_screen_size(32.0);
        assert_eq!((small.effort, small.steps, small.choice_samples()), (Effort::Fast, 250, 1));
        assert_eq!(Effort::ALL.map(Effort::name), ["fast", "normal", "best"]);
        assert!(Effort::Fast.about().contains("250 steps") && Effort::Best.about().contains("4000 steps"));
    }
}
