//! The report of a simplification: one HTML page that needs nothing else. (That of the other tasks: [`RecoveryReport`].)
//!
//! First a verdict, then the light asset at the size that it is for, what the file holds and what was left out, every
//! view of the judgement with a before-after slider and FLIP, the maps, the texture layout and wireframes. Figures of
//! the fit (stages, curves, times, plan, command line) are folded at the end.

mod atlas;
mod contents;
mod page;
mod pictures;
mod plots;
mod recovery;
mod verdict;
mod views;
mod wireframe;

pub(crate) use page::grouped;
pub use page::{count, counted};
pub use recovery::{RecoveryReport, write_recovery_report};
pub use verdict::{Likeness, Verdict};

use crate::FitError;
use crate::engine::judge::{BEST_PSNR, Judged};
use crate::simplify::{
    Appearance, DECIMATED, FILE, FITTED, Normalised, ORIGINAL, Outcome, StageQuality, Written,
};
use crate::traced_maps::MapsCourse;
use page::{bytes, escape};
use photofit_image::{set_aside, write_atomically};
use photofit_scene::Scene;
use std::path::{Path, PathBuf};

/// Name of the page in a report's folder.
pub const PAGE: &str = "index.html";
/// What pictures of the written file are called.
const SHIPPED: &str = "light asset";

/// What a report says beside the outcome.
#[derive(Clone, Debug)]
pub struct ReportInfo<'a> {
    /// The reference.
    pub scene: &'a Scene,
    /// The written file.
    pub light: &'a Path,
    /// Name of the asset.
    pub title: String,
    /// The command line.
    pub command: String,
    /// Bytes of the reference's file.
    pub bytes_in: Option<u64>,
    /// What the user was warned of, one line each.
    pub warnings: Vec<String>,
    /// Pixels that the asset covers on the screen that it is for; `None` where the budget does not say.
    pub screen_size: Option<f64>,
}

/// What evaluations of fits through the path tracer measure.
pub const TRACED_MEASURE: &str = "relative squared error, dB below 1";

/// Writes [`PAGE`] to `folder`, which is made when it does not exist, and returns its path. The page has all of its
/// pictures inside and stays below about 15 MB. It replaces an earlier report; another file of its name is kept with `.bak`
/// behind it.
///
/// # Errors
/// If the folder or the page cannot be written, the written file cannot be read, or the reference has no extent.
pub fn write_report(folder: &Path, outcome: &Outcome, info: &ReportInfo<'_>) -> Result<PathBuf, FitError> {
    write_page(folder, &html(outcome, info)?)
}

fn write_page(folder: &Path, html: &str) -> Result<PathBuf, FitError> {
    std::fs::create_dir_all(folder).map_err(|source| FitError::Io { path: folder.into(), source })?;
    let path = folder.join(PAGE);
    if path.is_file() && !page::is_page(&path) {
        set_aside(&path)?;
    }
    write_atomically(&path, html.as_bytes())?;
    Ok(path)
}

/// The page.
fn html(o: &Outcome, info: &ReportInfo<'_>) -> Result<String, FitError> {
    let light = photofit_scene::load(info.light)?;
    let file =
        std::fs::read(info.light).map_err(|source| FitError::Io { path: info.light.to_owned(), source })?;
    let last = o.stages.last().map_or("", |s| s.name);
    let how = if o.steps > 0 { "How the fit went" } else { "How it was made" };
    let body = [
        header(o, info, &light, file.len() as u64),
        views::at_size(o, info.screen_size)?,
        contents::section(contents::parts(&file).as_ref(), info.scene, &light, [&o.left_out, &o.not_fitted]),
        views::section(&o.views, &o.stages.iter().map(|s| s.name).collect::<Vec<_>>(), last)?,
        if o.written.has_own_surface() || o.appearance == Appearance::VertexColors {
            String::new()
        } else {
            atlas::section(&o.candidate, &stored(o))?
        },
        wireframes(&light, info)?,
        format!(
            "<details>\n<summary>{how}</summary>\n{}{}{}{}<h3>Plan</h3>\n<pre>{}</pre>\n<h3>Command</h3>\n\
             <pre>{}</pre>\n</details>\n",
            table(o),
            times(o),
            plots::section(&o.history, "held-out PSNR, dB")?,
            traced_maps(o)?,
            escape(&o.plan.to_string()),
            escape(&info.command)
        ),
    ];
    Ok(page::page(&format!("photofit: {}", info.title), &body.concat()))
}

