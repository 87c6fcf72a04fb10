//! The verdict of a report: does the light asset look like the asset?

use super::{counted, grouped};
use crate::engine::judge::{CLEAR_GAIN, Judged};
use crate::simplify::{Appearance, FITTED, ORIGINAL, Outcome, Quality, StageQuality, Written};
use crate::traced_maps::MapsCourse;
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
    /// Views that were asked for and not judged, as the work was ended.
    pub not_judged: usize,
    /// The best stage among those that are clearly better than the written file.
    pub better: Option<StageQuality>,
    /// What was written.
    pub written: Written,
    /// What it has in place of the asset's surface, where something was baked or fitted.
    pub appearance: Appearance,
    /// Whether steps of a fit were made.
    pub fitted: bool,
    /// Whether what was written was compared with what else could be.
    pub compared: bool,
    /// Whether the work was ended while it was.
    pub cut: bool,
    /// Bytes that the file was to have at most.
    pub max_bytes: Option<u64>,
    /// Whether it has more: it is the lightest that was found, whatever it looks like.
    pub too_large: bool,
    /// Whether its maps were fitted once more through the path tracer.
    pub traced: bool,
    /// Whether the asset that was given has textures.
    pub textured: bool,
    /// The asset itself drawn the same way, where that is not the picture of the reference: as an engine draws it, or path traced with
    /// other samples. [`Self::likeness`] is then by what FLIP of the written file has beyond that of the asset: the difference, and where it is
    /// noise the root of the difference of the squares.
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

/// What of FLIP of a file is beyond that of the asset drawn in the same way.
type Beyond = fn(f64, f64) -> f64;

/// Where an engine draws both.
fn beyond(file: f64, asset: f64) -> f64 {
    (file - asset).max(0.0)
}

/// Where FLIP of the asset is noise: errors that do not depend on each other add up in squares, so that noise hides more than its share. Where
/// errors are local this overstates them.
fn beyond_noise(file: f64, asset: f64) -> f64 {
    (file * file - asset * asset).max(0.0).sqrt()
}

impl Verdict {
    /// Judges the written file of an outcome.
    pub fn of(o: &Outcome) -> Self {
        let all = &o.stages;
        let Some(k) = all.len().checked_sub(1) else { return Self::new(&[], None) };
        let of = |k: usize| o.views.iter().map(|v| v.quality[k].quality).collect::<Vec<Quality>>();
        let original = all.iter().position(|s| s.name == ORIGINAL).map(of);
        let better = better(&all[..k], &all[k].quality);
        let (written, appearance, fitted) = (o.written, o.appearance, o.steps > 0);
        let (compared, cut, max_bytes) = (o.was_chosen(), o.choice_cut, o.max_bytes);
        let traced = o.traced_maps.as_ref().is_some_and(MapsCourse::gained);
        let (too_large, textured) = (o.is_too_large(), o.asset_textured);
        let beyond = if o.judged == Judged::PathTraced { beyond_noise } else { beyond };
        let judged = Self::new(&of(k), original.as_deref().map(|original| (original, beyond)));
        let asked = if o.stopped { o.report_views as usize } else { 0 };
        let not_judged = asked.saturating_sub(judged.views);
        let judged = Self { too_large, traced, textured, not_judged, ..judged };
        Self { better, written, appearance, fitted, compared, cut, max_bytes, ..judged }
    }

    /// Of views, and of the asset itself in the same ones, with what of FLIP is beyond that of the asset.
    fn new(views: &[Quality], original: Option<(&[Quality], Beyond)>) -> Self {
        let mean = Quality::mean(views.iter());
        let worst = views.iter().copied().enumerate().max_by(|a, b| a.1.flip.total_cmp(&b.1.flip));
        let (written, appearance, better) = (Written::Fitted, Appearance::Maps, None);
        let (fitted, compared, cut, max_bytes) = (true, true, false, None);
        let likeness = match original {
            _ if views.is_empty() => Likeness::Unknown,
            None => Likeness::of(mean.flip, worst.map_or(0.0, |w| w.1.flip)),
            Some((original, beyond)) => {
                let of_views = views.iter().zip(original).map(|(a, b)| beyond(a.flip, b.flip));
                let beyond: Vec<f64> = of_views.collect();
                let sum: f64 = beyond.iter().sum();
                Likeness::of(sum / beyond.len() as f64, beyond.into_iter().fold(0.0, f64::max))
            }
        };
        let original = original.map(|(o, _)| Quality::mean(o.iter()));
        let views = views.len();
        Self {
            likeness,
            mean,
            worst,
            views,
            not_judged: 0,
            better,
            written,
            appearance,
            fitted,
            compared,
            cut,
            max_bytes,
            too_large: false,
            traced: false,
            textured: true,
            original,
        }
    }

