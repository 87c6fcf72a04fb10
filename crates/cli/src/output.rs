//! What goes to stdout and into JSON files.

use crate::progress::say;
use anyhow::{Result, bail};
pub(crate) use photofit_fit::report::{count, counted};
use photofit_fit::simplify::Quality;
use serde_json::{Value, json};
use std::io::{ErrorKind, Write};
use std::path::Path;

/// Prints to stdout; a reader that has gone away is no error.
///
/// # Errors
/// Any other refusal of stdout.
pub(crate) fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(e.into()),
        _ => Ok(()),
    }
}

/// Ends what is explained: which benchmark measures what skipped passes save.
///
/// # Errors
/// As [`print()`].
pub(crate) fn name_suite(suite: &str) -> Result<()> {
    print(&format!("what skipped passes save is measured by `cargo xtask bench {suite}`\n"))
}

/// Writes JSON under a temporary name and renames it.
///
/// # Errors
/// If the file system refuses.
pub(crate) fn write_json(path: &Path, value: &Value) -> Result<()> {
    let mut text = serde_json::to_string_pretty(value)?;
    text.push('\n');
    Ok(photofit_image::write_atomically(path, text.as_bytes())?)
}

/// The files of a result that took long to find. One that cannot be written keeps no other from being written: the user is
/// told, and the command fails in the end.
#[derive(Default)]
pub(crate) struct Results {
    refused: usize,
}

impl Results {
    /// Takes note of how writing a file went; whether it is there.
    pub(crate) fn took(&mut self, written: Result<()>) -> bool {
        if let Err(e) = &written {
            say(&format!("warning: not written, all else is tried: {e}"));
            self.refused += 1;
        }
        written.is_ok()
    }

    /// Tells where the files stand.
    ///
    /// # Errors
    /// If a file could not be written.
    pub(crate) fn end(self, folder: &Path) -> Result<()> {
        match self.refused {
            0 => print(&format!("wrote {}\n", folder.display())),
            n => bail!(
                "{}: {n} of the files of the result could not be written; all others are there",
                folder.display()
            ),
        }
    }
}

/// Writes figures; where that is refused they go to stdout as one line, so that what was found is not lost and a program
/// can tell it from the text around it.
///
/// # Errors
/// If stdout is refused too.
pub(crate) fn keep_json(results: &mut Results, path: &Path, value: &Value) -> Result<()> {
    if results.took(write_json(path, value)) {
        return Ok(());
    }
    say("the figures are the line of standard output that begins with '{'");
    print(&format!("{}\n", serde_json::to_string(value)?))
}

/// A PSNR in decibels as JSON, `psnr`, and beside it `psnr_is`, what it says: `exact`; `at least`, where it is `bounded`: it
/// or a part of the mean reached the largest that is told apart; `infinite`, of equal images, where `psnr` is null: JSON has no such number.
pub(crate) fn write_psnr(figures: &mut Value, psnr: f64, bounded: bool) {
    figures["psnr"] = json!(psnr.is_finite().then_some(psnr));
    figures["psnr_is"] = json!(match (psnr.is_finite(), bounded) {
        (false, _) => "infinite",
        (true, true) => "at least",
        (true, false) => "exact",
    });
}

/// A quality as JSON.
pub(crate) fn quality(q: &Quality) -> Value {
    json!({
        "psnr": q.psnr,
        "ssim": q.ssim,
        "flip": q.flip,
        "outline_share": q.outline,
        "luminance_ratio": q.luminance,
    })
}

/// A table of qualities, with numbers of triangles where they are known; its last column is the share of the error that lies at the
/// outline.
pub(crate) fn quality_table(rows: &[(&str, Option<usize>, &Quality)]) -> String {
    let width = rows.iter().map(|r| r.0.len()).fold(11, usize::max) + 1;
    let counts = rows.iter().any(|r| r.1.is_some());
    let counted = |text: &str| if counts { format!(" {text:>10}") } else { String::new() };
    let mut text = format!(
        "{:<width$}{} {:>10} {:>8} {:>8} {:>11}\n",
        "",
        counted("triangles"),
        "PSNR dB",
        "SSIM",
        "FLIP",
        "at outline"
    );
    for (name, triangles, q) in rows {
        text += &format!(
            "{name:<width$}{} {:>10} {:>8.4} {:>8.4} {:>9.0} %\n",
            counted(&triangles.map_or_else(String::new, count)),
            q.decibels(2),
            q.ssim,
            q.flip,
            100.0 * q.outline
        );
    }
    text +=
        "at outline: share of the squared error where one of the two covers a pixel and the other does not\n";
    text
}

