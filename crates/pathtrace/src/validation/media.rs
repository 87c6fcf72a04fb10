//! Media: transmittance, energy, phase functions.

use super::scenes::{diffuse, looking, render, square, with_strategy};
use super::statistics::{agree, chi_square, mean_of};
use crate::volume::{phase, sample_phase};
use crate::{
    EnvironmentMap, Material, Parts, PathOptions, RenderOptions, Renderer, Shape, Strategy, TrainingSink,
    View, Volume, World,
};
use glam::{DAffine3, DVec3};
use photofit_sampling::{Rng, ScatteringSampler};
use photofit_scalar::{Vec3f, vec3};
use photofit_shading::bsdf::{Bsdf, Null};

fn white() -> Option<EnvironmentMap> {
    Some(EnvironmentMap::constant(Vec3f::splat(1.0)))
}

fn middle() -> View {
    looking([0.0, 0.0, 0.0], [0.3, 0.2, -1.0], 1.0)
}

fn cube(extinction: f32, albedo: f32, g: f32) -> Volume {
    Volume::homogeneous(DVec3::splat(-1.0), DVec3::ONE, extinction, Vec3f::splat(albedo), g)
}

#[test]
fn an_absorbing_sphere_lets_one_over_e_through() {
    let mut parts = Parts { environment: white(), ..Parts::default() };
    let mut material = Material::new(Bsdf::Null(Null));
    material.absorption = vec3(1.0, 0.5, 0.0);
    parts.add(Shape::Sphere { center: Vec3f::zero(), radius: 1.0 }, material);
    let world = World::new(parts).unwrap();
    let (picture, _) = render(&world, &middle(), square(8, 4));
    for p in picture.data.chunks(4) {
        for (found, expected) in p.iter().zip([(-1.0_f32).exp(), (-0.5_f32).exp(), 1.0]) {
            assert!((found - expected).abs() < 1e-5, "{p:?}");
        }
    }
}

#[test]
fn shadow_rays_see_the_same_absorption() {
    // A small lamp inside an absorbing ball, and the floor outside; and the reverse.
    let scene = |strategy| {
        let mut parts = Parts::default();
        let floor = super::scenes::quad(vec3(-4.0, -2.0, -4.0), vec3(0.0, 0.0, 8.0), vec3(8.0, 0.0, 0.0));
        super::scenes::place(&mut parts, floor, Material::new(diffuse(0.7, 0.7, 0.7)));
        let mut ball = Material::new(Bsdf::Null(Null));
        ball.absorption = vec3(0.4, 0.8, 1.6);
        parts.add(Shape::Sphere { center: Vec3f::zero(), radius: 1.0 }, ball);
        let lamp = Shape::Sphere { center: vec3(0.2, 0.1, 0.0), radius: 0.4 };
        parts.add(lamp, Material::new(diffuse(0.5, 0.5, 0.5)).emitting(Vec3f::splat(10.0)));
        let lamp = Shape::Sphere { center: vec3(-2.0, 2.0, 0.0), radius: 0.5 };
        parts.add(lamp, Material::new(diffuse(0.5, 0.5, 0.5)).emitting(Vec3f::splat(10.0)));
        let world = World::new(parts).unwrap();
        let spp = if strategy == Strategy::Bsdf { 2048 } else { 256 };
        let path = with_strategy(strategy, 2);
        let view = looking([0.0, 1.0, 5.0], [0.0, -0.5, 0.0], 0.9);
        let seed = spp.into();
        (render(&world, &view, RenderOptions { path, seed, ..square(12, spp) }), spp)
    };
    let (a, n) = scene(Strategy::Mis);
    for strategy in [Strategy::Light, Strategy::Bsdf] {
        let (b, m) = scene(strategy);
        agree(&format!("{strategy:?}"), (&a.0, &a.1, n), (&b.0, &b.1, m));
    }
}

