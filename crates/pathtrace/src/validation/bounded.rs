//! Media that surfaces bound: closed forms, energy, estimators.

use super::scenes::{diffuse, looking, place, quad, render, square, with_strategy};
use super::statistics::{agree, mean_of};
use crate::volume::{InteriorMedium, Media, Segment};
use crate::{
    Boundary, BoundedMedium, EnvironmentMap, Field, LightSource, Material, Parts, RenderOptions, Shape,
    Strategy, View, Volume, World,
};
use glam::{DAffine3, DVec3};
use photofit_sampling::Rng;
use photofit_scalar::{Vec3f, vec3};
use photofit_shading::bsdf::{Bsdf, Dielectric, Null, ThinDielectric, TransportMode};
use std::f64::consts::PI;

const NULL: Bsdf<f32> = Bsdf::Null(Null);

fn even(extinction: [f32; 3], albedo: f32, g: f32) -> BoundedMedium {
    BoundedMedium::homogeneous(Vec3f::from_array(extinction), Vec3f::splat(albedo), g)
}

/// The same on a grid over a box around the unit sphere.
fn gridded(extinction: f32, albedo: f32, g: f32) -> BoundedMedium {
    let transform = DAffine3::from_translation(DVec3::splat(-1.2)) * DAffine3::from_scale(DVec3::splat(2.4));
    let field = |size: [usize; 3], v: f32| {
        let count = size.iter().product();
        Field { size, values: vec![Vec3f::splat(v); count], transform }
    };
    BoundedMedium {
        extinction: field([9, 5, 6], extinction),
        scale: 1.0,
        albedo: field([2, 3, 4], albedo),
        g,
        emission: None,
    }
}

/// A ball with a medium inside and another outside.
fn ball(parts: &mut Parts, at: ([f32; 3], f32), bsdf: Bsdf<f32>, media: [Option<usize>; 2]) {
    let shape = Shape::Sphere { center: Vec3f::from_array(at.0), radius: at.1 };
    let instance = parts.add(shape, Material::new(bsdf));
    parts.boundaries.push(Boundary { instance, interior: media[0], exterior: media[1] });
}

/// The unit sphere full of a medium.
fn unit_ball(bsdf: Bsdf<f32>, medium: BoundedMedium) -> Parts {
    let mut parts = Parts { media: vec![medium], ..Parts::default() };
    ball(&mut parts, ([0.0; 3], 1.0), bsdf, [Some(0), None]);
    parts
}

fn white() -> Option<EnvironmentMap> {
    Some(EnvironmentMap::constant(Vec3f::splat(1.0)))
}

fn pane(ior: f32) -> Bsdf<f32> {
    let one = Vec3f::splat(1.0);
    Bsdf::ThinDielectric(ThinDielectric { ior, reflectance: one, transmittance: one })
}

/// A view of almost one ray, from +z to the origin.
fn narrow(z: f32) -> View {
    looking([0.0, 0.0, z], [0.0, 0.0, z - 1.0], 1e-3)
}

