//! Path tracing: error against time at 1 to 256 samples per pixel, with the uniform integrator as baseline; and what
//! each skip of the plan saves.

use anyhow::Result;
use glam::{DAffine3, DQuat, DVec3};
use photofit_geometry::shapes;
use photofit_image::Image;
use photofit_pathtrace::{
    EnvironmentMap, Features, Instance, Integrator, LightSource, Material, Parts, PathOptions, RenderOptions,
    Renderer, Shape, View, World, WorldOptions,
};
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::Camera;
use photofit_shading::Surface;
use photofit_shading::bsdf::{Bsdf, Diffuse, Energy, MetallicRoughness};

use crate::context::Context;

/// Pixels along the side of the pictures.
const SIDE: usize = 64;
/// Samples of the reference.
const REFERENCE: u32 = 1 << 14;
/// Scattering events of a path.
const DEPTH: u32 = 6;

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    convergence(ctx)?;
    skips(ctx)?;
    copies(ctx)?;
    ctx.note(
        "All threads. The error is the RMSE of linear RGB against 16384 samples per pixel; the size is samples per \
         pixel (of the skips: triangles; of the copies: instances).",
    );
    Ok(())
}

fn convergence(ctx: &mut Context) -> Result<()> {
    let world = World::new(boxed())?;
    let reference = shot(&world, Integrator::Path, Features::default(), REFERENCE, 1)?;
    let methods = [("path", Integrator::Path), ("uniform", Integrator::Uniform)];
    let baseline = ctx.baseline();
    for (name, integrator) in methods.into_iter().filter(|m| baseline || m.1 == Integrator::Path) {
        let mut points = Vec::new();
        for spp in [1_u32, 4, 16, 64, 256] {
            let work = || shot(&world, integrator, Features::default(), spp, 0);
            let error = |picture: &Result<Image>| picture.as_ref().map_or(f64::NAN, |p| rmse(p, &reference));
            let case = format!("box, {spp} spp");
            let picture = ctx.measure(name, &case, spp as usize, work, |p| vec![("RMSE", error(p))]);
            points.push((f64::from(spp).ln(), error(&picture).ln()));
        }
        ctx.note(format!("Slope of log RMSE over log samples, {name}: {:.3}.", slope(&points)));
    }
    Ok(())
}

/// The same picture by the integrator that the plan picks and by those with more compiled in.
fn skips(ctx: &mut Context) -> Result<()> {
    for (case, parts) in [("emitters", boxed as fn() -> Parts), ("sky", sky), ("lamps", lamps)] {
        let world = World::new(parts())?;
        let apart = World::with_options(parts(), WorldOptions { merge: false, ..WorldOptions::default() })?;
        let triangles = world.pieces();
        for (name, world, further) in [
            ("as planned", &world, Features::default()),
            ("all compiled in", &world, Features::ALL),
            ("one structure per shape", &apart, Features::default()),
        ] {
            let work = || shot(world, Integrator::Path, further, 16, 0).is_ok();
            ctx.measure(&format!("16 spp, {name}"), case, triangles, work, |_| vec![]);
        }
        let needs = Features::of(&world);
        for (name, feature) in Features::each().filter(|f| !needs.contains(f.1)) {
            let work = || shot(&world, Integrator::Path, feature, 16, 0).is_ok();
            ctx.measure(&format!("16 spp, with {name}"), case, triangles, work, |_| vec![]);
        }
    }
    Ok(())
}

/// One asset of about 10,000 triangles placed many times: the world is built, then seen.
fn copies(ctx: &mut Context) -> Result<()> {
    for count in [1_usize, 100, 3000] {
        let mut parts =
            Parts { environment: Some(EnvironmentMap::constant(vec3(1.0, 1.0, 1.0))), ..Parts::default() };
        parts.shapes.push(Shape::Mesh(shapes::displaced_sphere(22, 0.1, 3, 1)));
        parts.materials.push(diffuse(0.6, 0.6, 0.6));
        let side = (count as f64).cbrt().ceil();
        for i in 0..count {
            let at = |k: f64| ((i as f64 / k).floor() % side + 0.5) / side - 0.5;
            let place = DVec3::new(at(1.0), at(side) + 0.5, at(side * side));
            let transform = DAffine3::from_scale_rotation_translation(
                DVec3::splat(0.4 / side),
                DQuat::from_rotation_y(i as f64),
                place,
            );
            parts.instances.push(Instance { shape: 0, material: 0, transform });
        }
        let case = format!("{count} instances");
        let megabytes = |w: &Result<World, _>| w.as_ref().map_or(f64::NAN, |w| w.bytes() as f64 / 1e6);
        // The copy of the parts is part of the time.
        let copy = || Parts {
            shapes: parts.shapes.clone(),
            instances: parts.instances.clone(),
            materials: parts.materials.clone(),
            environment: parts.environment.clone(),
            ..Parts::default()
        };
        let world =
            ctx.measure("build", &case, count, || World::new(copy()), |w| vec![("MB", megabytes(w))])?;
        let work = || shot(&world, Integrator::Path, Features::default(), 16, 0).is_ok();
        ctx.measure("16 spp, copies", &case, count, work, |_| vec![]);
    }
    Ok(())
}

