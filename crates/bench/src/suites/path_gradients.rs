//! Gradients by path replay: their error against time for each kind of parameter, each in a pass of its own.

use std::time::Instant;

use anyhow::{Context as _, Result, ensure};
use glam::{DAffine3, DVec3, Vec3};
use photofit_geometry::shapes;
use photofit_image::Image;
use photofit_pathtrace::{
    Adjoint, EnvironmentMap, Field, GradientSamples, LightSource, Material, MaterialValue, MediumRef,
    MediumValue, Parameter, ParameterGradient, Parts, RenderOptions, Shape, View, Volume, World,
};
use photofit_sampling::{hash, unit_f32};
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::{
    Camera, Instance, MapKind, Material as SceneMaterial, Primitive, Scene, TextureImage, TextureSlot,
};
use photofit_shading::bsdf::{Bsdf, Diffuse, Null};

use super::pathtrace::slope;
use super::recover::picture;
use crate::context::Context;
use crate::plot::Axis;
use crate::timing::Timing;

const SIDE: usize = 32;
/// Samples per pixel of the estimates, and of what they are compared with, which is made of eight independent parts.
const SAMPLES: [u32; 4] = [1, 4, 16, 64];
const TRUE_SAMPLES: u32 = 4096;
const PARTS: u64 = 8;
/// Estimates of each row.
const ESTIMATES: u64 = 8;
/// Texels along a side of a map.
const TEXELS: usize = 32;
/// Voxels along a side of the two clouds.
const VOXELS: [usize; 2] = [12, 64];

/// Parameters whose gradients one pass makes, and which channels of them are meant.
struct Kind {
    name: &'static str,
    parameters: Vec<Parameter>,
    channels: std::ops::Range<usize>,
}

impl Kind {
    fn new(name: &'static str, parameter: Parameter, channels: std::ops::Range<usize>) -> Self {
        Self { name, parameters: vec![parameter], channels }
    }
}

/// A scene with parameters.
struct Case {
    name: &'static str,
    world: World,
    view: View,
    kinds: Vec<Kind>,
}

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    let [small, large] = VOXELS;
    for case in [surfaces()?, body()?, cloud("cloud", small)?, cloud("large cloud", large)?] {
        case.run(ctx)?;
    }
    ctx.note(format!(
        "The gradient of a sum of pixels with random weights between -.4 and 1, pictures of {SIDE} x {SIDE} pixels, up to eight events a path. \
         Error: root mean square distance of {ESTIMATES} estimates from the mean of {TRUE_SAMPLES} samples a pixel of the same estimator, relative to \
         the length of that, both less what noise of the latter makes of them; floor: that noise. What they converge to is tested elsewhere. Exponent: \
         slope of the error over the samples, both logarithmic, -.5 for independent samples. Time: one estimate, and as a multiple of that of a picture of the same samples; with one sample, the values of the gradient of a large grid take most of it. Roughness and metalness are \
         channels of one map: one pass makes both."
    ));
    Ok(())
}

impl Case {
    fn run(&self, ctx: &mut Context) -> Result<()> {
        let mut curves = Vec::new();
        let weights = weights();
        for kind in &self.kinds {
            let parts = (0..PARTS)
                .map(|part| self.gradient(kind, &weights, TRUE_SAMPLES / PARTS as u32, hash(1, 0, part)))
                .collect::<Result<Vec<_>>>()?;
            let (truth, variance) = mean(&parts);
            // Less what noise adds to it.
            let length = truth.iter().map(|t| t * t).sum::<f64>() - variance;
            ensure!(length > variance, "{}: the gradient is lost in noise", kind.name);
            let mut curve: Vec<(f64, f64)> = Vec::new();
            for spp in SAMPLES {
                let (mut seconds, mut of_pictures, mut squares) = (Vec::new(), Vec::new(), 0.0);
                for estimate in 0..=ESTIMATES {
                    let began = Instant::now();
                    let found = self.gradient(kind, &weights, spp, hash(2, u64::from(spp), estimate))?;
                    // The first warms caches alone.
                    if estimate > 0 {
                        seconds.push(began.elapsed().as_secs_f64());
                        let off = found.iter().zip(&truth).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
                        squares += off / ESTIMATES as f64;
                        let began = Instant::now();
                        picture(&self.world, &self.view, &options(spp))?;
                        of_pictures.push(began.elapsed().as_secs_f64());
                    }
                }
                let (timing, error) = (Timing::of(seconds), ((squares - variance).max(0.0) / length).sqrt());
                curve.push((timing.median, error));
                let mut figures = vec![("error", error)];
                if curve.len() == SAMPLES.len() {
                    let logarithms =
                        SAMPLES.iter().zip(&curve).map(|(n, (_, error))| (f64::from(*n).ln(), error.ln()));
                    figures.push(("exponent", slope(&logarithms.collect::<Vec<_>>())));
                }
                figures.push(("floor", (variance / length).sqrt()));
                figures.push(("times a picture", timing.median / Timing::of(of_pictures).median));
                let case = format!("{}, {spp} samples", self.name);
                ctx.record(kind.name, &case, spp as usize, timing, figures);
            }
            curves.push((kind.name.to_owned(), curve));
        }
        let title = format!("{}: error of gradients against time", self.name);
        let axes = [Axis("seconds of an estimate"), Axis("relative error")];
        ctx.plot(&self.name.replace(' ', "-"), &title, axes, &curves)
    }

