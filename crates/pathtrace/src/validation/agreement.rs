//! Estimators of the same integral agree.

use super::scenes::{cornell, cornell_view, diffuse, glossy, place, quad, render, square, with_strategy};
use super::statistics::agree;
use crate::{EnvironmentMap, Integrator, Material, Parts, RenderOptions, Shape, Strategy, View, World};
use photofit_image::Image;
use photofit_scalar::{Vec3f, vec3};
use photofit_shading::bsdf::Energy;

/// An environment with a bright spot, a horizon and a dark half.
fn sky() -> EnvironmentMap {
    let image = Image::from_fn(24, 12, 3, |x, y, c| {
        let base = if y < 6 { 0.4 + 0.1 * c as f32 } else { 0.05 };
        base + if (x, y) == (5, 3) { 60.0 } else { 0.0 }
    });
    EnvironmentMap::new(image)
}

/// Glossy and diffuse balls on a floor.
fn balls() -> Parts {
    let mut parts = Parts::default();
    let ground = quad(vec3(-3.0, 0.0, -3.0), vec3(0.0, 0.0, 6.0), vec3(6.0, 0.0, 0.0));
    place(&mut parts, ground, Material::new(diffuse(0.5, 0.6, 0.4)));
    let kinds = [
        glossy(0.8, 0.25, 1.0, Energy::Compensated),
        diffuse(0.8, 0.3, 0.2),
        glossy(0.5, 0.5, 0.0, Energy::Compensated),
    ];
    for (i, bsdf) in kinds.into_iter().enumerate() {
        let center = vec3(i as f32 * 0.7 - 0.7, 0.3, 0.0);
        parts.add(Shape::Sphere { center, radius: 0.3 }, Material::new(bsdf));
    }
    parts
}

/// Renders with every estimator and compares each with the first.
fn all_agree(name: &str, world: impl Fn(bool) -> World, view: &View, depth: u32, spp: u32) {
    let run = |world: &World, strategy: Strategy, integrator: Integrator, seed: u64, spp: u32| {
        let path = with_strategy(strategy, depth);
        let options = RenderOptions { path, integrator, seed, ..square(20, spp) };
        render(world, view, options)
    };
    let (compensated, plain) = (world(true), world(false));
    let first = run(&compensated, Strategy::Mis, Integrator::Path, 1, spp);
    let others = [
        ("light sampling", run(&plain, Strategy::Light, Integrator::Path, 2, 2 * spp), 2 * spp),
        ("BSDF sampling", run(&plain, Strategy::Bsdf, Integrator::Path, 3, 8 * spp), 8 * spp),
        ("uniform", run(&plain, Strategy::Mis, Integrator::Uniform, 4, 64 * spp), 64 * spp),
        ("uncompensated", run(&plain, Strategy::Mis, Integrator::Path, 5, spp), spp),
    ];
    for (other, (mean, variance), n) in &others {
        agree(&format!("{name}, {other}"), (&first.0, &first.1, spp), (mean, variance, *n));
    }
}

#[test]
fn estimators_agree_in_a_box_with_a_lamp() {
    all_agree("box", |_| World::new(cornell()).unwrap(), &cornell_view(), 3, 64);
}

#[test]
fn estimators_agree_under_a_sky() {
    let view = super::scenes::looking([0.0, 1.2, 2.2], [0.0, 0.2, 0.0], 0.8);
    let world = |compensate| {
        let mut parts = balls();
        parts.environment = Some(EnvironmentMap { compensate, ..sky() });
        World::new(parts).unwrap()
    };
    all_agree("sky", world, &view, 3, 64);
}

#[test]
fn estimators_agree_with_lamps_and_sky_together() {
    let view = super::scenes::looking([0.0, 1.2, 2.2], [0.0, 0.2, 0.0], 0.8);
    let world = |compensate| {
        let mut parts = balls();
        parts.environment = Some(EnvironmentMap { compensate, scale: 0.5, ..sky() });
        let lamp = Shape::Sphere { center: vec3(0.5, 1.0, 0.4), radius: 0.15 };
        parts.add(lamp, Material::new(diffuse(0.0, 0.0, 0.0)).emitting(vec3(8.0, 4.0, 2.0)));
        let mut panel = Material::new(diffuse(0.2, 0.2, 0.2)).emitting(Vec3f::splat(1.5));
        panel.emits_both_sides = true;
        place(&mut parts, quad(vec3(-1.2, 0.0, -0.8), vec3(0.0, 1.0, 0.0), vec3(1.0, 0.0, -0.5)), panel);
        World::new(parts).unwrap()
    };
    all_agree("lamps and sky", world, &view, 3, 64);
}
