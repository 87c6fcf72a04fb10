//! Instances, offsets, leaks, and what is refused.

use super::scenes::{cornell, cornell_view, diffuse, place, quad, render, square};
use super::statistics::agree;
use crate::{
    EnvironmentMap, Instance, LightSource, Material, Parts, PathtraceError, RenderOptions, Renderer, Shape,
    View, World, WorldOptions, WorldRay,
};
use glam::{DAffine3, DQuat, DVec3, Vec3};
use photofit_geometry::shapes;
use photofit_sampling::{Rng, uniform_sphere};
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::Camera;

#[test]
fn instances_look_like_copies() {
    let view = cornell_view();
    let make = |merge: bool| {
        let options = WorldOptions { merge, ..WorldOptions::default() };
        World::with_options(cornell(), options).unwrap()
    };
    let (merged, apart) = (make(true), make(false));
    assert_eq!((merged.entries(), apart.entries()), (1, 8));
    let options = |seed| RenderOptions { seed, ..square(24, 64) };
    let (a, b) = (render(&merged, &view, options(1)), render(&apart, &view, options(2)));
    agree("instances", (&a.0, &a.1, 64), (&b.0, &b.1, 64));
    // With the same random numbers nearly all paths are the same.
    let c = render(&apart, &view, options(1));
    let differ = a.0.data.iter().zip(&c.0.data).filter(|(x, y)| (*x - *y).abs() > 1e-3).count();
    assert!(differ * 50 < a.0.data.len(), "{differ} of {} values differ", a.0.data.len());
}

#[test]
fn mirrored_and_sheared_instances_keep_their_sides() {
    // A closed box of light-emitting walls: from inside one sees the front of each wall, or black.
    for transform in [
        DAffine3::IDENTITY,
        DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0)),
        DAffine3::from_scale_rotation_translation(
            DVec3::new(2.0, -0.3, 0.7),
            DQuat::from_rotation_x(0.4),
            DVec3::new(0.1, 0.0, 0.2),
        ),
    ] {
        for merge in [true, false] {
            for turn in [true, false] {
                let mut parts = Parts::default();
                let mut mesh = shapes::icosphere(3);
                if turn {
                    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
                }
                parts.add(
                    Shape::Mesh(mesh),
                    Material::new(diffuse(0.0, 0.0, 0.0)).emitting(Vec3f::splat(1.0)),
                );
                parts.instances[0].transform = transform;
                let world =
                    World::with_options(parts, WorldOptions { merge, ..WorldOptions::default() }).unwrap();
                let view = super::scenes::looking([0.1, 0.0, 0.2], [1.0, 0.3, -0.4], 1.5);
                let (picture, _) = render(&world, &view, square(8, 4));
                let expected = if turn { 1.0 } else { 0.0 };
                assert!(
                    picture.data.chunks(4).all(|p| p[0] == expected && p[3] == 1.0),
                    "{transform:?}, merged {merge}, turned {turn}: {:?}",
                    &picture.data[..4]
                );
            }
        }
    }
}

/// Leaks of `rays` rays from inside a closed mesh, through worlds with and without instancing, beside a far part if one is given.
fn leaks(rays: u64, mesh: &photofit_geometry::Mesh, offset: DVec3, merge: bool, far: Option<Vec3f>) -> u64 {
    let mut parts = Parts::default();
    parts.add(Shape::Mesh(mesh.clone()), Material::new(diffuse(0.5, 0.5, 0.5)));
    if let Some(at) = far {
        let quad = shapes::parallelogram(at, vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0));
        parts.add(Shape::Mesh(quad), Material::new(diffuse(0.5, 0.5, 0.5)));
    }
    let in_place = offset == DVec3::ZERO || merge;
    if !in_place {
        parts.instances[0].transform = DAffine3::from_translation(offset);
    } else if let Shape::Mesh(mesh) = &mut parts.shapes[0] {
        let shift = vec3(offset.x as f32, offset.y as f32, offset.z as f32);
        mesh.positions.iter_mut().for_each(|p| *p += shift);
    }
    let world = World::with_options(parts, WorldOptions { merge, ..WorldOptions::default() }).unwrap();
    let mut rng = Rng::new(3, offset.x.to_bits());
    let start = world.to_render(offset);
    let mut lost = 0;
    let mut ray = WorldRay { origin: start, direction: vec3(0.0, 0.0, 1.0), t_max: f32::INFINITY };
    for i in 0..rays {
        // Chains of reflections inside of the mesh: every second ray starts on the surface.
        if i % 8 == 0 {
            ray.origin = start;
        }
        ray.direction = uniform_sphere([rng.next_f32(), rng.next_f32()]);
        let hit = world.closest_where::<true>(&ray, |_| true);
        let Some(hit) = hit else {
            lost += 1;
            ray.origin = start;
            continue;
        };
        let at = world.interaction::<true>(&ray, &hit);
        let blocked = world.occluded_where::<true>(&ray, |_| true);
        // At an edge a point may lie on the plane of the next face, within its rounding, and meet that at once from
        // either side; nothing gets out there.
        let outside = hit.front && hit.t > at.rounding;
        lost += u64::from(!blocked) + u64::from(outside);
        // Leaves to the inside.
        ray.origin = at.beside(-at.ng);
    }
    lost
}