#[test]
fn flights_have_the_density_of_collisions() {
    let prepared =
        |medium| Media::default().with_bounded(vec![medium], &[], None, &[], (DVec3::ZERO, 1.0)).unwrap();
    let (n, length) = (60_000_u64, 1.3_f32);
    let along = Segment { origin: vec3(-0.6, 0.1, 0.2), direction: vec3(1.0, 0.0, 0.0), length };
    let media = [even([0.2, 1.0, 3.0], 0.5, 0.0), even([0.0, 0.7, 0.7], 0.5, 0.0), gridded(1.1, 0.5, 0.0)];
    for (which, medium) in media.into_iter().enumerate() {
        let sigma = medium.extinction.values[0];
        let all = prepared(medium);
        let medium: &InteriorMedium = &all.bounded[0];
        for throughput in [vec3(1.0, 1.0, 1.0), vec3(0.9, 0.1, 0.3)] {
            // Passed, and collided in the first half, per channel: sum and sum of squares.
            let mut sums = [[[0.0_f64; 2]; 3]; 2];
            for i in 0..n {
                let mut rng = Rng::new(7, i);
                let numbers = [rng.next_f32(), rng.next_f32()];
                let flight = medium.fly(&along, throughput, numbers, &mut rng);
                let bin = match flight.collision {
                    None => 0,
                    Some(t) if t < 0.5 * length => 1,
                    Some(_) => continue,
                };
                for (sum, w) in sums[bin].iter_mut().zip(flight.weight.to_array()) {
                    sum[0] += f64::from(w);
                    sum[1] += f64::from(w * w);
                }
            }
            for c in 0..3 {
                let (s, l, n) = (f64::from(sigma[c]), f64::from(length), n as f64);
                for (bin, expected) in [(0, (-s * l).exp()), (1, 1.0 - (-0.5 * s * l).exp())] {
                    let [sum, square] = sums[bin][c];
                    let mean = sum / n;
                    let error = ((square / n - mean * mean).max(0.0) / n).sqrt();
                    let bound = 4.0 * error + 1e-5;
                    let what = format!("medium {which}, channel {c}, {bin}");
                    assert!((mean - expected).abs() < bound, "{what}: {mean} +- {error}, {expected}");
                }
            }
        }
    }
}

#[test]
fn what_only_absorbs_is_exact() {
    // Through the middle of nested balls: 1/2 of a red absorber on each side of a blue one, around empty space.
    let nested = |outer: Bsdf<f32>| {
        let mut parts = unit_ball(outer, even([2.0, 0.5, 0.0], 0.0, 0.0));
        parts.media.push(even([0.0, 0.25, 3.0], 0.0, 0.0));
        ball(&mut parts, ([0.0; 3], 0.5), NULL, [Some(1), Some(0)]);
        ball(&mut parts, ([0.0; 3], 0.25), NULL, [None, Some(1)]);
        parts
    };
    let parts = Parts { environment: white(), ..nested(NULL) };
    let expected = [-2.0_f32, -0.5 - 0.125, -1.5].map(f32::exp);
    // The same for light that falls on a floor, through two panes.
    let floor = quad(vec3(-1.0, -1.0, -2.0), vec3(2.0, 0.0, 0.0), vec3(0.0, 2.0, 0.0));
    let irradiance = Vec3f::splat(std::f32::consts::PI);
    let sun = LightSource::Directional { direction: vec3(0.0, 0.0, 1.0), irradiance };
    let (seen, _) = render(&World::new(parts).unwrap(), &narrow(3.0), square(2, 2));
    for p in seen.data.chunks(4) {
        for c in 0..3 {
            assert!((p[c] - expected[c]).abs() < 2e-5, "{p:?}, expected {expected:?}");
        }
        assert_eq!(p[3], 0.0, "nothing is there");
    }
    for with_panes in [false, true] {
        let mut parts = nested(if with_panes { pane(1.5) } else { NULL });
        parts.lights.push(sun.clone());
        place(&mut parts, floor.clone(), Material::new(diffuse(0.5, 0.5, 0.5)));
        // From below the balls, so that the view itself does not pass them.
        let (picture, _) = render(&World::new(parts).unwrap(), &narrow(-1.5), square(2, 2));
        let r = 0.04_f32;
        let straight = if with_panes { (1.0 - 2.0 * r / (1.0 + r)).powi(2) } else { 1.0 };
        for p in picture.data.chunks(4) {
            for c in 0..3 {
                let wanted = 0.5 * straight * expected[c];
                assert!((p[c] - wanted).abs() < 2e-5, "panes {with_panes}: {p:?}, expected {wanted}");
            }
        }
    }
}