    /// One estimate of the gradient of a kind.
    fn gradient(&self, kind: &Kind, weights: &Image, spp: u32, seed: u64) -> Result<Vec<f64>> {
        let adjoint = Adjoint::new(&self.world, &self.view, options(spp), &kind.parameters)?;
        let found = adjoint.render_vjp(weights, GradientSamples { spp, seed: Some(seed) })?;
        ensure!(found.not_finite == 0, "{}: {} contributions are not finite", kind.name, found.not_finite);
        let channels = |of: &ParameterGradient| -> Vec<f64> {
            let meant = kind.channels.start..kind.channels.end.min(of.channels);
            of.values.chunks_exact(of.channels).flat_map(|v| &v[meant.clone()]).copied().collect()
        };
        Ok(found.parameters.iter().flat_map(channels).collect())
    }
}

fn options(spp: u32) -> RenderOptions {
    let mut options = RenderOptions { width: SIDE, height: SIDE, spp, ..RenderOptions::default() };
    options.path.max_depth = 8;
    options
}

/// Random weights of both signs, which favour one.
fn weights() -> Image {
    Image::from_fn(SIDE, SIDE, 3, |x, y, c| 1.4 * random((y * SIDE + x) as u64, c as u64) - 0.4)
}

/// Mean of independent estimates, and its variance, summed over all values.
fn mean(estimates: &[Vec<f64>]) -> (Vec<f64>, f64) {
    let n = estimates.len() as f64;
    let at = |i: usize| estimates.iter().map(|e| e[i]).sum::<f64>() / n;
    let mean: Vec<f64> = (0..estimates[0].len()).map(at).collect();
    let squares =
        estimates.iter().flat_map(|e| e.iter().zip(&mean)).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    (mean, squares / (n * (n - 1.0)))
}

/// A number in [0, 1) for two keys.
fn random(a: u64, b: u64) -> f32 {
    unit_f32((hash(0x9a7d, a, b) >> 32) as u32)
}

fn looking(eye: [f32; 3]) -> View {
    View::pinhole(&Camera::look_at(eye.into(), Vec3::ZERO, Vec3::Y, 0.7, 1.0, 0.1, 20.0))
}

/// A sky with windows.
fn sky() -> EnvironmentMap {
    EnvironmentMap::new(Image::from_fn(16, 8, 3, |x, y, c| {
        0.3 + 0.1 * c as f32 + if y < 4 && x % 8 < 3 { 2.0 } else { 0.0 }
    }))
}

/// A map of random values in a range, each of 4 x 4 texels.
fn map(key: u64, low: f32, high: f32) -> TextureImage {
    let texel = |i: usize| {
        let patch = (i / TEXELS / 4 * TEXELS + i % TEXELS / 4) as u64;
        let value = |c: u64| ((low + (high - low) * random(patch, 4 * key + c)) * 255.0).round() as u8;
        [value(0), value(1), value(2), 255]
    };
    let texels = (0..TEXELS * TEXELS).map(texel).collect();
    TextureImage { width: TEXELS, height: TEXELS, texels, ..Default::default() }
}