fn closed_meshes() -> Vec<(&'static str, photofit_geometry::Mesh)> {
    // Star-shaped around the origin, so that directions into the surface hit again at once: a bumpy sphere, a cube with
    // large triangles, and one with slivers.
    let mut sliver = shapes::uv_sphere(96, 3);
    sliver.uvs.clear();
    vec![
        ("bumpy", shapes::displaced_sphere(20, 0.1, 3, 1)),
        ("cube", shapes::cube()),
        ("icosphere", shapes::icosphere(8)),
        ("slivers", sliver),
    ]
}

fn check_leaks(rays: u64) {
    for (name, mesh) in closed_meshes() {
        for offset in [DVec3::ZERO, DVec3::new(1e6, -1e6, 5e5)] {
            for merge in [true, false] {
                // Vertices rounded at the offset no longer share a centre: only placed there do they keep their shape.
                if offset != DVec3::ZERO && merge && name != "cube" {
                    continue;
                }
                let lost = leaks(rays, &mesh, offset, merge, None);
                assert_eq!(lost, 0, "{name} at {offset}, merged {merge}: rays lost of {rays}");
            }
        }
        for far in [vec3(3.0, 511.3, 10.0), vec3(1e4, -3e4, 2e4)] {
            for merge in [true, false] {
                let lost = leaks(rays, &mesh, DVec3::ZERO, merge, Some(far));
                assert_eq!(lost, 0, "{name} beside {far:?}, merged {merge}: rays lost of {rays}");
            }
        }
    }
}

#[test]
fn closed_meshes_do_not_leak() {
    check_leaks(1 << 15);
}

#[test]
#[ignore = "slow: 2^24 rays"]
fn closed_meshes_do_not_leak_in_2_to_the_24_rays() {
    check_leaks(1 << 21);
}

#[test]
fn far_worlds_look_like_near_ones() {
    let shift = DVec3::new(1e6, -5e5, 2e6);
    let moved = || {
        let mut parts = cornell();
        for instance in &mut parts.instances {
            instance.transform = DAffine3::from_translation(shift) * instance.transform;
        }
        parts
    };
    let view = cornell_view();
    let far = View { eye: view.eye + shift, ..view };
    let near = render(&World::new(cornell()).unwrap(), &view, square(24, 64));
    let other = render(&World::new(moved()).unwrap(), &far, RenderOptions { seed: 7, ..square(24, 64) });
    agree("offset of 1e6", (&near.0, &near.1, 64), (&other.0, &other.1, 64));
}

