//! Solids that absorb: within one another, with lamps inside, scaled.

use super::scenes::{diffuse, looking, place, quad, render, square, with_strategy};
use super::statistics::agree;
use crate::{EnvironmentMap, LightSource, Material, Parts, RenderOptions, Shape, Strategy, World};
use glam::DVec3;
use photofit_scalar::{Vec3f, vec3};
use photofit_shading::bsdf::{
    Bsdf, Dielectric, Distribution, Microfacet, Null, RoughDielectric, TransportMode,
};

/// A ball around the origin.
fn ball(radius: f32) -> Shape {
    Shape::Sphere { center: Vec3f::zero(), radius }
}

/// A surface that is not there, around an absorber.
fn absorber(absorption: Vec3f) -> Material {
    Material { absorption, solid: true, ..Material::new(Bsdf::Null(Null)) }
}

const OUTER: [f32; 3] = [2.0, 0.5, 0.0];
const INNER: [f32; 3] = [0.0, 0.25, 3.0];

/// Balls of radius 1, 1/2 and 1/4 within one another; the innermost is empty.
fn nested() -> Parts {
    let mut parts = Parts::default();
    parts.add(ball(1.0), absorber(Vec3f::from_array(OUTER)));
    parts.add(ball(0.5), absorber(Vec3f::from_array(INNER)));
    parts.add(ball(0.25), absorber(Vec3f::zero()));
    parts
}

/// Transmittance along the axis.
fn through_all() -> [f32; 3] {
    std::array::from_fn(|c| (-OUTER[c] - 0.5 * INNER[c]).exp())
}

#[test]
fn nested_absorbers_come_back_when_one_is_left() {
    let white = || Some(EnvironmentMap::constant(Vec3f::splat(1.0)));
    let seen = |eye: f32| {
        let world = World::new(Parts { environment: white(), ..nested() }).unwrap();
        let view = looking([0.0, 0.0, eye], [0.0, 0.0, eye - 1.0], 1e-3);
        render(&world, &view, square(2, 1)).0.pixel(0, 0).to_vec()
    };
    // From outside; from within the empty one: half of everything.
    for (eye, share) in [(3.0, 1.0), (0.0, 0.5_f32)] {
        let (pixel, expected) = (seen(eye), through_all().map(|t| t.powf(share)));
        for c in 0..3 {
            assert!((pixel[c] - expected[c]).abs() < 2e-5 * expected[c], "{eye}: {pixel:?} {expected:?}");
        }
    }
    // In shadow: a floor behind the balls, lit along the axis.
    let mut parts = nested();
    let floor = quad(vec3(-1.0, -1.0, -2.0), vec3(2.0, 0.0, 0.0), vec3(0.0, 2.0, 0.0));
    place(&mut parts, floor, Material::new(diffuse(1.0, 1.0, 1.0)));
    let direction = vec3(0.0, 0.0, 1.0);
    let irradiance = Vec3f::splat(std::f32::consts::PI);
    parts.lights.push(LightSource::Directional { direction, irradiance });
    let view = looking([3.0, 0.0, -1.0], [0.0, 0.0, -2.0], 2e-4);
    let picture = render(&World::new(parts).unwrap(), &view, square(2, 1)).0;
    let (pixel, expected) = (picture.pixel(0, 0), through_all());
    for c in 0..3 {
        assert!((pixel[c] - expected[c]).abs() < 1e-4 * expected[c], "shadow: {pixel:?} {expected:?}");
    }
}

#[test]
fn a_ninth_solid_within_others_hides_none_of_them_when_it_is_left() {
    // Balls around each other, each absorbing as its letter says; the ninth is not told from the eighth.
    let mut parts =
        Parts { environment: Some(EnvironmentMap::constant(Vec3f::splat(1.0))), ..Parts::default() };
    let letters = [0, 1, 2, 2, 2, 2, 2, 2, 1];
    let sigma = [0.0, 1.0, 0.25];
    parts.materials = sigma.map(|s| absorber(Vec3f::splat(s))).to_vec();
    for (i, material) in letters.into_iter().enumerate() {
        parts.shapes.push(ball(1.0 - 0.1 * i as f32));
        parts.instances.push(crate::Instance { shape: i, material, transform: Default::default() });
    }
    let view = looking([0.0, 0.0, 3.0], [0.0; 3], 1e-3);
    let found = render(&World::new(parts).unwrap(), &view, square(2, 1)).0.pixel(0, 0)[0];
    let expected = (-(0.2 * sigma[1] + 1.6 * sigma[2])).exp();
    assert!((found - expected).abs() < 2e-5 * expected, "{found}, expected {expected}");
}

