//! The main job at each effort: error in views that it never saw against the time of the whole job.
//!
//! `PHOTOFIT_BENCH_EFFORT` names assets with budgets, separated by `:`, as `FILE=TRIANGLES`; without it an asset of our own
//! is made light in small pictures.

use anyhow::{Context as _, Result};
use photofit_fit::Silent;
use photofit_fit::engine::judge::{Judge, JudgeRenderer, Quality, Stage};
use photofit_fit::engine::reference::Rasterized;
use photofit_fit::simplify::{Effort, Normalised, SimplifyOptions, simplify};
use photofit_fit::views::Lighting;
use photofit_geometry::decimate::Target;
use photofit_geometry::shapes;
use photofit_scalar::{Vec3f, vec4};
use photofit_scene::{Instance, Material, Primitive, Scene};
use std::path::Path;

use crate::context::Context;
use crate::timing::Timing;

/// Views of the judgement, the same for all efforts, and their samples per axis of a pixel.
const VIEWS: u64 = 8;
const SAMPLES: usize = 4;
/// Seed of their cameras and lights; the fits have another.
const SEED: u64 = 1;

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    let assets = std::env::var("PHOTOFIT_BENCH_EFFORT").unwrap_or_default();
    for asset in assets.split(':').filter(|a| !a.is_empty()) {
        let (file, triangles) =
            asset.rsplit_once('=').with_context(|| format!("{asset}: it must be FILE=TRIANGLES"))?;
        let triangles =
            triangles.parse().with_context(|| format!("{asset}: TRIANGLES must be a whole number"))?;
        let name = Path::new(file).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let options = SimplifyOptions { target: Target::Triangles(triangles), ..SimplifyOptions::default() };
        job(ctx, &name, &photofit_scene::load(file)?, &options)?;
    }
    if assets.is_empty() {
        let options = SimplifyOptions {
            target: Target::Triangles(600),
            resolution: 128,
            texture_size: 128,
            ..SimplifyOptions::default()
        };
        job(ctx, "rock", &rock(), &options)?;
    }
    ctx.note(format!(
        "One run each, reading left out: time of the whole job, report included. FLIP and PSNR (dB) of the written file: means \
         over {VIEWS} views with cameras and lights of another seed, rasterized with {SAMPLES} x {SAMPLES} samples a pixel. \
         Fit: seconds until the file was written."
    ));
    Ok(())
}

/// One asset at each effort.
fn job(ctx: &mut Context, name: &str, scene: &Scene, options: &SimplifyOptions) -> Result<()> {
    let n = Normalised::new(scene)?;
    let judge = Judge {
        scene,
        n: &n,
        reference: &Rasterized::new(&n.flat, &n.library),
        renderer: JudgeRenderer::Raster,
        spp: 1,
        lighting: &Lighting::Mixed,
        size: options.resolution,
        samples: [SAMPLES; 2],
        seed: SEED,
    };
    let folder = Path::new("out/bench/effort-files");
    std::fs::create_dir_all(folder).with_context(|| format!("{}: cannot create", folder.display()))?;
    for effort in Effort::ALL {
        let output = folder.join(format!("{name}-{}.glb", effort.name()));
        let options = SimplifyOptions { judge: JudgeRenderer::Raster, ..options.clone() }.with_effort(effort);
        let outcome = simplify(scene, &output, &options, &Silent)?;
        let written = [Stage::new("written", photofit_scene::load(&output)?)];
        let views = judge.views(&written, VIEWS, &Silent)?;
        let quality = Quality::mean(views.iter().map(|v| &v.quality[0].quality));
        ctx.record(
            name,
            effort.name(),
            outcome.steps as usize,
            Timing::of(vec![outcome.seconds]),
            vec![
                ("FLIP", quality.flip),
                ("PSNR", quality.psnr),
                ("fit", outcome.fit_seconds),
                ("steps", outcome.steps as f64),
            ],
        );
    }
    Ok(())
}

/// A rock of 11,520 triangles in the colours of its places.
fn rock() -> Scene {
    let mut mesh = shapes::displaced_sphere(24, 0.2, 4, 1);
    let color = |p: &Vec3f| {
        let wave = |x: f32| 0.5 + 0.4 * (9.0 * x).sin();
        vec4(wave(p.x), wave(p.y + 0.3), wave(p.z - 0.7), 1.0)
    };
    mesh.colors = mesh.positions.iter().map(color).collect();
    Scene {
        primitives: vec![Primitive { mesh, material: 0 }],
        instances: vec![Instance { primitive: 0, transform: Default::default() }],
        materials: vec![Material::clay()],
        ..Scene::default()
    }
}
