//! What a suite records and how it is written: JSON, Markdown, SVG.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result};
use serde_json::{Map, Value, json};

use crate::plot::{self, Axis};
use crate::timing::{self, Timing};

/// One measurement.
#[derive(Clone, Debug)]
pub(crate) struct Row {
    /// The method: a curve of the plot.
    pub(crate) method: String,
    /// The case: where on the curve, in words.
    pub(crate) case: String,
    /// The size of the case, the abscissa of the plot of time.
    pub(crate) size: f64,
    /// Time.
    pub(crate) timing: Timing,
    /// The error, the first column after the time, then further figures by name.
    pub(crate) figures: Vec<(&'static str, f64)>,
}

/// The state of one suite's run.
#[derive(Debug)]
pub(crate) struct Context {
    name: &'static str,
    about: &'static str,
    baseline: bool,
    rows: Vec<Row>,
    notes: Vec<String>,
    /// Further plots: ending of the file's name, and the SVG.
    plots: Vec<(String, String)>,
}

impl Context {
    pub(crate) fn new(name: &'static str, about: &'static str, baseline: bool) -> Self {
        Self { name, about, baseline, rows: Vec::new(), notes: Vec::new(), plots: Vec::new() }
    }

    /// Whether the suite shall time its reference method too.
    pub(crate) fn baseline(&self) -> bool {
        self.baseline
    }

