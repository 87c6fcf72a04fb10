//! Whether a guide pays, and how that is told.

use super::pilot::{Trial, variances};
use super::{Guiding, GuidingOptions};

/// What training came to.
#[derive(Clone, Debug, PartialEq)]
pub struct GuidingReport {
    /// Which guide was trained.
    pub guiding: Guiding,
    /// Whether it is used.
    pub used: bool,
    /// Whether the pilot run found light without the guide, and with it.
    pub found: [bool; 2],
    /// Variance times work without the guide over that with it: infinite where nothing varies with it; not a number without
    /// light, or where nothing varies.
    pub gain: f64,
    /// Variance without the guide over that with it, over the picture as a whole or relative to the luminance around each pixel: the lesser of the two. Infinite and not a number as [`Self::gain`].
    pub variance_ratio: f64,
    /// Work of a path with the guide over that of one without.
    pub work_ratio: f64,
    /// The gain that was asked for.
    pub least_gain: f64,
    /// [`GuidingOptions::side`] of the pictures that were trained on, which are never larger than the picture.
    pub side: usize,
    /// Rounds of training.
    pub rounds: u32,
    /// Paths of training and pilot run.
    pub paths: u64,
    /// Records learned from.
    pub records: u64,
}

impl GuidingReport {
    /// Compares the two trials of a pilot run; counts of training are left at 0.
    ///
    /// Where neither finds light there is nothing that speaks for a guide.
    pub(super) fn judge(plain: &Trial, guided: &Trial, options: &GuidingOptions) -> Self {
        let found = [plain.found_light, guided.found_light];
        let variance_ratio = match variances(plain, guided) {
            _ if found == [false; 2] => f64::NAN,
            [without, with] => without / with,
        };
        let guiding = options.guiding;
        let work_ratio = options.cost * guided.work as f64 / plain.work as f64;
        let gain = variance_ratio / work_ratio;
        let used = options.least_gain <= 0.0 || gain >= options.least_gain;
        let least_gain = options.least_gain;
        Self {
            guiding,
            used,
            found,
            gain,
            variance_ratio,
            work_ratio,
            least_gain,
            side: options.side,
            rounds: 0,
            paths: 0,
            records: 0,
        }
    }

    /// One sentence for people.
    pub fn sentence(&self) -> String {
        let Self { variance_ratio, work_ratio, gain, .. } = self;
        let why = match self.found {
            [false, false] => "the pilot run found no light".to_owned(),
            _ if gain.is_nan() => "the pilot run found no noise".to_owned(),
            _ if gain.is_infinite() => "the pilot run found no noise with it".to_owned(),
            _ => format!("variance / {variance_ratio:.2}, work x {work_ratio:.2}: gain {gain:.2}"),
        };
        let state = match self.used {
            true => "is on",
            false if gain.is_nan() => "is off",
            false => &format!("switched itself off, a gain of {:?} is asked for", self.least_gain),
        };
        format!("guiding ({}) {state}: {why}", self.guiding.name())
    }
}
