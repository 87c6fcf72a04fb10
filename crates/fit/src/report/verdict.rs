//! The verdict of a report: does the light asset look like the asset?

use crate::engine::judge::CLEAR_GAIN;
use crate::simplify::{Appearance, ORIGINAL, Outcome, Quality, Written};
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
    /// The best stage among those that are clearly better than the written file.
    pub better: Option<(&'static str, Quality)>,
    /// What was written.
    pub written: Written,
    /// What it has in place of the asset's surface, where something was baked or fitted.
    pub appearance: Appearance,
    /// Whether steps of a fit were made.
    pub fitted: bool,
    /// Whether what was written was compared with what else could be.
    pub compared: bool,
    /// The asset itself drawn the same way, where engines draw it: with one sample a pixel it differs from the reference
    /// too. [`Self::likeness`] is then by what FLIP of the written file exceeds that of the asset.
    pub original: Option<Quality>,
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
        let Some(k) = all.len().checked_sub(1) else { return Self::new(&[], None) };
        let of = |k: usize| o.views.iter().map(|v| v.quality[k].quality).collect::<Vec<Quality>>();
        let original = all.iter().position(|s| s.0 == ORIGINAL).map(of);
        let better = better(&all[..k], &all[k].1);
        let (written, appearance, fitted) = (o.written, o.appearance, o.steps > 0);
        let compared = o.was_chosen();
        Self { better, written, appearance, fitted, compared, ..Self::new(&of(k), original.as_deref()) }
    }

    /// Of views, and of the asset itself in the same ones.
    fn new(views: &[Quality], original: Option<&[Quality]>) -> Self {
        let mean = Quality::mean(views.iter());
        let worst = views.iter().copied().enumerate().max_by(|a, b| a.1.flip.total_cmp(&b.1.flip));
        let (written, appearance, better) = (Written::Fitted, Appearance::Maps, None);
        let (fitted, compared) = (true, true);
        let likeness = match original {
            _ if views.is_empty() => Likeness::Unknown,
            None => Likeness::of(mean.flip, worst.map_or(0.0, |w| w.1.flip)),
            Some(original) => {
                let beyond = |(a, b): (&Quality, &Quality)| (a.flip - b.flip).max(0.0);
                let beyond: Vec<f64> = views.iter().zip(original).map(beyond).collect();
                let sum: f64 = beyond.iter().sum();
                Likeness::of(sum / beyond.len() as f64, beyond.into_iter().fold(0.0, f64::max))
            }
        };
        let original = original.map(|o| Quality::mean(o.iter()));
        let views = views.len();
        Self { likeness, mean, worst, views, better, written, appearance, fitted, compared, original }
    }
}

