//! Optima, certificates, limits.

use super::*;
use crate::Shape;
use crate::admm::tests::problems::{SIZE, clean, noisy, stored};
use crate::admm::{Coupling, Weight};
use crate::models;

const SHAPE: Shape = Shape::new(SIZE, SIZE, 1);

#[test]
fn chambolle_pock_reaches_the_optimum_and_certifies_it() {
    let (target, [optimum, _]) = (noisy(0), stored("rof"));
    let problem = models::rof(SHAPE, &target, 8.0);
    let mut solver = ChambollePock::new(&problem).expect("a good problem");
    for (iterations, most) in [(50, 3e-3), (150, 3e-4), (800, 2e-6)] {
        for _ in 0..iterations {
            solver.step();
        }
        let (gap, error) = (solver.gap(), solver.gap().primal / optimum - 1.0);
        println!("{error:.1e} certified {:.1e}", gap.relative());
        assert!((-1e-9..=most).contains(&error), "{error}");
        assert!(gap.dual <= optimum * (1.0 + 1e-9), "a lower bound: {gap:?}");
        assert!(gap.relative() >= error - 1e-9 && gap.relative() < 30.0 * most, "{gap:?}");
    }
    let rgb: Vec<f64> = (0..3).flat_map(noisy).collect();
    let problem = models::rof(Shape::new(SIZE, SIZE, 3), &rgb, 8.0).vectorial();
    let mut solver = ChambollePock::new(&problem).expect("a good problem");
    let gap = solver.solve(1e-5, 1000);
    assert!(
        gap.relative() <= 1e-5 && (gap.primal / stored("rof_vectorial")[0] - 1.0).abs() < 1e-5,
        "{gap:?}"
    );
}

#[test]
fn problems_that_are_not_rof_are_refused() {
    let target = noisy(0);
    let l1 = models::tv_l1(SHAPE, &target, 1.0);
    assert!(ChambollePock::new(&l1).is_err());
    let holes: Vec<f64> = (0..SIZE * SIZE).map(|k| (k % 2) as f64).collect();
    assert!(ChambollePock::new(&models::rof(SHAPE, &target, holes)).is_err());
    assert!(ChambollePock::new(&models::rof(SHAPE, &target, 8.0).with_hessian(1.0)).is_err());
}

#[test]
fn beltrami_reaches_the_optimum_and_its_fixed_point() {
    let (target, [optimum, probe]) = (noisy(0), stored("beltrami"));
    let (lambda, beta) = (Weight::Uniform(40.0), 5.0);
    let at_probe = beltrami_energy(SHAPE, &clean(0), &target, &lambda, beta);
    assert!((at_probe / probe - 1.0).abs() < 1e-9, "another problem: {at_probe} {probe}");
    let mut solver = Beltrami::new(SHAPE, &target, lambda.clone(), beta).expect("a good problem");
    solver.iterate(100);
    let error = beltrami_energy(SHAPE, &solver.solution(), &target, &lambda, beta) / optimum - 1.0;
    println!("100 iterations: {error:.1e}");
    assert!(error.abs() <= 1e-6, "{error}");
    solver.iterate(200);
    let (u, phi) = (solver.solution(), solver.dual());
    let g = crate::operators::gradient(crate::operators::Boundary::Neumann, SIZE, SIZE, &u);
    let n = SIZE * SIZE;
    for k in 0..n {
        let root = (1.0 + beta * beta * (g[k] * g[k] + g[n + k] * g[n + k])).sqrt();
        for part in [0, n] {
            assert!((phi[part + k] - beta * beta * g[part + k] / root).abs() < 1e-6, "fixed point at {k}");
        }
    }
}

/// The iteration as printed multiplies where the right one divides, and the other way round.
#[test]
fn the_printed_beltrami_iteration_misses_the_optimum() {
    let (target, [optimum, _]) = (noisy(0), stored("beltrami"));
    let (lambda, beta, s1) = (40.0, 5.0_f64, 0.2);
    let s2 = 0.25 / (beta * beta * s1);
    let run = |printed: bool| {
        let mut u = target.clone();
        let mut phi = vec![0.0_f64; 2 * u.len()];
        let n = u.len();
        for _ in 0..300 {
            let g = crate::operators::gradient(crate::operators::Boundary::Neumann, SIZE, SIZE, &u);
            for k in 0..n {
                let root = (beta * beta - phi[k].powi(2) - phi[n + k].powi(2)).max(1e-9).sqrt();
                let gain = if printed { beta * s1 / root } else { beta * s1 * root };
                let [x, y] = [k, n + k].map(|k| (1.0 - s1) * phi[k] + gain * g[k]);
                let scale = beta / x.hypot(y).max(beta);
                (phi[k], phi[n + k]) = (x * scale, y * scale);
            }
            let div = crate::operators::divergence(crate::operators::Boundary::Neumann, SIZE, SIZE, &phi);
            for k in 0..n {
                u[k] = (u[k] + s2 * (div[k] + lambda * target[k])) / (1.0 + s2 * lambda);
            }
        }
        beltrami_energy(SHAPE, &u, &target, &Weight::Uniform(lambda), beta) / optimum - 1.0
    };
    let (right, wrong) = (run(false), run(true));
    assert!(right.abs() < 1e-6, "the corrected form: {right}");
    assert!(wrong > 1e-2, "the printed form: {wrong}");
}

