//! Grids of distances against the sphere that they stand for, and light that must not leak.

use super::scenes::{diffuse, glossy, looking, render, square};
use super::statistics::agree;
use crate::{EnvironmentMap, Material, Parts, RenderPlan, Shape, World, WorldOptions, WorldRay};
use glam::{DAffine3, DQuat, DVec3};
use photofit_sampling::{Rng, uniform_sphere};
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::graph::{SurfaceGraph, SurfaceNode, Texture};
use photofit_shading::bsdf::Energy;

/// Side of the grid, and the radius of the ball in the middle of the unit cube.
const SIDE: usize = 48;
const RADIUS: f64 = 0.4;

fn ball(smooth: bool) -> Shape {
    let last = (SIDE - 1) as f64;
    let at =
        |i: usize| DVec3::new((i % SIDE) as f64, (i / SIDE % SIDE) as f64, (i / SIDE / SIDE) as f64) / last;
    let distance = |i| (at(i).distance(DVec3::splat(0.5)) - RADIUS) as f32;
    Shape::DistanceGrid { size: [SIDE; 3], values: (0..SIDE * SIDE * SIDE).map(distance).collect(), smooth }
}

/// A world of one shape in a place.
fn world(shape: Shape, transform: DAffine3) -> World {
    let mut parts = Parts::default();
    parts.add(shape, Material::new(diffuse(0.5, 0.5, 0.5)));
    parts.instances[0].transform = transform;
    World::new(parts).unwrap()
}

/// Turned, mirrored, stretched and moved far off.
fn places() -> [DAffine3; 3] {
    let turn = DQuat::from_rotation_x(0.4) * DQuat::from_rotation_z(1.1);
    [
        DAffine3::IDENTITY,
        DAffine3::from_scale_rotation_translation(
            DVec3::new(2.0, -0.3, 0.7),
            turn,
            DVec3::new(0.1, 0.0, 0.2),
        ),
        DAffine3::from_translation(DVec3::new(1e6, -1e6, 5e5)),
    ]
}

#[test]
fn rays_meet_a_grid_where_its_sphere_is() {
    // Interpolation over a cell h is off by at most 3 h^2 / 8 over the radius; a gradient turns over half a cell.
    let h = 1.0 / (SIDE - 1) as f64;
    for (smooth, turned) in [(false, 0.75 * h / RADIUS), (true, 0.3 * h / RADIUS)] {
        let grid = world(ball(smooth), DAffine3::IDENTITY);
        let sphere =
            world(Shape::Sphere { center: Vec3f::splat(0.5), radius: RADIUS as f32 }, DAffine3::IDENTITY);
        let mut rng = Rng::new(5, 1);
        for _ in 0..20_000 {
            let of = |rng: &mut Rng| uniform_sphere([rng.next_f32(), rng.next_f32()]);
            let origin = Vec3f::splat(0.5) + of(&mut rng) * 3.0;
            let aim = Vec3f::splat(0.5) + of(&mut rng) * (0.9 * RADIUS as f32);
            let ray =
                WorldRay { origin, direction: (aim - origin).normalize_or_zero(), t_max: f32::INFINITY };
            let [a, b] = [&grid, &sphere].map(|w| w.point(&ray, &w.closest(&ray).expect("aims at it")));
            assert!(a.front && b.front);
            let off = f64::from((a.p - b.p).dot(b.ng)).abs();
            assert!(off < 0.375 * h * h / RADIUS + 1e-6, "{off}");
            let angle = f64::from(a.ns.cross(b.ns).length());
            assert!(angle < turned, "smooth {smooth}: {angle} above {turned}");
        }
        let away =
            WorldRay { origin: Vec3f::splat(2.0), direction: vec3(1.0, 0.0, 0.0), t_max: f32::INFINITY };
        assert!(grid.closest(&away).is_none() && !grid.occluded(&away));
    }
}