#[test]
fn cameras_may_be_inside() {
    // A lamp of radius 1 at a distance of 3, in a fog without end, and behind the wall of a bubble around the camera.
    let scene = |bubble: bool| {
        let mut parts = Parts { media: vec![even([0.3, 0.6, 0.9], 0.0, 0.0)], ..Parts::default() };
        let lamp = Shape::Sphere { center: vec3(0.0, 0.0, 0.0), radius: 1.0 };
        parts.add(lamp, Material::new(diffuse(0.0, 0.0, 0.0)).emitting(Vec3f::splat(2.0)));
        if bubble {
            ball(&mut parts, ([0.0, 0.0, 3.0], 0.5), NULL, [None, Some(0)]);
        } else {
            parts.medium_around_camera = Some(0);
        }
        World::new(parts).unwrap()
    };
    for (bubble, distance) in [(false, 2.0), (true, 1.5)] {
        let (picture, _) = render(&scene(bubble), &narrow(3.0), square(2, 1));
        for (c, sigma) in [0.3_f32, 0.6, 0.9].into_iter().enumerate() {
            let (found, wanted) = (picture.pixel(0, 0)[c], 2.0 * (-sigma * distance).exp());
            assert!((found - wanted).abs() < 1e-4, "{bubble}: {found}, expected {wanted}");
        }
    }
}

/// Phase function of Henyey and Greenstein.
fn hg(g: f64, cosine: f64) -> f64 {
    (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * cosine).powf(1.5))
}

/// Light scattered once towards a ray down the z axis through the unit ball, by Simpson's rule; `light` gives
/// irradiance, the direction towards the light, and the distance in the medium.
fn single_scattering(sigma: f64, albedo: f64, g: f64, light: impl Fn(DVec3) -> (f64, DVec3, f64)) -> f64 {
    let n = 4000;
    let value = |i: usize| {
        let t = 2.0 * i as f64 / n as f64;
        let p = DVec3::new(0.0, 0.0, 1.0 - t);
        let (irradiance, toward, depth) = light(p);
        albedo * sigma * (-sigma * (t + depth)).exp() * hg(g, DVec3::NEG_Z.dot(toward)) * irradiance
    };
    let sum: f64 = (0..=n)
        .map(|i| {
            value(i)
                * if i == 0 || i == n {
                    1.0
                } else if i % 2 == 1 {
                    4.0
                } else {
                    2.0
                }
        })
        .sum();
    sum * 2.0 / n as f64 / 3.0
}

#[test]
fn single_scattering_is_that_of_quadrature() {
    let toward = DVec3::new(0.6, 0.64, 0.48);
    let direction = vec3(0.6, 0.64, 0.48);
    let sun = LightSource::Directional { direction, irradiance: Vec3f::splat(3.0) };
    let lamp = DVec3::new(0.4, 0.2, 0.1);
    let point = LightSource::Point { position: lamp, intensity: Vec3f::splat(0.5) };
    let of_sun = |p: DVec3| {
        let b = p.dot(toward);
        (3.0, toward, -b + (b * b + 1.0 - p.length_squared()).sqrt())
    };
    let of_point = |p: DVec3| {
        let v = lamp - p;
        (0.5 / v.length_squared(), v.normalize(), v.length())
    };
    let spp = 4096;
    for g in [0.0_f32, 0.6, -0.3] {
        for (which, light) in [&sun, &point].into_iter().enumerate() {
            for grid in [false, true] {
                let medium = if grid { gridded(1.7, 0.8, g) } else { even([0.4, 1.7, 3.0], 0.8, g) };
                let parts = Parts { lights: vec![light.clone()], ..unit_ball(NULL, medium) };
                let options = RenderOptions { path: with_strategy(Strategy::Mis, 1), ..square(2, spp) };
                let (picture, variance) = render(&World::new(parts).unwrap(), &narrow(3.0), options);
                for (c, even) in [0.4, 1.7, 3.0].into_iter().enumerate() {
                    let sigma = if grid { 1.7 } else { even };
                    let g = f64::from(g);
                    let wanted = if which == 0 {
                        single_scattering(sigma, 0.8, g, of_sun)
                    } else {
                        single_scattering(sigma, 0.8, g, of_point)
                    };
                    let (mean, error) = mean_of(&picture, &variance, spp, c);
                    let bound = 4.0 * error + 1e-5;
                    let what = format!("g {g}, light {which}, grid {grid}, channel {c}");
                    assert!((mean - wanted).abs() < bound, "{what}: {mean} +- {error}, expected {wanted}");
                }
            }
        }
    }
}

