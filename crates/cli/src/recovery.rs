//! What a fit to pictures tells and writes once its file is there: the table, the report, the figures.

use crate::args::Course;
use crate::interrupt;
use crate::output::{self, print};
use crate::progress::say;
use crate::simplify::SUITE;
use crate::status::Ending;
use anyhow::{Result, anyhow};
use photofit_fit::engine::judge::ReportView;
use photofit_fit::engine::plan::PlanRows;
use photofit_fit::engine::trainer::HistoryPoint;
use photofit_fit::report::{RecoveryReport, write_recovery_report};
use photofit_fit::simplify::Quality;
use serde_json::{Value, json};
use std::path::Path;

/// What was reached.
pub(crate) struct Recovery<'a> {
    /// What was done, to what.
    pub(crate) title: String,
    /// The stages of the views, with their means; the last one is what was written.
    pub(crate) stages: [(&'static str, &'a Quality); 2],
    pub(crate) views: &'a [ReportView],
    /// What the pictures of the views are, in one sentence.
    pub(crate) judged: String,
    pub(crate) history: &'a [HistoryPoint],
    /// What its evaluations measure, with the unit.
    pub(crate) measure: &'static str,
    pub(crate) plan: &'a PlanRows,
    /// What an input holds and the written file does not, with the input that it is of.
    pub(crate) left_out: (&'a Path, &'a [String]),
    /// Whether the fit was ended early.
    pub(crate) stopped: bool,
}

impl Recovery<'_> {
    /// Tells all that `text` says below the table, and writes the report and the figures. What cannot be written keeps
    /// nothing else from being written.
    ///
    /// # Errors
    /// If a file cannot be written; the text is told then.
    pub(crate) fn tell(&self, course: &Course, output: &Path, text: &str, figures: Value) -> Result<Ending> {
        if self.stopped {
            say("the fit was ended early; what was reached is written");
        }
        if course.explain {
            print(&format!("what ran:\n{}\n", self.plan))?;
            output::name_suite(SUITE)?;
            print("\n")?;
        }
        let (file, lines) = self.left_out;
        lines.iter().for_each(|line| say(&format!("warning: {}: left out: {line}", file.display())));
        print(&format!("{}\n{text}", output::quality_table(&self.stages.map(|(name, q)| (name, None, q)))))?;
        let report = course.report.as_deref().map_or(Ok(()), |folder| {
            let unwritten = |e| anyhow!("{e}: the report is not written; {} is", output.display());
            print(&format!("wrote {}\n", self.write(folder).map_err(unwritten)?))
        });
        let json = course.json.as_ref().map_or(Ok(()), |file| output::write_json(file, &self.with(figures)));
        report?;
        json?;
        Ok(if self.stopped && interrupt::is_stopping() { Ending::Stopped } else { Ending::Done })
    }

    /// Writes the report; its page.
    fn write(&self, folder: &Path) -> Result<String> {
        let [(first, start), (last, end)] = self.stages;
        let report = RecoveryReport {
            title: self.title.clone(),
            summary: format!(
                "PSNR {} -> {} dB, FLIP {:.3} -> {:.3}",
                start.decibels(1),
                end.decibels(1),
                start.flip,
                end.flip
            ),
            stages: &[first, last],
            views: self.views,
            judged: self.judged.clone(),
            history: self.history,
            measure: self.measure,
            plan: self.plan.to_string(),
            command: output::command_line(),
        };
        Ok(write_recovery_report(folder, &report)?.display().to_string())
    }

    /// The figures of a command with those that all have.
    fn with(&self, mut figures: Value) -> Value {
        for (name, quality) in self.stages {
            figures[name] = output::quality(quality);
        }
        let last = |v: &ReportView| v.quality.last().map(|q| output::quality(&q.quality));
        figures["views"] = self.views.iter().map(last).collect();
        figures["left_out"] = json!(self.left_out.1);
        figures["stopped"] = json!(self.stopped);
        figures
    }
}
