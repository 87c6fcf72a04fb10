//! The scenes of the suite, and where they are seen from.

use anyhow::Result;
use glam::{DVec3, Vec3};
use photofit_geometry::shapes;
use photofit_image::Image;
use photofit_pathtrace::{EnvironmentMap, LightSource, Material, Parts, Shape, View, World};
use photofit_sampling::Rng;
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::Camera;
use photofit_shading::Surface;
use photofit_shading::bsdf::{Bsdf, Diffuse, Energy, MetallicRoughness};

use super::Case;

/// Scenes whose light comes by ways that light sampling does not know.
pub(super) fn indirect() -> Result<Vec<Case>> {
    Ok(vec![
        ("room lit through a gap".into(), rooms()?, inside()),
        ("glossy room through a gap".into(), glossy_rooms()?, inside()),
        ("hall under a shelf".into(), hall()?, into_the_hall()),
        ("lamp behind a door".into(), door()?, beside_the_door()),
        ("lamp round a corner".into(), corridor()?, into_the_corridor()),
        ("room full of stones".into(), stones()?, inside()),
    ])
}

/// Scenes under a sky.
pub(super) fn open() -> Result<Vec<Case>> {
    Ok(vec![
        ("softboxes".into(), outdoors(softboxes())?, above()),
        ("small sun".into(), outdoors(sun())?, above()),
    ])
}

fn quad(corner: Vec3f, a: Vec3f, b: Vec3f) -> Shape {
    Shape::Mesh(shapes::parallelogram(corner, a, b))
}

fn grey(v: f32) -> Material {
    Material::new(Bsdf::Diffuse(Diffuse { reflectance: Vec3f::splat(v) }))
}

fn metal(roughness: f32) -> Material {
    let surface = Surface { base_color: Vec3f::splat(0.8), roughness, metallic: 1.0, gamma: 0.0 };
    Material::new(Bsdf::MetallicRoughness(MetallicRoughness::new(&surface, Energy::Compensated)))
}

/// A closed room under an even sky that is seen through one gap in its far wall.
fn two_rooms() -> Parts {
    let sky = Some(EnvironmentMap::constant(Vec3f::splat(10.0)));
    let mut parts = Parts { environment: sky, ..Parts::default() };
    let (x, y, z) = (vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0), vec3(0.0, 0.0, 1.0));
    let o = vec3(-1.0, 0.0, -0.5);
    for (corner, a, b) in [
        (o, z, x * 2.0),
        (o + y, x * 2.0, z),
        (o, x * 2.0, y),
        (o + z, y, x * 2.0),
        (o + x * 2.0, z, y),
        // The far wall around the gap.
        (o, y * 0.3, z),
        (o + y * 0.7, y * 0.3, z),
        (o + y * 0.3, y * 0.4, z * 0.3),
        (o + y * 0.3 + z * 0.7, y * 0.4, z * 0.3),
    ] {
        parts.add(quad(corner, a, b), grey(0.5));
    }
    parts
}

fn rooms() -> Result<World> {
    Ok(World::new(two_rooms())?)
}

fn glossy_rooms() -> Result<World> {
    let mut parts = two_rooms();
    parts.add(Shape::Sphere { center: vec3(0.6, 0.25, -0.1), radius: 0.25 }, metal(0.3));
    Ok(World::new(parts)?)
}

/// The room with a heap of rough stones in it, 768,000 triangles: paths cost what they cost in scenes with detail.
fn stones() -> Result<World> {
    let mut parts = two_rooms();
    let mut rng = Rng::new(5, 0);
    for seed in 0..24 {
        let center = vec3(rng.uniform(-0.6, 0.9), rng.uniform(0.05, 0.35), rng.uniform(-0.4, 0.2));
        let radius = rng.uniform(0.07, 0.14);
        let mut stone = shapes::displaced_sphere(40, 0.3, 6, seed);
        stone.positions.iter_mut().for_each(|p| *p = center + *p * radius);
        parts.add(Shape::Mesh(stone), grey(0.5));
    }
    Ok(World::new(parts)?)
}

fn inside() -> View {
    let eye = Vec3::new(0.15, 0.5, 0.4);
    View::pinhole(&Camera::look_at(eye, Vec3::new(0.9, 0.4, -0.3), Vec3::Y, 1.2, 1.0, 0.01, 10.0))
}

fn outdoors(sky: EnvironmentMap) -> Result<World> {
    let mut parts = Parts { environment: Some(sky), ..Parts::default() };
    parts.add(quad(vec3(-2.0, 0.0, -2.0), vec3(0.0, 0.0, 4.0), vec3(4.0, 0.0, 0.0)), grey(0.5));
    parts.add(Shape::Sphere { center: vec3(-0.4, 0.4, 0.0), radius: 0.4 }, grey(0.7));
    parts.add(Shape::Sphere { center: vec3(0.5, 0.4, 0.0), radius: 0.4 }, metal(0.4));
    Ok(World::new(parts)?)
}

