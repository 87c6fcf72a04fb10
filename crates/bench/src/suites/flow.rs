//! Learned importance sampling: variance times time of guided renders against multiple importance sampling alone.

pub(crate) mod cost;
mod scenes;

use anyhow::Result;
use photofit_fit::guiding::{Guidance, Guiding, GuidingOptions};
use photofit_flow::{Encoding, FlowOptions, Grid};
use photofit_image::Image;
use photofit_pathtrace::{Parts, RenderOptions, Renderer, View, World};
use photofit_scene::mitsuba::{MitsubaOptions, load_mitsuba};
use std::path::Path;
use std::time::Instant;

use crate::context::Context;
use crate::plot::Axis;
use crate::timing::Timing;

/// Pixels along the side of the pictures and their samples.
const SIDE: usize = 96;
const SPP: u32 = 64;
/// Pixels along the side of the large ones.
const LARGE: usize = 512;
/// Renders with a guide, and as many without.
const PAIRS: usize = 3;

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    let indirect = scenes::indirect()?;
    let mut others = scenes::open()?;
    match std::env::var("PHOTOFIT_SCENES") {
        Ok(folder) => {
            for file in SCENES {
                others.push(of_file(&Path::new(&folder).join(file))?);
            }
        }
        Err(_) => ctx.note("PHOTOFIT_SCENES names no folder of scenes: those of files are left out."),
    }
    for case in indirect.iter().chain(&others) {
        renders(ctx, case)?;
    }
    for case in indirect.iter().chain(&others) {
        large(ctx, case)?;
    }
    against_time(ctx, &indirect)?;
    ctx.note(format!(
        "All threads, {SIDE} x {SIDE} pixels, {SPP} samples; time \
         is that of the samples over that without a guide, the gains are once without the time of training and once with it, \
         medians of {PAIRS} renders each after one without a guide. The \
         variance is that of single samples over the squared mean of the picture, green. \"Forced\" guides and those below \
         them stay on whether or not they pay, and are trained in five rounds. \"Large\" pictures of {LARGE} x {LARGE} pixels are rendered once. The last rows and the plots: noise of the picture against all time, training included."
    ));
    Ok(())
}

/// A scene, its name and its camera.
type Case = (String, World, View);

/// Scenes of the folder `PHOTOFIT_SCENES`: light of a lamp in a box, and of an environment on rough metal.
const SCENES: [&str; 2] =
    ["mitsuba/scenes/cbox/cbox-rgb.xml", "mitsuba/tests/scenes/bsdf_spheres/test_envmap_path.xml"];

fn of_file(file: &Path) -> Result<Case> {
    let scene =
        load_mitsuba(file, &MitsubaOptions { allow_parent_paths: true, ..MitsubaOptions::default() })?;
    let name = file.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let view = View::from_mitsuba(&scene.sensor);
    Ok((name, World::new(Parts::from_mitsuba(scene))?, view))
}

fn options(side: usize, spp: u32) -> RenderOptions {
    let mut options = RenderOptions { width: side, height: side, spp, ..RenderOptions::default() };
    options.path.max_depth = 8;
    options
}

/// A guide for a picture of so many samples, its sentence and the seconds of its training.
fn trained(
    (_, world, view): &Case,
    (side, spp): (usize, u32),
    guiding: Guiding,
    forced: bool,
    flow: FlowOptions,
) -> Result<(Guidance, Option<String>, f64)> {
    let options = options(side, spp);
    let renderer = Renderer::new(world, view, options.clone())?;
    let mut guided = GuidingOptions::for_picture(guiding, &options);
    if forced {
        guided = GuidingOptions { least_gain: 0.0, pilot: 3, ..GuidingOptions::new(guiding) };
    }
    guided.flow = flow;
    let began = Instant::now();
    let guidance = Guidance::train(&renderer, &guided, || false)?;
    let sentence = guidance.report().map(|r| r.sentence());
    Ok((guidance, sentence, began.elapsed().as_secs_f64()))
}

/// The seconds of a picture and the relative variance of its samples.
fn rendered((_, world, view): &Case, size: (usize, u32), guidance: &Guidance) -> Result<(f64, f64)> {
    let mut renderer = Renderer::new(world, view, options(size.0, size.1))?;
    let began = Instant::now();
    while !guidance.pass(&mut renderer, || false).done {}
    let seconds = began.elapsed().as_secs_f64();
    Ok((seconds, relative(&renderer.picture(), &renderer.sample_variance())))
}

