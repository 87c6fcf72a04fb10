//! Samplers of lights against their densities.

use super::scenes::{cornell, diffuse, place, quad};
use super::statistics::chi_square;
use crate::light::{Facing, LightRandom, Lights, Receiver};
use crate::{EnvironmentMap, LightSource, Material, Parts, Shape, World, WorldRay};
use glam::{DAffine3, DQuat, DVec3, Quat};
use photofit_image::Image;
use photofit_sampling::Rng;
use photofit_scalar::{Vec3f, vec3};
use std::f64::consts::PI;

/// Cells of the sphere: bands of equal height by sectors.
const BANDS: usize = 40;
const SECTORS: usize = 80;

fn cell(d: Vec3f) -> usize {
    let band = ((0.5 - 0.5 * f64::from(d.y)) * BANDS as f64).clamp(0.0, BANDS as f64 - 1.0) as usize;
    let turn = f64::from(d.z).atan2(f64::from(d.x)) / (2.0 * PI) + 0.5;
    band * SECTORS + ((turn * SECTORS as f64) as usize).min(SECTORS - 1)
}

/// Integral of a density over every cell by a midpoint rule, with many points where its support ends.
fn integrate(density: impl Fn(Vec3f) -> f64) -> Vec<f64> {
    let rule = |i: usize, n: usize| {
        let area = 4.0 * PI / (BANDS * SECTORS * n * n) as f64;
        let (mut sum, mut zeros) = (0.0, 0);
        for k in 0..n * n {
            let v = (i / SECTORS) as f64 + ((k / n) as f64 + 0.5) / n as f64;
            let u = (i % SECTORS) as f64 + ((k % n) as f64 + 0.5) / n as f64;
            let y = 1.0 - 2.0 * v / BANDS as f64;
            let (s, c) = (2.0 * PI * (u / SECTORS as f64 - 0.5)).sin_cos();
            let r = (1.0 - y * y).sqrt();
            let p = density(vec3((r * c) as f32, y as f32, (r * s) as f32));
            zeros += usize::from(p == 0.0);
            sum += area * p;
        }
        (sum, zeros)
    };
    let coarse: Vec<(f64, usize)> = (0..BANDS * SECTORS).map(|i| rule(i, 6)).collect();
    let refined = |i: usize| {
        let (band, sector) = ((i / SECTORS) as isize, (i % SECTORS) as isize);
        let near = |d: isize| {
            let b = (band + d / 3 - 1).clamp(0, BANDS as isize - 1) as usize;
            coarse[b * SECTORS + (sector + d % 3 - 1).rem_euclid(SECTORS as isize) as usize]
        };
        let (any, all) = ((0..9).any(|d| near(d).1 < 36), (0..9).all(|d| near(d).1 == 0));
        // At the poles all sectors are neighbours.
        let pole = band == 0 || band == BANDS as isize - 1;
        if (any && !all) || pole { rule(i, 64).0 } else { coarse[i].0 }
    };
    (0..BANDS * SECTORS).map(refined).collect()
}

/// Samples against density for the lights of a world as seen by `from`; returns the integral of the density.
fn check(name: &str, world: &World, from: &Receiver, pdf: impl Fn(Vec3f) -> f64, tests: usize) -> f64 {
    let mut rng = Rng::new(9, name.len() as u64);
    let mut counts = vec![0; BANDS * SECTORS];
    let n = 200_000_u64;
    for _ in 0..n {
        let mut draw = || rng.next_f32();
        let u = LightRandom { choice: [draw(), draw()], place: [draw(), draw()] };
        let Some(sample) = world.lights.sample(world, from, u) else { continue };
        assert!((sample.wi.length() - 1.0).abs() < 1e-4, "{name}: a unit vector");
        let density = pdf(sample.wi);
        let (a, b) = (f64::from(sample.pdf), density);
        // Directions near a border may fall to the other side in the second computation; at grazing angles, where the
        // density is high, the cosine has few digits.
        let digits = if a > 100.0 { 0.2 } else { 0.02 };
        let border = b == 0.0 || (a - b).abs() > 0.2 * a;
        assert!(border || (a - b).abs() < digits * a.max(b), "{name}: {a} sampled, {b} evaluated");
        counts[cell(sample.wi)] += 1;
    }
    let probabilities = integrate(&pdf);
    let total: f64 = probabilities.iter().sum();
    let normalised: Vec<f64> = probabilities.iter().map(|p| p / total).collect();
    // Slivers of cells at a border, which the midpoint rule misses, hold very few samples.
    let (mut kept, mut kept_p, mut strays) = (Vec::new(), Vec::new(), 0);
    for (c, p) in counts.iter().zip(&normalised) {
        if *p > 0.0 {
            kept.push(*c);
            kept_p.push(*p);
        } else {
            strays += *c;
        }
    }
    assert!(strays * 2000 < n, "{name}: {strays} samples where the density is 0");
    chi_square(name, &kept, &kept_p, tests);
    total
}

