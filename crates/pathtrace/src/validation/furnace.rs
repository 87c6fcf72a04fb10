//! Furnaces: enclosures in which every pixel has a known value.

use super::scenes::{diffuse, glossy, looking, render, square, with_strategy};
use super::statistics::mean_of;
use crate::{EnvironmentMap, Material, Parts, RenderOptions, Shape, Strategy, World};
use photofit_scalar::{Vec3f, vec3};
use photofit_shading::bsdf::Energy;

/// A sphere around the origin.
fn ball(radius: f32) -> Shape {
    Shape::Sphere { center: vec3(0.0, 0.0, 0.0), radius }
}

#[test]
fn inside_a_glowing_diffuse_sphere_every_pixel_is_one() {
    // L = Le + Kd L, with both a half.
    let meshed = Shape::Mesh(photofit_geometry::shapes::icosphere(12));
    for (name, shape) in [("sphere", ball(1.0)), ("mesh", meshed)] {
        let mut parts = Parts::default();
        let mut material = Material::new(diffuse(0.5, 0.5, 0.5)).emitting(Vec3f::splat(0.5));
        material.emits_both_sides = true;
        let mut shape = shape;
        if let Shape::Mesh(mesh) = &mut shape {
            // Seen from within: the front turns inwards.
            mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
            mesh.normals.clear();
            material.emits_both_sides = false;
        } else {
            material.two_sided = true;
        }
        parts.add(shape, material);
        let world = World::new(parts).unwrap();
        let view = looking([0.3, 0.1, 0.2], [0.0, 0.4, -1.0], 1.2);
        for strategy in [Strategy::Mis, Strategy::Light, Strategy::Bsdf] {
            let path = with_strategy(strategy, 100);
            let options = RenderOptions { path, ..square(12, 256) };
            let (picture, variance) = render(&world, &view, options);
            let (mean, error) = mean_of(&picture, &variance, 256, 0);
            assert!((mean - 1.0).abs() < 4.0 * error + 2e-4, "{name} {strategy:?}: {mean} +- {error}");
            for i in 0..picture.pixels() {
                let sigma = (variance.data[3 * i] / 256.0).sqrt();
                let value = picture.data[4 * i];
                assert!((value - 1.0).abs() < 5.0 * sigma + 1e-3, "{name} {strategy:?}: {value} +- {sigma}");
            }
        }
    }
}

#[test]
fn white_objects_vanish_in_a_white_environment() {
    let cases = [
        ("diffuse", diffuse(1.0, 1.0, 1.0), 1.0),
        ("smooth metal", glossy(1.0, 0.0, 1.0, Energy::Single), 1.0),
        ("rough metal", glossy(1.0, 0.7, 1.0, Energy::Compensated), 1.0),
        ("rough plastic", glossy(1.0, 0.5, 0.0, Energy::Compensated), 1.0),
    ];
    for (name, bsdf, expected) in cases {
        let mut parts = Parts::default();
        parts.add(ball(1.0), Material::new(bsdf));
        parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(1.0)));
        let world = World::new(parts).unwrap();
        let view = looking([0.0, 0.0, 1.6], [0.0, 0.0, 0.0], 0.9);
        let options = RenderOptions { path: with_strategy(Strategy::Mis, 64), ..square(16, 256) };
        let (picture, variance) = render(&world, &view, options);
        let (mean, error) = mean_of(&picture, &variance, 256, 0);
        assert!((mean - expected).abs() < 5e-3 + 4.0 * error, "{name}: {mean} +- {error}");
    }
}

#[test]
fn single_scattering_metal_loses_what_the_table_says() {
    // Directional albedo of GGX without compensation never exceeds 1 and falls with roughness.
    let mut last = 1.0 + 1e-3;
    for roughness in [0.1, 0.4, 0.7, 1.0] {
        let mut parts = Parts::default();
        parts.add(ball(1.0), Material::new(glossy(1.0, roughness, 1.0, Energy::Single)));
        parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(1.0)));
        let world = World::new(parts).unwrap();
        let view = looking([0.0, 0.0, 1.2], [0.0, 0.0, 0.0], 0.3);
        let (picture, variance) = render(&world, &view, square(8, 1024));
        let (mean, error) = mean_of(&picture, &variance, 1024, 0);
        // Seen from the front, the sphere reflects 1 - e(cos), e from the split-sum table.
        let s = photofit_shading::split_sum(1.0_f32, roughness);
        assert!(mean <= last + 4.0 * error, "roughness {roughness}: {mean}");
        let expected = f64::from(s.scale + s.bias);
        assert!((mean - expected).abs() < 0.02, "roughness {roughness}: {mean}, table {expected}");
        last = mean;
    }
}
