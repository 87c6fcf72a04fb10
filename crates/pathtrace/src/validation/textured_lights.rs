//! Surfaces whose emission varies: small bright spots are found, and edits of anything else leave the table of emitting
//! triangles alone.

use super::library::{scene, slot};
use super::scenes::{looking, quad, render, square, with_strategy};
use super::statistics::mean_of;
use crate::{EnvironmentMap, MaterialValue, Parameter, Parts, RenderOptions, Strategy, World};
use photofit_geometry::shapes;
use photofit_scalar::{Vec3f, vec2, vec3};
use photofit_scene::{Instance, MapKind, Material, Primitive, Scene, TextureImage, TextureSlot};

/// A picture of `side` squared that is black but for some texels.
fn dots(side: usize, white: &[usize]) -> TextureImage {
    let mut texels = vec![[0, 0, 0, 255]; side * side];
    white.iter().for_each(|i| texels[*i] = [255; 4]);
    TextureImage { width: side, height: side, texels, ..Default::default() }
}

/// A spot that all probes miss, and a patch of the other triangle, which they find.
const SPOT: &[usize] = &[32 * 10 + 20];
const PATCH: &[usize] = &[32 * 27 + 13, 32 * 27 + 14, 32 * 28 + 13, 32 * 28 + 14];

/// A floor and a lamp above it, of whose 32 x 32 texels some glow.
fn under_a_lamp(white: &[usize]) -> Scene {
    under_a_lamp_of(32, white)
}

/// The same with so many texels a side.
fn under_a_lamp_of(side: usize, white: &[usize]) -> Scene {
    let glowing = Material {
        base_color: [0.0, 0.0, 0.0, 1.0],
        emissive: [1000.0; 3],
        emissive_texture: Some(slot()),
        ..Material::clay()
    };
    let mut lamp = quad(vec3(-0.5, 1.0, -0.5), vec3(1.0, 0.0, 0.0), vec3(0.0, 0.0, 1.0));
    lamp.uvs = lamp.positions.iter().map(|p| vec2(p.x + 0.5, p.z + 0.5)).collect();
    let mut out = scene(lamp, glowing);
    out.images.push(dots(side, white));
    let floor = quad(vec3(-1.0, 0.0, -1.0), vec3(0.0, 0.0, 2.0), vec3(2.0, 0.0, 0.0));
    out.materials.push(Material::clay());
    out.primitives.push(Primitive { mesh: floor, material: 1 });
    out.instances.push(Instance { primitive: 1, transform: Default::default() });
    out
}

#[test]
fn light_sampling_finds_a_spot_between_the_probes() {
    let run = |white: &[usize], strategy: Strategy, seed: u64| {
        let world = World::new(Parts::from_scene(&under_a_lamp(white))).unwrap();
        let view = looking([0.0, 0.6, 1.5], [0.0, 0.0, 0.0], 0.6);
        let options = RenderOptions { path: with_strategy(strategy, 1), seed, ..square(16, 1024) };
        let (picture, variance) = render(&world, &view, options);
        mean_of(&picture, &variance, 1024, 0)
    };
    let [spot, patch] = [SPOT, PATCH].map(|white| run(white, Strategy::Light, 1));
    let bsdf = run(SPOT, Strategy::Bsdf, 2);
    let error = spot.1.hypot(bsdf.1);
    assert!(error < 0.2 * bsdf.0, "{spot:?} {bsdf:?}");
    assert!((spot.0 - bsdf.0).abs() < 4.0 * error, "{spot:?} {bsdf:?}");
    // Beside light that the probes meet, it is found less often.
    let both = run(&[SPOT, PATCH].concat(), Strategy::Light, 3);
    let error = both.1.hypot(spot.1).hypot(patch.1);
    assert!(error < 0.5 * spot.0, "{both:?} {spot:?} {patch:?}");
    assert!((both.0 - spot.0 - patch.0).abs() < 4.0 * error, "{both:?} {spot:?} {patch:?}");
}