/// Mean and variance of the samples of a picture of a small box of fog under a lamp, and scattering events a path.
fn fog_under_a_lamp(roulette_depth: u32) -> [f64; 3] {
    let mut parts = Parts::default();
    let (low, high) = (DVec3::new(-0.5, 0.0, -0.5), DVec3::new(0.5, 1.0, 0.5));
    parts.volumes.push(Volume::homogeneous(low, high, 6.0, vec3(0.95, 0.9, 0.8), 0.0));
    let lamp = super::scenes::quad(vec3(-0.3, 1.5, -0.3), vec3(0.6, 0.0, 0.0), vec3(0.0, 0.0, 0.6));
    let light = Material::new(diffuse(0.0, 0.0, 0.0)).emitting(Vec3f::splat(5.0));
    super::scenes::place(&mut parts, lamp, light);
    let world = World::new(parts).unwrap();
    let path = PathOptions { max_depth: 64, roulette_depth, ..PathOptions::default() };
    let options = RenderOptions { path, ..square(12, 256) };
    let view = looking([0.0, 0.5, 3.0], [0.0, 0.5, 0.0], 0.3);
    let (picture, variance) = render(&world, &view, options.clone());
    let mean = |i: &photofit_image::Image, stride: usize| {
        let sum: f64 = i.data.chunks_exact(stride).map(|p| f64::from(p[0] + p[1] + p[2])).sum();
        sum / (3 * i.pixels()) as f64
    };
    let renderer = Renderer::new(&world, &view, options).unwrap();
    let mut sink = TrainingSink::default();
    for path in 0..144 * 64 {
        let pixel = [path / 64 % 12, path / 64 / 12];
        sink.begin();
        renderer.walk(pixel, path as u32 % 64, &ScatteringSampler, &mut sink);
    }
    [mean(&picture, 4), mean(&variance, 3), sink.vertices.len() as f64 / (144.0 * 64.0)]
}

#[test]
fn roulette_adds_little_noise_to_fog() {
    let ([mean, noise, events], [sure_mean, sure_noise, sure_events]) =
        (fog_under_a_lamp(1), fog_under_a_lamp(u32::MAX));
    assert!((mean - sure_mean).abs() < 0.02 * mean, "{mean} {sure_mean}");
    // 1.25 times; 1.28 where roulette begins after the second event, 1.31 after the first.
    assert!(noise < 1.265 * sure_noise, "variance {noise}, {sure_noise} without roulette");
    assert!(events < 0.9 * sure_events, "{events} scattering events a path, {sure_events} without roulette");
}

#[test]
fn homogeneous_media_follow_beer_and_lambert() {
    let mut volume = cube(0.7, 0.0, 0.0);
    volume.transform =
        DAffine3::from_scale(DVec3::splat(2.0)) * DAffine3::from_translation(DVec3::splat(-0.5));
    let world =
        World::new(Parts { environment: white(), volumes: vec![volume], ..Parts::default() }).unwrap();
    let view = looking([0.0, 0.0, 5.0], [0.0, 0.0, 0.0], 0.01);
    let (picture, variance) = render(&world, &view, square(8, 1024));
    let (mean, error) = mean_of(&picture, &variance, 1024, 0);
    let expected = (-1.4_f64).exp();
    assert!((mean - expected).abs() < 4.0 * error + 1e-4, "{mean} +- {error}, expected {expected}");
}

#[test]
fn constant_grids_are_homogeneous() {
    let grid = |n: usize| Volume {
        size: [n, n + 1, n + 2],
        density: vec![1.0; n * (n + 1) * (n + 2)],
        ..cube(1.5, 0.8, 0.4)
    };
    let view = looking([0.5, 0.3, 3.0], [0.0, 0.0, 0.0], 0.9);
    let shot = |volume: Volume, seed| {
        let mut parts = Parts { volumes: vec![volume], ..Parts::default() };
        let mut sky = EnvironmentMap::constant(vec3(0.2, 0.5, 1.0));
        sky.image = photofit_image::Image::from_fn(8, 4, 3, |x, _, _| if x == 3 { 4.0 } else { 0.2 });
        parts.environment = Some(sky);
        let world = World::new(parts).unwrap();
        render(&world, &view, RenderOptions { seed, ..square(12, 256) })
    };
    let (a, b) = (shot(cube(1.5, 0.8, 0.4), 1), shot(grid(9), 2));
    agree("grid", (&a.0, &a.1, 256), (&b.0, &b.1, 256));
}

