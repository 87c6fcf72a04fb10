//! The HTML report of a golden run: one file that needs no other.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use photofit_image::Image;

use crate::compare::heat;
use crate::store::{Format, encode_png};
use crate::suite::Outcome;

const HEAD: &str = "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Golden images</title><style>\
body{font:15px system-ui,sans-serif;margin:2rem;background:#fafafa;color:#222}\
section{background:#fff;border:1px solid #ddd;border-left:6px solid #2a2;margin:1rem 0;padding:.6rem 1rem}\
section.failed{border-left-color:#c22}figure{display:inline-block;vertical-align:top;width:288px;margin:.4rem 1rem .4rem 0}\
img{image-rendering:pixelated;width:288px;background:repeating-conic-gradient(#ccc 0 25%,#fff 0 50%) 0/16px 16px}\
figcaption{color:#666}td{padding:0 1rem 0 0}</style><h1>Golden images</h1>\n";

/// Writes the report, failures first.
///
/// # Errors
/// If the file cannot be written.
pub fn write(path: &Path, outcomes: &[Outcome]) -> Result<()> {
    let folder = path.parent().context("the report has a folder")?;
    fs::create_dir_all(folder).with_context(|| format!("{}: cannot create", folder.display()))?;
    let temporary = path.with_extension("html.tmp");
    fs::write(&temporary, html(outcomes)?)
        .with_context(|| format!("{}: cannot write", temporary.display()))?;
    fs::rename(&temporary, path).with_context(|| format!("{}: cannot rename", path.display()))
}

/// The report's text.
///
/// # Errors
/// If a picture cannot be encoded.
pub fn html(outcomes: &[Outcome]) -> Result<String> {
    let mut text = String::from(HEAD);
    let failed = outcomes.iter().filter(|o| !o.passed()).count();
    writeln!(text, "<p>{failed} of {} cases differ.</p>", outcomes.len())?;
    for outcome in outcomes.iter().filter(|o| !o.passed()).chain(outcomes.iter().filter(|o| o.passed())) {
        section(&mut text, outcome)?;
    }
    text.push_str("</html>\n");
    Ok(text)
}

fn section(text: &mut String, outcome: &Outcome) -> Result<()> {
    let class = if outcome.passed() { "passed" } else { "failed" };
    writeln!(
        text,
        "<section class=\"{class}\"><h2>{}</h2><p>{}</p>",
        outcome.case.name,
        escape(&outcome.summary())
    )?;
    figure(text, "actual", &outcome.actual, outcome.case.format)?;
    if let Some(expected) = &outcome.expected {
        figure(text, "expected", expected, outcome.case.format)?;
        if let Ok(d) = &outcome.result {
            let case = outcome.case;
            let map = heat(&outcome.actual, expected, case.format.step(), case.tolerance.sample);
            figure(text, "difference, yellow at the bound", &map, Format::Png)?;
            writeln!(
                text,
                "<table><tr><td>largest difference<td>{:.3e} at ({}, {})<tr><td>root mean square<td>{:.3e}\
                 <tr><td>pixels outside<td>{} of {}<tr><td>bound on a sample<td>{:.3e}</table>",
                d.largest, d.at.0, d.at.1, d.rmse, d.outliers, d.pixels, d.bound
            )?;
        }
    }
    let tolerance = &outcome.case.tolerance;
    writeln!(
        text,
        "<p>Tolerance {:.1e}, {:.2}% of the pixels exempt: {}.</p></section>",
        tolerance.sample,
        100.0 * tolerance.outliers,
        escape(tolerance.reason)
    )?;
    Ok(())
}

fn figure(text: &mut String, caption: &str, image: &Image, format: Format) -> Result<()> {
    let png = STANDARD.encode(encode_png(&display(image, format))?);
    writeln!(
        text,
        "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{png}\"><figcaption>{caption}, {}x{}x{}\
         </figcaption></figure>",
        image.height, image.width, image.channels
    )?;
    Ok(())
}

/// What a browser can show: floats through the sRGB curve, at most 4 channels, two of them as red and green.
fn display(image: &Image, format: Format) -> Image {
    let channels = if matches!(image.channels, 1 | 3 | 4) { image.channels } else { 3 };
    let mut out = Image::new(image.width, image.height, channels);
    for (to, from) in out.data.chunks_exact_mut(channels).zip(image.data.chunks_exact(image.channels)) {
        for (c, (to, from)) in to.iter_mut().zip(from).enumerate() {
            let value = if from.is_nan() { 0.0 } else { from.clamp(0.0, 1.0) };
            *to = if format == Format::Png || c == 3 { value } else { srgb(value) };
        }
    }
    out
}

fn srgb(v: f32) -> f32 {
    if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
