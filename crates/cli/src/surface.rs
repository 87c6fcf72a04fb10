//! `photofit surface`: depth, normals and colours without holes from a point cloud.

use crate::args::{Surface, SurfaceMethod};
use crate::output::{self, count, print};
use crate::preflight::Places;
use crate::progress::{Terminal, say};
use crate::{surface_camera, threads};
use anyhow::{Result, anyhow};
use photofit_denoise::surface::{self as recon, Cloud, Method, Pinhole, SurfaceOptions, reconstruct};
use photofit_fit::Progress;
use photofit_scene::load_points;
use serde_json::{Value, json};
use std::path::Path;
use std::time::Instant;

/// What is written.
const FILES: [&str; 7] =
    ["surface.exr", "depth.png", "normal.png", "shaded.png", "albedo.png", "sheet.png", "camera.json"];
/// Fewest points that span a surface.
const LEAST_POINTS: usize = 3;

pub(crate) fn run(a: &Surface) -> Result<()> {
    Places::default()
        .reads("POINTS", Some(&a.input))
        .reads("--camera", a.camera.as_deref())
        .fills("--output", Some(&a.output), &FILES)
        .writes("--json", a.json.as_deref())
        .check()?;
    threads::set(a.threads)?;
    let given = a.camera.as_deref().map(surface_camera::read).transpose()?;
    let terminal = Terminal::new();
    let began = Instant::now();
    let told = |stage| terminal.report(stage, 0, 1, "");
    told("load");
    let points = load_points(&a.input)?;
    for warning in &points.warnings {
        say(&format!("warning: {}: {warning}", a.input.display()));
    }
    if points.positions.len() < LEAST_POINTS {
        let (file, found) = (a.input.display(), points.positions.len());
        return Err(anyhow!(
            "{file}: the number of points with a position is {found}; it must be at least {LEAST_POINTS}"
        ));
    }
    let camera = match given {
        Some(file) => file.camera(points.origin, (a.width, a.height))?,
        None => surface_camera::chosen(a, &points),
    };
    camera.check().map_err(|e| anyhow!("{e}"))?;
    let (skipped, origin) = (points.skipped, points.origin);
    told("normals");
    let with_normals = !points.normals.is_empty();
    let loaded = began.elapsed().as_secs_f64();
    let cloud = Cloud::new(points.positions, points.normals, points.colors)?;
    let prepared = began.elapsed().as_secs_f64();
    let options = options(a);
    let step = |stage, done: usize, total: usize| {
        terminal.report(stage, done as u64, total as u64, "");
        true
    };
    let surface =
        reconstruct(&cloud, &camera, &options, step).map_err(|e| anyhow!("{}: {e}", a.input.display()))?;
    let reconstructed = began.elapsed().as_secs_f64();
    told("write");
    let world = surface_camera::to_json(&camera, origin);
    write(&a.output, &surface, &camera, &world)?;
    terminal.finish();
    let f = &surface.figures;
    let seconds = [loaded, prepared - loaded, reconstructed - prepared];
    let figures = json!({
        "points": cloud.positions().len(), "skipped": skipped, "in_view": f.in_view, "samples": f.samples,
        "hidden": f.hidden, "spacing": f.spacing, "max_level": f.max_level, "covered": f.covered,
        "normals": if with_normals { "given" } else { "estimated" }, "colors": surface.maps.albedo.is_some(),
        "method": a.method.name(), "camera": world,
        "seconds": { "load": seconds[0], "prepare": seconds[1], "reconstruct": seconds[2] },
    });
    if let Some(file) = &a.json {
        output::write_json(file, &figures)?;
    }
    print(&summary(a, &camera, &surface, cloud.positions().len(), skipped, seconds))
}

impl SurfaceMethod {
    fn name(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::Blend => "blend",
            Self::Hybrid => "hybrid",
        }
    }
}

fn options(a: &Surface) -> SurfaceOptions {
    let method = match a.method {
        SurfaceMethod::Fast => Method::Fast,
        SurfaceMethod::Blend => Method::Blend,
        SurfaceMethod::Hybrid => Method::Hybrid,
    };
    let defaults = SurfaceOptions::new(method);
    SurfaceOptions {
        iterations: a.iterations.map_or(defaults.iterations, usize::from),
        fill: a.fill,
        texture: a.texture.unwrap_or(defaults.texture),
        ..defaults
    }
}

fn write(folder: &Path, surface: &recon::Surface, camera: &Pinhole, world: &Value) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|e| anyhow!("{}: cannot be made: {e}", folder.display()))?;
    let maps = &surface.maps;
    photofit_image::write_exr(folder.join("surface.exr"), &maps.exr_layers())?;
    let range = recon::depth_range(maps);
    photofit_image::write_png(folder.join("depth.png"), &recon::depth_preview(maps, range))?;
    photofit_image::write_png(folder.join("normal.png"), &recon::normal_preview(maps, camera))?;
    photofit_image::write_png(folder.join("shaded.png"), &recon::shaded_preview(maps, camera))?;
    if maps.albedo.is_some() {
        photofit_image::write_png(folder.join("albedo.png"), &recon::albedo_preview(maps))?;
    }
    let sheet = recon::before_after_sheet(&surface.raw, maps, camera);
    photofit_image::write_png(folder.join("sheet.png"), &sheet)?;
    output::write_json(&folder.join("camera.json"), world)
}

fn summary(
    a: &Surface,
    camera: &Pinhole,
    surface: &recon::Surface,
    points: usize,
    skipped: usize,
    seconds: [f64; 3],
) -> String {
    let f = &surface.figures;
    let share = |n: usize| 100.0 * n as f64 / camera.pixels() as f64;
    let left_out = if skipped > 0 {
        format!(" ({} without a position left out)", count(skipped))
    } else {
        String::new()
    };
    format!(
        "{}: {} points{left_out}, {} in view\n  {} x {}: {} pixels with a point ({:.1}%), {} of them hidden, {:.1} pixels apart\n  \
        surface on {:.1}% of the picture\n  load {:.2} s, normals {:.2} s, reconstruct {:.2} s\n  written to {}\n",
        a.input.display(),
        count(points),
        count(f.in_view),
        camera.width,
        camera.height,
        count(f.samples),
        share(f.samples),
        count(f.hidden),
        f.spacing,
        share(f.covered),
        seconds[0],
        seconds[1],
        seconds[2],
        a.output.display(),
    )
}