#[test]
fn transmittance_of_a_ramp_is_that_of_its_integral() {
    // Density from 0 to 2 along x, linear between the centres of two voxels.
    let volume = Volume { size: [2, 1, 1], density: vec![0.0, 2.0], ..cube(1.0, 0.0, 0.0) };
    let world =
        World::new(Parts { environment: white(), volumes: vec![volume], ..Parts::default() }).unwrap();
    let medium = &world.media.boxes[0];
    let (n, mut sum, mut passed) = (40_000, 0.0, 0);
    let (from, to) = (vec3(-3.0, 0.1, 0.2), vec3(1.0, 0.0, 0.0));
    for i in 0..n {
        let mut rng = Rng::new(5, i);
        sum += f64::from(medium.transmittance(from, to, 10.0, &mut rng));
        passed += u64::from(medium.collide(from, to, 10.0, &mut rng).is_none());
    }
    // 0 for half a unit, a ramp over one unit, 2 for half a unit.
    let expected = (-(1.0_f64 + 1.0)).exp();
    for (name, found) in [("ratio tracking", sum / n as f64), ("delta tracking", passed as f64 / n as f64)] {
        assert!((found - expected).abs() < 0.008, "{name}: {found}, expected {expected}");
    }
}

#[test]
fn media_that_only_scatter_vanish_in_a_white_environment() {
    for g in [0.0, 0.7, -0.5] {
        let density: Vec<f32> = (0..5 * 6 * 7).map(|i| (i * 7919 % 13) as f32 / 4.0).collect();
        let volume = Volume { size: [5, 6, 7], density, ..cube(1.0, 1.0, g) };
        let world =
            World::new(Parts { environment: white(), volumes: vec![volume], ..Parts::default() }).unwrap();
        let view = looking([0.5, 0.3, 3.0], [0.0, 0.0, 0.0], 0.9);
        let options = RenderOptions { path: with_strategy(Strategy::Mis, 1000), ..square(12, 64) };
        let (picture, variance) = render(&world, &view, options);
        let (mean, error) = mean_of(&picture, &variance, 64, 1);
        assert!((mean - 1.0).abs() < 4.0 * error + 1e-4, "g = {g}: {mean} +- {error}");
    }
}

/// A cloud of coloured albedo around a ball, on a floor beside a lamp and under a sky, and a coloured pane that is crossed.
fn cloudy() -> World {
    let mut cloud = cube(3.0, 1.0, 0.5);
    cloud.albedo = vec3(0.98, 0.85, 0.6);
    let density = (0..4 * 4 * 4).map(|i| (i * 7919 % 13) as f32 / 6.0).collect();
    let cloud = Volume { size: [4, 4, 4], density, ..cloud };
    // Compensated, light sampling alone would miss some of it.
    let sky = EnvironmentMap { compensate: false, ..EnvironmentMap::constant(vec3(0.2, 0.3, 0.5)) };
    let mut parts = Parts { environment: Some(sky), volumes: vec![cloud], ..Parts::default() };
    let floor = super::scenes::quad(vec3(-4.0, -1.2, -4.0), vec3(0.0, 0.0, 8.0), vec3(8.0, 0.0, 0.0));
    super::scenes::place(&mut parts, floor, Material::new(diffuse(0.8, 0.7, 0.6)));
    parts.add(Shape::Sphere { center: Vec3f::zero(), radius: 0.4 }, Material::new(diffuse(0.9, 0.9, 0.9)));
    let mut pane = Material::new(Bsdf::Null(Null));
    pane.absorption = vec3(0.8, 0.1, 0.4);
    parts.add(Shape::Sphere { center: vec3(0.9, -0.6, 0.9), radius: 0.5 }, pane);
    let lamp = Shape::Sphere { center: vec3(-1.8, 1.6, 0.5), radius: 0.5 };
    parts.add(lamp, Material::new(diffuse(0.5, 0.5, 0.5)).emitting(Vec3f::splat(6.0)));
    World::new(parts).unwrap()
}

