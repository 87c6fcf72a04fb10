//! Whether a guide pays, and how that is told.

use super::pilot::Trial;
use super::{Guiding, GuidingOptions};

/// Part of the gain that is asked for below which half of a pilot run is enough: .85 where 1.15 is asked for.
const LOST: f64 = 0.85 / 1.15;

/// What training came to.
#[derive(Clone, Debug, PartialEq)]
pub struct GuidingReport {
    /// Which guide was trained.
    pub guiding: Guiding,
    /// Whether it is used.
    pub used: bool,
    /// Whether the pilot run found light without the guide, and with it.
    pub found: [bool; 2],
    /// Variance times work without the guide over that with it: infinite where light was found with it alone, or nothing
    /// varies with it; 0 where light was found without it alone; not a number without light, or where nothing varies.
    pub gain: f64,
    /// Variance without the guide over that with it; infinite, 0 and not a number as [`Self::gain`].
    pub variance_ratio: f64,
    /// Work of a path with the guide over that of one without.
    pub work_ratio: f64,
    /// Whether gain and ratios are from half of the pilot run, where the guide clearly lost, and not from all of it.
    pub half: bool,
    /// Rounds of training.
    pub rounds: u32,
    /// Paths of training and pilot run.
    pub paths: u64,
    /// Records learned from.
    pub records: u64,
}

impl GuidingReport {
    /// Compares the two trials of a whole pilot run; counts of training are left at 0.
    ///
    /// A sampler that finds no light has no variance, which is no merit: it loses against one that finds some. Where both
    /// find none there is nothing that speaks for a guide.
    pub(super) fn judge(plain: &Trial, guided: &Trial, options: &GuidingOptions) -> Self {
        let found = [plain.found_light(), guided.found_light()];
        let variance_ratio = match found {
            [true, true] => plain.variance(guided) / guided.variance(plain),
            [false, true] => f64::INFINITY,
            [true, false] => 0.0,
            [false, false] => f64::NAN,
        };
        let guiding = options.guiding;
        let work_ratio = guiding.cost() * guided.work as f64 / plain.work as f64;
        let gain = variance_ratio / work_ratio;
        let used = options.least_gain <= 0.0 || gain >= options.least_gain;
        Self {
            guiding,
            used,
            found,
            gain,
            variance_ratio,
            work_ratio,
            half: false,
            rounds: 0,
            paths: 0,
            records: 0,
        }
    }

    /// Whether a first look is enough: the guide loses clearly, and would have to gain. (Few paths tell too little of the variance
    /// where light is rare, which is where guides pay: the bound is [`LOST`] times the gain that is asked for.)
    pub(super) fn is_lost(&self, options: &GuidingOptions) -> bool {
        !self.used && self.found == [true; 2] && self.gain < LOST * options.least_gain
    }

    /// One sentence for people.
    pub fn sentence(&self) -> String {
        let Self { variance_ratio, work_ratio, gain, .. } = self;
        let why = match self.found {
            [false, false] => "the pilot run found no light".to_owned(),
            [false, true] => "the pilot run found light with it alone".to_owned(),
            [true, false] => "the pilot run found light without it alone".to_owned(),
            [true, true] if gain.is_nan() => "the pilot run found no noise".to_owned(),
            [true, true] if gain.is_infinite() => "the pilot run found no noise with it".to_owned(),
            [true, true] => {
                let half = if self.half { "in half of the pilot run " } else { "" };
                format!("{half}variance / {variance_ratio:.2}, work x {work_ratio:.2}: gain {gain:.2}")
            }
        };
        let state = match self.used {
            true => "is on",
            false if gain.is_nan() => "is off",
            false => "switched itself off, it does not pay with so many samples",
        };
        format!("guiding ({}) {state}: {why}", self.guiding.name())
    }
}