/// The course of the maps through the path tracer.
fn traced_maps(o: &Outcome) -> Result<String, FitError> {
    let Some(m) = &o.traced_maps else { return Ok(String::new()) };
    let (curves, plan) = (plots::section(&m.history, TRACED_MEASURE)?, escape(&m.plan.to_string()));
    Ok(format!("<h3>Maps through the path tracer, {} steps</h3>\n{curves}<pre>{plan}</pre>\n", m.steps))
}

/// How the file stores its maps, which the report shows as they were made.
fn stored(o: &Outcome) -> String {
    let traced = if o.traced_maps.as_ref().is_some_and(MapsCourse::gained) {
        "before they were fitted through the path tracer"
    } else {
        "before the file was written"
    };
    format!("As they were {traced}; textures of the file: {}", o.textures)
}

/// The verdict and the figures of the file.
fn header(o: &Outcome, info: &ReportInfo<'_>, light: &Scene, bytes_out: u64) -> String {
    let verdict = Verdict::of(o);
    let class = match verdict.likeness {
        Likeness::Same => "same",
        Likeness::Close => "close",
        Likeness::Different | Likeness::Unknown => "different",
    };
    let text = verdict.to_string();
    let (first, rest) = text.split_once(": ").unwrap_or((&text, ""));
    let share = 100.0 * o.triangles_out as f64 / o.triangles_in.max(1) as f64;
    let of = |n: Option<u64>| n.map_or_else(String::new, |n| format!(" <span>of {}</span>", bytes(n)));
    let mut tiles = vec![
        (
            "triangles",
            format!("{} <span>of {}, {share:.2} %</span>", count(o.triangles_out), count(o.triangles_in)),
        ),
        ("bytes", format!("{}{}", bytes(bytes_out), of(info.bytes_in))),
    ];
    if let Some(density) = contents::texel_density(light) {
        let asset = contents::texel_density(info.scene)
            .map_or_else(String::new, |d| format!(" <span>the asset has {}</span>", significant(d)));
        tiles.push(("texels per unit of length", format!("{}{asset}", significant(density))));
    }
    let tiles: String =
        tiles.iter().map(|(name, value)| format!("<div><b>{value}</b>{name}</div>\n")).collect();
    let stopped =
        o.ended_early().map_or_else(String::new, |how| format!("<p class=note>{}.</p>\n", sentence(how)));
    let large = o.max_bytes.filter(|most| bytes_out > *most).map_or_else(String::new, |most| {
        format!(
            "<p class=note><b>The file is too large</b>: {} bytes, the fewest that were found, where at most {} were asked for. It stands \
             in {}.</p>\n",
            grouped(bytes_out),
            grouped(most),
            escape(&o.file.display().to_string())
        )
    });
    let warned: String = info.warnings.iter().map(|w| format!("<li>{}</li>\n", escape(w))).collect();
    let warned = match warned {
        none if none.is_empty() => none,
        lines => format!("<ul class=left>\n{lines}</ul>\n"),
    };
    let beyond = if verdict.original.is_some() { " beyond that of the asset itself, drawn so," } else { "" };
    format!(
        "<p class=\"verdict {class}\"><b>{}</b> {}</p>\n<h1>{}</h1>\n{stopped}{large}{warned}<div class=tiles>\n{tiles}</div>\n\
         <p class=note>The same: FLIP{beyond} at most 0.03 in the mean and 0.05 in the worst view, hard to tell side by side. \
         Close: at most 0.08 and 0.12. The file was {}.</p>\n",
        escape(first),
        escape(rest),
        escape(&info.title),
        escape(&o.judged_by())
    )
}