/// A guided render, each time after one without a guide, so that both see the same machine.
fn renders(ctx: &mut Context, case: &Case) -> Result<()> {
    let plain = FlowOptions::default();
    let hashed = FlowOptions { encoding: Encoding::Hash(Grid::default()), ..plain };
    for (name, guiding, forced, flow) in [
        ("lobes", Guiding::Lobes, false, plain),
        ("flow", Guiding::Flow, false, plain),
        ("lobes, forced", Guiding::Lobes, true, plain),
        ("flow, forced", Guiding::Flow, true, plain),
        ("flow, hash grid", Guiding::Flow, true, hashed),
        ("flow without position", Guiding::Flow, true, FlowOptions { spatial: false, ..plain }),
        ("flow without direction", Guiding::Flow, true, FlowOptions { directional: false, ..plain }),
    ] {
        let (mut seconds, mut ratios, mut whole) = (Vec::new(), Vec::new(), Vec::new());
        let (mut variances, mut told, mut learning) = ([0.0; 2], None, Vec::new());
        for _ in 0..PAIRS {
            let (off, without) = rendered(case, (SIDE, SPP), &Guidance::off())?;
            let (guidance, sentence, training) = trained(case, (SIDE, SPP), guiding, forced, flow)?;
            let (on, with) = rendered(case, (SIDE, SPP), &guidance)?;
            ratios.push(on / off);
            whole.push((on + training) / off);
            (variances, told) = ([without, with], sentence);
            seconds.push(on);
            learning.push(training);
        }
        if let Some(sentence) = told {
            ctx.note(format!("{}, {name}: {sentence}.", case.0));
        }
        let [ratio, whole, training] = [ratios, whole, learning].map(|v| Timing::of(v).median);
        ctx.record(
            name,
            &case.0,
            SPP as usize,
            Timing::of(seconds),
            compared(variances, [ratio, whole], training),
        );
    }
    Ok(())
}

/// A picture of usual size, where training is a small part of the work.
fn large(ctx: &mut Context, case: &Case) -> Result<()> {
    let size = (LARGE, SPP);
    for (name, guiding) in [("lobes, large", Guiding::Lobes), ("flow, large", Guiding::Flow)] {
        let (off, without) = rendered(case, size, &Guidance::off())?;
        let (guidance, sentence, training) = trained(case, size, guiding, false, FlowOptions::default())?;
        let (on, with) = rendered(case, size, &guidance)?;
        ctx.note(format!("{}, {name}: {}.", case.0, sentence.unwrap_or_default()));
        let ratios = [on / off, (on + training) / off];
        let figures = compared([without, with], ratios, training);
        ctx.record(name, &case.0, SPP as usize, Timing::of(vec![on]), figures);
    }
    Ok(())
}

/// Figures of a picture with a guide beside one without: variances without and with, times over that without, once without
/// training and once with it, and the seconds of training.
fn compared([without, with]: [f64; 2], [time, whole]: [f64; 2], training: f64) -> Vec<(&'static str, f64)> {
    let gain = without / with;
    vec![
        ("variance, off", without),
        ("variance", with),
        ("time / off", time),
        ("variance x time, gain", gain / time),
        ("with training, gain", gain / whole),
        ("training s", training),
    ]
}

/// Noise of the picture against all time, training included.
fn against_time(ctx: &mut Context, cases: &[Case]) -> Result<()> {
    for case in cases {
        let mut curves = Vec::new();
        for (name, guiding) in [("off", Guiding::Off), ("lobes", Guiding::Lobes), ("flow", Guiding::Flow)] {
            let mut curve = Vec::new();
            let most = if guiding == Guiding::Flow { 256 } else { 1024 };
            for spp in [16, 64, 256, 1024].into_iter().filter(|s| *s <= most) {
                let (guidance, _, training) =
                    trained(case, (SIDE, spp), guiding, false, FlowOptions::default())?;
                let (seconds, variance) = rendered(case, (SIDE, spp), &guidance)?;
                let (noise, all) = ((variance / f64::from(spp)).sqrt(), seconds + training);
                curve.push((all, noise));
                let name = format!("{}, {name}", case.0);
                let figures = vec![("noise", noise), ("all seconds", all)];
                ctx.record(
                    &name,
                    &format!("{spp} samples"),
                    spp as usize,
                    Timing::of(vec![seconds]),
                    figures,
                );
            }
            curves.push((name.to_owned(), curve));
        }
        let title = format!("{}: noise against time, training included", case.0);
        let ending = case.0.replace(' ', "-");
        ctx.plot(&ending, &title, [Axis("seconds"), Axis("noise")], &curves)?;
    }
    Ok(())
}

/// Mean variance over the squared mean of the picture, green.
fn relative(picture: &Image, variance: &Image) -> f64 {
    let n = picture.pixels() as f64;
    let mean = picture.data.chunks_exact(4).map(|p| f64::from(p[1])).sum::<f64>() / n;
    variance.data.chunks_exact(3).map(|p| f64::from(p[1])).sum::<f64>() / n / (mean * mean)
}