/// A ball with four maps on a floor, a lamp, a point light, a sky.
fn surfaces() -> Result<Case> {
    let slot = |image| Some(TextureSlot::new(image));
    let mut normals = map(3, 0.4, 0.6);
    normals.texels.iter_mut().for_each(|t| t[2] = 240);
    let mapped = SceneMaterial {
        emissive: [0.4, 0.3, 0.5],
        base_color_texture: slot(0),
        metallic_roughness_texture: slot(1),
        emissive_texture: slot(2),
        normal_texture: slot(3),
        ..SceneMaterial::default()
    };
    let lamp = SceneMaterial { emissive: [6.0, 5.0, 4.0], ..SceneMaterial::clay() };
    let (x, z) = (vec3(1.0, 0.0, 0.0), vec3(0.0, 0.0, 1.0));
    let floor = shapes::parallelogram(vec3(-4.0, -1.0, -4.0), z * 8.0, x * 8.0);
    let ceiling = shapes::parallelogram(vec3(-0.5, 2.5, -0.5), x, z);
    let meshes = [shapes::uv_sphere(48, 24), floor, ceiling];
    let scene = Scene {
        primitives: meshes
            .into_iter()
            .enumerate()
            .map(|(material, mesh)| Primitive { mesh, material })
            .collect(),
        instances: (0..3).map(|primitive| Instance { primitive, transform: Default::default() }).collect(),
        materials: vec![mapped, SceneMaterial::clay(), lamp],
        images: vec![map(0, 0.3, 0.9), map(1, 0.3, 0.9), map(2, 0.2, 0.8), normals],
        ..Scene::default()
    };
    let mut parts = Parts::from_scene(&scene);
    let position = DVec3::new(1.5, 2.0, 2.0);
    parts.lights.push(LightSource::Point { position, intensity: vec3(4.0, 5.0, 6.0) });
    parts.environment = Some(sky());
    let world = World::new(parts)?;
    let texels = |map| -> Result<Parameter> {
        let texture = world.library().and_then(|l| l.texture_of(0, map)).context("no such map")?;
        Ok(Parameter::Texels { texture })
    };
    let lamp = Parameter::Material { materials: vec![2], value: MaterialValue::Emissive };
    let maps = [MapKind::BaseColor, MapKind::MetallicRoughness, MapKind::Normal, MapKind::Emissive];
    let all = maps.into_iter().map(texels).collect::<Result<_>>()?;
    let kinds = vec![
        Kind { name: "all maps in one pass", parameters: all, channels: 0..3 },
        Kind::new("base colour texels", texels(MapKind::BaseColor)?, 0..3),
        Kind::new("roughness texels", texels(MapKind::MetallicRoughness)?, 1..2),
        Kind::new("metalness texels", texels(MapKind::MetallicRoughness)?, 2..3),
        Kind::new("normal texels", texels(MapKind::Normal)?, 0..2),
        Kind::new("emission texels", texels(MapKind::Emissive)?, 0..3),
        Kind::new("radiance of a lamp", lamp, 0..3),
        Kind::new("intensity of a point light", Parameter::Light { light: 0 }, 0..3),
        Kind::new("environment texels", Parameter::Environment, 0..3),
    ];
    Ok(Case { name: "surfaces", world, view: looking([0.0, 0.9, 3.6]), kinds })
}

/// A clear body that absorbs, around a ball.
fn body() -> Result<Case> {
    let mut parts = Parts::default();
    let clear = Material { absorption: vec3(0.3, 0.6, 0.9), solid: true, ..Material::new(Bsdf::Null(Null)) };
    parts.add(Shape::Sphere { center: Vec3f::zero(), radius: 1.0 }, clear);
    let ball = Bsdf::Diffuse(Diffuse { reflectance: vec3(0.8, 0.7, 0.6) });
    parts.add(Shape::Sphere { center: Vec3f::zero(), radius: 0.5 }, Material::new(ball));
    let direction = vec3(0.3, 0.5, 1.0);
    parts.lights.push(LightSource::Directional { direction, irradiance: Vec3f::splat(2.0) });
    parts.environment = Some(sky());
    let of = |material, value| Parameter::Material { materials: vec![material], value };
    let kinds = vec![
        Kind::new("absorption", of(0, MaterialValue::Absorption), 0..3),
        Kind::new("reflectance", of(1, MaterialValue::Reflectance), 0..3),
        Kind::new("irradiance of a sun", Parameter::Light { light: 0 }, 0..3),
    ];
    Ok(Case { name: "clear body", world: World::new(parts)?, view: looking([0.0, 0.5, 3.0]), kinds })
}

/// A cloud that scatters and glows, of so many voxels along a side.
fn cloud(name: &'static str, side: usize) -> Result<Case> {
    let (count, size) = (side.pow(3), [side; 3]);
    let color = |key: u64, i: usize, low: f32| {
        Vec3f::from_array([0, 1, 2].map(|c| low + (1.0 - low) * random(i as u64, key + c)))
    };
    let transform = DAffine3::from_translation(DVec3::splat(-1.0)) * DAffine3::from_scale(DVec3::splat(2.0));
    let volume = Volume {
        size,
        density: (0..count).map(|i| random(i as u64, 20)).collect(),
        scale: 3.0,
        albedo: Vec3f::splat(1.0),
        albedos: (0..count).map(|i| color(21, i, 0.3)).collect(),
        g: 0.3,
        emission: Some(Field {
            size,
            values: (0..count).map(|i| color(24, i, 0.0) * 0.5).collect(),
            transform,
        }),
        transform,
    };
    let direction = vec3(0.3, 1.0, 0.4);
    let world = World::new(Parts {
        environment: Some(sky()),
        volumes: vec![volume],
        lights: vec![LightSource::Directional { direction, irradiance: Vec3f::splat(4.0) }],
        ..Parts::default()
    })?;
    let of = |value| Parameter::Medium { medium: MediumRef::Volume(0), value };
    let kind = |name, value, channels| Kind::new(name, of(value), channels);
    let both = vec![of(MediumValue::Extinction), of(MediumValue::Albedo)];
    let kinds = vec![
        kind("extinction of voxels", MediumValue::Extinction, 0..1),
        kind("albedo of voxels", MediumValue::Albedo, 0..3),
        kind("emission of voxels", MediumValue::Emission, 0..3),
        Kind { name: "extinction and albedo in one pass", parameters: both, channels: 0..3 },
    ];
    Ok(Case { name, world, view: looking([0.8, 1.2, 3.4]), kinds })
}
