//! Sparse samples, outliers, occlusion.

use super::problems::uniform;
use super::{distance, solved, solved_from};
use crate::Shape;
use crate::admm::{Admm, DataTerm, Problem, Stop, Weight};
use crate::models;
use crate::operators::{Boundary, gradient};

fn samples(n: usize, stream: u64, share: f64, weight: f64) -> Weight<f64> {
    Weight::Map((0..n).map(|k| if uniform(stream, k) < share { weight } else { 0.0 }).collect())
}

/// The value of the nearest seen pixel.
fn nearest(target: &[f64], weight: &Weight<f64>, shape: Shape) -> Vec<f64> {
    let n = shape.width;
    let seen: Vec<usize> = (0..shape.pixels()).filter(|&k| weight.at(k, shape) > 0.0).collect();
    let square = |a: usize, b: usize| (a / n).abs_diff(b / n).pow(2) + (a % n).abs_diff(b % n).pow(2);
    (0..shape.pixels())
        .map(|k| target[*seen.iter().min_by_key(|&&s| square(k, s)).expect("a sample")])
        .collect()
}

#[test]
fn htv_extends_a_ramp_from_a_tenth_of_its_samples() {
    let shape = Shape::new(48, 48, 1);
    let ramp: Vec<f64> = (0..2304).map(|k| (0.6 * (k % 48) as f64 + 0.4 * (k / 48) as f64) / 48.0).collect();
    let lambda = samples(2304, 30, 0.1, 20.0);
    let start = nearest(&ramp, &lambda, shape);
    let rms = |u: &[f64]| (u.iter().zip(&ramp).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / 2304.0).sqrt();
    let htv = Problem::new(shape, &ramp, DataTerm::L2 { lambda: lambda.clone() }).with_hessian(1.0);
    let u = solved_from(&htv, &start, 100);
    let rof = solved_from(&models::rof(shape, &ramp, lambda), &start, 100);
    println!("HTV {:.1e}, ROF {:.1e}", rms(&u), rms(&rof));
    assert!(rms(&u) <= 1e-3, "{}", rms(&u));
    assert!(rms(&rof) >= 0.03, "{}", rms(&rof));
}

#[test]
fn the_start_does_not_matter() {
    let shape = Shape::new(24, 24, 1);
    let target: Vec<f64> = (0..576).map(|k| uniform(31, k)).collect();
    let lambda = samples(576, 32, 0.6, 8.0);
    let problem = models::htv_l2(shape, &target, lambda.clone(), 0.0, 0.4);
    let starts =
        [vec![0.0; 576], nearest(&target, &lambda, shape), (0..576).map(|k| 3.0 * uniform(33, k)).collect()];
    let ends = starts.map(|start| solved_from(&problem, &start, 20_000));
    for end in &ends[1..] {
        assert!(distance(&ends[0], end) <= 1e-6, "{}", distance(&ends[0], end));
    }
}

/// One plane from 2% of its pixels, with the exact gradient.
#[test]
fn the_exact_gradient_fills_a_plane() {
    let shape = Shape::new(64, 64, 1);
    let plane: Vec<f64> = (0..4096).map(|k| 1.0 + 0.01 * (k % 64) as f64 - 0.006 * (k / 64) as f64).collect();
    let lambda = samples(4096, 34, 0.02, 8.0);
    let g = gradient(Boundary::Neumann, 64, 64, &plane);
    let weights = [0.0, 0.2, 1.0].map(Weight::Uniform);
    let start = nearest(&plane, &lambda, shape);
    let u = solved_from(&models::htv_l2_n(shape, &plane, lambda, weights, &g), &start, 1000);
    let worst = distance(&u, &plane);
    println!("{worst:.1e}");
    assert!(worst <= 1e-6, "{worst}");
}