/// Chi-square over quarters of texels, over which the density is constant in the map's coordinates.
fn check_environment(name: &str, world: &World, rotation: Quat, image: &Image) {
    let (w, h) = (2 * image.width, 2 * image.height);
    let mut rng = Rng::new(9, name.len() as u64);
    let (mut counts, mut differ) = (vec![0; w * h], 0);
    for _ in 0..200_000 {
        let mut draw = || rng.next_f32();
        let u = LightRandom { choice: [draw(), draw()], place: [draw(), draw()] };
        let Some(sample) = world.lights.sample(world, &Receiver::point(Vec3f::zero()), u) else { continue };
        let density = world.lights.environment_from(sample.wi, true).1;
        differ += u32::from((sample.pdf - density).abs() > 1e-2 * sample.pdf);
        let d = rotation.inverse() * glam::Vec3::from_array(sample.wi.to_array());
        let x = (0.5 + f64::from(d.z).atan2(f64::from(d.x)) / (2.0 * PI)) * w as f64;
        let y = f64::from(d.y).clamp(-1.0, 1.0).acos() / PI * h as f64;
        counts[(y as usize).min(h - 1) * w + (x as usize).min(w - 1)] += 1;
    }
    // The texel of a direction at a border may be another one in the second computation.
    assert!(differ < 100, "{name}: {differ} densities differ between sampling and evaluation");
    let cell = |i: usize| {
        let (theta, phi) =
            (((i / w) as f64 + 0.5) / h as f64 * PI, (((i % w) as f64 + 0.5) / w as f64 - 0.5) * 2.0 * PI);
        let d = DVec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin());
        let d = rotation * d.as_vec3();
        let pdf = f64::from(world.lights.environment_from(vec3(d.x, d.y, d.z), true).1);
        pdf * theta.sin() * (PI / h as f64) * (2.0 * PI / w as f64)
    };
    let probabilities: Vec<f64> = (0..w * h).map(cell).collect();
    let total: f64 = probabilities.iter().sum();
    assert!((total - 1.0).abs() < 1e-3, "{name}: the density integrates to {total}");
    // Rounding carries a few samples over a border.
    let strays = counts.iter().zip(&probabilities).filter(|(_, p)| **p == 0.0).map(|(c, _)| *c).sum::<u64>();
    assert!(strays < 40, "{name}: {strays} samples where the density is 0");
    let kept = counts.iter().zip(&probabilities).filter(|(_, p)| **p > 0.0);
    let (counts, probabilities): (Vec<u64>, Vec<f64>) = kept.map(|(c, p)| (*c, *p / total)).unzip();
    chi_square(name, &counts, &probabilities, 12);
}