/// Rough glass of radius 1 that absorbs, with a lamp inside.
fn lantern() -> Parts {
    let mut parts = Parts::default();
    let one = Vec3f::splat(1.0);
    let glass = Dielectric { ior: 1.3, reflectance: one, transmittance: one, mode: TransportMode::Radiance };
    let glass = RoughDielectric { glass, surface: Microfacet::isotropic(Distribution::Ggx, 0.4) };
    let absorption = vec3(0.3, 1.0, 2.5);
    parts.add(ball(1.0), Material { absorption, ..Material::new(Bsdf::RoughDielectric(glass)) });
    let lamp = Shape::Sphere { center: vec3(0.2, 0.1, 0.0), radius: 0.5 };
    parts.add(lamp, Material::new(diffuse(0.0, 0.0, 0.0)).emitting(Vec3f::splat(3.0)));
    parts
}

#[test]
fn all_estimators_absorb_behind_the_surface_that_a_shadow_ray_leaves() {
    let view = looking([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], 0.35);
    let world = World::new(lantern()).unwrap();
    let run = |strategy: Strategy, seed: u64, spp: u32| {
        let path = with_strategy(strategy, 1);
        render(&world, &view, RenderOptions { path, seed, ..square(16, spp) })
    };
    let (both, light, bsdf) =
        (run(Strategy::Mis, 1, 512), run(Strategy::Light, 2, 512), run(Strategy::Bsdf, 3, 2048));
    agree("light sampling", (&both.0, &both.1, 512), (&light.0, &light.1, 512));
    agree("BSDF sampling", (&both.0, &both.1, 512), (&bsdf.0, &bsdf.1, 2048));
    assert!(both.0.data.iter().step_by(4).sum::<f32>() > 1.0, "the lamp is seen");
}

/// A sheet of rough glass bounds no closed solid: what a path leaves behind it to the environment or a sun is not absorbed, whichever way
/// the light is found.
#[test]
fn all_estimators_agree_behind_an_open_sheet() {
    let one = Vec3f::splat(1.0);
    let glass = Dielectric { ior: 1.3, reflectance: one, transmittance: one, mode: TransportMode::Radiance };
    let glass = RoughDielectric { glass, surface: Microfacet::isotropic(Distribution::Ggx, 0.4) };
    let solid = Material { absorption: vec3(0.5, 1.0, 2.0), ..Material::new(Bsdf::RoughDielectric(glass)) };
    let sky = photofit_image::Image::from_data(2, 1, 3, vec![0.2, 0.5, 1.0, 1.0, 0.6, 0.3]);
    let sky = EnvironmentMap { compensate: false, ..EnvironmentMap::new(sky) };
    let mut parts = Parts { environment: Some(sky), ..Parts::default() };
    let sheet = quad(vec3(-2.0, -2.0, 0.0), vec3(4.0, 0.0, 0.0), vec3(0.0, 4.0, 0.0));
    place(&mut parts, sheet, solid);
    // Beside it a floor in whose light the sheet stands: from there its inside is seen through it.
    let floor = quad(vec3(-2.0, -2.0, -1.0), vec3(4.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0));
    place(&mut parts, floor, Material::new(diffuse(0.8, 0.8, 0.8)));
    let world = World::new(parts).unwrap();
    let view = looking([0.0, 0.3, 3.0], [0.0, -0.4, 0.0], 0.35);
    let run = |strategy: Strategy, seed: u64, spp: u32| {
        let path = with_strategy(strategy, 4);
        render(&world, &view, RenderOptions { path, seed, ..square(16, spp) })
    };
    let (both, light, bsdf) =
        (run(Strategy::Mis, 1, 512), run(Strategy::Light, 2, 2048), run(Strategy::Bsdf, 3, 2048));
    agree("light sampling", (&both.0, &both.1, 512), (&light.0, &light.1, 2048));
    agree("BSDF sampling", (&both.0, &both.1, 512), (&bsdf.0, &bsdf.1, 2048));
}

