//! The verdict of a report: does the light asset look like the asset?

use super::SHIPPED;
use crate::simplify::{Outcome, Quality};
use std::fmt;

/// Mean FLIP over all views, and FLIP of the worst view, up to which two assets look the same.
const SAME: [f64; 2] = [0.03, 0.05];
/// The same up to which they look close.
const CLOSE: [f64; 2] = [0.08, 0.12];

/// A stage is better than the written file where its PSNR is higher by more than this, in decibels, and its FLIP lower:
/// the views of the choice are others than those of the report, and differences below are noise between the two.
const MARGIN: f64 = 0.1;
/// The stage of the asset itself, which has all of its triangles.
const NOT_LIGHT: &str = "original";

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
    /// The best stage among those that are clearly better than the written file.
    pub better: Option<(&'static str, Quality)>,
    /// Whether the written file is the decimated asset with its own materials.
    pub own_materials: bool,
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
        let views: Vec<Quality> = o.views.iter().map(|v| v.quality[k].quality).collect();
        Self { better: better(all, &all[k].1), own_materials: o.own_materials, ..Self::new(&views) }
    }

    fn new(views: &[Quality]) -> Self {
        let mean = Quality::mean(views.iter());
        let worst = views.iter().copied().enumerate().max_by(|a, b| a.1.flip.total_cmp(&b.1.flip));
        let likeness = worst.map_or(Likeness::Unknown, |(_, q)| Likeness::of(mean.flip, q.flip));
        Self { likeness, mean, worst, views: views.len(), better: None, own_materials: false }
    }
}

/// The stage with the highest PSNR among those that are clearly better than the written file.
fn better(stages: &[(&'static str, Quality)], written: &Quality) -> Option<(&'static str, Quality)> {
    let clearly = |q: &Quality| q.psnr > written.psnr + MARGIN && q.flip < written.flip;
    let stages = stages.iter().filter(|(name, q)| *name != NOT_LIGHT && *name != SHIPPED && clearly(q));
    stages.max_by(|a, b| a.1.psnr.total_cmp(&b.1.psnr)).copied()
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
        )?;
        if self.own_materials {
            f.write_str("; no fit looked better than fewer triangles alone, which is what was written")?;
        }
        if let Some((name, q)) = &self.better {
            write!(f, "; {name} is better: {:.1} dB, FLIP {:.3}", q.psnr, q.flip)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_is_better_by_more_than_the_margin_in_both_measures() {
        let q = |psnr: f64, flip: f64| Quality { psnr, flip, ..Quality::default() };
        let name = |stages: &[(&'static str, Quality)]| better(stages, &q(30.0, 0.05)).map(|b| b.0);
        assert_eq!(name(&[("decimated", q(30.0 + 0.9 * MARGIN, 0.04))]), None, "within noise");
        assert_eq!(name(&[("decimated", q(31.0, 0.06))]), None, "one measure alone");
        assert_eq!(name(&[("original", q(40.0, 0.01)), (SHIPPED, q(31.0, 0.04))]), None);
        assert_eq!(name(&[("baked", q(31.0, 0.04)), ("decimated", q(33.0, 0.03))]), Some("decimated"));
    }

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