/// Words that begin with a capital letter.
fn sentence(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().into_iter().flat_map(char::to_uppercase).chain(letters).collect()
}

/// A number with three significant digits.
fn significant(x: f64) -> String {
    let digits = (2.0 - x.abs().max(1e-12).log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{x:.digits$}")
}

fn table(o: &Outcome) -> String {
    let last = o.stages.last().map_or("", |s| s.name);
    let start = |start: Written| format!("{} with baked {}: a start", start.start(), o.appearance.in_words());
    let what = |name: &str| match name {
        ORIGINAL if o.judged == Judged::PathTraced => {
            "the asset itself, of other samples: what noise makes".to_owned()
        }
        ORIGINAL => "the asset itself, drawn as an engine draws it".to_owned(),
        DECIMATED => "the asset's own materials".to_owned(),
        FITTED if last == FITTED => "the written file, loaded again".to_owned(),
        FITTED if o.written == Written::Fitted => {
            "what was fitted, before it was made to fit into bytes".to_owned()
        }
        FITTED => "what was fitted, which is not in the file".to_owned(),
        FILE => "the written file, loaded again".to_owned(),
        name => Written::STARTS.into_iter().find(|s| s.name() == name).map_or_else(String::new, start),
    };
    let row = |StageQuality { name, triangles, quality: q }: &StageQuality| {
        format!(
            "<tr><th>{name}</th><td class=what>{}</td><td>{}</td><td>{}</td><td>{:.4}</td><td>{:.4}</td><td>{:.0} \
             %</td></tr>\n",
            what(name),
            count(*triangles),
            q.decibels(2),
            q.ssim,
            q.flip,
            100.0 * q.outline
        )
    };
    let rows: String = o.stages.iter().map(row).collect();
    let side = o.views.first().map_or(o.resolution, |v| v.reference.width);
    format!(
        "<div class=wide><table class=stages>\n<tr><th></th><th></th><th>triangles</th><th>PSNR, dB</th><th>SSIM</th><th>FLIP</th><th>error at \
         the outline</th></tr>\n{rows}</table></div>\n\
         <p class=note>Means over {} views and lights that the fit never saw, over the foreground (the union of both \
         silhouettes and a margin) of {} x {} pixels. Error at the outline: the share of the squared error in pixels that one asset \
         covers and the other does not, which no texture can mend. PSNR is told up to {BEST_PSNR} dB: what 8 bits can tell \
         apart.</p>\n",
        o.views.len(),
        side,
        side
    )
}

/// Where the time went, in one line.
fn times(o: &Outcome) -> String {
    let (fit, settled) = match o.steps {
        0 => ("no steps".to_owned(), String::new()),
        n => (
            format!("{}, {:.1} million pixels per second", counted(n as usize, "step"), o.mpix_per_s),
            format!("; within 0.5 dB of the end after {:.0} s", o.seconds_to_half_db),
        ),
    };
    format!(
        "<p class=note>effort {}: {fit}; {:.0} s until the file was written, {:.0} s with this report{settled}.</p>\n",
        o.effort.name(),
        o.fit_seconds,
        o.seconds
    )
}

fn wireframes(light: &Scene, info: &ReportInfo<'_>) -> Result<String, FitError> {
    let n = Normalised::new(info.scene)?;
    let mut light = light.flatten().mesh;
    light.positions.iter_mut().for_each(|p| *p = n.frame().to_frame(*p));
    let reference = n.flat.mesh;
    let mut figures = String::new();
    for (name, mesh) in [("reference", &reference), (SHIPPED, &light)] {
        let picture = wireframe::shaded(&mesh.positions, &mesh.triangles);
        let caption = format!("{name}: {} triangles", count(mesh.triangles.len()));
        figures += &page::figure(&pictures::display(&picture, usize::MAX)?, name, &caption);
    }
    Ok(format!("<h2>Wireframes</h2>\n<div class=pair>\n{figures}</div>\n"))
}

#[cfg(test)]
mod tests;