    /// What was written and why that, where it is not what was fitted or asked for.
    fn told_written(&self) -> Option<String> {
        let maps = self.appearance.in_words();
        let start = self.written.start();
        let what = match self.written {
            Written::Fitted => "the fit".to_owned(),
            Written::Kept => "the asset's own surface".to_owned(),
            Written::Whole => "the asset as it was given".to_owned(),
            Written::Rebaked => format!("the fitted shape with {maps} baked anew"),
            Written::ShrinkWrapped | Written::Sphere | Written::Baked => format!("{start} with baked {maps}"),
            Written::Decimated => "the asset's own materials".to_owned(),
        };
        let traced = if self.traced { ", its maps fitted once more through the path tracer" } else { "" };
        if self.too_large {
            let most = grouped(self.max_bytes.unwrap_or_default());
            return Some(format!("written is {what}{traced}: nothing of at most {most} bytes was found"));
        }
        if self.compared && self.cut {
            return Some(format!(
                "written is {what}{traced}: the best when the work was ended, not all was compared"
            ));
        }
        Some(match self.written {
            Written::Fitted | Written::Kept => return None,
            Written::Whole => format!("written is {what}, which has few enough bytes"),
            // The path tracer came to something that none of these was.
            _ if self.traced => format!("written is {what}{traced}, which looked best"),
            Written::Rebaked => format!("written is {what}, which looked best"),
            Written::Decimated => {
                let (within, new) = (within(self.max_bytes), if self.fitted { "fit" } else { "baked maps" });
                format!("no {new} looked better{within} than {what}, which are what was written")
            }
            _ if !self.fitted => format!("written is {what}: no steps were made"),
            _ if !self.compared => format!("written is the start, {what}: no step came to a better one"),
            _ => format!("no fit looked better than a start, {what}, which is what was written"),
        })
    }

    /// Whether a stage is what was written, before its textures and its geometry were stored.
    fn is_before_it_was_stored(&self, stage: &StageQuality) -> bool {
        !self.traced && stage.name == self.written.name() && !stage.has_own_materials()
    }

    /// How many views were judged, in words.
    fn told_views(&self) -> String {
        let seen = |word| counted(self.views, word);
        match self.not_judged {
            0 => seen("new view"),
            more => format!("{} of {} (the judgement was cut short)", seen("view"), self.views + more),
        }
    }

    /// What a stage is that scores better than the file.
    fn told_better(&self, stage: &StageQuality) -> String {
        let triangles = counted(stage.triangles, "triangle");
        let bytes = if self.max_bytes.is_some() { ", whatever its bytes" } else { "" };
        let maps = self.appearance.in_words();
        match stage.name {
            _ if stage.has_own_materials() && self.textured => {
                format!(
                    " (the asset's own materials with their textures as they were given, {triangles}{bytes})"
                )
            }
            _ if stage.has_own_materials() => format!(" (the asset's own materials, {triangles}{bytes})"),
            // Within bytes it was what was to be made to fit, unless something else looked better even before.
            FITTED if self.max_bytes.is_some() && !self.written.is_baked() => {
                format!(" (the fit, {triangles}{bytes})")
            }
            FITTED => format!(" (the fit, {triangles}, which looked worse in the views of the choice)"),
            name => {
                Written::STARTS.into_iter().find(|s| s.name() == name).map_or_else(String::new, |start| {
                    format!(" ({} with baked {maps}, {triangles}{bytes})", start.start())
                })
            }
        }
    }
}

/// A budget of bytes, in words.
fn within(most: Option<u64>) -> String {
    most.map_or_else(String::new, |most| format!(" within {} bytes", grouped(most)))
}