/// The stage with the highest PSNR among those beside the written file that are clearly better than the written file.
fn better(stages: &[(&'static str, Quality)], written: &Quality) -> Option<(&'static str, Quality)> {
    let clearly = |q: &Quality| q.psnr > written.psnr + CLEAR_GAIN && q.flip < written.flip;
    let stages = stages.iter().filter(|(name, q)| *name != ORIGINAL && clearly(q));
    stages.max_by(|a, b| a.1.psnr.total_cmp(&b.1.psnr)).copied()
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some((k, worst)) = &self.worst else { return write!(f, "{}", self.likeness) };
        write!(
            f,
            "{}: PSNR {} dB, FLIP {:.3} over {} new {}; worst FLIP {:.3} ({} dB) in view {}",
            self.likeness,
            self.mean.decibels(1),
            self.mean.flip,
            self.views,
            if self.views == 1 { "view" } else { "views" },
            worst.flip,
            worst.decibels(1),
            k + 1
        )?;
        if let Some(original) = &self.original {
            write!(f, "; the asset itself drawn so: {} dB, FLIP {:.3}", original.decibels(1), original.flip)?;
        }
        let (maps, start) = (self.appearance.in_words(), self.written.start());
        match self.written {
            Written::Fitted | Written::Kept => Ok(()),
            Written::Rebaked => {
                write!(f, "; written is the fitted shape with {maps} baked anew, which looked best")
            }
            Written::ShrinkWrapped | Written::Sphere | Written::Baked if !self.fitted => {
                write!(f, "; written is {start} with baked {maps}: no steps were made")
            }
            Written::ShrinkWrapped | Written::Sphere | Written::Baked if !self.compared => {
                write!(f, "; written is the start, {start} with baked {maps}: no step came to a better one")
            }
            Written::ShrinkWrapped | Written::Sphere | Written::Baked => write!(
                f,
                "; no fit looked better than its start, {start} with baked {maps}, which is what was written"
            ),
            Written::Decimated if !self.fitted => {
                write!(
                    f,
                    "; no baked {maps} looked better than fewer triangles alone, which is what was written"
                )
            }
            Written::Decimated => {
                f.write_str("; no fit looked better than fewer triangles alone, which is what was written")
            }
            Written::Whole => {
                f.write_str("; written is the asset as it was given: no other file took so few bytes")
            }
        }?;
        if let Some((name, q)) = &self.better {
            let start = |start: Written| format!(" ({} with baked {maps})", start.start());
            let what = match *name {
                "decimated" if self.written == Written::Decimated => {
                    " (the first of several decimations, with all its texels; written is the one that looked best in the views of the \
                     choice, with as many texels and triangles as are allowed)"
                        .into()
                }
                own if own == self.written.name() => " (the same before its textures were made smaller)".into(),
                "decimated" => " (as many triangles with the asset's own materials and all their texels)".into(),
                "fitted" => {
                    " (the fit, which looked worse in the views of the choice or takes more bytes than allowed)".into()
                }
                name => Written::STARTS.into_iter().find(|s| s.name() == name).map_or_else(String::new, start),
            };
            write!(
                f,
                ". What the table calls {name}{what} scores better here and is not in the file: {} dB, FLIP {:.3}",
                q.decibels(1),
                q.flip
            )?;
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
        assert_eq!(name(&[("decimated", q(30.0 + 0.9 * CLEAR_GAIN, 0.04))]), None, "within noise");
        assert_eq!(name(&[("decimated", q(31.0, 0.06))]), None, "one measure alone");
        assert_eq!(name(&[("original", q(40.0, 0.01))]), None);
        assert_eq!(name(&[("baked", q(31.0, 0.04)), ("decimated", q(33.0, 0.03))]), Some("decimated"));
    }

    #[test]
    fn what_is_better_is_told_apart_from_what_was_written() {
        let q = |psnr: f64, flip: f64| Quality { psnr, flip, ..Quality::default() };
        for written in [Written::Fitted, Written::Rebaked, Written::Baked] {
            let better = Some(("decimated", q(33.0, 0.03)));
            let verdict = Verdict { better, written, ..Verdict::new(&[q(30.0, 0.05)], None) };
            let text = verdict.to_string();
            // One sentence of its own, the last, that says that the file holds something else.
            let sentence = ". What the table calls decimated (as many triangles with the asset's own materials and all their \
                            texels) scores better here and is not in the file: 33.0 dB, FLIP 0.030";
            assert!(text.ends_with(sentence), "{text}");
            assert_eq!(text.matches("table calls").count(), 1, "{text}");
        }
        for (name, words) in [
            ("baked", "baked (the decimated shape with baked maps)"),
            ("sphere", "sphere (a"),
            ("start", "start scores"),
        ] {
            let better = Some((name, q(33.0, 0.03)));
            let text = Verdict { better, ..Verdict::new(&[q(30.0, 0.05)], None) }.to_string();
            assert!(text.contains(&format!(". What the table calls {words}")), "{text}");
        }
    }

    #[test]
    fn without_steps_no_fit_is_spoken_of() {
        let told = |written, fitted| {
            Verdict { written, fitted, ..Verdict::new(&[Quality::default()], None) }.to_string()
        };
        for written in [Written::Baked, Written::ShrinkWrapped, Written::Sphere, Written::Decimated] {
            assert!(told(written, true).contains("no fit looked better"), "{written:?}");
            assert!(!told(written, false).contains("no fit"), "{written:?}");
        }
        let start = |written, appearance| {
            Verdict { written, appearance, ..Verdict::new(&[Quality::default()], None) }.to_string()
        };
        assert!(
            start(Written::Sphere, Appearance::Maps)
                .contains("a sphere, drawn onto the asset's surface, with baked maps")
        );
        assert!(
            start(Written::ShrinkWrapped, Appearance::VertexColors)
                .contains("surface, with baked colours of vertices")
        );
        assert!(told(Written::Whole, false).ends_with("as it was given: no other file took so few bytes"));
    }

    #[test]
    fn the_worst_view_counts() {
        let view = |flip: f64| Quality { psnr: 40.0 - 100.0 * flip, ssim: 0.9, flip, ..Quality::default() };
        let of = |flips: &[f64]| Verdict::new(&flips.iter().map(|f| view(*f)).collect::<Vec<_>>(), None);
        assert_eq!(of(&[0.02, 0.03, 0.04]).likeness, Likeness::Same);
        assert_eq!(of(&[0.02, 0.02, 0.06]).likeness, Likeness::Close, "one view differs");
        assert_eq!(of(&[0.02, 0.02, 0.20]).likeness, Likeness::Different, "one view is wrong");
        assert_eq!(of(&[0.09, 0.09]).likeness, Likeness::Different);
        assert_eq!(of(&[]).likeness, Likeness::Unknown);
        let beside = |flips: &[f64], original: &[f64]| {
            let views = |flips: &[f64]| flips.iter().map(|f| view(*f)).collect::<Vec<_>>();
            Verdict::new(&views(flips), Some(&views(original)))
        };
        assert_eq!(beside(&[0.14, 0.12], &[0.13, 0.12]).likeness, Likeness::Same, "as the asset is drawn");
        assert_eq!(beside(&[0.14, 0.30], &[0.13, 0.12]).likeness, Likeness::Different);
        assert!(beside(&[0.14], &[0.13]).to_string().ends_with("drawn so: 27.0 dB, FLIP 0.130"));
        let text = of(&[0.02, 0.06]).to_string();
        assert_eq!(
            text,
            "looks close: PSNR 36.0 dB, FLIP 0.040 over 2 new views; worst FLIP 0.060 (34.0 dB) in view 2"
        );
    }
}
