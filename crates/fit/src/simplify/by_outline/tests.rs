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

/// Means of what triangles far from the hole and those at it count.
fn outside_and_inside(mesh: &Mesh, weights: &[f32]) -> [f64; 2] {
    let radius = |t: usize| {
        let [a, b, c] = mesh.corners(t);
        ((a + b + c) * (1.0 / 3.0)).length()
    };
    let most = (0..weights.len()).map(radius).fold(0.0, f32::max);
    let mean = |of: &dyn Fn(f32) -> bool| {
        let of: Vec<f64> =
            (0..weights.len()).filter(|t| of(radius(*t))).map(|t| f64::from(weights[t])).collect();
        of.iter().sum::<f64>() / of.len() as f64
    };
    [mean(&|r| r > 0.85 * most), mean(&|r| r < 0.5 * most)]
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
    let [before, after] = [&visible, &counting].map(|w| {
        let [outside, inside] = outside_and_inside(&n.flat.mesh, w);
        outside / inside
    });
    assert!(after > 1.2 * before, "outside counts {after} of the hole, {before} where outlines do not count");
    let area = |w: &[f32]| -> f64 {
        let weighted = |(t, w): (usize, &f32)| f64::from(rays.area_normal(t as u32).length() * w);
        w.iter().enumerate().map(weighted).sum()
    };
    assert!((area(&counting) / area(&visible) - 1.0).abs() < 0.05, "the asset counts as before");
    let made = |importance: &[f32]| {
        decimate(&n.flat.mesh, &[], importance, &Options::new(Target::Triangles(500))).unwrap().mesh
    };
    let [plain, outlined] = [visible, counting].map(|w| made(&w));
    assert_eq!([plain.triangles.len(), outlined.triangles.len()], [500; 2], "the budget stays");
    assert_ne!(plain.positions, outlined.positions, "triangles went elsewhere");
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
    // Of what is tried the best one is taken: nearly all that a grey ball of few triangles lacks is its outline.
    let few = SimplifyOptions { target: Target::Triangles(64), ..options() };
    let (runs, why) = row_of(&of(shapes::icosphere(24), Material::clay()), &few);
    let numbers: Vec<f64> = why.split([' ', ':', ',']).filter_map(|w| w.parse().ok()).collect();
    let [plain, most, _, half, _, ref taken @ ..] = numbers[..] else { panic!("{why}") };
    let best = if most >= half { 0.9 } else { 0.5 };
    assert_eq!(runs == Runs::Yes, taken.first() == Some(&best), "{why}");
    assert!(runs == Runs::Yes || plain >= most.max(half), "{why}");
    assert!(runs == Runs::No || plain <= most.max(half), "{why}");
    let (runs, why) = row(&options());
    assert!(runs != Runs::Open && why.contains("of the squared error"), "{why}");
    let (runs, why) = row(&options().with_effort(Effort::Fast));
    assert!(runs == Runs::No && why.contains("fast"), "{why}");
    let (runs, why) = row(&SimplifyOptions { init: crate::simplify::Init::Sphere, ..options() });
    assert!(runs == Runs::No && why.contains("sphere"), "{why}");
    assert_eq!(planned(&options()).runs, Runs::Open, "before a picture is drawn");
}