#[test]
fn media_that_only_scatter_vanish_inside_of_any_clear_boundary() {
    let one = Vec3f::splat(1.0);
    let glass = Bsdf::Dielectric(Dielectric {
        ior: 1.33,
        reflectance: one,
        transmittance: one,
        mode: TransportMode::Radiance,
    });
    let view = looking([0.5, 0.3, 3.0], [0.0, 0.0, 0.0], 0.8);
    for (name, bsdf) in [("null", NULL), ("pane", pane(1.5)), ("glass", glass)] {
        for (g, grid) in [(0.0, false), (0.7, false), (-0.5, true)] {
            let medium = if grid { gridded(1.0, 1.0, g) } else { even([0.5, 1.0, 2.0], 1.0, g) };
            let mut parts = Parts { environment: white(), ..unit_ball(bsdf, medium) };
            ball(&mut parts, ([0.2, 0.0, 0.1], 0.4), NULL, [None, Some(0)]);
            let options = RenderOptions { path: with_strategy(Strategy::Mis, 1000), ..square(10, 48) };
            let (picture, variance) = render(&World::new(parts).unwrap(), &view, options);
            for c in 0..3 {
                let (mean, error) = mean_of(&picture, &variance, 48, c);
                let bound = 4.0 * error + 2e-4;
                assert!((mean - 1.0).abs() < bound, "{name}, g = {g}, {grid}: {mean} +- {error}");
            }
        }
    }
}

/// A ball of fog on a floor with a lamp beside it and one inside.
fn foggy(bsdf: Bsdf<f32>, medium: BoundedMedium) -> World {
    let mut parts = unit_ball(bsdf, medium);
    let floor = quad(vec3(-4.0, -1.1, -4.0), vec3(0.0, 0.0, 8.0), vec3(8.0, 0.0, 0.0));
    place(&mut parts, floor, Material::new(diffuse(0.7, 0.6, 0.5)));
    let black = || Material::new(diffuse(0.0, 0.0, 0.0));
    for (center, radius) in [(vec3(-2.0, 1.5, 0.3), 0.5), (vec3(0.3, 0.1, 0.0), 0.3)] {
        parts.add(Shape::Sphere { center, radius }, black().emitting(Vec3f::splat(4.0)));
    }
    let block = quad(vec3(-0.7, -0.5, -0.2), vec3(0.5, 0.0, 0.0), vec3(0.0, 0.5, 0.2));
    let mut wall = Material::new(diffuse(0.5, 0.8, 0.5));
    wall.two_sided = true;
    place(&mut parts, block, wall);
    World::new(parts).unwrap()
}

#[test]
fn estimators_agree_in_media() {
    let view = looking([0.0, 0.6, 4.5], [0.0, -0.2, 0.0], 0.7);
    let run = |world: &World, strategy, seed, spp| {
        let path = with_strategy(strategy, 4);
        let (mean, variance) = render(world, &view, RenderOptions { path, seed, ..square(12, spp) });
        (mean, variance, spp)
    };
    for (name, bsdf) in [("null", NULL), ("pane", pane(1.6))] {
        let world = foggy(bsdf, even([0.5, 1.0, 1.8], 0.9, 0.4));
        let a = run(&world, Strategy::Mis, 1, 128);
        for (strategy, seed, spp) in [(Strategy::Light, 2, 256), (Strategy::Bsdf, 3, 1024)] {
            let b = run(&world, strategy, seed, spp);
            agree(&format!("{name}, {strategy:?}"), (&a.0, &a.1, a.2), (&b.0, &b.1, b.2));
        }
    }
    let a = run(&foggy(NULL, even([1.3; 3], 0.9, 0.4)), Strategy::Mis, 4, 256);
    let b = run(&foggy(NULL, gridded(1.3, 0.9, 0.4)), Strategy::Mis, 5, 256);
    agree("grid", (&a.0, &a.1, a.2), (&b.0, &b.1, b.2));
}

