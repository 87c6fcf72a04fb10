//! Levels of procedural shapes that become coarser ones.

use super::*;
use crate::engine::asset::bits;
use photofit_geometry::decimate::{Options, Target, decimate};
use photofit_geometry::normals::mesh_normals;
use photofit_geometry::{Mesh, shapes};
use photofit_scene::{Instance, Material, Primitive};
use std::collections::{HashMap, HashSet};

/// A quarter of a pixel of shapes of diameter 2 that are 64 pixels large.
const QUARTER: f32 = 0.25 * 2.0 / 64.0;

fn decimated(mesh: &Mesh, triangles: usize) -> Mesh {
    let group = vec![0; mesh.triangles.len()];
    with_normals(decimate(mesh, &group, &[], &Options::new(Target::Triangles(triangles))).unwrap().mesh)
}

fn with_normals(mesh: Mesh) -> Mesh {
    Mesh {
        normals: mesh_normals(&mesh),
        positions: mesh.positions,
        triangles: mesh.triangles,
        ..Mesh::default()
    }
}

/// A level as it is read, with a primitive for each mesh.
fn level(meshes: &[Mesh]) -> Scene {
    let material = |k: usize| Material { name: format!("part {k}"), ..Material::clay() };
    let primitive = |(k, mesh): (usize, &Mesh)| Primitive { mesh: mesh.clone(), material: k };
    let instance = |primitive| Instance { primitive, transform: glam::Affine3A::IDENTITY };
    let scene = Scene {
        primitives: meshes.iter().enumerate().map(primitive).collect(),
        instances: (0..meshes.len()).map(instance).collect(),
        materials: (0..meshes.len()).map(material).collect(),
        ..Scene::default()
    };
    read(&scene)
}

/// The scene through a file.
fn read(scene: &Scene) -> Scene {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("level.glb");
    photofit_scene::save_glb(&path, scene).unwrap();
    photofit_scene::load(&path).unwrap()
}

