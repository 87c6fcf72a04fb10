//! The verdict of a report: does the light asset look like the asset?

use super::SHIPPED;
use crate::simplify::{Outcome, Quality};
use std::fmt;

/// Mean FLIP over all views, and FLIP of the worst view, up to which two assets look the same.
const SAME: [f64; 2] = [0.03, 0.05];
/// The same up to which they look close.
const CLOSE: [f64; 2] = [0.08, 0.12];

/// How much the written file looks like the asset, in views and lights that the fit never saw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdict {
    /// The class.
    pub likeness: Likeness,
    /// Mean quality over the views.
    pub mean: Quality,
    /// Index of the view with the largest FLIP, and its quality; `None` where no view was judged.
    pub worst: Option<(usize, Quality)>,
    /// Number of views.
    pub views: usize,
}

/// Classes of likeness by mean LDR-FLIP over the foreground.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Likeness {
    /// FLIP at most 0.03 in the mean and 0.05 in the worst view: differences are hard to find side by side.
    Same,
    /// FLIP at most 0.08 in the mean and 0.12 in the worst view: differences show when one looks for them.
    Close,
    /// More than that.
    Different,
    /// No view was judged.
    Unknown,
}

impl Likeness {
    fn of(mean: f64, worst: f64) -> Self {
        let within = |[m, w]: [f64; 2]| mean <= m && worst <= w;
        if within(SAME) {
            Self::Same
        } else if within(CLOSE) {
            Self::Close
        } else {
            Self::Different
        }
    }
}

impl fmt::Display for Likeness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Same => "looks the same",
            Self::Close => "looks close",
            Self::Different => "looks visibly different",
            Self::Unknown => "not judged",
        })
    }
}

impl Verdict {
    /// Judges the written file of an outcome.
    pub fn of(o: &Outcome) -> Self {
        let all = &o.stages;
        let Some(k) = all.iter().position(|s| s.0 == SHIPPED) else { return Self::new(&[]) };
        Self::new(&o.views.iter().map(|v| v.quality[k].quality).collect::<Vec<_>>())
    }

    fn new(views: &[Quality]) -> Self {
        let mean = Quality::mean(views.iter());
        let worst = views.iter().copied().enumerate().max_by(|a, b| a.1.flip.total_cmp(&b.1.flip));
        let likeness = worst.map_or(Likeness::Unknown, |(_, q)| Likeness::of(mean.flip, q.flip));
        Self { likeness, mean, worst, views: views.len() }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some((k, worst)) = &self.worst else { return write!(f, "{}", self.likeness) };
        write!(
            f,
            "{}: PSNR {} dB, FLIP {:.3} over {} new views; worst view {}: {} dB, FLIP {:.3}",
            self.likeness,
            self.mean.decibels(1),
            self.mean.flip,
            self.views,
            k + 1,
            worst.decibels(1),
            worst.flip
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_view_counts() {
        let view = |flip: f64| Quality { psnr: 40.0 - 100.0 * flip, ssim: 0.9, flip, ..Quality::default() };
        let of = |flips: &[f64]| Verdict::new(&flips.iter().map(|f| view(*f)).collect::<Vec<_>>());
        assert_eq!(of(&[0.02, 0.03, 0.04]).likeness, Likeness::Same);
        assert_eq!(of(&[0.02, 0.02, 0.06]).likeness, Likeness::Close, "one view differs");
        assert_eq!(of(&[0.02, 0.02, 0.20]).likeness, Likeness::Different, "one view is wrong");
        assert_eq!(of(&[0.09, 0.09]).likeness, Likeness::Different);
        assert_eq!(of(&[]).likeness, Likeness::Unknown);
        let text = of(&[0.02, 0.06]).to_string();
        assert_eq!(
            text,
            "looks close: PSNR 36.0 dB, FLIP 0.040 over 2 new views; worst view 2: 34.0 dB, FLIP 0.060"
        );
    }
}
