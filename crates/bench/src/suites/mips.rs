//! Mip levels with texels of their own beside averages: error, mean light and flicker by size on screen.
//!
//! `PHOTOFIT_BENCH_MIPS` names assets with budgets and the size that they are made for, separated by `:`, as
//! `FILE=TRIANGLES,PIXELS`; without it a glossy ball with bumps is made light. `PHOTOFIT_BENCH_STEPS` is the number of steps.

use anyhow::{Context as _, Result};
use photofit_fit::Silent;
use photofit_fit::engine::judge::{Judge, JudgeRenderer, Quality, Stage, flicker};
use photofit_fit::engine::reference::{Rasterized, samples_for};
use photofit_fit::simplify::{Mips, Normalised, SimplifyOptions, simplify};
use photofit_fit::views::Lighting;
use photofit_geometry::decimate::Target;
use photofit_geometry::shapes;
use photofit_scalar::vec3;
use photofit_scene::{Instance, Material, Primitive, Scene, TextureEncoding, TextureImage, TextureSlot};
use std::path::Path;

use crate::context::Context;
use crate::timing::Timing;

/// Views of the judgement, and those in which the camera moves.
const VIEWS: [u64; 2] = [12, 6];
/// Seed of their cameras and lights; the fits have another.
const SEED: u64 = 1;

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    let assets = std::env::var("PHOTOFIT_BENCH_MIPS").unwrap_or_default();
    let steps = std::env::var("PHOTOFIT_BENCH_STEPS").ok().map(|s| s.parse()).transpose();
    let steps = steps.context("PHOTOFIT_BENCH_STEPS: it must be a whole number")?;
    let default = SimplifyOptions::default();
    let options = SimplifyOptions {
        steps: steps.unwrap_or(default.steps),
        texture_encoding: TextureEncoding::Ktx2 { quality: 90 },
        own_textures: false,
        judge: JudgeRenderer::Raster,
        report_views: 1,
        ..default
    };
    for asset in assets.split(':').filter(|a| !a.is_empty()) {
        let rule = || format!("{asset}: it must be FILE=TRIANGLES,PIXELS");
        let (file, numbers) = asset.rsplit_once('=').with_context(rule)?;
        let (triangles, pixels) = numbers.split_once(',').with_context(rule)?;
        let target = Target::Triangles(triangles.parse().with_context(rule)?);
        let pixels: usize = pixels.parse().with_context(rule)?;
        let name = Path::new(file).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let options = SimplifyOptions { target, ..options.clone() };
        job(ctx, &name, &photofit_scene::load(file)?, &options, pixels)?;
    }
    if assets.is_empty() {
        job(ctx, "ball", &ball(), &SimplifyOptions { target: Target::Triangles(1200), ..options }, 64)?;
    }
    ctx.note(format!(
        "One run each, written as KTX 2.0 and read again; time of the whole job. Original: the asset itself. One sample a pixel and \
         mip levels against 16 x 16, 8 x 8 or 4 x 4 samples of the asset; means over {} views with cameras and lights of another \
         seed. Light: sum of linear luminance over that of the reference. Flicker: mean change when the camera moves by half a \
         pixel over that of the reference, {} views.",
        VIEWS[0], VIEWS[1]
    ));
    Ok(())
}

/// An asset with both kinds of levels, judged at all sizes down to 16 pixels.
fn job(ctx: &mut Context, name: &str, scene: &Scene, options: &SimplifyOptions, pixels: usize) -> Result<()> {
    let folder = Path::new("out/bench/mips-files");
    std::fs::create_dir_all(folder).with_context(|| format!("{}: cannot create", folder.display()))?;
    let (mut stages, mut seconds) = (vec![Stage::new("original", scene.clone())], vec![0.0]);
    for mips in [Mips::Classic, Mips::Free] {
        let path = folder.join(format!("{name}-{}.glb", mips.name()));
        let options = SimplifyOptions { mips, ..options.clone().for_screen_size(pixels as f64) };
        seconds.push(simplify(scene, &path, &options, &Silent)?.seconds);
        stages.push(Stage::new(mips.name(), photofit_scene::load(&path)?));
    }
    let n = Normalised::new(scene)?;
    let reference = Rasterized::new(&n.flat, &n.library).sampled_by_size(1);
    let mut size = pixels;
    while size >= 16 {
        let judge = Judge {
            scene,
            n: &n,
            reference: &reference,
            renderer: JudgeRenderer::Raster,
            spp: 1,
            lighting: &Lighting::Mixed,
            size,
            samples: [samples_for(size), 1],
            seed: SEED,
        };
        let views = judge.views(&stages, VIEWS[0], &Silent)?;
        let moved = flicker(&n.light_asset, &reference, &stages, &Lighting::Mixed, (size, VIEWS[1], SEED))?;
        for (k, stage) in stages.iter().enumerate() {
            let q = Quality::mean(views.iter().map(|v| &v.quality[k].quality));
            ctx.record(
                &format!("{name}, {}", stage.name),
                &size.to_string(),
                size,
                Timing::of(vec![seconds[k]]),
                vec![("FLIP", q.flip), ("PSNR", q.psnr), ("light", q.luminance), ("flicker", moved[k])],
            );
        }
        size /= 2;
    }
    Ok(())
}

/// A glossy metal ball with bumps that no vertex shows.
fn ball() -> Scene {
    let (width, height) = (256, 128);
    let normal = |i: usize| {
        let (x, y) = ((i % width) as f32, (i / width) as f32);
        let wave = |t: f32| 0.5 * (0.9 * t).sin() + 0.3 * (0.37 * t + 1.0).sin();
        let n = vec3(wave(x), wave(y + 0.3 * x), 1.0).normalize_or_zero();
        let [x, y, z] = n.to_array().map(|x| (127.5 + 127.5 * x) as u8);
        [x, y, z, 255]
    };
    let glossy = Material {
        metallic: 1.0,
        roughness: 0.3,
        normal_texture: Some(TextureSlot::new(0)),
        ..Material::clay()
    };
    let texels = (0..width * height).map(normal).collect();
    Scene {
        primitives: vec![Primitive { mesh: shapes::uv_sphere(48, 24), material: 0 }],
        instances: vec![Instance { primitive: 0, transform: Default::default() }],
        materials: vec![glossy],
        images: vec![TextureImage { width, height, texels, ..TextureImage::default() }],
        ..Scene::default()
    }
}