#[test]
fn points_seen_from_afar_lie_on_the_surface() {
    // A distance in single precision is off by .06 there, several cells.
    let world = world(ball(false), DAffine3::IDENTITY);
    let mut rng = Rng::new(8, 2);
    let h = 1.0 / (SIDE - 1) as f64;
    for _ in 0..2000 {
        let away = uniform_sphere([rng.next_f32(), rng.next_f32()]);
        let origin = Vec3f::splat(0.5) + away * 1e6;
        let ray = WorldRay { origin, direction: -away, t_max: f32::INFINITY };
        // Rounding of the direction moves the ray by as much.
        let Some(hit) = world.closest(&ray) else { continue };
        let at = world.point(&ray, &hit);
        let radius = f64::from((at.p - Vec3f::splat(0.5)).length());
        assert!((radius - RADIUS).abs() < 0.375 * h * h / RADIUS + 1e-6, "{radius}");
        // What leaves does not meet the surface at once.
        assert!(!world.occluded(&at.leave(at.ng, f32::INFINITY)));
        assert!(world.closest(&at.leave(-at.ng, f32::INFINITY)).is_some_and(|h| !h.front));
    }
}

/// Rays of `count` that leave the ball: chains of reflections from inside.
fn leaks(count: u32, smooth: bool, transform: DAffine3) -> u32 {
    let world = world(ball(smooth), transform);
    let start = world.to_render(transform.transform_point3(DVec3::splat(0.5)));
    let mut rng = Rng::new(3, 1);
    let (mut lost, mut origin) = (0, start);
    for i in 0..count {
        if i % 8 == 0 {
            origin = start;
        }
        let direction = uniform_sphere([rng.next_f32(), rng.next_f32()]);
        let ray = WorldRay { origin, direction, t_max: f32::INFINITY };
        let Some(hit) = world.closest(&ray) else {
            lost += 1;
            origin = start;
            continue;
        };
        let at = world.point(&ray, &hit);
        lost += u32::from(hit.front) + u32::from(!world.occluded(&ray));
        origin = at.beside(-at.ng);
    }
    lost
}

#[test]
fn no_ray_leaves_a_closed_grid() {
    for transform in places() {
        for smooth in [false, true] {
            assert_eq!(leaks(1 << 16, smooth, transform), 0, "{transform:?}, smooth {smooth}");
        }
    }
}

#[test]
fn a_grid_is_drawn_as_the_sphere_it_stands_for() {
    // A glossy ball over a floor, beside a copy of itself, in light from one side.
    let picture = |shape: &dyn Fn() -> Shape, seed: u64| {
        let mut parts = Parts::default();
        let metal = || Material::new(glossy(0.8, 0.3, 1.0, Energy::default()));
        for x in [-0.6, 0.4] {
            let i = parts.add(shape(), metal());
            parts.instances[i].transform = DAffine3::from_translation(DVec3::new(x, 0.0, 0.0));
        }
        let floor = super::scenes::quad(vec3(-2.0, 0.1, -2.0), vec3(0.0, 0.0, 4.0), vec3(4.0, 0.0, 0.0));
        super::scenes::place(&mut parts, floor, Material::new(diffuse(0.6, 0.4, 0.3)));
        let sky = |_: usize, y: usize, c: usize| if y < 4 { [2.0, 1.5, 1.0][c] } else { 0.2 };
        parts.environment = Some(EnvironmentMap::new(photofit_image::Image::from_fn(16, 8, 3, sky)));
        let world = World::with_options(parts, WorldOptions::default()).unwrap();
        let view = looking([1.5, 1.6, 2.2], [0.4, 0.4, 0.4], 0.8);
        render(&world, &view, crate::RenderOptions { seed, ..square(16, 256) })
    };
    let sphere = || Shape::Sphere { center: Vec3f::splat(0.5), radius: RADIUS as f32 };
    let (a, b) = (picture(&|| ball(true), 1), picture(&sphere, 2));
    agree("grid and sphere", (&a.0, &a.1, 256), (&b.0, &b.1, 256));
}