/// Every triangle with vertices of its own.
fn unwelded(mesh: &Mesh) -> Mesh {
    let corners = || mesh.triangles.as_flattened().iter().map(|v| *v as usize);
    Mesh {
        positions: corners().map(|v| mesh.positions[v]).collect(),
        normals: corners().map(|v| mesh.normals[v]).collect(),
        triangles: (0..mesh.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        ..Mesh::default()
    }
}

/// Distance of points from the surface of a mesh.
fn farthest(points: impl Iterator<Item = Vec3f>, mesh: &Mesh) -> f32 {
    let accel = accel(&mesh.positions, &mesh.triangles).unwrap();
    points.map(|p| accel.closest_point(p, f32::INFINITY).unwrap().distance).fold(0.0, f32::max)
}

/// Positions of a primitive at weight 1.
fn moved(level: &Scene, moves: &Moves, primitive: usize) -> Vec<Vec3f> {
    let positions = level.primitives[primitive].mesh.positions.iter();
    positions.zip(&moves.targets[primitive].positions).map(|(p, d)| *p + *d).collect()
}

#[test]
fn a_rock_comes_onto_the_next_level_and_no_triangle_turns_over() {
    let whole = shapes::displaced_sphere(10, 0.25, 4, 3);
    let fine = decimated(&whole, 600);
    let (fine, coarse) = (level(std::slice::from_ref(&fine)), level(&[decimated(&fine, 150)]));
    let made = moves(&fine, &coarse, QUARTER).unwrap();
    let (before, after) = (made.before, made.after);
    assert!(after.mean < 0.6 * before.mean, "{before:?} {after:?}");
    assert!(after.mean_back < 0.75 * before.mean_back, "{before:?} {after:?}");
    assert!(
        after.largest < before.largest && after.largest_back < before.largest_back,
        "{before:?} {after:?}"
    );
    assert_eq!(made.turned, 0);
    assert!(made.flattened < fine.triangle_count() / 10, "{}", made.flattened);
    // A level that is the next one stays where it is.
    let still = moves(&coarse, &coarse, QUARTER).unwrap();
    assert!(still.targets[0].positions.iter().all(|d| *d == Vec3f::zero()));
    assert!(still.targets[0].normals.iter().all(|d| d.length() < 1e-3));
}

#[test]
fn vertices_that_share_a_position_move_alike() {
    let whole = shapes::displaced_sphere(8, 0.25, 4, 3);
    let fine = decimated(&whole, 400);
    let coarse = decimated(&fine, 100);
    // Halves with materials of their own, every triangle apart.
    let halves = [true, false].map(|upper| {
        let up = |t: &&[u32; 3]| t.iter().all(|v| fine.positions[*v as usize].y > 0.0) == upper;
        let triangles = fine.triangles.iter().filter(up).copied().collect();
        unwelded(&Mesh { triangles, ..fine.clone() })
    });
    let (fine, coarse) = (level(&halves), level(&[coarse]));
    let made = moves(&fine, &coarse, QUARTER).unwrap();
    let mut of = HashMap::new();
    let mut shared = 0;
    for (p, target) in fine.primitives.iter().zip(&made.targets) {
        for (at, d) in p.mesh.positions.iter().zip(&target.positions) {
            let known = *of.entry(bits(*at)).or_insert(*d);
            shared += usize::from(bits(known) == bits(*d));
        }
    }
    assert_eq!(shared, 3 * fine.triangle_count());
    assert!(made.after.mean < 0.6 * made.before.mean, "{:?} {:?}", made.before, made.after);
}

/// A square with a hole in its middle.
fn plate(cells: u32) -> Mesh {
    let mut mesh = shapes::quad_grid(cells, cells);
    let middle = |t: &[u32; 3]| {
        let p = t.iter().fold(Vec3f::zero(), |s, v| s + mesh.positions[*v as usize]) * (1.0 / 3.0);
        p.x.abs() < 0.5 && p.y.abs() < 0.5
    };
    mesh.triangles.retain(|t| !middle(t));
    // Bent, so that there is something to come onto.
    mesh.positions.iter_mut().for_each(|p| p.z = 0.3 * (1.0 - p.x * p.x));
    with_normals(mesh)
}

#[test]
fn borders_stay_borders_and_vertices_that_stay_stay_to_the_bit() {
    let (fine, coarse) = (level(&[plate(16)]), level(&[plate(4)]));
    let made = moves(&fine, &coarse, QUARTER).unwrap();
    let there: HashSet<_> = coarse.primitives[0].mesh.positions.iter().map(|p| bits(*p)).collect();
    let mesh = &fine.primitives[0].mesh;
    let at = moved(&fine, &made, 0);
    let mut kept = 0;
    for (p, d) in mesh.positions.iter().zip(&made.targets[0].positions) {
        if there.contains(&bits(*p)) {
            assert_eq!(*d, Vec3f::zero());
            kept += 1;
        }
    }
    assert!(kept >= 16, "{kept}");
    // The border of the square and that of the hole run along those of the next level.
    let used: HashSet<u32> = mesh.triangles.iter().flatten().copied().collect();
    let on = |p: &Vec3f, r: f32| (p.x.abs().max(p.y.abs()) - r).abs() < 1e-6;
    let mut counts = [0, 0];
    for v in used.iter().map(|v| *v as usize) {
        for (k, r) in [1.0, 0.5].into_iter().enumerate() {
            if on(&mesh.positions[v], r) {
                assert!(on(&at[v], r), "{:?} goes to {:?}", mesh.positions[v], at[v]);
                counts[k] += 1;
            }
        }
    }
    assert_eq!(counts, [64, 32]);
    assert!(made.after.largest < 1e-3 && made.before.largest > 5e-3, "{:?} {:?}", made.before, made.after);
    assert_eq!(made.turned, 0);
}

#[test]
fn borders_find_a_border_that_is_divided_more_finely() {
    // Farther than a segment of the next level is long, nearer than one of this level.
    let mut wide = shapes::quad_grid(32, 32);
    wide.positions.iter_mut().for_each(|p| *p *= 1.1);
    let (fine, coarse) = (level(&[shapes::quad_grid(4, 4)]), level(&[wide]));
    let made = moves(&fine, &coarse, QUARTER).unwrap();
    let mesh = &fine.primitives[0].mesh;
    let border = |p: &Vec3f, r: f32| (p.x.abs().max(p.y.abs()) - r).abs() < 1e-5;
    let moved = moved(&fine, &made, 0);
    let of_border: Vec<_> = mesh.positions.iter().zip(&moved).filter(|(p, _)| border(p, 1.0)).collect();
    assert_eq!(of_border.len(), 16);
    assert!(of_border.iter().all(|(_, at)| border(at, 1.1)), "{of_border:?}");
}

#[test]
fn layers_and_the_sides_of_thin_parts_are_not_confused() {
    let sphere = |radius: f32, frequency: u32| {
        let mut mesh = shapes::icosphere(frequency);
        mesh.positions.iter_mut().for_each(|p| *p *= radius);
        mesh
    };
    // The next level's faces of the outer sphere lie inside of the inner one.
    let (outer, inner) = (sphere(1.02, 8), sphere(1.0, 8));
    let [below, within] = [sphere(1.02, 3), sphere(1.0, 3)];
    let (fine, coarse) = (level(&[outer, inner]), level(&[below.clone(), within.clone()]));
    let made = moves(&fine, &coarse, QUARTER).unwrap();
    for (k, (own, other)) in [(&below, &within), (&within, &below)].into_iter().enumerate() {
        let confused = |p: &Vec3f| farthest([*p].into_iter(), other) < farthest([*p].into_iter(), own);
        let at = moved(&fine, &made, k);
        assert!(!at.iter().any(confused), "sphere {k}");
        assert!(farthest(at.into_iter(), own) < 0.009, "sphere {k}");
    }
    // A lens that is thinner than its triangles.
    let mut lens = shapes::uv_sphere(24, 12);
    lens.positions.iter_mut().for_each(|p| p.y *= 0.02);
    let lens = with_normals(lens);
    let (fine, coarse) = (level(std::slice::from_ref(&lens)), level(&[decimated(&lens, 80)]));
    let made = moves(&fine, &coarse, QUARTER).unwrap();
    let above = |p: &Vec3f| if p.y.abs() > 0.008 { p.y.signum() } else { 0.0 };
    let sides = lens.positions.iter().zip(moved(&fine, &made, 0));
    let sides: Vec<(f32, f32)> = sides.map(|(p, to)| (above(p), to.y)).filter(|(s, _)| *s != 0.0).collect();
    assert!(sides.len() > 100 && sides.iter().all(|(side, y)| side * y > 0.0), "{sides:?}");
}

#[test]
fn a_part_that_the_next_level_lacks_shrinks_to_a_point_of_it() {
    let ball = shapes::icosphere(6);
    let mut knob = shapes::cube();
    knob.positions.iter_mut().for_each(|p| *p = *p * 0.05 + vec3(1.2, 0.0, 0.0));
    let (fine, coarse) = (level(&[ball, knob]), level(&[shapes::icosphere(3)]));
    let made = moves(&fine, &coarse, QUARTER).unwrap();
    let knob = moved(&fine, &made, 1);
    assert!(knob.iter().all(|p| (*p - knob[0]).length() < 1e-6), "{knob:?}");
    assert!(farthest(knob.into_iter(), &coarse.primitives[0].mesh) < 1e-6);
    assert_eq!((made.turned, made.flattened >= 12), (0, true));
}

#[test]
fn normals_become_those_of_the_next_level() {
    let (fine, coarse) = (level(&[shapes::icosphere(6)]), level(&[shapes::cube()]));
    let made = moves(&fine, &coarse, QUARTER).unwrap();
    let flat = |n: &Vec3f| n.x.abs().max(n.y.abs()).max(n.z.abs()) > 0.999;
    let normals = fine.primitives[0].mesh.normals.iter().zip(&made.targets[0].normals);
    let normals: Vec<Vec3f> = normals.map(|(n, d)| *n + *d).collect();
    assert!(normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-4));
    assert!(normals.iter().all(flat), "the faces of a cube");
    assert!(fine.primitives[0].mesh.normals.iter().filter(|n| flat(n)).count() < 40);
    // The corners of the cube draw vertices, unless they may be missed.
    let loose = moves(&fine, &coarse, 10.0).unwrap();
    let (near, far) = (made.after.largest_back, loose.after.largest_back);
    assert!(near < 0.6 * far, "{near} {far}");
}

