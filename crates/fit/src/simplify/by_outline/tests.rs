//! Where triangles go when outlines count.

use super::super::tests::{of, options, rock};
use super::super::{Effort, simplify};
use super::*;
use crate::Silent;
use photofit_geometry::decimate::{Options, decimate};
use photofit_geometry::{Mesh, shapes};
use photofit_scene::Material;

/// A ring with bumps all over: those at its hole are hidden by it from most sides.
fn ring() -> Mesh {
    let mut ring = shapes::torus(160, 64, 1.0, 0.45);
    for (p, n) in ring.positions.iter_mut().zip(&ring.normals) {
        let bump = (11.0 * p.x).sin() * (13.0 * p.y).sin() * (12.0 * p.z + 0.5).sin();
        *p += *n * (0.06 * bump);
    }
    ring.normals = photofit_geometry::normals::mesh_normals(&ring);
    ring
}

/// Share of the triangles that lie at the hole.
fn at_the_hole(mesh: &Mesh) -> f64 {
    let radius = |t: usize| {
        let [a, b, c] = mesh.corners(t);
        let p = (a + b + c) * (1.0 / 3.0);
        // The hole is about the shortest axis of the box.
        let r = [p.x * p.x + p.y * p.y, p.y * p.y + p.z * p.z, p.z * p.z + p.x * p.x];
        r[axis(mesh)].sqrt()
    };
    let radii: Vec<f32> = (0..mesh.triangles.len()).map(radius).collect();
    let middle = 0.69;
    radii.iter().filter(|r| **r < middle * 0.75).count() as f64 / radii.len() as f64
}

/// Which pair of coordinates spans the plane of the ring.
fn axis(mesh: &Mesh) -> usize {
    let extent = |of: fn(&photofit_scalar::Vec3f) -> f32| {
        mesh.positions.iter().map(of).fold(0.0_f32, |m, x| m.max(x.abs()))
    };
    let sizes = [extent(|p| p.z), extent(|p| p.x), extent(|p| p.y)];
    (0..3).min_by(|a, b| sizes[*a].total_cmp(&sizes[*b])).unwrap_or(0)
}

#[test]
fn triangles_go_where_outlines_are_on_any_number_of_threads() {
    let scene = of(ring(), Material::clay());
    let n = Normalised::new(&scene).unwrap();
    let rays = n.surface().unwrap();
    let seen = prepare::visibility(&rays, &Silent).unwrap();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| density(&rays, 500, &Silent).unwrap())
    };
    let lengths = on(1);
    assert_eq!(lengths, on(4));
    let visible = prepare::importance(&n, &seen);
    let counting = importance(&rays, &visible, &lengths, 0.9);
    let made = |importance: &[f32]| {
        decimate(&n.flat.mesh, &[], importance, &Options::new(Target::Triangles(500))).unwrap().mesh
    };
    let [plain, outlined] = [visible, counting].map(|w| made(&w));
    assert_eq!([plain.triangles.len(), outlined.triangles.len()], [500; 2], "the budget stays");
    let [before, after] = [at_the_hole(&plain), at_the_hole(&outlined)];
    assert!(
        after < 0.9 * before,
        "{after} of the triangles at the hole, {before} where outlines do not count"
    );
}

#[test]
fn the_plan_tells_whether_outlines_count_and_why() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let row_of = |scene: &photofit_scene::Scene, options: &SimplifyOptions| {
        let outcome =
            simplify(scene, &path, &SimplifyOptions { steps: 0, ..options.clone() }, &Silent).unwrap();
        let rows = outcome.plan.items();
        let row = rows.iter().find(|i| i.what == ROW).expect("a row").clone();
        (row.runs, row.why)
    };
    let row = |options: &SimplifyOptions| row_of(&rock(), options);
    // Of what is tried the best one is taken.
    let few = SimplifyOptions { target: Target::Triangles(200), ..options() };
    let (runs, why) = row_of(&of(ring(), Material::clay()), &few);
    let numbers: Vec<f64> = why.split([' ', ':', ',']).filter_map(|w| w.parse().ok()).collect();
    let [plain, most, _, half, _, taken] = numbers[..] else { panic!("{why}") };
    assert!(runs == Runs::Yes && taken == if most >= half { 0.9 } else { 0.5 }, "{why}");
    assert!(most.max(half) > plain, "{why}");
    let (runs, why) = row(&options());
    assert!(runs != Runs::Open && why.contains("of the squared error"), "{why}");
    let (runs, why) = row(&options().with_effort(Effort::Fast));
    assert!(runs == Runs::No && why.contains("fast"), "{why}");
    let (runs, why) = row(&SimplifyOptions { init: Init::Sphere, ..options() });
    assert!(runs == Runs::No && why.contains("sphere"), "{why}");
    assert_eq!(planned(&options()).runs, Runs::Open, "before a picture is drawn");
}