#[test]
fn l1_ignores_outliers_where_l2_does_not() {
    let shape = Shape::new(48, 48, 1);
    let smooth = |k: usize| {
        let (x, y) = ((k % 48) as f64 / 48.0, (k / 48) as f64 / 48.0);
        1.0 + 0.3 * (3.0 * x).sin() + 0.2 * (2.0 * y).cos()
    };
    let truth: Vec<f64> = (0..2304).map(smooth).collect();
    let target: Vec<f64> = (0..2304)
        .map(|k| if uniform(41, k) < 0.05 { 1.0 + 6.0 * uniform(42, k) } else { truth[k] })
        .collect();
    let g = gradient(Boundary::Neumann, 48, 48, &truth);
    let rms = |u: &[f64]| (u.iter().zip(&truth).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / 2304.0).sqrt();
    let weights = || [0.0, 0.2, 1.0].map(Weight::Uniform);
    let l1 = solved(&models::htv_l1_n(shape, &target, samples(2304, 40, 0.5, 2.0), weights(), &g), 400);
    let l2 = solved(&models::htv_l2_n(shape, &target, samples(2304, 40, 0.5, 2.0), weights(), &g), 400);
    println!("HTV-L1-N {:.4}, HTV-L2-N {:.4}", rms(&l1), rms(&l2));
    assert!(rms(&l1) <= 0.01, "{}", rms(&l1));
    assert!(rms(&l2) >= 0.1, "{}", rms(&l2));
}

/// A front surface through which 45% of the samples fall onto the wall behind: with smaller `delta` the front gets
/// better, and the wall, whose own samples now pull less, worse.
#[test]
fn the_one_sided_huber_term_sees_through_occlusion() {
    let shape = Shape::new(60, 40, 1);
    let n = shape.pixels();
    let front = |k: usize| (15..45).contains(&(k % 60));
    let truth: Vec<f64> = (0..n).map(|k| if front(k) { 0.0 } else { 0.5 }).collect();
    let target: Vec<f64> =
        (0..n).map(|k| if front(k) && uniform(50, k) < 0.45 { 0.5 } else { truth[k] }).collect();
    let rms = |u: &[f64], want: bool| {
        let inside: Vec<usize> = (0..n).filter(|&k| front(k) == want).collect();
        let sum: f64 = inside.iter().map(|&k| (u[k] - truth[k]).powi(2)).sum();
        (sum / inside.len() as f64).sqrt()
    };
    let mut last: Option<[f64; 2]> = None;
    for delta in [10.0, 0.1, 0.02, 0.005] {
        let data = DataTerm::Huber { lambda: samples(n, 51, 0.8, 8.0), delta: delta.into() };
        let u = solved(&Problem::new(shape, &target, data).with_gradient(0.15).with_hessian(0.1), 300);
        let errors = [rms(&u, true), rms(&u, false)];
        println!("delta {delta}: front {:.4} back {:.4}", errors[0], errors[1]);
        if let Some(before) = last {
            assert!(
                errors[0] < before[0] && errors[1] > before[1] - 1e-6,
                "delta {delta}: {before:?} {errors:?}"
            );
        }
        last = Some(errors);
    }
}

/// What stands in holes is no contrast that the changes of a flat solution are measured by.
#[test]
fn values_in_holes_do_not_end_a_solve() {
    let shape = Shape::new(48, 32, 1);
    let weight = samples(shape.pixels(), 60, 0.7, 0.02);
    let solve = |hole: f64| {
        let value = |k: usize| if weight.at(k, shape) > 0.0 { uniform(61, k) } else { hole };
        let target: Vec<f64> = (0..shape.pixels()).map(value).collect();
        // So little data that the solution is flat.
        let mut admm = Admm::new(&models::rof(shape, &target, weight.clone())).expect("sound");
        let report = admm.solve(Stop::Tolerance { tolerance: 1e-2, limit: 500 });
        (report, admm.solution())
    };
    let ((empty, a), (loud, b)) = (solve(0.5), solve(1e3));
    assert!(empty.iterations > 10 && empty.converged, "{empty:?}");
    assert_eq!(empty.iterations, loud.iterations, "{empty:?} {loud:?}");
    assert!(distance(&a, &b) < 1e-9, "{}", distance(&a, &b));
}
