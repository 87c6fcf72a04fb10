//! The report of a task that makes something look like pictures: what was reached, the pictures, the course of the fit.

use super::{page, plots, views, write_page};
use crate::FitError;
use crate::engine::judge::{Quality, ReportView};
use crate::engine::trainer::HistoryPoint;
use page::escape;
use std::path::{Path, PathBuf};

/// What such a report says.
#[derive(Clone, Debug)]
pub struct RecoveryReport<'a> {
    /// What was done, to what.
    pub title: String,
    /// What was reached, in one sentence.
    pub summary: String,
    /// Name of each stage of the views; the last one is what was written.
    pub stages: &'a [&'a str],
    /// The pictures, each with the stages against it.
    pub views: &'a [ReportView],
    /// What these pictures are, in one sentence.
    pub judged: String,
    /// The course of the fit.
    pub history: &'a [HistoryPoint],
    /// What its evaluations measure, with the unit.
    pub measure: &'static str,
    /// What ran and what was skipped.
    pub plan: String,
    /// The command line.
    pub command: String,
}

/// Writes [`super::PAGE`] to `folder`, which is made when it does not exist, and returns its path.
///
/// # Errors
/// If the folder or the page cannot be written.
pub fn write_recovery_report(folder: &Path, report: &RecoveryReport<'_>) -> Result<PathBuf, FitError> {
    let RecoveryReport { title, summary, stages, judged, .. } = report;
    let shipped = stages.last().copied().unwrap_or_default();
    let body = [
        format!(
            "<p class=\"verdict\"><b>{}</b></p>\n<h1>{}</h1>\n{}<p class=note>{}</p>\n",
            escape(summary),
            escape(title),
            table(report),
            escape(judged)
        ),
        plots::section(report.history, report.measure)?,
        views::section(report.views, stages, shipped)?,
        format!(
            "<details>\n<summary>What ran</summary>\n<h3>Plan</h3>\n<pre>{}</pre>\n<h3>Command</h3>\n<pre>{}</pre>\n\
             </details>\n",
            escape(&report.plan),
            escape(&report.command)
        ),
    ];
    write_page(folder, &page::page(&format!("photofit: {title}"), &body.concat()))
}

/// Means over the views.
fn table(r: &RecoveryReport<'_>) -> String {
    let row = |(k, name): (usize, &&str)| {
        let q = Quality::mean(r.views.iter().filter_map(|v| v.quality.get(k)).map(|v| &v.quality));
        let (psnr, name) = (q.decibels(2), escape(name));
        format!("<tr><th>{name}</th><td>{psnr}</td><td>{:.4}</td><td>{:.4}</td></tr>\n", q.ssim, q.flip)
    };
    let rows: String = r.stages.iter().enumerate().map(row).collect();
    format!(
        "<div class=wide><table class=stages>\n<tr><th></th><th>PSNR, dB</th><th>SSIM</th><th>FLIP</th></tr>\n{rows}\
         </table></div>\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::judge::view_quality;
    use photofit_image::Image;

    #[test]
    fn the_page_shows_pictures_curves_and_escaped_text() {
        let picture = |v: f32| Image::from_data(24, 16, 4, [v, v, v, 1.0].repeat(24 * 16));
        let against = |v: f32| view_quality(&picture(0.5), &picture(v));
        let views =
            vec![ReportView { reference: against(0.5).picture, quality: vec![against(0.1), against(0.49)] }];
        let point = |step: u64| HistoryPoint { step, seconds: 1.0, loss: 0.5, quality: 20.0 + step as f64 };
        let report = RecoveryReport {
            title: "a < b".into(),
            summary: "found".into(),
            stages: &["start", "recovered"],
            views: &views,
            judged: "one picture".into(),
            history: &[point(0), point(25)],
            measure: "held-out PSNR, dB",
            plan: "  run it".into(),
            command: "photofit \"x\"".into(),
        };
        let dir = tempfile::tempdir().unwrap();
        let file = write_recovery_report(&dir.path().join("new"), &report).unwrap();
        let html = std::fs::read_to_string(file).unwrap();
        for part in ["a &lt; b", "found", "recovered", "<svg", "data:image/png", "run it", "&quot;x&quot;"] {
            assert!(html.contains(part), "{part}");
        }
        assert!(!html.contains("src=\"http"), "the page needs nothing else");
        let psnr = |k: usize| views[0].quality[k].quality.decibels(2);
        assert!(html.contains(&psnr(0)) && html.contains(&psnr(1)));
    }
}
