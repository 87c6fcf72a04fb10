//! Materials and light of a mesh found again from pictures: errors of base colour and roughness and the picture under another
//! sky, by what chooses the directions of paths, at equal samples and at equal time; and what each part of the fit brings.

mod scenes;

use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, Result};
use photofit_fit::Silent;
use photofit_fit::engine::traced::Smoothing;
use photofit_fit::guiding::{Guiding, GuidingOptions};
use photofit_fit::recover_material::{
    KnownMaterial, MaterialErrors, RecoverMaterialOptions, first_sky, guiding, recover_material,
};
use photofit_flow::FlowOptions;
use photofit_image::{Image, contact_sheet};

use crate::context::Context;
use crate::timing::Timing;

/// Pixels along the side of the pictures, and their samples.
const PIXELS: usize = 32;
const TARGET_SPP: u32 = 256;
/// Steps of a fit.
const STEPS: u64 = 80;
/// Samples of the pictures of a step and of its gradients.
const SAMPLES: [u32; 2] = [12, 6];
/// Seeds of the comparison of filters.
const FILTER_SEEDS: [u64; 2] = [11, 12];
/// Pictures of what was found, under another sky.
const FOLDER: &str = "out/bench/material";

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    std::fs::create_dir_all(FOLDER).with_context(|| format!("{FOLDER}: cannot create"))?;
    for (name, asset, views) in [scenes::open(), scenes::room()] {
        let known = KnownMaterial::new(&asset, &first_sky(), views, (PIXELS, TARGET_SPP), false, 1)?;
        let bench = Bench { name, asset: &asset, known };
        bench.start(ctx)?;
        let off = bench.run(ctx, "full multiple importance sampling", &options(Guiding::Off))?;
        for kind in [Guiding::Lobes, Guiding::Flow] {
            let equal_samples = options(kind);
            let took = bench.run(ctx, &format!("{}, equal samples", kind.name()), &equal_samples)?;
            let fewer = |n: u32| ((f64::from(n) * off / took).round() as u32).max(1);
            let [spp, gradient_spp] = SAMPLES.map(fewer);
            let equal_time = RecoverMaterialOptions { spp, gradient_spp, ..equal_samples };
            bench.run(ctx, &format!("{}, equal time", kind.name()), &equal_time)?;
        }
        bench.ablations(ctx)?;
    }
    ctx.note(format!(
        "Guides are forced: they stay on whether or not they pay. {STEPS} steps in two rounds, of which the second is guided, on 10 \
         pictures of {PIXELS} x {PIXELS} pixels; {} samples a pixel and {} for gradients, at equal time as many fewer as \
         the run at equal samples took longer. Time is that of the whole fit, training of guides included. Errors are means over the \
         pixels of all pictures; \"scaled\": after the best factor of each channel of the base colour.",
        SAMPLES[0], SAMPLES[1]
    ));
    Ok(())
}

/// Filters of the steps in the scenes of the suite `material`, with seeds that no setting was chosen on.
pub(crate) fn filters(ctx: &mut Context) -> Result<()> {
    std::fs::create_dir_all(FOLDER).with_context(|| format!("{FOLDER}: cannot create"))?;
    for (name, asset, views) in [scenes::open(), scenes::room()] {
        for seed in FILTER_SEEDS {
            let known =
                KnownMaterial::new(&asset, &first_sky(), views.clone(), (PIXELS, TARGET_SPP), false, seed)?;
            let bench = Bench { name, asset: &asset, known };
            for (method, smoothing) in [
                ("bilateral filter", Smoothing::Bilateral),
                ("low-pass filter", Smoothing::Laplacian),
                ("without filters", Smoothing::None),
            ] {
                let options = RecoverMaterialOptions { smoothing, seed, ..options(Guiding::Off) };
                bench.run(ctx, &format!("{method}, seed {seed}"), &options)?;
            }
        }
    }
    ctx.note(format!("{STEPS} steps in two rounds without guides; errors as in the suite `material`."));
    Ok(())
}