#[test]
fn roulette_in_media_keeps_the_mean() {
    let world = cloudy();
    let view = looking([1.2, 0.8, 3.2], [0.0, -0.2, 0.0], 0.8);
    let shot = |strategy, roulette_depth, seed, spp| {
        let path = PathOptions { roulette_depth, ..with_strategy(strategy, 48) };
        render(&world, &view, RenderOptions { path, seed, ..square(12, spp) })
    };
    for strategy in [Strategy::Mis, Strategy::Light, Strategy::Bsdf] {
        let (never, n) = (shot(strategy, u32::MAX, 1, 2048), 2048);
        // From the first event on that the schedule allows, and later.
        for (depth, seed) in [(1, 2), (12, 3)] {
            let played = shot(strategy, depth, seed, n);
            let name = format!("{strategy:?} from event {depth} on");
            agree(&name, (&never.0, &never.1, n), (&played.0, &played.1, n));
        }
        // It does end paths: with the same random numbers, the same picture would come out else.
        let (with, without) = (shot(strategy, 1, 4, 16), shot(strategy, u32::MAX, 4, 16));
        assert_ne!(with.0.data, without.0.data, "{strategy:?}");
    }
}

#[test]
fn phase_functions_are_sampled_by_their_density() {
    for g in [0.0, 0.5, -0.8, 0.95] {
        let d = vec3(0.48, 0.6, 0.64);
        let (bins, n) = (50, 100_000);
        let mut counts = vec![0_u64; bins];
        let mut rng = Rng::new(1, 1);
        for _ in 0..n {
            let wi = sample_phase(g, d, [rng.next_f32(), rng.next_f32()]);
            assert!((wi.length() - 1.0).abs() < 1e-5);
            let x = f64::from(d.dot(wi)).clamp(-1.0, 1.0);
            counts[((0.5 + 0.5 * x) * bins as f64).min(bins as f64 - 1.0) as usize] += 1;
        }
        let fine = 2000;
        let probabilities: Vec<f64> = (0..bins)
            .map(|b| {
                let cosine =
                    |k| -1.0 + 2.0 * (b as f64 + (f64::from(k) + 0.5) / f64::from(fine)) / bins as f64;
                let sum: f64 = (0..fine).map(|k| f64::from(phase(g, cosine(k) as f32))).sum();
                sum / f64::from(fine) * 2.0 / bins as f64 * std::f64::consts::TAU
            })
            .collect();
        let total: f64 = probabilities.iter().sum();
        assert!((total - 1.0).abs() < 1e-3, "g = {g}: the density integrates to {total}");
        chi_square(
            &format!("g = {g}"),
            &counts,
            &probabilities.iter().map(|p| p / total).collect::<Vec<_>>(),
            4,
        );
    }
}

#[test]
fn bad_media_are_refused() {
    let fails = |volume: Volume| {
        World::new(Parts { volumes: vec![volume], ..Parts::default() }).unwrap_err().to_string()
    };
    for (volume, words) in [
        (
            Volume { density: vec![-1.0], ..cube(1.0, 0.5, 0.0) },
            "density of voxel (0, 0, 0) is -1; it must be finite and not negative",
        ),
        (Volume { density: vec![f32::NAN], ..cube(1.0, 0.5, 0.0) }, "density of voxel (0, 0, 0) is NaN"),
        (Volume { size: [2, 1, 1], ..cube(1.0, 0.5, 0.0) }, "there are 1 densities for 2 x 1 x 1 voxels"),
        (Volume { size: [usize::MAX, 2, 3], ..cube(1.0, 0.5, 0.0) }, "voxels"),
        (cube(1.0, 1.5, 0.0), "an albedo is [1.5, 1.5, 1.5]; it must lie in [0, 1]"),
        (cube(1.0, 0.5, 1.0), "anisotropy"),
        (cube(f32::NAN, 0.5, 0.0), "scale"),
        (Volume { transform: DAffine3::from_scale(DVec3::ZERO), ..cube(1.0, 0.5, 0.0) }, "transform"),
    ] {
        let text = fails(volume);
        assert!(text.contains("volume 0") && text.contains(words), "{text}");
    }
}
