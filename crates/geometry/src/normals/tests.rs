//! Tests of this operation: known values, gradients, determinism.

use super::*;
use crate::shapes;
use crate::weld::Weld;
use photofit_gradcheck::{Uniform, check};
use photofit_scalar::vec3;

fn to_f64(positions: &[Vec3f]) -> Vec<Vec3<f64>> {
    positions.iter().map(|p| p.cast()).collect()
}

fn jittered_cube(seed: u64) -> (Incidence, Vec<Vec3<f64>>) {
    let cube = shapes::cube();
    let weld = weld_exact(&cube.positions);
    let mut rng = Uniform::new(seed);
    // Members of one weld move apart too: the gradient is taken with respect to every vertex on its own.
    let positions = to_f64(&cube.positions).iter().map(|p| p.map(|x| x + rng.range(-0.2, 0.2))).collect();
    (Incidence::new(&cube.triangles, &weld), positions)
}

#[test]
fn vjp_agrees_with_central_differences() {
    for weighting in [Weighting::Angle, Weighting::Area] {
        for scale in [1.0, 1e-6, 1e6] {
            let (incidence, positions) = jittered_cube(5);
            let positions: Vec<_> = positions.iter().map(|p| *p * scale).collect();
            let n = positions.len();
            let seeds = Uniform::new(9).vec(3 * n, -1.0, 1.0);
            let seeds: &[Vec3<f64>] = bytemuck::cast_slice(&seeds);
            let mut gradient = vec![Vec3::zero(); n];
            vertex_normals_vjp(&incidence, &positions, weighting, seeds, &mut gradient);
            let name = format!("{weighting:?} normals at scale {scale}");
            check(
                &name,
                bytemuck::cast_slice(&positions),
                bytemuck::cast_slice(&gradient),
                1e-5 * scale,
                1e-7,
                |x| {
                    let normals = vertex_normals(&incidence, bytemuck::cast_slice(x), weighting);
                    normals.iter().zip(seeds).map(|(n, g)| n.dot(*g)).sum()
                },
            );
        }
    }
}

#[test]
fn the_adjoint_accumulates() {
    let (incidence, positions) = jittered_cube(1);
    let seeds = vec![vec3(0.3, -0.2, 0.9); positions.len()];
    let mut once = vec![Vec3::zero(); positions.len()];
    vertex_normals_vjp(&incidence, &positions, Weighting::Angle, &seeds, &mut once);
    let mut twice = once.clone();
    vertex_normals_vjp(&incidence, &positions, Weighting::Angle, &seeds, &mut twice);
    assert!(once.iter().zip(&twice).all(|(a, b)| (*a * 2.0 - *b).length() < 1e-12));
}

#[test]
fn sphere_normals_point_outward() {
    let sphere = shapes::icosphere(12);
    let incidence = Incidence::new(&sphere.triangles, &weld_exact(&sphere.positions));
    for scale in [1e-20_f32, 1.0, 1e15] {
        let scaled: Vec<_> = sphere.positions.iter().map(|p| *p * scale).collect();
        for weighting in [Weighting::Angle, Weighting::Area] {
            let normals = vertex_normals(&incidence, &scaled, weighting);
            let worst =
                normals.iter().zip(&sphere.positions).map(|(n, p)| (*n - *p).length()).fold(0.0, f32::max);
            assert!(worst < 0.01, "{weighting:?} at {scale}: {worst}");
        }
    }
}

#[test]
fn seams_do_not_split_and_bad_faces_do_not_count() {
    let torus = shapes::torus(24, 12, 1.0, 0.4);
    let weld = weld_exact(&torus.positions);
    assert!(weld.count() < torus.positions.len(), "the torus has a uv seam");
    let incidence = Incidence::new(&torus.triangles, &weld);
    let normals = vertex_normals(&incidence, &torus.positions, Weighting::Angle);
    for (v, n) in normals.iter().enumerate() {
        assert_eq!(*n, normals[weld.first[weld.ids[v] as usize] as usize], "vertex {v}");
        assert!((*n - torus.normals[v]).length() < 0.05, "vertex {v}");
    }
    let mut positions = torus.positions.clone();
    positions.extend([vec3(f32::NAN, 0.0, 0.0), vec3(9.0, 9.0, 9.0)]);
    let mut triangles = torus.triangles.clone();
    let bad = torus.positions.len() as u32;
    triangles.extend([[0, 1, bad], [3, 3, 4], [5, 5, 5]]);
    let more = Incidence::new(&triangles, &weld_exact(&positions));
    let again = vertex_normals(&more, &positions, Weighting::Angle);
    assert_eq!(again[..normals.len()], normals);
    assert_eq!(again[normals.len()..], [Vec3::zero(); 2]);
    let mut d = vec![Vec3::zero(); positions.len()];
    vertex_normals_vjp(
        &more,
        &positions,
        Weighting::Angle,
        &vec![vec3(1.0, 0.5, 0.2); positions.len()],
        &mut d,
    );
    assert!(d.iter().all(|d| d.is_finite()));
}

#[test]
fn slivers_far_from_the_origin_stay_finite() {
    let offset = vec3(1e6_f32, -1e6, 1e6);
    let positions =
        [offset, offset + vec3(1.0, 0.0, 0.0), offset + vec3(0.5, 0.07, 0.0), offset + vec3(2.0, 0.0, 0.0)];
    let incidence = Incidence::new(&[[0, 1, 2], [0, 1, 3]], &Weld::identity(4));
    for weighting in [Weighting::Angle, Weighting::Area] {
        assert!(vertex_normals(&incidence, &positions, weighting).iter().all(|n| n.is_finite()));
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let sphere = shapes::displaced_sphere(40, 0.2, 4, 7);
    let incidence = Incidence::new(&sphere.triangles, &weld_exact(&sphere.positions));
    let seeds: Vec<Vec3f> = sphere.positions.iter().map(|p| vec3(p.y, p.z, p.x)).collect();
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut d = vec![Vec3::zero(); seeds.len()];
            vertex_normals_vjp(&incidence, &sphere.positions, Weighting::Angle, &seeds, &mut d);
            (vertex_normals(&incidence, &sphere.positions, Weighting::Angle), d)
        })
    };
    assert_eq!(run(1), run(5));
}

#[test]
#[ignore = "measurement"]
fn time_of_ten_thousand_triangles() {
    let sphere = shapes::icosphere(22);
    let incidence = Incidence::new(&sphere.triangles, &weld_exact(&sphere.positions));
    let mut d = vec![Vec3::zero(); sphere.positions.len()];
    for weighting in [Weighting::Angle, Weighting::Area] {
        let mut best = [f64::INFINITY; 2];
        for _ in 0..50 {
            let start = std::time::Instant::now();
            let normals = vertex_normals(&incidence, &sphere.positions, weighting);
            let forward = start.elapsed().as_secs_f64();
            vertex_normals_vjp(&incidence, &sphere.positions, weighting, &normals, &mut d);
            best = [best[0].min(forward), best[1].min(start.elapsed().as_secs_f64() - forward)];
        }
        println!(
            "{} triangles {weighting:?}: forward {:.3} ms, vjp {:.3} ms",
            sphere.triangles.len(),
            best[0] * 1e3,
            best[1] * 1e3
        );
    }
}