#[test]
fn environments_are_sampled_by_their_density() {
    let hot = Image::from_fn(64, 32, 3, |x, y, _| if (x, y) == (20, 9) { 5000.0 } else { 0.01 });
    let tiny = Image::from_fn(3, 2, 3, |x, y, c| (1 + x + 2 * y + c) as f32);
    let ramp = Image::from_fn(32, 16, 3, |x, y, _| (x as f32 / 32.0).powi(3) + 0.2 * (y as f32 / 16.0));
    for (name, image) in [("hot pixel", hot), ("3 x 2", tiny), ("ramp", ramp)] {
        for compensate in [true, false] {
            for rotation in [Quat::IDENTITY, Quat::from_euler(glam::EulerRot::XYZ, 0.4, 1.0, -0.3)] {
                let map = EnvironmentMap { compensate, rotation, ..EnvironmentMap::new(image.clone()) };
                let world = World::new(Parts { environment: Some(map), ..Parts::default() }).unwrap();
                check_environment(&format!("{name}, {compensate}, {rotation}"), &world, rotation, &image);
            }
        }
    }
    // Compensated, a constant map is left to BSDF sampling; else it is sampled evenly.
    for compensate in [true, false] {
        let map = EnvironmentMap { compensate, ..EnvironmentMap::constant(Vec3f::splat(1.0)) };
        let world = World::new(Parts { environment: Some(map), ..Parts::default() }).unwrap();
        let pdf = f64::from(world.lights.environment_from(vec3(0.6, 0.0, 0.8), true).1);
        let expected = if compensate { 0.0 } else { 1.0 / (2.0 * PI * PI) };
        assert!((pdf - expected).abs() < 1e-6, "{pdf}");
    }
}

#[test]
fn interpolation_joins_at_the_seam() {
    let image = Image::from_fn(16, 8, 3, |x, _, _| if x < 8 { 1.0 } else { 3.0 });
    let map = EnvironmentMap::new(image);
    let world = World::new(Parts { environment: Some(map), ..Parts::default() }).unwrap();
    // The seam is at -x, where the map is halfway between its first and its last column.
    let at = |z: f32| world.lights.environment_from(vec3(-1.0, 0.0, z).normalize_or_zero(), false).0.x;
    assert!(
        (at(0.0) - 2.0).abs() < 1e-3 && (at(1e-4) - at(-1e-4)).abs() < 1e-2,
        "{} {}",
        at(1e-4),
        at(-1e-4)
    );
    assert!((world.lights.environment_from(vec3(0.0, 1.0, 0.0), false).0.x - 2.0).abs() < 1.01);
}

/// Density of finding an emitting surface in a direction.
fn surface_density(world: &World, from: &Receiver, d: Vec3f) -> f64 {
    let ray = WorldRay { origin: from.p, direction: d, t_max: f32::INFINITY };
    // Of all surfaces on the ray, because nothing hides from the sampler.
    let mut sum = 0.0;
    let mut done = std::collections::BTreeSet::new();
    loop {
        let hit = world.closest_where::<true>(&ray, |h| !done.contains(&(h.instance, h.piece, h.front)));
        let Some(hit) = hit else { return sum };
        done.insert((hit.instance, hit.piece, hit.front));
        let at = world.interaction::<true>(&ray, &hit);
        sum += f64::from(world.lights.surface_pdf(world, from, &at));
    }
}

#[test]
fn surfaces_are_sampled_by_their_density() {
    let dark = || Material::new(diffuse(0.0, 0.0, 0.0));
    let ball = |scale: DVec3| {
        let mut parts = Parts::default();
        let sphere = Shape::Sphere { center: vec3(0.2, 0.1, 0.0), radius: 0.5 };
        parts.add(sphere, dark().emitting(Vec3f::splat(1.0)));
        let turn = DQuat::from_rotation_x(0.5);
        parts.instances[0].transform =
            DAffine3::from_scale_rotation_translation(scale, turn, DVec3::new(0.0, 1.5, 0.3));
        parts
    };
    let panels = || {
        let mut panels = Parts::default();
        place(&mut panels, quad(vec3(-1.0, 1.5, -1.0), vec3(2.0, 0.0, 0.0), vec3(0.0, 0.3, 2.0)), {
            let mut m = dark().emitting(Vec3f::splat(2.0));
            m.emits_both_sides = true;
            m
        });
        place(
            &mut panels,
            quad(vec3(2.0, -1.0, -1.0), vec3(0.0, 0.0, 2.0), vec3(0.0, 2.0, 0.0)),
            dark().emitting(Vec3f::splat(1.0)),
        );
        panels
    };
    let mut inside = ball(DVec3::splat(6.0));
    inside.materials[0].emits_both_sides = true;
    // Four triangles of which no two make up a parallelogram.
    let kites = || {
        let mut kites = Parts::default();
        for (corner, a, b) in [
            (vec3(-1.0, 1.0, -1.0), vec3(2.0, 0.2, 0.0), vec3(0.3, 0.0, 1.0)),
            (vec3(1.5, -1.0, -1.0), vec3(0.0, 0.0, 2.0), vec3(0.3, 1.0, 0.0)),
        ] {
            let mut kite = quad(corner, a, b);
            kite.positions[2] += a * 0.7;
            place(&mut kites, kite, dark().emitting(Vec3f::splat(1.0)));
        }
        kites
    };
    let around = Facing::Around;
    let (low, high) = (vec3(0.95, 0.3, 0.087).normalize_or_zero(), vec3(0.6, 0.8, 0.0));
    for (name, parts, facing) in [
        ("sphere", ball(DVec3::ONE), around),
        ("inside", inside, around),
        ("panels", panels(), around),
        ("panels, from a surface", panels(), Facing::Front(high)),
        ("panels, at the horizon", panels(), Facing::Front(low)),
        ("panels, from both sides", panels(), Facing::Both(low)),
        ("triangles, from around", kites(), around),
        ("triangles, from one side only", kites(), Facing::Front(high)),
    ] {
        let world = World::new(parts).unwrap();
        let from = Receiver { p: Vec3f::zero(), facing };
        let total = check(name, &world, &from, |d| surface_density(&world, &from, d), 8);
        assert!((0.98..1.02).contains(&total), "{name}: the density integrates to {total}");
    }
}

