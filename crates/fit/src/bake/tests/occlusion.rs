//! Ambient occlusion by rays against closed forms.

use super::{World, moved, sheet, size};
use crate::bake::{BakeSettings, Baked, Occlusion, OcclusionRays};
use crate::visibility::Visibility;
use photofit_geometry::{Mesh, shapes};
use photofit_raster::channel;
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::{AlphaMode, Material};

/// Many rays, and a reach beyond which nothing lies.
const FAR: OcclusionRays = OcclusionRays { rays: 4096, reach: 1e4 };

fn settings(side: usize, rays: OcclusionRays) -> BakeSettings {
    BakeSettings { occlusion: Occlusion::Rays(rays), ..size(side) }
}

/// Occlusion of all texels of a floor over `[-1, 1]^2`, each with its centre.
fn on_floor(world: &World, triangles: usize, side: usize, rays: OcclusionRays) -> Vec<(f32, f32, f32)> {
    let seen = Visibility::everything(triangles);
    let baked = world.bake(&seen, &sheet(1), &settings(side, rays));
    assert!(baked.valid.iter().all(|v| *v));
    let centre = |k: usize| 2.0 * (k as f32 + 0.5) / side as f32 - 1.0;
    let texels = baked.maps.texels.iter().enumerate();
    texels.map(|(i, t)| (centre(i % side), -centre(i / side), t[channel::OCCLUSION])).collect()
}

fn turned(mesh: &Mesh, to: impl Fn(Vec3f) -> Vec3f) -> Mesh {
    let mut out = mesh.clone();
    out.positions.iter_mut().for_each(|p| *p = to(*p));
    out.normals.iter_mut().for_each(|n| *n = to(*n).normalize_or_zero());
    out
}

#[test]
fn a_wall_takes_half_of_one_minus_the_cosine() {
    // A wall at x = -1, one unit high and so wide that its ends do not matter, seen from the floor at distance d:
    // 1/2 (1 - d / sqrt(d^2 + 1)).
    let wall = turned(&shapes::quad_grid(1, 1), |p| vec3(p.z, 60.0 * p.x, 0.5 * p.y));
    let mut world = World::default();
    world.add(&sheet(1), Material::clay()).add(&moved(&wall, 1.0, vec3(-1.0, 0.0, 0.5)), Material::clay());
    let texels = on_floor(&world, 4, 8, FAR);
    for (x, y, open) in &texels {
        let d = x + 1.0;
        let expected = 1.0 - 0.5 * (1.0 - d / d.hypot(1.0));
        assert!((open - expected).abs() < 0.01, "at {x} {y}: {open}, expected {expected}");
    }
    let (least, most) = texels.iter().fold((1.0_f32, 0.0_f32), |(a, b), t| (a.min(t.2), b.max(t.2)));
    assert!(least < 0.6 && most > 0.9, "{least} {most}");
}

#[test]
fn a_sphere_takes_its_form_factor() {
    // A sphere of radius r, its centre at height h: r^2 h / (h^2 + d^2)^(3/2) at the distance d from the point below it.
    let (r, h) = (0.5_f32, 0.8_f32);
    let ball = moved(&shapes::icosphere(20), r, vec3(0.0, 0.0, h));
    let mut world = World::default();
    world.add(&sheet(1), Material::clay()).add(&ball, Material::clay());
    for (x, y, open) in on_floor(&world, 2 + ball.triangles.len(), 15, FAR) {
        let expected = 1.0 - r * r * h / (h * h + x * x + y * y).powf(1.5);
        assert!((open - expected).abs() < 0.01, "at {x} {y}: {open}, expected {expected}");
    }
}

#[test]
fn what_is_far_darkens_less() {
    // In the middle of a sphere of radius 1 every ray ends at distance 1; the diagonal of its box is sqrt(12).
    let ball = shapes::icosphere(12);
    let small = moved(&sheet(1), 0.02, Vec3f::zero());
    let mut world = World::default();
    world.add(&small, Material::clay()).add(&ball, Material::clay());
    let open = |reach: f32| {
        let seen = Visibility::everything(2 + ball.triangles.len());
        let rays = OcclusionRays { rays: 256, reach };
        let baked = world.bake(&seen, &small, &settings(2, rays));
        baked.maps.texels[0][channel::OCCLUSION]
    };
    let radius = 1.0 / 12_f32.sqrt();
    for (reach, expected) in [(2.0 * radius, 0.5), (4.0 * radius, 0.25), (0.9 * radius, 1.0), (1e4, 0.0)] {
        let found = open(reach);
        assert!((found - expected).abs() < 0.01, "{reach}: {found}, expected {expected}");
    }
}

#[test]
fn convex_bodies_are_not_occluded() {
    // Normals of so coarse a sphere lean far away from its faces.
    let ball = shapes::icosphere(2);
    let mut world = World::default();
    world.add(&ball, Material::clay());
    let target = super::patches(&ball);
    let seen = Visibility::everything(ball.triangles.len());
    let baked = world.bake(&seen, &target, &settings(64, OcclusionRays::default()));
    let open = |b: &Baked| {
        let of_valid = b.maps.texels.iter().zip(&b.valid).filter(|(_, v)| **v);
        of_valid.map(|(t, _)| t[channel::OCCLUSION]).fold(1.0, f32::min)
    };
    assert!(baked.statistics.valid_texels > 500);
    assert_eq!(open(&baked), 1.0);
}

#[test]
fn holes_and_glass_let_light_pass() {
    let roof = moved(&sheet(1), 3.0, vec3(0.0, 0.0, 0.3));
    let clear = Material { base_color: [1.0, 1.0, 1.0, 0.1], ..Material::clay() };
    for (mode, passes) in [
        (AlphaMode::Opaque, false),
        (AlphaMode::Mask { cutoff: 0.5 }, true),
        (AlphaMode::Mask { cutoff: 0.05 }, false),
        (AlphaMode::Blend, true),
    ] {
        let mut world = World::default();
        world.add(&sheet(1), Material::clay()).add(&roof, Material { alpha_mode: mode, ..clear.clone() });
        let rays = OcclusionRays { rays: 64, ..FAR };
        for (x, y, open) in on_floor(&world, 4, 4, rays) {
            assert_eq!(open > 0.999, passes, "{mode:?} at {x} {y}: {open}");
        }
    }
}

#[test]
fn the_setting_is_checked() {
    let mut world = World::default();
    world.add(&sheet(1), Material::clay());
    let bake = |rays: OcclusionRays| {
        let seen = Visibility::everything(2);
        let floor = sheet(1);
        let target = crate::bake::Target::new(&floor);
        world.with(|r| crate::bake::bake(r, &seen, &target, &settings(2, rays), &super::go_on)).err()
    };
    let text = |rays| bake(rays).map(|e| e.to_string()).unwrap_or_default();
    assert!(text(OcclusionRays { rays: 0, reach: 1.0 }).contains("occlusion rays is 0"));
    assert!(text(OcclusionRays { rays: 1, reach: f32::NAN }).contains("occlusion reach is NaN"));
    assert!(bake(OcclusionRays { rays: 1, reach: 1.0 }).is_none());
}