/// The command line of this run, as a shell would take it.
pub(crate) fn command_line() -> String {
    let arguments = std::env::args().skip(1).map(|a| quoted(&a));
    ["photofit".to_owned()].into_iter().chain(arguments).collect::<Vec<_>>().join(" ")
}

/// An argument as a shell would take it.
fn quoted(argument: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./=:,+@%".contains(c);
    if !argument.is_empty() && argument.chars().all(plain) {
        argument.to_owned()
    } else {
        format!("'{}'", argument.replace('\'', "'\\''"))
    }
}

/// A number of bytes for people.
pub(crate) fn bytes(n: u64) -> String {
    let x = n as f64;
    match n {
        0..1024 => format!("{n} B"),
        1024..1_048_576 => format!("{:.1} KiB", x / 1024.0),
        1_048_576..1_073_741_824 => format!("{:.1} MiB", x / 1_048_576.0),
        _ => format!("{:.2} GiB", x / 1_073_741_824.0),
    }
}

/// What a fit through the path tracer reached: its errors before and after, steps and seconds.
pub(crate) fn traced_error(judged: &str, errors: [Option<f64>; 2], (steps, seconds): (u64, f64)) -> String {
    let [first, best] = errors.map(|e| e.unwrap_or(f64::NAN));
    format!(
        "relative squared error of {judged}: {first:.4e} -> {best:.4e}, {}, {seconds:.1} s\n",
        counted(steps as usize, "step")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_for_people() {
        for (n, text) in [(0, "0"), (999, "999"), (1000, "1,000"), (1_234_567, "1,234,567")] {
            assert_eq!(count(n), text);
        }
        for (n, text) in [(12, "12 B"), (1536, "1.5 KiB"), (3 << 20, "3.0 MiB"), (5 << 30, "5.00 GiB")] {
            assert_eq!(bytes(n), text);
        }
    }

    #[test]
    fn columns_stand_below_each_other() {
        let q = Quality { psnr: 30.0, ..Quality::default() };
        for triangles in [None, Some(1_234_567)] {
            let table = quality_table(&[("file", triangles, &q), ("shrink-wrapped", triangles, &q)]);
            let ends: Vec<usize> = table.lines().take(3).map(str::len).collect();
            assert_eq!(ends, [ends[0]; 3], "{table}");
            assert_eq!(table.contains("1,234,567"), triangles.is_some(), "{table}");
        }
    }

    #[test]
    fn one_thing_is_told_in_the_singular() {
        let told = [(1, "sample"), (0, "step"), (1200, "vertex"), (1, "medium"), (2, "medium")];
        let told = told.map(|(n, what)| counted(n, what));
        assert_eq!(told, ["1 sample", "0 steps", "1,200 vertices", "1 medium", "2 media"]);
    }

    #[test]
    fn a_psnr_says_what_it_is() {
        let of = |psnr, bounded| {
            let mut figures = json!({});
            write_psnr(&mut figures, psnr, bounded);
            figures
        };
        assert_eq!(of(31.5, false), json!({ "psnr": 31.5, "psnr_is": "exact" }));
        assert_eq!(of(60.0, true), json!({ "psnr": 60.0, "psnr_is": "at least" }));
        assert_eq!(of(f64::INFINITY, false), json!({ "psnr": null, "psnr_is": "infinite" }));
    }

    #[test]
    fn arguments_are_quoted_where_a_shell_needs_it() {
        assert_eq!(quoted("--ratio=0.03"), "--ratio=0.03");
        assert_eq!(quoted("my asset.glb"), "'my asset.glb'");
        assert_eq!(quoted("it's"), "'it'\\''s'");
        assert_eq!(quoted(""), "''");
    }
}