#[test]
fn nothing_is_sampled_behind_a_receiver() {
    let world = World::new(cornell()).unwrap();
    let u = LightRandom { choice: [0.3, 0.6], place: [0.2, 0.7] };
    for (y, lit) in [(1.0, true), (-1.0, false)] {
        let from = Receiver { p: vec3(0.1, 0.3, 0.0), facing: Facing::Front(vec3(0.0, y, 0.0)) };
        assert_eq!(world.lights.sample(&world, &from, u).is_some(), lit);
    }
    let from = Receiver::point(vec3(0.1, 0.999, 0.0));
    assert!(world.lights.sample(&world, &from, u).is_none(), "behind the lamp");
}

#[test]
fn triangles_that_make_up_a_parallelogram_are_one_light() {
    let lamp = |order: [[u32; 3]; 2], bend: f32| {
        let mut mesh = quad(Vec3f::zero(), vec3(1.0, 0.1, 0.0), vec3(0.3, 0.0, 2.0));
        mesh.triangles = order.to_vec();
        mesh.positions[2].y += bend;
        let mut parts = Parts::default();
        place(&mut parts, mesh, Material::new(diffuse(0.0, 0.0, 0.0)).emitting(Vec3f::splat(1.0)));
        World::new(parts).unwrap().lights.is_single()
    };
    let turned = |t: [u32; 3], k: usize| [t[k], t[(k + 1) % 3], t[(k + 2) % 3]];
    for k in 0..9 {
        assert!(lamp([turned([0, 1, 2], k % 3), turned([0, 2, 3], k / 3)], 0.0), "{k}");
        assert!(lamp([turned([2, 3, 0], k % 3), turned([0, 1, 2], k / 3)], 0.0), "{k}");
        assert!(!lamp([turned([0, 1, 2], k % 3), turned([0, 2, 3], k / 3)], 1e-3), "{k}");
        // The second triangle is turned over.
        assert!(!lamp([turned([0, 1, 2], k % 3), turned([0, 3, 2], k / 3)], 0.0), "{k}");
    }
}

