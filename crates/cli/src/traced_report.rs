//! The page of what was found through the path tracer: pictures beside those that were given, and the course of the fit.

use crate::output::{self, Results, print};
use crate::progress::{Terminal, say};
use anyhow::Result;
use photofit_fit::Progress;
use photofit_fit::engine::judge::{ReportView, view_quality};
use photofit_fit::engine::plan::PlanRows;
use photofit_fit::engine::traced::Traced;
use photofit_fit::engine::trainer::HistoryPoint;
use photofit_fit::pictures::doubts;
use photofit_fit::recover_scene::relative_error;
use photofit_fit::report::{RecoveryReport, TRACED_MEASURE, write_recovery_report};
use photofit_image::{Image, contact_sheet};
use photofit_pathtrace::View;
use serde_json::{Value, json};
use std::path::Path;

/// Most pictures of a page.
const MOST: usize = 12;
/// Most pictures of a sheet.
const SHOWN: usize = 4;

/// What a page is made of.
pub(crate) struct Found<'a> {
    pub(crate) title: String,
    /// What is told of what was reached; its first line stands on the page.
    pub(crate) reached: &'a str,
    pub(crate) model: &'a Traced,
    pub(crate) views: &'a [View],
    /// One for each view.
    pub(crate) targets: &'a [Image],
    pub(crate) held_out: Option<usize>,
    pub(crate) history: &'a [HistoryPoint],
    pub(crate) plan: &'a PlanRows,
    /// Samples and seed of the pictures.
    pub(crate) sampled: (u32, u64),
}

/// The pictures of a self-test, one for each view, with their progress.
pub(crate) fn self_test_pictures<E>(
    views: &[View],
    picture: impl Fn(&View) -> Result<Image, E>,
) -> Result<Vec<Image>, E> {
    let progress = Terminal::new();
    let one = |(k, view): (usize, &View)| {
        progress.report("pictures", k as u64, views.len() as u64, "");
        picture(view)
    };
    let pictures = views.iter().enumerate().map(one).collect();
    progress.finish();
    pictures
}

/// Warns of pictures that tell a fit nothing, by the file or option that brings them.
pub(crate) fn tell_doubts(name: &str, views: &[View], pictures: &[Image]) {
    let cameras: Vec<String> = views.iter().map(|v| format!("{v:?}")).collect();
    let doubts = doubts(&pictures.iter().collect::<Vec<_>>(), &cameras);
    doubts.iter().for_each(|d| say(&format!("warning: {name}: {d}")));
}

/// Errors of the first and of the best evaluation.
pub(crate) fn first_and_best(history: &[HistoryPoint]) -> [Option<f64>; 2] {
    let errors = || history.iter().map(|h| relative_error(h.quality));
    [errors().next(), errors().reduce(f64::min)]
}

/// Tells that a fit through the path tracer was ended early, and what ran where that is asked for.
pub(crate) fn tell_course(stopped: bool, plan: Option<&PlanRows>) -> Result<()> {
    if stopped {
        say("the fit was ended early; what was reached is written");
    }
    match plan {
        Some(plan) => print(&format!("what ran:\n{plan}\n\n")),
        None => Ok(()),
    }
}

/// By which of so many pictures a fit was judged, for people.
pub(crate) fn judged(held_out: Option<usize>, pictures: usize) -> String {
    match held_out {
        Some(k) => format!("picture {} of {pictures}, which was held out", k + 1),
        None if pictures == 1 => "the picture that was fitted (none is held out)".into(),
        None => "the pictures that were fitted (none is held out)".into(),
    }
}

/// The course of a fit as JSON.
pub(crate) fn course(history: &[HistoryPoint]) -> Vec<Value> {
    let point = |h: &HistoryPoint| json!({ "step": h.step, "loss": h.training_loss(), "relative_error": relative_error(h.quality) });
    history.iter().map(point).collect()
}

/// Up to four pictures in the upper row, what was found below; the last one, which may be held out, is always there.
pub(crate) fn sheet(
    model: &Traced,
    views: &[View],
    targets: &[Image],
    (spp, seed): (u32, u64),
) -> Result<Image> {
    let shown = spread(views.len(), SHOWN);
    let mut images: Vec<Image> = shown.iter().map(|k| targets[*k].select(&[0, 1, 2])).collect();
    for k in &shown {
        images.push(model.picture(&views[*k], spp, seed)?.select(&[0, 1, 2]));
    }
    Ok(contact_sheet(&images.iter().collect::<Vec<_>>(), shown.len(), 4))
}

/// At most `most` of `all` pictures, evenly spread; the last one is always among them.
fn spread(all: usize, most: usize) -> Vec<usize> {
    let count = all.min(most);
    (0..count).map(|k| (all - 1) * (k + 1) / count).collect()
}

impl Found<'_> {
    /// Writes the page to a folder beside the other results and tells people what was found.
    pub(crate) fn tell(&self, folder: &Path, text: &str, mut results: Results) -> Result<()> {
        results.took(self.write(folder));
        let mut errors = self.history.iter().map(|h| relative_error(h.quality));
        let first = errors.next().filter(|e| *e > 0.0);
        if self.history.last().is_some_and(|h| h.step > 1) && errors.all(|e| Some(e) == first) {
            let why = "no picture that was judged sees what was to be found, or no value could move";
            say(&format!("warning: the error is what it was at the start: {why}"));
        }
        print(&format!("{text}{}", self.reached))?;
        results.end(folder)
    }

    /// Writes the page to a folder; of many pictures some are shown, the last one always.
    fn write(&self, folder: &Path) -> Result<()> {
        let (all, (spp, seed)) = (self.views.len(), self.sampled);
        let mut views = Vec::new();
        for k in spread(all, MOST) {
            let found = self.model.picture(&self.views[k], spp, seed)?;
            let quality = view_quality(&opaque(&self.targets[k]), &opaque(&found));
            let reference = view_quality(&opaque(&self.targets[k]), &opaque(&self.targets[k])).picture;
            views.push(ReportView { reference, quality: vec![quality] });
        }
        let held_out = match self.held_out {
            Some(k) => format!("picture {k} was held out, the others were fitted"),
            None => "all pictures were fitted".into(),
        };
        write_recovery_report(
            folder,
            &RecoveryReport {
                title: self.title.clone(),
                summary: self.reached.lines().next().unwrap_or_default().to_owned(),
                stages: &["found"],
                views: &views,
                judged: format!("{} of {all} pictures, {spp} samples a pixel; {held_out}.", views.len()),
                history: self.history,
                measure: TRACED_MEASURE,
                plan: self.plan.to_string(),
                command: output::command_line(),
            },
        )?;
        Ok(())
    }
}

/// Linear light without what alpha says.
fn opaque(picture: &Image) -> Image {
    let value = |x, y, c| if c < 3 { picture.pixel(x, y)[c] } else { 1.0 };
    Image::from_fn(picture.width, picture.height, 4, value)
}