#[test]
fn the_target_is_read_back_and_normals_are_taken_where_they_help() {
    let whole = shapes::displaced_sphere(8, 0.25, 4, 3);
    let fine = decimated(&whole, 400);
    let (fine, coarse) = (level(std::slice::from_ref(&fine)), level(&[decimated(&fine, 100)]));
    for helps in [true, false] {
        let better = |scene: &Scene| {
            let normals = scene.primitives[0].mesh.normals.iter().zip(&fine.primitives[0].mesh.normals);
            let moves_normals = normals.into_iter().any(|(a, b)| a.dot(*b) < 0.99);
            let flip = if moves_normals == helps { 0.1 } else { 0.2 };
            Ok(Popping { flip, outline: 0.0 })
        };
        let (scene, blend) = blend((&fine, &coarse), "lod1", [64.0, 32.0], QUARTER, &better).unwrap();
        assert_eq!((blend.normals, blend.target.as_str()), (helps, "lod1"));
        assert!((blend.popping.flip - 0.1).abs() < 1e-12 && blend.sizes == [64.0, 32.0]);
        let scene = read(&scene);
        let mesh = &scene.hierarchy.as_ref().unwrap().meshes[0];
        assert_eq!((mesh.targets(), mesh.target_names().collect::<Vec<_>>()), (1, vec!["lod1"]));
        let [rest, was] = [&scene, &fine].map(|s| &s.primitives[0].mesh);
        assert!(
            rest.positions == was.positions && rest.triangles == was.triangles,
            "at rest it is the level"
        );
        let next = &coarse.primitives[0].mesh;
        let mut last = f32::INFINITY;
        for weight in [0.0, 0.5, 1.0] {
            let at = weighted(&scene, weight);
            let triangles = &at.primitives[0].mesh.triangles;
            let (_, mean) = distance(
                (&at.primitives[0].mesh.positions, triangles),
                &accel(&next.positions, &next.triangles).unwrap(),
            );
            assert!((mean as f32) < 0.9 * last, "{weight}: {mean}");
            last = mean as f32;
        }
    }
}