fn options(kind: Guiding) -> RecoverMaterialOptions {
    RecoverMaterialOptions {
        texture_size: 32,
        environment_size: 8,
        guiding: GuidingOptions { least_gain: 0.0, ..guiding(kind) },
        steps: STEPS,
        spp: SAMPLES[0],
        gradient_spp: SAMPLES[1],
        max_depth: 4,
        ..RecoverMaterialOptions::default()
    }
}

/// A scene with known materials.
struct Bench<'a> {
    name: &'static str,
    asset: &'a photofit_scene::Scene,
    known: KnownMaterial<'a>,
}

impl Bench<'_> {
    /// The errors of the start.
    fn start(&self, ctx: &mut Context) -> Result<()> {
        let none = RecoverMaterialOptions { steps: 0, rounds: 1, ..options(Guiding::Off) };
        self.run(ctx, "start", &none).map(drop)
    }

    /// Fits, records the errors and writes pictures under another sky; the seconds that it took.
    fn run(&self, ctx: &mut Context, method: &str, options: &RecoverMaterialOptions) -> Result<f64> {
        let began = Instant::now();
        let found = recover_material(self.asset, &self.known.views, &self.known.pictures, options, &Silent)?;
        let seconds = began.elapsed().as_secs_f64();
        let errors = self.known.errors(&found.asset)?;
        for guide in &found.guides {
            ctx.note(format!("{}, {method}: {}.", self.name, guide.sentence()));
        }
        let timing = Timing { median: seconds, spread: 0.0, runs: 1 };
        ctx.record(method, self.name, options.spp as usize, timing, figures(&errors, options));
        let pictures = self.known.under_another_sky(&found.asset, errors.albedo_scale)?;
        let opaque = |p: &Image| Image::from_fn(p.width, p.height, 3, |x, y, c| p.pixel(x, y)[c]);
        let images: Vec<Image> = pictures.iter().flatten().map(opaque).collect();
        let sheet = contact_sheet(&images.iter().collect::<Vec<_>>(), pictures[0].len().max(1), 4);
        let file = format!("{}-{method}.png", self.name).replace([' ', ','], "-");
        photofit_image::write_png(Path::new(FOLDER).join(file), &sheet)?;
        Ok(seconds)
    }

    /// The fit without one of its parts.
    fn ablations(&self, ctx: &mut Context) -> Result<()> {
        let plain = options(Guiding::Off);
        let sky = Some(first_sky());
        let flow = |change: FlowOptions| {
            let guiding = GuidingOptions { flow: change, ..options(Guiding::Flow).guiding };
            RecoverMaterialOptions { guiding, ..plain.clone() }
        };
        let cases = [
            ("direct light alone", RecoverMaterialOptions { max_depth: 1, ..plain.clone() }),
            ("even sky kept", RecoverMaterialOptions { keep_environment: true, ..plain.clone() }),
            (
                "true sky kept",
                RecoverMaterialOptions { keep_environment: true, environment: sky, ..plain.clone() },
            ),
            ("without filters", RecoverMaterialOptions { smoothing: Smoothing::None, ..plain.clone() }),
            ("bilateral filter", RecoverMaterialOptions { smoothing: Smoothing::Bilateral, ..plain.clone() }),
            ("one round", RecoverMaterialOptions { rounds: 1, ..plain.clone() }),
            ("flow without position", flow(FlowOptions { spatial: false, ..FlowOptions::default() })),
            ("flow without direction", flow(FlowOptions { directional: false, ..FlowOptions::default() })),
        ];
        // Fits in the room take longer: light between surfaces alone is left out there.
        let wanted = if self.name == "room" { 1 } else { cases.len() };
        for (name, options) in &cases[..wanted] {
            self.run(ctx, name, options)?;
        }
        Ok(())
    }
}

fn figures(e: &MaterialErrors, options: &RecoverMaterialOptions) -> Vec<(&'static str, f64)> {
    vec![
        ("albedo", e.albedo),
        ("scaled albedo", e.scaled_albedo),
        ("roughness", e.roughness),
        ("metalness", e.metallic),
        ("relit, dB", e.relit),
        ("scaled relit, dB", e.scaled_relit),
        ("samples", f64::from(options.spp)),
        ("of gradients", f64::from(options.gradient_spp)),
    ]
}