fn above() -> View {
    View::pinhole(&Camera::look_at(
        Vec3::new(0.0, 1.2, 2.5),
        Vec3::new(0.0, 0.2, 0.0),
        Vec3::Y,
        0.8,
        1.0,
        0.01,
        10.0,
    ))
}

fn softboxes() -> EnvironmentMap {
    let boxes = |x: usize, y: usize| (8..14).contains(&y) && (x % 24 < 5);
    EnvironmentMap::new(Image::from_fn(64, 32, 3, |x, y, _| if boxes(x, y) { 8.0 } else { 0.2 }))
}

fn sun() -> EnvironmentMap {
    EnvironmentMap::new(Image::from_fn(256, 128, 3, |x, y, _| if (x, y) == (60, 34) { 2e4 } else { 0.3 }))
}

/// The six walls of a box from `o`, `size` along each axis.
fn walls(parts: &mut Parts, o: Vec3f, size: Vec3f, reflectance: f32) {
    let [x, y, z] = [vec3(size.x, 0.0, 0.0), vec3(0.0, size.y, 0.0), vec3(0.0, 0.0, size.z)];
    for (corner, a, b) in [(o, z, x), (o + y, x, z), (o, x, y), (o + z, y, x), (o + x, z, y), (o, y, z)] {
        parts.add(quad(corner, a, b), grey(reflectance));
    }
}

/// A closed hall with a lamp above a shelf: its light reaches the floor from ceiling and walls alone.
fn hall() -> Result<World> {
    let mut parts = Parts::default();
    walls(&mut parts, vec3(-1.0, 0.0, -1.0), vec3(2.0, 1.5, 2.0), 0.6);
    parts.add(quad(vec3(-0.5, 1.2, -0.5), vec3(1.0, 0.0, 0.0), vec3(0.0, 0.0, 1.0)), grey(0.5));
    let position = DVec3::new(0.0, 1.35, 0.0);
    parts.lights.push(LightSource::Point { position, intensity: Vec3f::splat(3.0) });
    parts.add(Shape::Sphere { center: vec3(0.5, 0.3, 0.3), radius: 0.3 }, metal(0.4));
    Ok(World::new(parts)?)
}

fn into_the_hall() -> View {
    let eye = Vec3::new(-0.9, 0.7, 0.9);
    View::pinhole(&Camera::look_at(eye, Vec3::new(0.3, 0.4, -0.2), Vec3::Y, 1.0, 1.0, 0.01, 10.0))
}

/// Two rooms with a door between them, and a ball that gives light in the other one, out of sight.
fn door() -> Result<World> {
    let mut parts = Parts::default();
    walls(&mut parts, vec3(-2.0, 0.0, -1.0), vec3(4.0, 1.2, 2.0), 0.7);
    let (y, z) = (vec3(0.0, 1.2, 0.0), vec3(0.0, 0.0, 1.0));
    // The wall beside the door and above it.
    parts.add(quad(vec3(0.0, 0.0, -1.0), y, z * 1.5), grey(0.7));
    parts.add(quad(vec3(0.0, 0.9, 0.5), vec3(0.0, 0.3, 0.0), z * 0.5), grey(0.7));
    let lamp = grey(0.0).emitting(Vec3f::splat(40.0));
    parts.add(Shape::Sphere { center: vec3(-1.2, 0.9, -0.5), radius: 0.1 }, lamp);
    parts.add(Shape::Sphere { center: vec3(1.2, 0.25, 0.2), radius: 0.25 }, metal(0.5));
    parts.add(Shape::Sphere { center: vec3(0.9, 0.2, -0.5), radius: 0.2 }, grey(0.5));
    Ok(World::new(parts)?)
}

fn beside_the_door() -> View {
    let eye = Vec3::new(0.2, 0.6, -0.9);
    View::pinhole(&Camera::look_at(eye, Vec3::new(1.4, 0.35, 0.3), Vec3::Y, 1.1, 1.0, 0.01, 10.0))
}

/// Two corridors side by side that join at one end, and a lamp at the far end of the other one.
fn corridor() -> Result<World> {
    let mut parts = Parts::default();
    walls(&mut parts, vec3(-1.0, 0.0, -4.0), vec3(4.0, 1.5, 5.0), 0.6);
    walls(&mut parts, vec3(0.15, -0.1, -4.1), vec3(1.8, 1.7, 4.05), 0.6);
    let lamp = grey(0.0).emitting(Vec3f::splat(40.0));
    parts.add(Shape::Sphere { center: vec3(2.5, 0.8, -3.4), radius: 0.15 }, lamp);
    parts.add(Shape::Sphere { center: vec3(-0.3, 0.3, -0.2), radius: 0.3 }, metal(0.45));
    Ok(World::new(parts)?)
}

fn into_the_corridor() -> View {
    let eye = Vec3::new(0.0, 0.8, 0.9);
    View::pinhole(&Camera::look_at(eye, Vec3::new(-0.2, 0.5, -2.0), Vec3::Y, 1.0, 1.0, 0.01, 10.0))
}