#[test]
fn one_part_of_the_next_level_may_stand_for_many() {
    let boxes: Vec<Mesh> = (0..8)
        .map(|k| {
            let sign = |bit: u32| if k >> bit & 1 == 1 { 0.6 } else { -0.6 };
            let mut mesh = shapes::cube();
            mesh.positions.iter_mut().for_each(|p| *p = *p * 0.4 + vec3(sign(0), sign(1), sign(2)));
            mesh
        })
        .collect();
    let (fine, coarse) = (level(&boxes), level(&[shapes::icosphere(4)]));
    let made = moves(&fine, &coarse, QUARTER).unwrap();
    for k in 0..8 {
        let at = moved(&fine, &made, k);
        let widest = at.iter().map(|p| (*p - at[0]).length()).fold(0.0, f32::max);
        assert!(widest > 0.2, "box {k} shrinks to {widest}");
    }
}

#[test]
fn parts_that_are_far_from_any_other_take_no_search_of_all() {
    // Sheets that face up, over a floor that faces down: no triangle of one is what those of the other look for.
    let mut floor = shapes::quad_grid(40, 40);
    floor.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    floor.normals.iter_mut().for_each(|n| *n = -*n);
    let mut sheet = shapes::quad_grid(40, 40);
    sheet.positions.iter_mut().for_each(|p| p.z += 0.02);
    let (fine, coarse) = (level(&[sheet]), level(&[floor]));
    let made = moves(&fine, &coarse, QUARTER).unwrap();
    // They come onto it from whichever side.
    assert!(made.after.mean < 0.2 * made.before.mean, "{:?} {:?}", made.before, made.after);
}