#[test]
fn far_shapes_leave_near_light_as_it_is() {
    let scene = |far: Option<Vec3f>| {
        let mut parts = Parts::default();
        let mut flat = |corner: Vec3f, size: f32| {
            let quad = shapes::parallelogram(corner, vec3(0.0, 0.0, size), vec3(size, 0.0, 0.0));
            parts.add(Shape::Mesh(quad), Material::new(diffuse(0.5, 0.5, 0.5)));
        };
        flat(vec3(-2.0, 0.0, -2.0), 4.0);
        if let Some(at) = far {
            flat(at, 1.0);
        }
        let position = DVec3::new(0.3, 1.6, -0.4);
        parts.lights.push(LightSource::Point { position, intensity: Vec3f::splat(1.0) });
        World::new(parts).unwrap()
    };
    let view = {
        let eye = Vec3::new(0.0, 1.5, 3.0);
        View::pinhole(&Camera::look_at(eye, Vec3::ZERO, Vec3::Y, 1.0, 1.0, 0.01, 10.0))
    };
    let near = render(&scene(None), &view, square(16, 4)).0;
    for far in [vec3(3.0, 511.0, 10.0), vec3(3.0, -511.0, 10.0), vec3(2e3, 3e3, -1e3)] {
        let both = render(&scene(Some(far)), &view, square(16, 4)).0;
        assert!(both.data.iter().all(|v| v.is_finite()));
        let apart = near.data.iter().zip(&both.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let most = near.data.iter().copied().fold(0.0, f32::max);
        assert!(apart < 1e-4 * most, "{far:?}: {apart} of {most}");
    }
}

#[test]
fn thousands_of_copies_take_little_memory() {
    let mut parts = Parts::default();
    // 81920 / 8 triangles.
    parts.shapes.push(Shape::Mesh(shapes::icosphere(22)));
    parts.materials.push(Material::new(diffuse(0.5, 0.5, 0.5)));
    for i in 0..3000 {
        let at = DVec3::new(f64::from(i % 60) * 3.0, 0.0, f64::from(i / 60) * 3.0);
        parts.instances.push(Instance { shape: 0, material: 0, transform: DAffine3::from_translation(at) });
    }
    parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(1.0)));
    let world = World::new(parts).unwrap();
    assert!(world.pieces() > 3000 * 9000, "{}", world.pieces());
    assert!(world.bytes() < 100 << 20, "{} bytes", world.bytes());
    let (picture, _) =
        render(&world, &super::scenes::looking([90.0, 80.0, 200.0], [90.0, 0.0, 75.0], 0.9), square(16, 4));
    assert!(picture.is_finite() && picture.data[3] <= 1.0);
}

#[test]
fn bad_scenes_are_refused_with_the_place_and_the_rule() {
    let fails = |change: &dyn Fn(&mut Parts)| {
        let mut parts = cornell();
        change(&mut parts);
        World::new(parts).unwrap_err().to_string()
    };
    let contains = |text: String, words: &[&str]| {
        assert!(words.iter().all(|w| text.contains(w)), "{text:?} should say {words:?}");
    };
    let transform = |m: DAffine3| move |p: &mut Parts| p.instances[2].transform = m;
    contains(fails(&transform(DAffine3::from_scale(DVec3::ZERO))), &["instance 2", "scaled by 0"]);
    contains(
        fails(&transform(DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0)))),
        &["instance 2", "scaled by 0"],
    );
    contains(fails(&transform(DAffine3::from_translation(DVec3::NAN))), &["instance 2", "finite"]);
    contains(fails(&transform(DAffine3::from_translation(DVec3::splat(1e30)))), &["instance 2", "1e10"]);
    contains(fails(&|p| p.instances[1].shape = 99), &["instance 1", "shape 99"]);
    contains(fails(&|p| p.instances[1].material = 99), &["instance 1", "material 99"]);
    let vertex = |x: f32| {
        move |p: &mut Parts| {
            if let Shape::Mesh(m) = &mut p.shapes[1] {
                m.positions[2].x = x;
            }
        }
    };
    contains(fails(&vertex(f32::NAN)), &["shape 1", "vertex 2", "finite"]);
    contains(fails(&vertex(1e30)), &["shape 1", "vertex 2", "1e18"]);
    contains(fails(&|p| p.materials[0].emission.x = f32::NAN), &["material 0", "emission"]);
    contains(
        fails(&|p| p.shapes.push(Shape::Sphere { center: Vec3f::zero(), radius: -1.0 })),
        &["shape 7", "radius"],
    );
    let light = LightSource::Point { position: DVec3::NAN, intensity: Vec3f::splat(1.0) };
    contains(fails(&|p| p.lights.push(light.clone())), &["light 0", "position"]);
    let mut dark = Parts::default();
    place(
        &mut dark,
        quad(vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0)),
        Material::new(diffuse(1.0, 1.0, 1.0)),
    );
    let dark = World::new(dark).unwrap();
    let error = Renderer::new(&dark, &cornell_view(), square(4, 1)).unwrap_err();
    assert_eq!(error, PathtraceError::NoLight);
    let lit = World::new(cornell()).unwrap();
    let blind = View { half: [f32::NAN, 1.0], ..cornell_view() };
    contains(
        Renderer::new(&lit, &blind, square(4, 1)).unwrap_err().to_string(),
        &["camera", "field of view"],
    );
    assert!(Renderer::new(&lit, &cornell_view(), square(0, 1)).is_err());
}