    /// Times `work` and records it with the figures that `measure` finds in its result (error first).
    pub(crate) fn measure<T>(
        &mut self,
        method: &str,
        case: &str,
        size: usize,
        work: impl FnMut() -> T,
        measure: impl FnOnce(&T) -> Vec<(&'static str, f64)>,
    ) -> T {
        let (timing, result) = timing::time(work);
        let figures = measure(&result);
        self.record(method, case, size, timing, figures);
        result
    }

    /// Records what was timed elsewhere, with its figures (error first).
    pub(crate) fn record(
        &mut self,
        method: &str,
        case: &str,
        size: usize,
        timing: Timing,
        figures: Vec<(&'static str, f64)>,
    ) {
        let told: Vec<String> = figures.iter().map(|(name, v)| format!("{name} {}", number(*v))).collect();
        println!("{method:24} {case:16} {:10.3} ms  {}", 1e3 * timing.median, told.join(", "));
        let (method, case) = (method.to_owned(), case.to_owned());
        self.rows.push(Row { method, case, size: size as f64, timing, figures });
    }

    /// A further plot of named curves, written as `NAME-ENDING.svg`.
    pub(crate) fn plot(
        &mut self,
        ending: &str,
        title: &str,
        axes: [Axis<'_>; 2],
        curves: &[(String, Vec<(f64, f64)>)],
    ) -> Result<()> {
        let [x, y] = axes;
        self.plots.push((ending.to_owned(), plot::curves(title, x, y, curves)?));
        Ok(())
    }

    /// A sentence below the table.
    pub(crate) fn note(&mut self, text: impl Into<String>) {
        self.notes.push(text.into());
    }

    /// Names of the figures, in order of appearance.
    fn columns(&self) -> Vec<&'static str> {
        let mut names = Vec::new();
        for (name, _) in self.rows.iter().flat_map(|row| &row.figures) {
            if !names.contains(name) {
                names.push(*name);
            }
        }
        names
    }

    /// The table.
    pub(crate) fn markdown(&self) -> String {
        let columns = self.columns();
        let mut text = format!("{}\n\n| method | case | time | spread | runs |", self.about);
        for column in &columns {
            let _ = write!(text, " {column} |");
        }
        text.push_str("\n|---|---|---:|---:|---:|");
        text.push_str(&"---:|".repeat(columns.len()));
        text.push('\n');
        for row in &self.rows {
            let t = &row.timing;
            let _ = write!(
                text,
                "| {} | {} | {:.3} ms | {:.0}% | {} |",
                row.method,
                row.case,
                1e3 * t.median,
                100.0 * t.spread,
                t.runs
            );
            for column in &columns {
                let figure = row.figures.iter().find(|(name, _)| name == column);
                let _ = write!(text, " {} |", figure.map_or(String::new(), |(_, v)| number(*v)));
            }
            text.push('\n');
        }
        for note in &self.notes {
            let _ = writeln!(text, "\n{note}");
        }
        text
    }

    fn json(&self) -> Value {
        let rows = self.rows.iter().map(|row| {
            let figures: Map<String, Value> =
                row.figures.iter().map(|(name, value)| ((*name).to_owned(), json!(value))).collect();
            json!({
                "method": row.method, "case": row.case, "size": row.size, "seconds": row.timing.median,
                "spread": row.timing.spread, "runs": row.timing.runs, "figures": figures,
            })
        });
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        json!({
            "suite": self.name, "about": self.about, "threads": threads, "baseline": self.baseline,
            "rows": rows.collect::<Vec<_>>(), "notes": self.notes,
        })
    }

    /// Writes `NAME.json`, `NAME.md` and the plots of the suite; where it draws none, `NAME-time.svg` and, if there is an error,
    /// `NAME-error.svg`.
    pub(crate) fn write(&self, folder: &Path) -> Result<()> {
        fs::create_dir_all(folder).with_context(|| format!("{}: cannot create", folder.display()))?;
        let save = |ending: &str, text: String| {
            let path = folder.join(format!("{}{ending}", self.name));
            fs::write(&path, text).with_context(|| format!("{}: cannot write", path.display()))
        };
        save(".json", serde_json::to_string_pretty(&self.json())?)?;
        save(".md", format!("# {}\n\n{}", self.name, self.markdown()))?;
        for (ending, svg) in &self.plots {
            save(&format!("-{ending}.svg"), svg.clone())?;
        }
        if !self.plots.is_empty() {
            // Those of versions that drew them would look like those of this run.
            for ending in ["-time.svg", "-error.svg"] {
                let drawn = self.plots.iter().any(|(own, _)| ending == format!("-{own}.svg"));
                let path = folder.join(format!("{}{ending}", self.name));
                if !drawn && path.exists() {
                    fs::remove_file(&path).with_context(|| format!("{}: cannot remove", path.display()))?;
                }
            }
            return Ok(());
        }
        let time = self.curves(|row| Some((row.size, 1e3 * row.timing.median)));
        save("-time.svg", plot::curves(self.about, Axis("size"), Axis("milliseconds"), &time)?)?;
        let Some(error) = self.columns().first().copied() else { return Ok(()) };
        let points = self.curves(|row| {
            let value = row.figures.iter().find(|(name, _)| *name == error)?.1;
            Some((1e3 * row.timing.median, value))
        });
        save("-error.svg", plot::curves(self.about, Axis("milliseconds"), Axis(error), &points)?)
    }

    /// Points of each method, methods in order of appearance.
    fn curves(&self, point: impl Fn(&Row) -> Option<(f64, f64)>) -> Vec<(String, Vec<(f64, f64)>)> {
        let mut curves: Vec<(String, Vec<(f64, f64)>)> = Vec::new();
        for row in &self.rows {
            let Some(at) = point(row) else { continue };
            match curves.iter_mut().find(|(method, _)| *method == row.method) {
                Some((_, points)) => points.push(at),
                None => curves.push((row.method.clone(), vec![at])),
            }
        }
        curves
    }
}

/// Four significant digits.
fn number(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 {
        "0".to_owned()
    } else if !(1e-3..1e5).contains(&size) {
        format!("{value:.2e}")
    } else {
        let digits = (3 - size.log10().floor() as i32).max(0) as usize;
        format!("{value:.digits$}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Context {
        let mut context = Context::new("sample", "a sample", true);
        for size in [10_usize, 100] {
            context.measure(
                "sum",
                &size.to_string(),
                size,
                || (0..size).sum::<usize>(),
                |_| vec![("error", 0.0)],
            );
        }
        context.note("A note.");
        context
    }

    #[test]
    fn numbers_keep_four_digits() {
        for (value, text) in
            [(0.0, "0"), (12.3456, "12.35"), (0.0123456, "0.01235"), (98765.0, "98765"), (1e-9, "1.00e-9")]
        {
            assert_eq!(number(value), text, "{value}");
        }
    }

    #[test]
    fn tables_have_one_row_per_measurement() {
        let text = sample().markdown();
        assert_eq!(text.lines().filter(|line| line.starts_with("| sum |")).count(), 2, "{text}");
        assert!(text.ends_with("A note.\n"), "{text}");
        let json = sample().json();
        assert_eq!(json["rows"][1]["size"], json!(100.0));
        assert_eq!(json["rows"][1]["figures"]["error"], json!(0.0));
    }

    #[test]
    fn files_are_written() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let folder = folder.path().join("bench");
        sample().write(&folder).expect("written");
        for file in ["sample.json", "sample.md", "sample-time.svg", "sample-error.svg"] {
            assert!(folder.join(file).is_file(), "{file}");
        }
        let svg = fs::read_to_string(folder.join("sample-time.svg")).expect("a plot");
        assert!(svg.contains("<svg") && svg.contains("polyline"), "a curve is drawn");
        let mut own = sample();
        own.plot("own", "Own", [Axis("x"), Axis("y")], &[("a".into(), vec![(1.0, 2.0)])]).expect("drawn");
        own.write(&folder).expect("written");
        assert!(folder.join("sample-own.svg").is_file() && !folder.join("sample-time.svg").exists());
    }
}