#[test]
fn boxes_and_bounded_media_add_up() {
    // A box of fog that only absorbs, through a ball of fog that scatters: both take their part of straight light.
    let volume =
        Volume::homogeneous(DVec3::new(-0.5, -0.5, -0.5), DVec3::new(0.5, 0.5, 0.5), 1.0, Vec3f::zero(), 0.0);
    let mut parts = Parts { environment: white(), ..unit_ball(NULL, even([0.2, 0.4, 0.8], 0.7, 0.0)) };
    parts.volumes.push(volume);
    let spp = 4096;
    // Scattered light is cut off.
    let options = RenderOptions { path: with_strategy(Strategy::Mis, 0), ..square(2, spp) };
    let (picture, variance) = render(&World::new(parts).unwrap(), &narrow(3.0), options);
    for (c, sigma) in [0.2_f64, 0.4, 0.8].into_iter().enumerate() {
        let (mean, error) = mean_of(&picture, &variance, spp, c);
        let wanted = (-1.0 - 2.0 * sigma).exp();
        assert!((mean - wanted).abs() < 4.0 * error + 1e-5, "{mean} +- {error}, expected {wanted}");
    }
}

#[test]
fn bad_bounded_media_are_refused() {
    let good = || even([1.0; 3], 0.5, 0.0);
    let fails = |parts: Parts| World::new(parts).unwrap_err().to_string();
    let field =
        |values: Vec<Vec3f>| Field { size: [values.len(), 1, 1], ..Field { values, ..good().albedo } };
    for (medium, words) in [
        (
            even([-1.0, 0.0, 0.0], 0.5, 0.0),
            "extinction of voxel (0, 0, 0) is [-1.0, 0.0, 0.0]; it must be finite and not negative",
        ),
        (even([f32::NAN; 3], 0.5, 0.0), "is [NaN, NaN, NaN]; it must be finite"),
        (even([f32::INFINITY; 3], 0.5, 0.0), "is [inf, inf, inf]; it must be finite"),
        (even([1.0; 3], 1.01, 0.0), "albedo of voxel (0, 0, 0) is [1.01, 1.01, 1.01]; it must be in [0, 1]"),
        (even([1.0; 3], f32::NAN, 0.0), "it must be in [0, 1]"),
        (even([1.0; 3], 0.5, -1.0), "anisotropy is -1; it must lie in (-1, 1)"),
        (even([1.0; 3], 0.5, f32::NAN), "anisotropy"),
        (BoundedMedium { scale: -1.0, ..good() }, "scale"),
        (
            BoundedMedium { scale: f32::MAX, extinction: Field::constant(Vec3f::splat(9.0)), ..good() },
            "times",
        ),
        (
            BoundedMedium { extinction: field(vec![vec3(1.0, 2.0, 3.0); 2]), ..good() },
            "extinction of voxel 0 is [1.0, 2.0, 3.0]; a grid of extinction must be grey",
        ),
        (
            BoundedMedium { albedo: field(vec![Vec3f::zero(), Vec3f::splat(2.0)]), ..good() },
            "albedo of voxel (1, 0, 0) is [2.0, 2.0, 2.0]; it must be in [0, 1]",
        ),
        (
            BoundedMedium { albedo: Field { size: [2, 2, 2], ..good().albedo }, ..good() },
            "albedo has 1 values for 2 x 2 x 2 voxels",
        ),
        (
            BoundedMedium {
                albedo: Field { transform: DAffine3::from_scale(DVec3::ZERO), ..good().albedo },
                ..good()
            },
            "transform",
        ),
    ] {
        let text = fails(unit_ball(NULL, medium));
        assert!(text.contains("medium 0") && text.contains(words), "{words} in {text}");
    }
    let boundary = |instance, interior| Boundary { instance, interior: Some(interior), exterior: None };
    for (b, words) in [
        (boundary(1, 0), "instance 1 is not there; the index must be below 1"),
        (boundary(0, 1), "medium 1 is not there"),
    ] {
        let text = fails(Parts { boundaries: vec![b], ..unit_ball(NULL, good()) });
        assert!(text.contains("boundary 0") && text.contains(words), "{words} in {text}");
    }
    let text = fails(Parts { medium_around_camera: Some(1), ..unit_ball(NULL, good()) });
    assert!(text.contains("camera") && text.contains("medium 1"), "{text}");
}