/// The stage with the highest PSNR among those beside the written file that are clearly better than the written file.
fn better(stages: &[StageQuality], written: &Quality) -> Option<StageQuality> {
    let clearly = |q: &Quality| q.psnr > written.psnr + CLEAR_GAIN && q.flip < written.flip;
    let stages = stages.iter().filter(|s| s.name != ORIGINAL && clearly(&s.quality));
    stages.max_by(|a, b| a.quality.psnr.total_cmp(&b.quality.psnr)).copied()
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some((k, worst)) = &self.worst else { return write!(f, "{}", self.likeness) };
        write!(
            f,
            "{}: PSNR {} dB, FLIP {:.4} over {}; worst FLIP {:.4} ({} dB) in view {}",
            self.likeness,
            self.mean.decibels(1),
            self.mean.flip,
            self.told_views(),
            worst.flip,
            worst.decibels(1),
            k + 1
        )?;
        if let Some(original) = &self.original {
            write!(f, "; the asset itself drawn so: {} dB, FLIP {:.3}", original.decibels(1), original.flip)?;
        }
        if let Some(written) = self.told_written() {
            write!(f, "; {written}")?;
        }
        if let Some(stage) = self.better.as_ref().filter(|s| self.is_before_it_was_stored(s)) {
            let (name, q) = (stage.name, &stage.quality);
            return write!(
                f,
                ". Before it was stored it has {} dB, FLIP {:.3} here ({name} in the table): {} would keep more",
                q.decibels(1),
                q.flip,
                if self.max_bytes.is_some() { "more bytes" } else { "finer textures or geometry" }
            );
        }
        if let Some(stage) = &self.better {
            let (what, q) = (self.told_better(stage), &stage.quality);
            write!(
                f,
                ". What the table calls {}{what} scores better here and is not in the file: {} dB, FLIP {:.3}",
                stage.name,
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

    fn stage(name: &'static str, quality: Quality) -> StageQuality {
        StageQuality { name, triangles: 1200, quality }
    }

    #[test]
    fn a_stage_is_better_by_more_than_the_margin_in_both_measures() {
        let q = |psnr: f64, flip: f64| Quality { psnr, flip, ..Quality::default() };
        let name = |stages: &[(&'static str, Quality)]| {
            let stages: Vec<StageQuality> = stages.iter().map(|(name, q)| stage(name, *q)).collect();
            better(&stages, &q(30.0, 0.05)).map(|b| b.name)
        };
        assert_eq!(name(&[("decimated", q(30.0 + 0.9 * CLEAR_GAIN, 0.04))]), None, "within noise");
        assert_eq!(name(&[("decimated", q(31.0, 0.06))]), None, "one measure alone");
        assert_eq!(name(&[("original", q(40.0, 0.01))]), None);
        assert_eq!(name(&[("baked", q(31.0, 0.04)), ("decimated", q(33.0, 0.03))]), Some("decimated"));
    }

    #[test]
    fn what_is_better_is_told_apart_from_what_was_written() {
        let q = |psnr: f64, flip: f64| Quality { psnr, flip, ..Quality::default() };
        for written in [Written::Fitted, Written::Rebaked, Written::Baked] {
            let better = Some(stage("decimated", q(33.0, 0.03)));
            let verdict = Verdict { better, written, ..Verdict::new(&[q(30.0, 0.05)], None) };
            let text = verdict.to_string();
            // One sentence of its own, the last, that says that the file holds something else.
            let sentence = ". What the table calls decimated (the asset's own materials with their textures as they were \
                            given, 1,200 triangles) scores better here and is not in the file: 33.0 dB, FLIP 0.030";
            assert!(text.ends_with(sentence), "{text}");
            assert_eq!(text.matches("table calls").count(), 1, "{text}");
        }
        for (name, words) in [
            ("baked", "baked (the decimated shape with baked maps, 1,200 triangles)"),
            ("fitted", "fitted (the fit, 1,200 triangles, which looked worse in the views of the choice)"),
            ("sphere", "sphere (a"),
            ("start", "start scores"),
        ] {
            let better = Some(stage(name, q(33.0, 0.03)));
            let plain = || Verdict { written: Written::Decimated, ..Verdict::new(&[q(30.0, 0.05)], None) };
            let text = Verdict { better, ..plain() }.to_string();
            assert!(text.contains(&format!(". What the table calls {words}")), "{text}");
            // A file that is to fit into bytes is not as what was fitted, though that is what was written.
            let most = Verdict { better, max_bytes: Some(30_000), ..plain() };
            let text = most.to_string();
            assert_eq!(text.contains("1,200 triangles, whatever its bytes)"), name != "start", "{text}");
            assert!(!text.contains("looked worse"), "{text}");
        }
        // A start that was chosen before bytes counted is another reason.
        let better = Some(stage("fitted", q(33.0, 0.03)));
        let (written, max_bytes) = (Written::Baked, Some(30_000));
        let lost = Verdict { better, written, max_bytes, ..Verdict::new(&[q(30.0, 0.05)], None) };
        assert!(lost.to_string().contains("which looked worse in the views of the choice)"), "{lost}");
    }

    #[test]
    fn what_storing_a_file_costs_is_told_as_that() {
        let q = |psnr: f64, flip: f64| Quality { psnr, flip, ..Quality::default() };
        let told = |name, written, textured| {
            let better = Some(stage(name, q(33.0, 0.03)));
            Verdict { better, written, textured, ..Verdict::new(&[q(30.0, 0.05)], None) }.to_string()
        };
        for written in [Written::Fitted, Written::ShrinkWrapped, Written::Baked] {
            let text = told(written.name(), written, true);
            let sentence = format!("33.0 dB, FLIP 0.030 here ({} in the table)", written.name());
            assert!(text.contains(&sentence) && text.contains("Before it was stored"), "{text}");
            assert!(!text.contains("not in the file"), "{text}");
            assert!(text.ends_with("finer textures or geometry would keep more"), "{text}");
        }
        let (better, max_bytes) = (Some(stage("fitted", q(33.0, 0.03))), Some(9000));
        let within = Verdict { better, max_bytes, ..Verdict::new(&[q(30.0, 0.05)], None) }.to_string();
        assert!(within.ends_with(": more bytes would keep more"), "{within}");
        // The row of own materials is one of several decimations, and has all texels.
        assert!(
            told("decimated", Written::Decimated, true).contains("with their textures as they were given")
        );
        assert!(told("decimated", Written::Decimated, false).contains("(the asset's own materials, 1,200"));
    }

    #[test]
    fn a_choice_within_bytes_and_one_that_was_cut_say_so() {
        let plain = || Verdict::new(&[Quality::default()], None);
        let of = |written, cut, max_bytes| Verdict { written, cut, max_bytes, ..plain() }.to_string();
        // New maps are chosen before bytes count; own materials meet them as files.
        assert!(
            of(Written::Decimated, false, Some(9000))
                .contains("no fit looked better within 9,000 bytes than")
        );
        for written in
            [Written::Fitted, Written::Rebaked, Written::ShrinkWrapped, Written::Baked, Written::Kept]
        {
            assert!(!of(written, false, Some(9000)).contains("within"), "{written:?}");
            let cut = of(written, true, None);
            assert!(cut.contains("not all was compared") && !cut.contains("looked b"), "{cut}");
            assert!(!of(written, false, None).contains("ended"));
            // A file that is too large was not chosen for its looks.
            let max_bytes = Some(9000);
            let large = Verdict { written, too_large: true, max_bytes, ..plain() }.to_string();
            assert!(large.ends_with("nothing of at most 9,000 bytes was found"), "{large}");
            for cut in [
                Verdict { written, cut: true, traced: true, ..plain() },
                Verdict { written, too_large: true, traced: true, max_bytes, ..plain() },
            ] {
                assert!(cut.to_string().contains("more through the path tracer: "), "{cut}");
            }
            assert!(!large.contains("looked b"), "{large}");
        }
        // Maps of the path tracer are those of no start.
        let traced = Verdict { written: Written::ShrinkWrapped, traced: true, ..plain() }.to_string();
        assert!(traced.ends_with("fitted once more through the path tracer, which looked best"), "{traced}");
        // Where all triangles stay none are fewer.
        assert!(!of(Written::Decimated, false, None).contains("fewer"));
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
        assert!(told(Written::Whole, false).ends_with("as it was given, which has few enough bytes"));
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
            Verdict::new(&views(flips), Some((&views(original), beyond)))
        };
        let noisy = Verdict::new(&[view(0.056)], Some((&[view(0.036)], beyond_noise)));
        assert_eq!(noisy.likeness, Likeness::Close, "root of .056^2 - .036^2 is .043");
        let noisy = Verdict::new(&[view(0.05)], Some((&[view(0.045)], beyond_noise)));
        assert_eq!(noisy.likeness, Likeness::Same);
        assert_eq!(beside(&[0.14, 0.12], &[0.13, 0.12]).likeness, Likeness::Same, "as the asset is drawn");
        assert_eq!(beside(&[0.14, 0.30], &[0.13, 0.12]).likeness, Likeness::Different);
        assert!(beside(&[0.14], &[0.13]).to_string().ends_with("drawn so: 27.0 dB, FLIP 0.130"));
        let cut = Verdict { not_judged: 2, ..of(&[0.02, 0.06]) }.to_string();
        assert!(cut.contains(" over 2 views of 4 (the judgement was cut short); worst"), "{cut}");
        let text = of(&[0.02, 0.06]).to_string();
        assert_eq!(
            text,
            "looks close: PSNR 36.0 dB, FLIP 0.0400 over 2 new views; worst FLIP 0.0600 (34.0 dB) in view 2"
        );
    }
}
