//! Density and albedo of a cloud on a grid, from pictures around it.

use anyhow::Result;
use glam::Vec3;
use photofit_image::Image;
use photofit_optim::{Bilateral, Grid, GuideMap, Placement, Sigma};
use photofit_pathtrace::{
    EnvironmentMap, LightSource, MediumRef, MediumValue, Parameter, Parts, RenderOptions, View, Volume, World,
};
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::Camera;

use super::{Method, TARGET_SPP, Task, Unknown, best, picture, plot, race, sheet};
use crate::context::Context;

/// Voxels along the side of the grid, and pixels of the pictures.
pub(super) const VOXELS: usize = 64;
pub(super) const PIXELS: usize = 128;
/// Extinction of density 1, per length; the box has side 2.
const SCALE: f32 = 8.0;
/// Pictures, those of a step, and those that are held out.
const VIEWS: usize = 64;
const BATCH: usize = 4;
const HELD_OUT: usize = 3;
/// Steps at which a run is looked at.
const LOOKS: [u64; 3] = [10, 25, 50];
/// Density below which albedo is not seen.
const DENSE: f32 = 0.1;

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    let mut task = task()?;
    let mut adams = [0.008, 0.02, 0.05].map(|rate| Method::adam(rate, 0.2).paired()).to_vec();
    adams.extend([Method::adam(0.02, 0.2), Method::adam(0.02, 0.2).falling()]);
    let last = &LOOKS[LOOKS.len() - 1..];
    let adam = best(&adams, &race(ctx, &mut task, &adams, last)?).clone();
    let moments = |name, filter| Method::filtered(name, 0.02, filter, Placement::POST).paired();
    let tuned =
        Bilateral { levels: 3, map: GuideMap::Linear, sigma: Sigma::Fixed(0.1), ..Bilateral::default() };
    let cross = Method { sigmas: vec![0.001, 0.2], ..moments("bilateral", tuned) };
    let own = automatic();
    let methods = [
        adam,
        Method::low_pass(0.02),
        moments("low-pass of moments", Bilateral::low_pass(3)),
        cross,
        own.clone(),
        moments("bilateral of moments, automatic width", width()),
        Method::low_pass(0.02).falling().narrowing(),
    ];
    let courses = race(ctx, &mut task, &methods, &LOOKS)?;
    plot(ctx, &task, &methods, &courses)?;
    // Slices through the middle.
    let at = |x, y| x + VOXELS * (VOXELS - 1 - y + VOXELS * (VOXELS / 2));
    sheet(&task, &courses, 0, |v| Image::from_fn(VOXELS, VOXELS, 3, |x, y, _| v[at(x, y)]))?;
    sheet(&task, &courses, 1, |v| Image::from_fn(VOXELS, VOXELS, 3, |x, y, c| v[3 * at(x, y) + c]))?;
    let ends = task.ends()?;
    ctx.note(format!(
        "{ends} {}: {VOXELS} voxels a side, {VIEWS} pictures of {PIXELS} x {PIXELS} pixels, {BATCH} of them a step, 16 samples a pixel and 1 \
         for gradients; the loss is that of {HELD_OUT} pictures that no step sees; errors of albedo where the density is \
         above {DENSE}. Adam is the best of the runs above it by the last loss.",
        task.name
    ));
    Ok(())
}

/// The same from one picture a step, with few samples and with many, which take about as long as seven steps of few.
pub(crate) fn samples(ctx: &mut Context) -> Result<()> {
    let mut task = Task { batch: 1, ..task()? };
    let (mut all, mut courses) = (Vec::new(), Vec::new());
    for (samples, looks) in [([16, 1], &[10, 25, 50, 350][..]), ([128, 32], &LOOKS)] {
        [task.options.spp, task.gradient_spp] = samples;
        let [a, b] = samples;
        let named = |m: Method| Method { name: format!("{}, {a} + {b} samples", m.name), ..m };
        let methods = [Method::adam(0.02, 0.2), Method::low_pass(0.02), automatic()].map(named);
        courses.extend(race(ctx, &mut task, &methods, looks)?);
        all.extend(methods);
    }
    plot(ctx, &task, &all, &courses)?;
    let ends = task.ends()?;
    ctx.note(format!(
        "{ends} The cloud of the suite `recover` from one of its {VIEWS} pictures a step, by samples of the picture and of the gradient; rates are those of \
         that suite, found with 16 + 1 samples in four pictures a step, and halved every 50 steps."
    ));
    Ok(())
}

/// The filter whose width follows from the noise, as `recover volume` has it.
fn automatic() -> Method {
    Method::filtered("bilateral, automatic width", 0.02, width(), Placement::BOTH)
}

fn width() -> Bilateral {
    Bilateral { levels: 3, map: GuideMap::Log, sigma: Sigma::Auto(2.0), ..Bilateral::default() }
}

