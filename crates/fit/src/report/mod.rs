//! The report of a simplification: one HTML page that needs nothing else.
//!
//! It holds the figures, every view of the judgement with a before-after slider and FLIP heat maps, the course of the
//! fit, the maps, the texture layout, wireframes, the plan and the command line.

mod atlas;
mod page;
mod pictures;
mod plots;
mod views;
mod wireframe;

use crate::FitError;
use crate::simplify::{Normalised, Outcome, Quality};
use page::{bytes, count, escape};
use photofit_image::write_atomically;
use photofit_scene::Scene;
use std::path::{Path, PathBuf};

/// What a report says beside the outcome.
#[derive(Clone, Debug)]
pub struct ReportInfo<'a> {
    /// The reference, for its wireframe.
    pub scene: &'a Scene,
    /// Name of the asset.
    pub title: String,
    /// The command line.
    pub command: String,
    /// Bytes of the reference's file.
    pub bytes_in: Option<u64>,
    /// Bytes of the written file.
    pub bytes_out: Option<u64>,
}

/// Writes `index.html` to `folder`, which is made when it does not exist, and returns its path. The page has all of its
/// pictures inside and stays below about 15 MB.
///
/// # Errors
/// If the folder or the page cannot be written, or the reference has no extent.
pub fn write_report(folder: &Path, outcome: &Outcome, info: &ReportInfo<'_>) -> Result<PathBuf, FitError> {
    std::fs::create_dir_all(folder).map_err(|source| FitError::Io { path: folder.into(), source })?;
    let path = folder.join("index.html");
    write_atomically(&path, html(outcome, info)?.as_bytes())?;
    Ok(path)
}

/// The page.
fn html(o: &Outcome, info: &ReportInfo<'_>) -> Result<String, FitError> {
    let body = [
        header(o, info),
        table(o),
        views::section(o)?,
        plots::section(o)?,
        wireframes(o, info)?,
        atlas::section(&o.candidate)?,
        format!("<h2>Plan</h2>\n<pre>{}</pre>\n", escape(&o.plan.to_string())),
        format!("<h2>Command</h2>\n<pre>{}</pre>\n", escape(&info.command)),
    ];
    Ok(page::page(&format!("photofit: {}", info.title), &body.concat()))
}

/// Headline figures.
fn header(o: &Outcome, info: &ReportInfo<'_>) -> String {
    let share = 100.0 * o.triangles_out as f64 / o.triangles_in.max(1) as f64;
    let mut tiles = vec![
        ("triangles", format!("{} <span>of {}</span>", count(o.triangles_out), count(o.triangles_in))),
        ("kept", format!("{share:.2} %")),
    ];
    if let (Some(a), Some(b)) = (info.bytes_in, info.bytes_out) {
        tiles.push(("file size", format!("{} <span>of {}</span>", bytes(b), bytes(a))));
    }
    let [fitted, baked] = ["fitted", "baked"].map(|name| o.stage(name).copied().unwrap_or_default());
    tiles.extend([
        (
            "fitted PSNR",
            format!("{:.2} dB <span>{:+.2} over baked</span>", fitted.psnr, fitted.psnr - baked.psnr),
        ),
        ("fitted FLIP", format!("{:.4} <span>{}</span>", fitted.flip, change(fitted.flip, baked.flip))),
        ("time", format!("{:.0} s <span>{:.0} s to the file</span>", o.seconds, o.fit_seconds)),
        ("steps", format!("{} <span>{:.1} Mpixel/s</span>", o.steps, o.mpix_per_s)),
        ("within 0.5 dB of the end", format!("{:.0} s", o.seconds_to_half_db)),
    ]);
    let tiles: String =
        tiles.iter().map(|(name, value)| format!("<div><b>{value}</b>{name}</div>\n")).collect();
    let stopped = if o.stopped {
        "<p class=note>The fit was ended early; this is what it had reached.</p>\n"
    } else {
        ""
    };
    format!("<h1>{}</h1>\n{stopped}<div class=tiles>\n{tiles}</div>\n", escape(&info.title))
}

fn change(new: f64, old: f64) -> String {
    if old > 0.0 { format!("{:+.0} % against baked", 100.0 * (new / old - 1.0)) } else { String::new() }
}

fn table(o: &Outcome) -> String {
    let what = |name: &str| match name {
        "decimated" => "the asset's own textures on fewer triangles",
        "baked" => "new atlas, maps baked from the asset",
        "wrapped" => "drawn onto the asset's surface, then baked; the fit starts from the better of the two",
        "fitted" => "the written file, loaded again",
        _ => "",
    };
    let row = |(name, q): &(&str, Quality)| {
        let what = what(name);
        format!(
            "<tr><th>{name}</th><td class=what>{what}</td><td>{:.2}</td><td>{:.4}</td><td>{:.4}</td><td>{:.0} \
             %</td></tr>\n",
            q.psnr,
            q.ssim,
            q.flip,
            100.0 * q.outline
        )
    };
    let rows: String = o.stages.iter().map(row).collect();
    format!(
        "<table>\n<tr><th></th><th></th><th>PSNR, dB</th><th>SSIM</th><th>FLIP</th><th>at \
         outline</th></tr>\n{rows}</table>\n\
         <p class=note>Means over {} views and lights that the fit never saw, over the foreground (the union of both \
         silhouettes and a margin) of {} x {} pixels. At outline: the share of the squared error in pixels that one asset \
         covers and the other does not, which no texture can mend.</p>\n",
        o.views.len(),
        o.resolution,
        o.resolution
    )
}

fn wireframes(o: &Outcome, info: &ReportInfo<'_>) -> Result<String, FitError> {
    let reference = Normalised::new(info.scene)?.flat.mesh;
    let light = o.candidate.mesh();
    let mut figures = String::new();
    for (name, mesh) in [("reference", &reference), ("fitted", &light)] {
        let picture = wireframe::shaded(&mesh.positions, &mesh.triangles);
        let caption = format!("{name}: {} triangles", count(mesh.triangles.len()));
        figures += &page::figure(&pictures::display(&picture, usize::MAX)?, name, &caption);
    }
    Ok(format!("<h2>Wireframes</h2>\n<div class=pair>\n{figures}</div>\n"))
}

#[cfg(test)]
mod tests;