/// A texel whose share of the mean 8 bits do not hold.
#[test]
fn a_lamp_with_one_white_texel_of_many_gives_light() {
    let spot = 256 * 81 + 163;
    let world = |white: &[usize]| World::new(Parts::from_scene(&under_a_lamp_of(256, white))).unwrap();
    assert!(!world(&[spot]).lights.is_dark() && world(&[]).lights.is_dark());
    // The power of its two triangles together: one texel of the unit square sends 1000 to both sides.
    let power: f32 = world(&[spot]).lights.weights().iter().sum();
    let expected = 2.0 * std::f32::consts::PI * 1000.0 / 65536.0;
    assert!((power / expected - 1.0).abs() < 1e-5, "{power}, expected {expected}");
}

#[test]
fn a_lamp_whose_texture_is_black_gives_no_light() {
    let scene = under_a_lamp(&[]);
    let world = World::new(Parts::from_scene(&scene)).unwrap();
    assert!(world.lights.is_dark());
}

/// A ball with one texture for each kind of map.
fn mapped_ball() -> Scene {
    let map = |image: usize| Some(TextureSlot { image, ..slot() });
    let material = Material {
        emissive: [2.0; 3],
        base_color_texture: map(0),
        metallic_roughness_texture: map(1),
        normal_texture: map(2),
        emissive_texture: map(3),
        ..Material::clay()
    };
    let mut out = scene(shapes::uv_sphere(24, 12), material);
    out.images = (0..4).map(|i| dots(16, &[3 * i, 100 + i, 200])).collect();
    out
}

#[test]
fn edits_of_what_is_not_emitted_leave_the_lights_alone() {
    let view = looking([0.0, 0.0, 3.0], [0.0; 3], 0.7);
    let picture = |world: &World| render(world, &view, square(8, 4)).0.data;
    let parts = || {
        let environment = Some(EnvironmentMap::constant(Vec3f::splat(1.0)));
        Parts { environment, ..Parts::from_scene(&mapped_ball()) }
    };
    let mut world = World::new(parts()).unwrap();
    let texels: Vec<[f32; 4]> = (0..256).map(|i| [0.5, 0.4, 0.3 + 0.001 * i as f32, 1.0]).collect();
    for (map, shines) in [
        (MapKind::BaseColor, false),
        (MapKind::MetallicRoughness, false),
        (MapKind::Normal, false),
        (MapKind::Emissive, true),
    ] {
        let before = (world.lights.table(), picture(&world));
        let texture = world.library().and_then(|l| l.texture_of(0, map)).unwrap();
        world.set_texels(texture, &texels).unwrap();
        assert_eq!(before.0 != world.lights.table(), shines, "{map:?}");
        assert!(before.1 != picture(&world), "{map:?}");
    }
    // As in a world that is built with all of them.
    let mut new = parts();
    let library = new.library.as_mut().unwrap();
    (0..4).for_each(|texture| library.set_texels(texture, &texels));
    assert!(picture(&world) == picture(&World::new(new).unwrap()), "texels");
    for (value, values, shines) in [
        (MaterialValue::Roughness, &[0.4][..], false),
        (MaterialValue::BaseColor, &[0.4; 3], false),
        (MaterialValue::Emissive, &[0.5, 1.0, 3.0], true),
    ] {
        let table = world.lights.table();
        world.set_parameter(&Parameter::Material { materials: vec![0], value }, values).unwrap();
        assert_eq!(table != world.lights.table(), shines, "{value:?}");
    }
    let mut new = parts();
    let library = new.library.as_mut().unwrap();
    (0..4).for_each(|texture| library.set_texels(texture, &texels));
    let mut factors = library.factors(0);
    (factors.roughness, factors.base_color, factors.emissive) = (0.4, Vec3f::splat(0.4), vec3(0.5, 1.0, 3.0));
    library.set_factors(0, &factors);
    assert!(picture(&world) == picture(&World::new(new).unwrap()), "factors");
}