/// Density 0 to 1 and albedo of a cloud with bumps, x fastest.
pub(super) fn cloud() -> (Vec<f32>, Vec<f32>) {
    let at = |i: usize| (i as f32 + 0.5) / VOXELS as f32;
    let mut rng = photofit_sampling::Rng::new(5, 0);
    let mut waves = Vec::new();
    for octave in 0..4 {
        for _ in 0..5 {
            let w =
                Vec3::new(rng.normal(), rng.normal(), rng.normal()).normalize() * 9.0 * 1.8_f32.powi(octave);
            waves.push((w, rng.uniform(0.0, std::f32::consts::TAU), 0.6_f32.powi(octave) / 5.0));
        }
    }
    let (mut density, mut albedo) = (Vec::new(), Vec::new());
    for z in 0..VOXELS {
        for y in 0..VOXELS {
            for x in 0..VOXELS {
                let p = Vec3::new(at(x), at(y), at(z));
                let r = (p - 0.5).length();
                let bumps: f32 = waves.iter().map(|(w, phase, a)| a * (w.dot(p) + phase).sin()).sum();
                let inner = if r < 0.45 { 0.55 * bumps } else { 0.0 };
                density.push(((1.6 - 3.9 * r).clamp(0.0, 1.0) + inner).clamp(0.0, 1.0));
                albedo.extend([0.35 + 0.6 * p.x, 0.9 - 0.5 * p.y, 0.3 + 0.6 * p.z]);
            }
        }
    }
    (density, albedo)
}

/// A camera that looks at the cloud from a point of a Fibonacci sphere.
fn view(k: usize, of: usize, turn: f32) -> View {
    let y = 1.0 - 2.0 * (k as f32 + 0.5) / of as f32;
    let (a, r) = (2.4 * k as f32 + turn, (1.0 - y * y).sqrt());
    let eye = 3.6 * Vec3::new(r * a.cos(), y, r * a.sin());
    View::pinhole(&Camera::look_at(eye, Vec3::ZERO, Vec3::Y, 0.7, 1.0, 0.1, 20.0))
}

fn task() -> Result<Task> {
    let (density, albedo) = cloud();
    let transform = glam::DAffine3::from_translation(glam::DVec3::splat(-1.0))
        * glam::DAffine3::from_scale(glam::DVec3::splat(2.0));
    let albedos = albedo.as_chunks::<3>().0.iter().map(|a| Vec3f::from_array(*a)).collect();
    let (size, white) = ([VOXELS; 3], Vec3f::splat(1.0));
    let volume = Volume {
        size,
        density: density.clone(),
        scale: SCALE,
        albedo: white,
        albedos,
        g: 0.0,
        emission: None,
        transform,
    };
    // Light and dark behind the cloud tell density from albedo, which light from all around alone would not.
    let sky = Image::from_fn(8, 4, 3, |x, y, _| if (x + y) % 2 == 0 { 0.9 } else { 0.1 });
    let sun = LightSource::Directional { direction: vec3(0.3, 1.0, 0.4), irradiance: Vec3f::splat(6.0) };
    let world = World::new(Parts {
        environment: Some(EnvironmentMap::new(sky)),
        volumes: vec![volume],
        lights: vec![sun],
        ..Parts::default()
    })?;
    let of = |value| Parameter::Medium { medium: MediumRef::Volume(0), value };
    let grid = Grid::volume(VOXELS, VOXELS, VOXELS);
    let seen = density.iter().map(|d| *d > DENSE).collect();
    let density = Unknown {
        name: "density error",
        parameter: of(MediumValue::Extinction),
        grid,
        channels: 1,
        range: [0.0, 4.0],
        start: vec![0.002; density.len()],
        counts: vec![true; density.len()],
        truth: density,
        rate: 1.0,
    };
    let albedo = Unknown {
        name: "albedo error",
        parameter: of(MediumValue::Albedo),
        grid,
        channels: 3,
        range: [0.0, 0.99],
        start: vec![0.6; albedo.len()],
        truth: albedo,
        counts: seen,
        rate: 1.0,
    };
    let mut options = RenderOptions { width: PIXELS, height: PIXELS, spp: 16, ..RenderOptions::default() };
    options.path.max_depth = 16;
    let target = RenderOptions { spp: TARGET_SPP / 4, seed: 99, ..options.clone() };
    let shown = |view: View| Ok((view, picture(&world, &view, &target)?));
    // Neighbours on the sphere do not follow each other in the steps.
    let views = (0..VIEWS).map(|k| shown(view(k * 37 % VIEWS, VIEWS, 0.0))).collect::<Result<_>>()?;
    let held_out = (0..HELD_OUT).map(|k| shown(view(k, HELD_OUT, 0.5))).collect::<Result<_>>()?;
    Ok(Task {
        name: "cloud",
        world,
        options,
        gradient_spp: 1,
        unknowns: vec![density, albedo],
        views,
        batch: BATCH,
        held_out,
        half_life: Some(50),
    })
}
