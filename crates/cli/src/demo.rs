//! `photofit demo`: the main job on a generated asset.

use crate::args::Demo;
use crate::demo_asset::demo_asset;
use crate::fields::DEMO;
use crate::output::{self, bytes, count, print};
use crate::preflight::Places;
use crate::render;
use crate::simplify::Job;
use crate::status::Ending;
use crate::threads;
use crate::{device, interrupt};
use anyhow::{Context, Result};
use photofit_fit::report::PAGE;
use photofit_fit::simplify::SimplifyOptions;
use photofit_geometry::decimate::Target;
use std::path::Path;

/// What is written beside the report.
const FILES: [&str; 5] = ["heavy.glb", "light.glb", "figures.json", "heavy.png", "light.png"];
/// Share of the triangles that is kept.
const RATIO: f64 = 0.01;
/// Width and height of the two pictures.
const PICTURE: usize = 768;

pub(crate) fn run(a: &Demo) -> Result<Ending> {
    Places::default()
        .fills("--out", Some(&a.out), &FILES)
        .fills("--out", Some(&a.out.join("report")), &[PAGE])
        .check()?;
    threads::set(a.threads)?;
    let device = device::choose(&a.device)?;
    std::fs::create_dir_all(&a.out).with_context(|| format!("{}: cannot be made", a.out.display()))?;
    let (heavy, light) = (a.out.join("heavy.glb"), a.out.join("light.glb"));
    let scene = demo_asset();
    photofit_scene::save_glb(&heavy, &scene)?;
    print(&format!("wrote {}: {} triangles\n", heavy.display(), count(scene.triangle_count())))?;
    let options = SimplifyOptions {
        target: Target::Ratio(RATIO),
        resolution: 768,
        steps: 150,
        time_limit: Some(a.time_limit),
        texture_size: 1024,
        report_views: 6,
        device,
        ..SimplifyOptions::default()
    };
    let report = a.out.join("report");
    // The file, not the scene in memory, so that everything a user's asset goes through is shown.
    let scene = photofit_scene::load(&heavy)?;
    let job = Job { command: DEMO, input: &heavy, output: &light, report: Some(&report), explain: true };
    let done = job.run(&scene, &options)?;
    output::write_json(&a.out.join("figures.json"), &done.json)?;
    // Who stopped the demo does not wait for pictures.
    let pictures = if interrupt::is_stopping() { "" } else { "pictures and " };
    for (asset, file) in [(&heavy, "heavy.png"), (&light, "light.png")] {
        if !pictures.is_empty() {
            picture(asset, &a.out.join(file))?;
        }
    }
    let size = |path: &Path| std::fs::metadata(path).map_or_else(|_| "?".into(), |m| bytes(m.len()));
    print(&format!(
        "\n{} triangles, {} -> {} triangles, {}\n{pictures}report in {}\n",
        count(done.outcome.triangles_in),
        size(&heavy),
        count(done.outcome.triangles_out),
        size(&light),
        a.out.display()
    ))?;
    done.unwritten.map_or(Ok(()), Err)?;
    Ok(done.ending)
}

fn picture(asset: &Path, file: &Path) -> Result<()> {
    let scene = photofit_scene::load(asset)?;
    match render::portrait(&scene, PICTURE) {
        Some(image) => render::write(file, &image),
        None => Ok(()),
    }
}
