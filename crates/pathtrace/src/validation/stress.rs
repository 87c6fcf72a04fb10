//! Extremes: every picture stays finite and no pixel exceeds what it may.

use super::scenes::{diffuse, glossy, looking, place, quad, render, square, with_strategy};
use super::statistics::mean_of;
use crate::{EnvironmentMap, LightSource, Material, Parts, RenderOptions, Shape, Strategy, World};
use glam::DVec3;
use photofit_geometry::Mesh;
use photofit_image::Image;
use photofit_scalar::{Vec3f, vec3};
use photofit_shading::bsdf::Energy;

#[test]
fn roughness_from_0_to_1_and_grazing_views_stay_within_the_furnace() {
    let mut failures = Vec::new();
    for roughness in [0.0, 1e-4, 1e-3, 0.01, 0.05, 0.2, 0.6, 1.0] {
        for metallic in [0.0, 1.0] {
            for height in [1e-3, 0.02, 0.5] {
                let mut parts = Parts::default();
                let ground = quad(vec3(-100.0, 0.0, -100.0), vec3(0.0, 0.0, 200.0), vec3(200.0, 0.0, 0.0));
                place(
                    &mut parts,
                    ground,
                    Material::new(glossy(1.0, roughness, metallic, Energy::Compensated)),
                );
                parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(1.0)));
                let world = World::new(parts).unwrap();
                let view = looking([0.0, height, 1.0], [0.0, 0.0, 0.0], 0.005);
                let (picture, variance) = render(&world, &view, square(4, 256));
                let (mean, error) = mean_of(&picture, &variance, 256, 0);
                let name = format!("roughness {roughness}, metallic {metallic}, height {height}");
                assert!(picture.is_finite(), "{name}");
                // At the sharpest lobe that is no delta lobe, slopes have three digits left.
                let slack = if roughness == 0.01 && height < 0.01 { 0.06 } else { 0.01 };
                if !(0.9..1.0 + 4.0 * error + slack).contains(&mean) {
                    failures.push(format!("{name}: {mean:.4} +- {error:.4}"));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
fn very_bright_and_tiny_lights_give_their_irradiance() {
    // The same power from smaller and smaller panels, straight above.
    for size in [0.1_f32, 1e-3, 1e-5] {
        let mut parts = Parts::default();
        let ground = quad(vec3(-5.0, 0.0, -5.0), vec3(0.0, 0.0, 10.0), vec3(10.0, 0.0, 0.0));
        place(&mut parts, ground, Material::new(diffuse(0.5, 0.5, 0.5)));
        let panel = quad(vec3(-0.5 * size, 2.0, -0.5 * size), vec3(size, 0.0, 0.0), vec3(0.0, 0.0, size));
        let radiance = 1.0 / (size * size);
        place(&mut parts, panel, Material::new(diffuse(0.0, 0.0, 0.0)).emitting(Vec3f::splat(radiance)));
        let world = World::new(parts).unwrap();
        let view = looking([1.0, 1.0, 0.0], [0.0, 0.0, 0.0], 0.001);
        let options = RenderOptions { path: with_strategy(Strategy::Mis, 1), ..square(4, 64) };
        let (picture, variance) = render(&world, &view, options);
        let (mean, error) = mean_of(&picture, &variance, 64, 0);
        let expected = 0.5 / std::f64::consts::PI / 4.0;
        assert!(
            (mean - expected).abs() < 4.0 * error + 3e-3 * expected,
            "{size}: {mean}, expected {expected}"
        );
    }
}

#[test]
fn degenerate_shapes_and_lights_are_harmless() {
    let mut parts = Parts::default();
    let ground = quad(vec3(-5.0, 0.0, -5.0), vec3(0.0, 0.0, 10.0), vec3(10.0, 0.0, 0.0));
    place(&mut parts, ground, Material::new(diffuse(0.5, 0.5, 0.5)));
    // No area, no length, slivers, doubled: all of them emit.
    let p = vec3(0.3, 1.0, 0.2);
    let flat = Mesh {
        positions: vec![p, p, p + vec3(1.0, 0.0, 0.0), p + vec3(0.5, 0.0, 0.0), p + vec3(1.0, 1e-7, 0.0)],
        triangles: vec![[0, 1, 2], [0, 0, 0], [0, 3, 2], [0, 2, 4], [0, 2, 4]],
        ..Mesh::default()
    };
    place(&mut parts, flat, Material::new(diffuse(0.2, 0.2, 0.2)).emitting(Vec3f::splat(1e6)));
    parts
        .add(Shape::Mesh(Mesh::default()), Material::new(diffuse(0.2, 0.2, 0.2)).emitting(Vec3f::splat(1.0)));
    parts
        .lights
        .push(LightSource::Point { position: DVec3::new(0.0, 0.0, 0.0), intensity: Vec3f::splat(1e6) });
    parts.environment = Some(EnvironmentMap::new(Image::from_fn(1, 1, 3, |_, _, _| 1e6)));
    let world = World::new(parts).unwrap();
    let (picture, _) = render(&world, &looking([0.0, 2.0, 3.0], [0.0, 0.5, 0.0], 0.9), square(16, 16));
    assert!(picture.is_finite());
    assert!(picture.data.iter().any(|v| *v > 1e5), "the sky is seen");
}

#[test]
fn an_empty_world_shows_its_sky() {
    let sky = EnvironmentMap::constant(vec3(0.1, 0.2, 0.3));
    let world = World::new(Parts { environment: Some(sky), ..Parts::default() }).unwrap();
    let view = looking([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], 0.9);
    let (picture, _) = render(&world, &view, square(1, 2));
    let near = |a: &[f32], b: [f32; 4]| a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-6);
    assert!(near(picture.pixel(0, 0), [0.1, 0.2, 0.3, 0.0]), "{:?}", picture.data);
    let mut options = square(1, 2);
    options.path.show_environment = false;
    let (hidden, _) = render(&world, &view, options);
    assert!(near(hidden.pixel(0, 0), [0.0; 4]), "{:?}", hidden.data);
}