#[test]
fn beltrami_with_large_beta_is_total_variation() {
    let target = noisy(0);
    let problem = models::rof(SHAPE, &target, 8.0);
    let mut rof = ChambollePock::new(&problem).expect("a good problem");
    rof.solve(1e-7, 3000);
    let mut last = f64::INFINITY;
    for beta in [10.0, 100.0, 1000.0] {
        let mut solver = Beltrami::new(SHAPE, &target, 8.0 * beta, beta).expect("a good problem");
        solver.iterate(1500);
        let pairs = solver.solution();
        let distance = pairs.iter().zip(rof.solution()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        println!("beta {beta}: {distance:.1e}");
        assert!(distance < 0.5 * last, "beta {beta}: {distance}");
        last = distance;
    }
    assert!(last < 1e-2, "{last}");
}

#[test]
fn tgv_reaches_the_optimum() {
    let (target, [optimum, probe]) = (noisy(0), stored("tgv2"));
    let (lambda, weights) = (Weight::Uniform(8.0), [1.0, 2.0]);
    let slope = crate::operators::gradient(crate::operators::Boundary::Neumann, SIZE, SIZE, &clean(0));
    let at_probe = tgv2_energy((SHAPE, &target, &lambda), weights, Coupling::Separate, &clean(0), &slope);
    assert!((at_probe / probe - 1.0).abs() < 1e-9, "another problem: {at_probe} {probe}");
    let mut solver =
        Tgv2::new(SHAPE, &target, lambda.clone(), weights, Coupling::Separate).expect("a good problem");
    for (iterations, most) in [(200, 1e-2), (300, 1e-3), (1500, 1e-4)] {
        solver.iterate(iterations);
        let (u, w) = (solver.solution(), solver.slope());
        let error =
            tgv2_energy((SHAPE, &target, &lambda), weights, Coupling::Separate, &u, &w) / optimum - 1.0;
        println!("{error:.1e}");
        assert!((-1e-7..=most).contains(&error), "{error}");
    }
}

/// An affine ramp is no cost: TGV2 keeps it, total variation flattens it.
#[test]
fn tgv_keeps_ramps() {
    let shape = Shape::new(24, 24, 1);
    let ramp: Vec<f64> = (0..576).map(|k| 0.03 * (k % 24) as f64 - 0.02 * (k / 24) as f64).collect();
    let mut solver = Tgv2::new(shape, &ramp, 2.0, [1.0, 2.0], Coupling::Separate).expect("a good problem");
    solver.iterate(3000);
    let worst = |u: Vec<f64>| u.iter().zip(&ramp).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let kept = worst(solver.solution());
    let problem = models::rof(shape, &ramp, 2.0);
    let mut rof = ChambollePock::new(&problem).expect("a good problem");
    rof.solve(1e-6, 2000);
    assert!(kept < 1e-6, "{kept}");
    assert!(worst(rof.solution()) > 0.02);
}

#[test]
fn strange_shapes_and_holes_stay_finite() {
    for shape in [Shape::new(1, 1, 1), Shape::new(9, 1, 3), Shape::new(1, 9, 2), Shape::new(7, 13, 3)] {
        let mut target: Vec<f32> = (0..shape.len()).map(|k| (k * 7 % 5) as f32).collect();
        target[0] = f32::NAN;
        let weight =
            Weight::Map((0..shape.pixels()).map(|k| if k == 0 { 0.0 } else { 2.0 }).collect::<Vec<_>>());
        let mut tgv =
            Tgv2::new(shape, &target, weight.clone(), [1.0, 2.0], Coupling::Vectorial).expect("a hole");
        let mut beltrami = Beltrami::new(shape, &target, weight, 5.0).expect("a hole");
        tgv.iterate(50);
        beltrami.iterate(50);
        assert!(tgv.solution().iter().chain(&beltrami.solution()).all(|v| v.is_finite()), "{shape}");
        assert!(
            Tgv2::new(shape, &target, 1.0, [1.0, 2.0], Coupling::Separate).is_err(),
            "a NaN that is read"
        );
    }
}