#[test]
fn ellipsoids_are_sampled_without_bias() {
    // The density of a point uniform on the surface has no bound at the rim: integrals are compared, not cells.
    let mut parts = Parts::default();
    let sphere = Shape::Sphere { center: vec3(0.2, 0.1, 0.0), radius: 0.5 };
    parts.add(sphere, Material::new(diffuse(0.0, 0.0, 0.0)).emitting(Vec3f::splat(1.0)));
    let (scale, turn) = (DVec3::new(1.0, 0.5, 1.6), DQuat::from_rotation_x(0.5));
    parts.instances[0].transform =
        DAffine3::from_scale_rotation_translation(scale, turn, DVec3::new(0.0, 1.5, 0.3));
    let world = World::new(parts).unwrap();
    let p = Vec3f::zero();
    let functions: [fn(Vec3f) -> f64; 4] =
        [|_| 1.0, |d| f64::from(d.y), |d| f64::from(d.x + 1.0).powi(3), |d| f64::from(d.z * d.x)];
    let mut sums = [0.0; 4];
    let (mut rng, n) = (Rng::new(2, 7), 400_000);
    for _ in 0..n {
        let mut draw = || rng.next_f32();
        let u = LightRandom { choice: [draw(), draw()], place: [draw(), draw()] };
        let Some(sample) = world.lights.sample(&world, &Receiver::point(p), u) else { continue };
        for (sum, f) in sums.iter_mut().zip(functions) {
            *sum += f(sample.wi) / f64::from(sample.pdf) / f64::from(n);
        }
    }
    for (f, found) in functions.iter().zip(sums) {
        let seen = |d: Vec3f| {
            let hit = world.closest(&WorldRay { origin: p, direction: d, t_max: f32::INFINITY });
            hit.map_or(0.0, |_| 1.0)
        };
        let expected: f64 = integrate(|d| seen(d) * f(d)).iter().sum();
        assert!((found - expected).abs() < 5e-3 * sums[0], "{found}, expected {expected}");
    }
}

#[test]
fn lights_are_chosen_with_the_probability_that_is_stated() {
    // The mean of 1 / (p n) over n equally likely lights is 1 when p is what is drawn.
    let mut parts = cornell();
    parts
        .lights
        .push(LightSource::Point { position: DVec3::new(0.0, 0.5, 0.4), intensity: vec3(1.0, 1.0, 0.5) });
    parts
        .lights
        .push(LightSource::Directional { direction: vec3(0.0, 1.0, 1.0), irradiance: Vec3f::splat(2.0) });
    let image = Image::from_fn(8, 4, 3, |x, _, _| x as f32);
    parts.environment = Some(EnvironmentMap { compensate: false, ..EnvironmentMap::new(image) });
    let world = World::new(parts).unwrap();
    // Two sources: the sum of 1/p over draws of sources counts each with weight 1.
    let p = vec3(0.1, 0.2, 0.1);
    let (mut sum, mut rng) = (0.0, Rng::new(4, 4));
    let n = 10_000;
    for _ in 0..n {
        let u =
            LightRandom { choice: [rng.next_f32(), rng.next_f32()], place: [rng.next_f32(), rng.next_f32()] };
        if let Some(s) = world.lights.sample(&world, &Receiver::point(p), u).filter(|s| s.delta) {
            sum += 1.0 / f64::from(s.pdf) / 2.0;
        }
    }
    let mean = sum / f64::from(n);
    assert!((0.95..1.05).contains(&mean), "{mean}");
}

#[test]
fn sums_of_light_are_those_of_brute_force() {
    // Irradiance by light sampling against integration of the radiance over the sphere.
    let world = World::new(cornell()).unwrap();
    let p = vec3(0.1, 0.3, 0.0);
    let mut rng = Rng::new(1, 2);
    let n = 20_000;
    let estimate = |lights: &Lights, rng: &mut Rng| {
        let mut sum = 0.0;
        for _ in 0..n {
            let u = LightRandom {
                choice: [rng.next_f32(), rng.next_f32()],
                place: [rng.next_f32(), rng.next_f32()],
            };
            sum += lights
                .sample(&world, &Receiver::point(p), u)
                .map_or(0.0, |s| f64::from(s.radiance.x / s.pdf));
        }
        sum / f64::from(n)
    };
    let found = estimate(&world.lights, &mut rng);
    let radiance = |d: Vec3f| {
        let ray = WorldRay { origin: p, direction: d, t_max: f32::INFINITY };
        let lamp = |h: &crate::WorldHit| h.instance == 5 && h.front;
        if world.closest_where::<true>(&ray, lamp).is_some() { 17.0 } else { 0.0 }
    };
    let expected: f64 = integrate(radiance).iter().sum();
    assert!((found - expected).abs() < 0.02 * expected, "{found} {expected}");
}
