//! Learned importance sampling: cost of a sample and of a density, and variance times time of guided renders against
//! multiple importance sampling alone.

use anyhow::Result;
use glam::Vec3;
use photofit_fit::guiding::{Guidance, Guiding, GuidingOptions};
use photofit_flow::{FlowGuide, FlowOptions, Guide, LobeGuide, LobeOptions, Query};
use photofit_geometry::shapes;
use photofit_image::Image;
use photofit_pathtrace::{EnvironmentMap, Material, Parts, RenderOptions, Renderer, Shape, View, World};
use photofit_sampling::Rng;
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::Camera;
use photofit_scene::mitsuba::{MitsubaOptions, load_mitsuba};
use photofit_shading::Surface;
use photofit_shading::bsdf::{Bsdf, Diffuse, Energy, MetallicRoughness};
use std::path::Path;
use std::time::Instant;

use crate::context::Context;
use crate::plot::Axis;
use crate::timing;

/// Vertices of a timed pass.
const VERTICES: usize = 1 << 14;
/// Pixels along the side of the pictures and their samples.
const SIDE: usize = 96;
const SPP: u32 = 64;

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    let flow = |options| FlowGuide::new(Vec3f::zero(), Vec3f::splat(1.0), options);
    let plain = FlowOptions::default();
    costs(ctx, "flow, 15 bins", flow(plain)?);
    costs(ctx, "flow, 31 bins", flow(FlowOptions { bins: 31, ..plain })?);
    let family = photofit_flow::spline::Family::Rational;
    costs(ctx, "flow, rational, 10 bins", flow(FlowOptions { family, bins: 10, ..plain })?);
    costs(ctx, "lobes", LobeGuide::new(LobeOptions::default()));
    let mut cases: Vec<Case> = vec![
        ("room lit through a gap".into(), rooms()?, inside()),
        ("glossy room through a gap".into(), glossy_rooms()?, inside()),
        ("softboxes".into(), outdoors(softboxes())?, above()),
        ("small sun".into(), outdoors(sun())?, above()),
    ];
    match std::env::var("PHOTOFIT_SCENES") {
        Ok(folder) => {
            for file in SCENES {
                cases.push(of_file(&Path::new(&folder).join(file))?);
            }
        }
        Err(_) => ctx.note("PHOTOFIT_SCENES names no folder of scenes: those of files are left out."),
    }
    for case in &cases {
        renders(ctx, case)?;
    }
    against_time(ctx, &cases[..2])?;
    ctx.note(format!(
        "Costs: one thread, features of the vertex included. Renders: all threads, {SIDE} x {SIDE} pixels, {SPP} samples; time \
         is that of the samples, the gains are over \"off\", once without the time of training and once with it. The \
         variance is that of single samples over the squared mean luminance of the picture. \"Forced\" guides stay on whether \
         or not they pay. The last rows and the plot: noise of the picture against all time, training included."
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

/// Nanoseconds of a sample and of a density.
fn costs<G: Guide>(ctx: &mut Context, name: &str, guide: G) {
    let mut rng = Rng::new(1, 0);
    let normal = vec3(0.0, 0.0, 1.0);
    let at: Vec<(Query, [f32; 2])> = (0..VERTICES)
        .map(|_| {
            let position = vec3(rng.next_f32(), rng.next_f32(), rng.next_f32());
            let wo = photofit_sampling::cosine_hemisphere([rng.next_f32(), rng.next_f32()]);
            (Query { position, normal, wo, roughness: 1.0 }, [rng.next_f32(), rng.next_f32()])
        })
        .collect();
    let sample =
        || at.iter().filter_map(|(q, u)| guide.sample(&guide.local(q), *u)).map(|s| s.1).sum::<f32>();
    let density = || at.iter().map(|(q, _)| guide.pdf(&guide.local(q), vec3(0.6, 0.0, 0.8))).sum::<f32>();
    let (timing, _) = timing::time(sample);
    let each = 1e9 * timing.median / VERTICES as f64;
    ctx.record(name, "sample", VERTICES, timing, vec![("ns", each)]);
    let (timing, _) = timing::time(density);
    let each = 1e9 * timing.median / VERTICES as f64;
    ctx.record(name, "density", VERTICES, timing, vec![("ns", each)]);
}

fn options(spp: u32) -> RenderOptions {
    let mut options = RenderOptions { width: SIDE, height: SIDE, spp, ..RenderOptions::default() };
    options.path.max_depth = 8;
    options
}

/// A guide for a picture of so many samples, its sentence and the seconds of its training.
fn trained(
    (_, world, view): &Case,
    spp: u32,
    guiding: Guiding,
    forced: bool,
) -> Result<(Guidance, Option<String>, f64)> {
    let options = options(spp);
    let renderer = Renderer::new(world, view, options.clone())?;
    let mut guided = GuidingOptions::for_picture(guiding, &options);
    if forced {
        guided.least_gain = 0.0;
    }
    let began = Instant::now();
    let guidance = Guidance::train(&renderer, &guided, || false)?;
    let sentence = guidance.report().map(|r| r.sentence());
    Ok((guidance, sentence, began.elapsed().as_secs_f64()))
}

/// The time of a picture and the relative variance of its samples.
fn rendered((_, world, view): &Case, spp: u32, guidance: &Guidance) -> Result<(timing::Timing, f64)> {
    let (timing, variance) = timing::time(|| -> Result<f64> {
        let mut renderer = Renderer::new(world, view, options(spp))?;
        while !guidance.pass(&mut renderer, || false).done {}
        Ok(relative(&renderer.picture(), &renderer.sample_variance()))
    });
    Ok((timing, variance?))
}

fn renders(ctx: &mut Context, case: &Case) -> Result<()> {
    let mut reference = f64::NAN;
    for (name, guiding, forced) in [
        ("off", Guiding::Off, true),
        ("lobes, forced", Guiding::Lobes, true),
        ("flow, forced", Guiding::Flow, true),
        ("lobes", Guiding::Lobes, false),
        ("flow", Guiding::Flow, false),
    ] {
        let (guidance, sentence, training) = trained(case, SPP, guiding, forced)?;
        let (timing, variance) = rendered(case, SPP, &guidance)?;
        if guiding == Guiding::Off {
            reference = variance * timing.median;
        }
        if let Some(sentence) = sentence {
            ctx.note(format!("{}, {name}: {sentence}.", case.0));
        }
        let figures = vec![
            ("variance", variance),
            ("us/sample", 1e6 * timing.median / (SIDE * SIDE) as f64 / f64::from(SPP)),
            ("variance x time, gain", reference / (variance * timing.median)),
            ("with training, gain", reference / (variance * (timing.median + training))),
            ("training s", training),
        ];
        ctx.record(name, &case.0, SPP as usize, timing, figures);
    }
    Ok(())
}

/// Noise of the picture against all time, training included.
fn against_time(ctx: &mut Context, cases: &[Case]) -> Result<()> {
    let mut curves = Vec::new();
    for case in cases {
        for (name, guiding) in [("off", Guiding::Off), ("lobes", Guiding::Lobes), ("flow", Guiding::Flow)] {
            let mut curve = Vec::new();
            let most = if guiding == Guiding::Flow { 256 } else { 1024 };
            for spp in [16, 64, 256, 1024].into_iter().filter(|s| *s <= most) {
                let (guidance, _, training) = trained(case, spp, guiding, false)?;
                let (timing, variance) = rendered(case, spp, &guidance)?;
                let (noise, all) = ((variance / f64::from(spp)).sqrt(), timing.median + training);
                curve.push((all, noise));
                let name = format!("{}, {name}", case.0);
                let figures = vec![("noise", noise), ("all seconds", all)];
                ctx.record(&name, &format!("{spp} samples"), spp as usize, timing, figures);
            }
            curves.push((format!("{}, {name}", case.0), curve));
        }
    }
    ctx.plot("total", "Noise against time, training included", [Axis("seconds"), Axis("noise")], &curves)
}

/// Mean variance over the squared mean of the picture, green.
fn relative(picture: &Image, variance: &Image) -> f64 {
    let n = picture.pixels() as f64;
    let mean = picture.data.chunks_exact(4).map(|p| f64::from(p[1])).sum::<f64>() / n;
    variance.data.chunks_exact(3).map(|p| f64::from(p[1])).sum::<f64>() / n / (mean * mean)
}

fn quad(corner: Vec3f, a: Vec3f, b: Vec3f) -> Shape {
    Shape::Mesh(shapes::parallelogram(corner, a, b))
}

fn grey(v: f32) -> Material {
    Material::new(Bsdf::Diffuse(Diffuse { reflectance: Vec3f::splat(v) }))
}

fn metal(roughness: f32) -> Material {
    let surface = Surface { base_color: Vec3f::splat(0.8), roughness, metallic: 1.0, gamma: 0.0 };
    Material::new(Bsdf::MetallicRoughness(MetallicRoughness::new(&surface, Energy::Compensated)))
}

/// A closed room under an even sky that is seen through one gap in its far wall.
fn two_rooms() -> Parts {
    let sky = Some(EnvironmentMap::constant(Vec3f::splat(10.0)));
    let mut parts = Parts { environment: sky, ..Parts::default() };
    let (x, y, z) = (vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0), vec3(0.0, 0.0, 1.0));
    let o = vec3(-1.0, 0.0, -0.5);
    for (corner, a, b) in [
        (o, z, x * 2.0),
        (o + y, x * 2.0, z),
        (o, x * 2.0, y),
        (o + z, y, x * 2.0),
        (o + x * 2.0, z, y),
        // The far wall around the gap.
        (o, y * 0.3, z),
        (o + y * 0.7, y * 0.3, z),
        (o + y * 0.3, y * 0.4, z * 0.3),
        (o + y * 0.3 + z * 0.7, y * 0.4, z * 0.3),
    ] {
        parts.add(quad(corner, a, b), grey(0.5));
    }
    parts
}

fn rooms() -> Result<World> {
    Ok(World::new(two_rooms())?)
}

fn glossy_rooms() -> Result<World> {
    let mut parts = two_rooms();
    parts.add(Shape::Sphere { center: vec3(0.6, 0.25, -0.1), radius: 0.25 }, metal(0.3));
    Ok(World::new(parts)?)
}

fn inside() -> View {
    let eye = Vec3::new(0.15, 0.5, 0.4);
    View::pinhole(&Camera::look_at(eye, Vec3::new(0.9, 0.4, -0.3), Vec3::Y, 1.2, 1.0, 0.01, 10.0))
}

fn outdoors(sky: EnvironmentMap) -> Result<World> {
    let mut parts = Parts { environment: Some(sky), ..Parts::default() };
    parts.add(quad(vec3(-2.0, 0.0, -2.0), vec3(0.0, 0.0, 4.0), vec3(4.0, 0.0, 0.0)), grey(0.5));
    parts.add(Shape::Sphere { center: vec3(-0.4, 0.4, 0.0), radius: 0.4 }, grey(0.7));
    parts.add(Shape::Sphere { center: vec3(0.5, 0.4, 0.0), radius: 0.4 }, metal(0.4));
    Ok(World::new(parts)?)
}

fn above() -> View {
    View::pinhole(&Camera::look_at(
        Vec3::new(0.0, 1.2, 2.5),
        Vec3::new(0.0, 0.2, 0.0),
        Vec3::Y,
        0.8,
        1.0,
        0.01,
        10.0,
    ))
}

fn softboxes() -> EnvironmentMap {
    let boxes = |x: usize, y: usize| (8..14).contains(&y) && (x % 24 < 5);
    EnvironmentMap::new(Image::from_fn(64, 32, 3, |x, y, _| if boxes(x, y) { 8.0 } else { 0.2 }))
}

fn sun() -> EnvironmentMap {
    EnvironmentMap::new(Image::from_fn(256, 128, 3, |x, y, _| if (x, y) == (60, 34) { 2e4 } else { 0.3 }))
}