/// A floor lit by a ball of radius [`RADIUS`] above it, and by a dim sky.
fn under(ball: Shape, material: Material, seed: u64) -> (photofit_image::Image, photofit_image::Image) {
    let mut parts = Parts::default();
    parts.add(ball, material);
    let floor = super::scenes::quad(vec3(-2.0, -0.2, -2.0), vec3(0.0, 0.0, 5.0), vec3(5.0, 0.0, 0.0));
    super::scenes::place(&mut parts, floor, Material::new(diffuse(0.6, 0.4, 0.3)));
    parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(0.2)));
    let world = World::new(parts).unwrap();
    let view = looking([1.8, 1.4, 2.4], [0.5, 0.3, 0.5], 0.8);
    render(&world, &view, crate::RenderOptions { seed, ..square(16, 256) })
}

#[test]
fn a_grid_that_glows_lights_what_its_sphere_does() {
    let lamp = || Material::new(diffuse(0.2, 0.2, 0.2)).emitting(vec3(2.0, 1.5, 1.0));
    let sphere = Shape::Sphere { center: Vec3f::splat(0.5), radius: RADIUS as f32 };
    let (a, b) = (under(ball(true), lamp(), 1), under(sphere, lamp(), 2));
    agree("a glowing grid and its sphere", (&a.0, &a.1, 256), (&b.0, &b.1, 256));
    let dark = under(ball(true), Material::new(diffuse(0.2, 0.2, 0.2)), 1).0;
    let sum = |i: &photofit_image::Image| i.data.iter().sum::<f32>();
    assert!(sum(&a.0) > 1.5 * sum(&dark), "it gives light: {} {}", sum(&a.0), sum(&dark));
}

#[test]
fn a_grid_is_as_thin_as_its_mask_says() {
    let masked = |opacity: f32| {
        let inner = Box::new(SurfaceNode::Constant(diffuse(0.9, 0.1, 0.1)));
        let root = SurfaceNode::Mask { opacity: Texture::number(opacity), inner };
        Material::from_graph(SurfaceGraph { root, emission: None })
    };
    // Coverage of spheres is looked up on triangles.
    let mesh = || {
        let mut mesh = photofit_geometry::shapes::icosphere(40);
        for p in &mut mesh.positions {
            *p = p.normalize_or_zero() * (RADIUS as f32) + Vec3f::splat(0.5);
        }
        mesh.normals = mesh.positions.iter().map(|p| (*p - Vec3f::splat(0.5)).normalize_or_zero()).collect();
        Shape::Mesh(mesh)
    };
    let (a, b) = (under(ball(true), masked(0.4), 1), under(mesh(), masked(0.4), 2));
    agree("a thin grid and its sphere", (&a.0, &a.1, 256), (&b.0, &b.1, 256));
    // The more it covers, the redder the picture.
    let red = |opacity| {
        let picture = under(ball(true), masked(opacity), 1).0;
        let sum = |c: usize| picture.data.iter().skip(c).step_by(4).sum::<f32>();
        sum(0) / sum(1)
    };
    let [open, thin, solid] = [0.0, 0.4, 1.0].map(red);
    assert!(1.02 * open < thin && 1.02 * thin < solid, "{open} {thin} {solid}");
}

#[test]
fn grids_run_where_they_are_and_bad_ones_are_refused() {
    let environment = Some(EnvironmentMap::constant(Vec3f::splat(1.0)));
    let mut parts = Parts { environment, ..Parts::default() };
    parts.add(ball(true), Material::new(diffuse(0.5, 0.5, 0.5)));
    let world = World::new(parts).unwrap();
    assert!(
        RenderPlan::new(&world).to_string().contains("two-level traversal    runs"),
        "{}",
        RenderPlan::new(&world)
    );
    assert!(world.pieces() > 1000 && world.bytes() > 4 * SIDE * SIDE * SIDE);
    let fails = |values: Vec<f32>| {
        let mut parts = Parts::default();
        parts.add(
            Shape::DistanceGrid { size: [2; 3], values, smooth: true },
            Material::new(diffuse(0.5, 0.5, 0.5)),
        );
        World::new(parts).unwrap_err().to_string()
    };
    assert_eq!(fails(vec![1.0; 7]), "shape 0: there are 7 values; there must be 8, one a sample");
    assert!(fails(vec![f32::INFINITY; 8]).contains("value 0 is inf; it must be finite"));
}