/// A volume of a surface that lets no light through means nothing: it bounds no solid.
#[test]
fn a_volume_behind_an_opaque_surface_absorbs_nothing() {
    let volume = |transmission: f32| {
        let extensions = photofit_scene::Extensions {
            transmission: Some(photofit_scene::Transmission { factor: transmission, texture: None }),
            volume: Some(photofit_scene::Volume {
                thickness: 1.0,
                attenuation_distance: 0.1,
                attenuation_color: [0.5; 3],
                ..Default::default()
            }),
            ..Default::default()
        };
        let material = photofit_scene::Material {
            extensions: Some(Box::new(extensions)),
            ..photofit_scene::Material::clay()
        };
        let scene = photofit_scene::Scene { materials: vec![material], ..Default::default() };
        Parts::from_scene(&scene).materials[0].clone()
    };
    let (opaque, glass) = (volume(0.0), volume(1.0));
    assert!(!opaque.solid && opaque.absorption == Vec3f::zero());
    assert!(glass.solid && glass.absorption.x > 1.0);
}

#[test]
fn absorption_counts_on_the_way_to_a_collision() {
    // A dense box in an absorbing ball, lit from where it is seen: half a unit of absorber there and back.
    let mut parts = Parts::default();
    parts.add(ball(1.0), absorber(vec3(1.0, 0.5, 0.0)));
    let (low, high) = (DVec3::splat(-0.5), DVec3::splat(0.5));
    parts.volumes.push(crate::Volume::homogeneous(low, high, 1000.0, Vec3f::splat(1.0), 0.0));
    let (direction, irradiance) = (vec3(0.0, 0.0, 1.0), Vec3f::splat(1.0));
    parts.lights.push(LightSource::Directional { direction, irradiance });
    let path = with_strategy(Strategy::Mis, 1);
    let view = looking([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], 1e-3);
    let picture = render(&World::new(parts).unwrap(), &view, RenderOptions { path, ..square(2, 256) }).0;
    let [r, g, b] = [0, 1, 2].map(|c| picture.pixel(0, 0)[c]);
    assert!(b > 0.0, "light is scattered");
    for (found, expected) in [(r / b, (-1.0_f32).exp()), (g / b, (-0.5_f32).exp())] {
        assert!((found - expected).abs() < 3e-3 * expected, "{found}, expected {expected}");
    }
}

#[test]
fn scaled_parts_look_the_same() {
    let glow = EnvironmentMap::constant(Vec3f::splat(0.5));
    let whole = || {
        let mut parts = Parts { environment: Some(glow.clone()), ..lantern() };
        let floor = quad(vec3(-3.0, -1.2, -3.0), vec3(0.0, 0.0, 6.0), vec3(6.0, 0.0, 0.0));
        place(&mut parts, floor, Material::new(diffuse(0.6, 0.5, 0.4)));
        let position = DVec3::new(1.0, 2.0, 1.5);
        parts.lights.push(LightSource::Point { position, intensity: Vec3f::splat(2.0) });
        parts.volumes.push(crate::Volume::homogeneous(
            DVec3::new(-1.5, -1.2, 1.0),
            DVec3::new(1.5, 0.0, 1.5),
            1.5,
            Vec3f::splat(0.7),
            0.1,
        ));
        parts
    };
    let options = |seed| RenderOptions { seed, ..square(16, 256) };
    let first = render(&World::new(whole()).unwrap(), &looking([0.0, 0.5, 4.0], [0.0; 3], 0.8), options(1));
    let mut scaled = whole();
    scaled.scale(0.05, DVec3::new(0.0, 0.1, 0.0));
    let view = looking([0.0, 0.125, 0.2], [0.0, 0.1, 0.0], 0.8);
    let second = render(&World::new(scaled).unwrap(), &view, options(2));
    agree("scaled", (&first.0, &first.1, 256), (&second.0, &second.1, 256));
}
