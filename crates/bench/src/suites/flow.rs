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
use photofit_shading::Surface;
use photofit_shading::bsdf::{Bsdf, Diffuse, Energy, MetallicRoughness};
use std::time::Instant;

use crate::context::Context;
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
    for (case, world, view) in [
        ("room lit through a gap", rooms()?, inside()),
        ("glossy room through a gap", glossy_rooms()?, inside()),
        ("softboxes", outdoors(softboxes())?, above()),
        ("small sun", outdoors(sun())?, above()),
    ] {
        renders(ctx, case, &world, &view)?;
    }
    ctx.note(
        "Costs: one thread, features of the vertex included. Renders: all threads, 96 x 96 pixels, 64 samples, training \
         apart. The first figure is the variance of single samples over the squared mean luminance of the picture; \
         the time is that of the samples. \"Forced\" guides stay on whether or not they pay.",
    );
    Ok(())
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

fn renders(ctx: &mut Context, case: &str, world: &World, view: &View) -> Result<()> {
    let mut reference = f64::NAN;
    for (name, guiding, least_gain) in [
        ("off", Guiding::Off, 0.0),
        ("lobes, forced", Guiding::Lobes, 0.0),
        ("flow, forced", Guiding::Flow, 0.0),
        ("lobes", Guiding::Lobes, f64::NAN),
        ("flow", Guiding::Flow, f64::NAN),
    ] {
        let mut options = RenderOptions { width: SIDE, height: SIDE, spp: SPP, ..RenderOptions::default() };
        options.path.max_depth = 8;
        let renderer = Renderer::new(world, view, options.clone())?;
        let mut guided = GuidingOptions::for_picture(guiding, &options);
        if !least_gain.is_nan() {
            guided.least_gain = least_gain;
        }
        let began = Instant::now();
        let guidance = Guidance::train(&renderer, &guided, || false)?;
        let training = began.elapsed().as_secs_f64();
        let (timing, outcome) = timing::time(|| -> Result<f64> {
            let mut renderer = Renderer::new(world, view, options.clone())?;
            while !guidance.pass(&mut renderer, || false).done {}
            Ok(relative(&renderer.picture(), &renderer.sample_variance()))
        });
        let (variance, each) = (outcome?, timing.median / (SIDE * SIDE) as f64 / f64::from(SPP));
        let product = variance * each;
        if guiding == Guiding::Off {
            reference = product;
        }
        if let Some(report) = guidance.report() {
            ctx.note(format!("{case}, {name}: {}.", report.sentence()));
        }
        let figures = vec![
            ("variance", variance),
            ("us/sample", 1e6 * each),
            ("variance x time, gain", reference / product),
            ("training s", training),
        ];
        ctx.record(name, case, SPP as usize, timing, figures);
    }
    Ok(())
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