fn shot(world: &World, integrator: Integrator, further: Features, spp: u32, seed: u64) -> Result<Image> {
    let (eye, target) = (glam::Vec3::new(0.0, 0.5, 2.2), glam::Vec3::new(0.0, 0.5, 0.0));
    let camera = Camera::look_at(eye, target, glam::Vec3::Y, 0.65, 1.0, 0.1, 10.0);
    let options = RenderOptions {
        width: SIDE,
        height: SIDE,
        spp,
        seed,
        integrator,
        further,
        path: PathOptions { max_depth: DEPTH, ..PathOptions::default() },
        ..RenderOptions::default()
    };
    let mut renderer = Renderer::new(world, &View::pinhole(&camera), options)?;
    renderer.finish();
    Ok(renderer.picture())
}

fn rmse(a: &Image, b: &Image) -> f64 {
    photofit_image::rmse(&a.select(&[0, 1, 2]), &b.select(&[0, 1, 2]))
}

/// Slope of the line of least squares.
pub(super) fn slope(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let (mx, my) = points.iter().fold((0.0, 0.0), |(x, y), p| (x + p.0 / n, y + p.1 / n));
    let (xy, xx) =
        points.iter().fold((0.0, 0.0), |(a, b), p| (a + (p.0 - mx) * (p.1 - my), b + (p.0 - mx).powi(2)));
    xy / xx
}

fn diffuse(r: f32, g: f32, b: f32) -> Material {
    Material::new(Bsdf::Diffuse(Diffuse { reflectance: vec3(r, g, b) }))
}

fn quad(corner: Vec3f, a: Vec3f, b: Vec3f) -> Shape {
    Shape::Mesh(shapes::parallelogram(corner, a, b))
}

/// A unit box without ceiling and front.
fn walls() -> Parts {
    let mut parts = Parts::default();
    let (x, y, z) = (vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0), vec3(0.0, 0.0, 1.0));
    let o = vec3(-0.5, 0.0, -0.5);
    parts.add(quad(o, z, x), diffuse(0.73, 0.73, 0.73));
    parts.add(quad(o, x, y), diffuse(0.73, 0.73, 0.73));
    parts.add(quad(o, y, z), diffuse(0.63, 0.06, 0.05));
    parts.add(quad(o + x, z, y), diffuse(0.14, 0.45, 0.09));
    balls(&mut parts);
    parts
}

/// A bumpy ball of metal and one of plaster.
fn balls(parts: &mut Parts) {
    let surface = Surface { base_color: vec3(0.9, 0.7, 0.4), roughness: 0.3, metallic: 1.0, gamma: 0.0 };
    let metal = Material::new(Bsdf::MetallicRoughness(MetallicRoughness::new(&surface, Energy::Compensated)));
    for (at, material) in [(-0.2, metal), (0.22, diffuse(0.7, 0.7, 0.7))] {
        parts.shapes.push(Shape::Mesh(shapes::displaced_sphere(24, 0.1, 3, 1)));
        parts.materials.push(material);
        let (shape, material) = (parts.shapes.len() - 1, parts.materials.len() - 1);
        let place = DAffine3::from_translation(DVec3::new(at, 0.25, 0.1 - at));
        let transform = place * DAffine3::from_scale(DVec3::splat(0.2));
        parts.instances.push(Instance { shape, material, transform });
    }
}

/// The box with a ceiling and a lamp in it.
fn boxed() -> Parts {
    let mut parts = walls();
    let (x, z) = (vec3(1.0, 0.0, 0.0), vec3(0.0, 0.0, 1.0));
    parts.add(quad(vec3(-0.5, 1.0, -0.5), x, z), diffuse(0.73, 0.73, 0.73));
    let lamp = quad(vec3(-0.15, 0.998, -0.15), x * 0.3, z * 0.3);
    parts.add(lamp, diffuse(0.0, 0.0, 0.0).emitting(vec3(17.0, 12.0, 4.0)));
    parts
}

/// The box under a sky with a sun.
fn sky() -> Parts {
    let image = Image::from_fn(128, 64, 3, |x, y, c| {
        let base = if y < 32 { 0.4 + 0.2 * c as f32 } else { 0.1 };
        base + if (x / 3, y / 3) == (20, 4) { 400.0 } else { 0.0 }
    });
    Parts { environment: Some(EnvironmentMap::new(image)), ..walls() }
}

/// The box with point lights.
fn lamps() -> Parts {
    let mut parts = walls();
    for (x, color) in [(-0.3, vec3(0.8, 0.5, 0.3)), (0.3, vec3(0.3, 0.5, 0.8))] {
        parts.lights.push(LightSource::Point { position: DVec3::new(x, 0.8, 0.2), intensity: color });
    }
    parts
}
