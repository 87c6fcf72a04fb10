//! Radiance with closed forms.

use super::scenes::{diffuse, looking, place, quad, render, square, with_strategy};
use super::statistics::mean_of;
use crate::{
    EnvironmentMap, Falloff, LightSource, Material, Parts, PathOptions, RenderOptions, Shape, Strategy, View,
    World,
};
use glam::DVec3;
use photofit_scalar::{Vec3, Vec3f, vec3};
use std::f64::consts::PI;

const ALBEDO: f64 = 0.6;

/// A large floor at y = 0, seen from above around the origin through a narrow angle.
fn floor() -> (Parts, View) {
    let mut parts = Parts::default();
    let ground = quad(vec3(-50.0, 0.0, -50.0), vec3(0.0, 0.0, 100.0), vec3(100.0, 0.0, 0.0));
    let a = ALBEDO as f32;
    place(&mut parts, ground, Material::new(diffuse(a, a, a)));
    (parts, looking([0.0, 2.0, 0.001], [0.0, 0.0, 0.0], 0.002))
}

fn direct(strategy: Strategy) -> PathOptions {
    with_strategy(strategy, 1)
}

fn value(parts: Parts, view: &View, strategy: Strategy, spp: u32) -> (f64, f64) {
    let world = World::new(parts).unwrap();
    let options = RenderOptions { path: direct(strategy), ..square(4, spp) };
    let (picture, variance) = render(&world, view, options);
    mean_of(&picture, &variance, spp, 0)
}

#[test]
fn sources_without_a_surface() {
    let up = Vec3f::splat(3.0);
    let cone = |inner, outer, falloff| LightSource::Spot {
        position: DVec3::new(1.0, 2.0, 0.0),
        direction: vec3(-0.5, -2.0, 0.0),
        intensity: up,
        inner,
        outer,
        falloff,
        picture: None,
    };
    let r2 = 5.0_f64;
    let facing = 2.0 / r2.sqrt();
    // Angle between the axis of the cone and the direction to the origin.
    let cosine = (0.5 + 4.0) / (4.25_f64.sqrt() * r2.sqrt());
    let smooth = ((cosine - 0.6_f64.cos()) / (0.1_f64.cos() - 0.6_f64.cos())).powi(2);
    let linear = (0.6 - cosine.acos()) / 0.5;
    let cases = [
        (LightSource::Point { position: DVec3::new(1.0, 2.0, 0.0), intensity: up }, 3.0 * facing / r2),
        (LightSource::Directional { direction: vec3(3.0, 4.0, 0.0), irradiance: up }, 3.0 * 0.8),
        (LightSource::Directional { direction: vec3(3.0, -4.0, 0.0), irradiance: up }, 0.0),
        (cone(0.4, 0.5, Falloff::Smooth), 3.0 * facing / r2),
        (cone(0.1, 0.6, Falloff::Smooth), 3.0 * facing / r2 * smooth),
        (cone(0.1, 0.6, Falloff::Linear), 3.0 * facing / r2 * linear),
        (cone(0.1, 0.15, Falloff::Smooth), 0.0),
    ];
    for (light, irradiance) in cases {
        let (mut parts, view) = floor();
        parts.lights.push(light.clone());
        let (found, _) = value(parts, &view, Strategy::Mis, 16);
        let expected = irradiance * ALBEDO / PI;
        assert!((found - expected).abs() < 2e-3 * expected + 1e-6, "{light:?}: {found}, expected {expected}");
    }
}

/// Irradiance at the origin with normal +y of a polygon of unit radiance (Lambert's formula).
fn form_factor(corners: &[Vec3<f64>]) -> f64 {
    let n = corners.len();
    let mut sum = 0.0;
    for i in 0..n {
        let (a, b) = (corners[i].normalize_or_zero(), corners[(i + 1) % n].normalize_or_zero());
        let cross = a.cross(b);
        sum += a.dot(b).clamp(-1.0, 1.0).acos() * cross.normalize_or_zero().y;
    }
    0.5 * sum.abs()
}

#[test]
fn polygons_have_lambert_form_factors() {
    let panels = [
        (vec3(-0.5, 1.0, -0.5), vec3(1.0, 0.0, 0.0), vec3(0.0, 0.0, 1.0)),
        (vec3(0.4, 0.3, -0.2), vec3(0.9, 0.1, 0.0), vec3(0.0, 0.2, 1.1)),
        (vec3(-3.0, 0.05, 2.0), vec3(6.0, 0.0, 0.0), vec3(0.0, 3.0, -0.5)),
    ];
    for (corner, a, b) in panels {
        for strategy in [Strategy::Mis, Strategy::Light, Strategy::Bsdf] {
            let (mut parts, view) = floor();
            let mut material = Material::new(diffuse(0.0, 0.0, 0.0)).emitting(vec3(2.0, 2.0, 2.0));
            material.emits_both_sides = true;
            let corners: Vec<Vec3<f64>> =
                [corner, corner + a, corner + a + b, corner + b].map(Vec3f::cast).to_vec();
            place(&mut parts, quad(corner, a, b), material);
            // From below the panels, so that none hides the floor.
            let view = View { eye: DVec3::new(0.0, 0.04, 0.0), ..view };
            let (found, error) = value(parts, &view, strategy, 4096);
            let expected = 2.0 * form_factor(&corners) * ALBEDO / PI;
            assert!(
                (found - expected).abs() < 4.0 * error + 1e-3 * expected,
                "{corner:?} {strategy:?}: {found} +- {error}, expected {expected}"
            );
        }
    }
}

#[test]
fn spheres_shine_as_their_cones_do() {
    // Irradiance of a sphere of unit radiance at height h above the floor: pi sin^2 of its half angle.
    for (height, radius) in [(1.0_f64, 0.5_f64), (3.0, 0.2), (1.0, 0.9)] {
        for strategy in [Strategy::Mis, Strategy::Light, Strategy::Bsdf] {
            let (mut parts, view) = floor();
            let ball = Shape::Sphere { center: vec3(0.0, height as f32, 0.0), radius: radius as f32 };
            parts.add(ball, Material::new(diffuse(0.0, 0.0, 0.0)).emitting(Vec3f::splat(1.0)));
            let view = View { eye: DVec3::new(0.0, 0.05, 0.0), ..view };
            let (found, error) = value(parts, &view, strategy, 4096);
            let expected = ALBEDO * (radius / height).powi(2);
            assert!(
                (found - expected).abs() < 4.0 * error + 1e-3 * expected,
                "{height} {radius} {strategy:?}: {found} +- {error}, expected {expected}"
            );
        }
    }
}

#[test]
fn a_constant_environment_lights_an_open_floor_fully() {
    let (mut parts, view) = floor();
    parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(2.0)));
    let (found, error) = value(parts, &view, Strategy::Mis, 256);
    assert!((found - 2.0 * ALBEDO).abs() < 4.0 * error + 1e-4, "{found}");
}

#[test]
fn what_lies_between_casts_a_shadow() {
    let (mut parts, view) = floor();
    parts
        .lights
        .push(LightSource::Point { position: DVec3::new(0.0, 3.0, 0.0), intensity: Vec3f::splat(5.0) });
    // Above the camera: hides the light, not the floor.
    let sheet = quad(vec3(-1.0, 2.5, -1.0), vec3(0.0, 0.0, 2.0), vec3(2.0, 0.0, 0.0));
    place(&mut parts, sheet, Material::new(diffuse(0.5, 0.5, 0.5)));
    let (found, _) = value(parts, &view, Strategy::Mis, 16);
    assert_eq!(found, 0.0);
}
