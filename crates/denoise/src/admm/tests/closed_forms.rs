//! Solutions known in closed form.

use super::problems::{SIZE, noisy, stored};
use super::{distance, solved};
use crate::Shape;
use crate::admm::{Admm, DataTerm, LinearStep, Penalties, Problem, Stop};
use crate::models;
use crate::primal_dual::rof_gap;

fn step() -> (Shape, Vec<f64>) {
    (Shape::new(64, 8, 1), (0..512).map(|k| if k % 64 < 32 { 0.0 } else { 1.0 }).collect())
}

/// A disc of radius `r` about the middle of a square.
fn disc(size: usize, r: f64) -> (Shape, Vec<f64>) {
    let middle = (size as f64 - 1.0) / 2.0;
    let at = |k: usize| {
        let (y, x) = ((k / size) as f64 - middle, (k % size) as f64 - middle);
        // Coverage of the pixel, so that the perimeter is that of a circle.
        (r + 0.5 - x.hypot(y)).clamp(0.0, 1.0)
    };
    (Shape::new(size, size, 1), (0..size * size).map(at).collect())
}

#[test]
fn rof_lowers_a_step() {
    let (shape, f) = step();
    let u = solved(&models::rof(shape, &f, 0.2), 2000);
    for (k, v) in u.iter().enumerate() {
        let expected = if k % 64 < 32 { 0.15625 } else { 0.84375 };
        assert!((v - expected).abs() < 1e-6, "{k}: {v}");
    }
}

#[test]
fn rof_lowers_a_disc_by_two_over_lambda_r() {
    for r in [10.0, 20.0, 30.0] {
        let (shape, f) = disc(96, r);
        let lambda = 8.0 / r;
        let u = solved(&models::rof(shape, &f, lambda), 300);
        let middle = u[48 * 96 + 48];
        let background: f64 = u[0];
        let expected = 2.0 / (lambda * r);
        let drop = 1.0 - middle;
        println!("R={r}: drop {drop:.4}, expected {expected:.4}, corner {background:.4}");
        assert!((drop / expected - 1.0).abs() < 0.07, "R={r}: {drop} against {expected}");
    }
}

#[test]
fn rof_keeps_mean_scale_and_range() {
    let target = noisy(0);
    let shape = Shape::new(SIZE, SIZE, 1);
    let exact = |problem: &Problem<'_, f64>| {
        let penalties = Penalties::for_problem(problem);
        let mut admm =
            Admm::with_linear_step(problem, penalties, None, LinearStep::Exact).expect("a good problem");
        admm.solve(Stop::Iterations(200));
        admm.solution()
    };
    let u = exact(&models::rof(shape, &target, 8.0));
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    assert!((mean(&u) - mean(&target)).abs() <= 1e-12);
    let five: Vec<f64> = target.iter().map(|v| 5.0 * v).collect();
    let scaled = exact(&models::rof(shape, &five, 8.0 / 5.0));
    let back: Vec<f64> = scaled.iter().map(|v| v / 5.0).collect();
    assert!(distance(&back, &u) < 1e-12, "{}", distance(&back, &u));
    let range = |v: &[f64]| v.iter().fold([f64::MAX, f64::MIN], |[l, h], &x| [l.min(x), h.max(x)]);
    let ([low, high], [least, most]) = (range(&u), range(&target));
    assert!(low >= least && high <= most, "maximum principle: {low}..{high} in {least}..{most}");
    // The sweep has the same limit.
    let swept = solved(&models::rof(shape, &target, 8.0), 1500);
    assert!((mean(&swept) - mean(&target)).abs() <= 1e-9, "{}", mean(&swept) - mean(&target));
}

#[test]
fn rof_is_certified() {
    for (channels, linear) in
        [(1, LinearStep::Exact), (3, LinearStep::Exact), (1, LinearStep::Sweep), (3, LinearStep::Sweep)]
    {
        let target: Vec<f64> = (0..channels).flat_map(noisy).collect();
        let mut problem = models::rof(Shape::new(SIZE, SIZE, channels), &target, 8.0);
        let name = if channels == 3 { "rof_vectorial" } else { "rof" };
        if channels == 3 {
            problem = problem.vectorial();
        }
        let penalties = Penalties::for_problem(&problem);
        let mut admm = Admm::with_linear_step(&problem, penalties, None, linear).expect("a good problem");
        for (iterations, most) in [(20, 2e-2), (80, 2e-3), (100, 1e-3), (300, 1e-4)] {
            admm.solve(Stop::Iterations(iterations));
            let y = admm.gradient_dual().expect("the term is on");
            let gap = rof_gap(&problem, &admm.solution(), &y);
            println!("{name} {linear:?} {}: {:.1e}", admm.steps(), gap.relative());
            assert!(gap.relative() <= most, "{gap:?} after {}", admm.steps());
            let optimum = stored(name)[0];
            assert!(gap.dual <= optimum * (1.0 + 1e-8) && gap.primal >= optimum * (1.0 - 1e-8), "{gap:?}");
        }
    }
}

#[test]
fn tv_l1_keeps_or_removes_by_size() {
    let (shape, f) = step();
    for (product, jump) in [(0.9, 0.0), (1.1, 1.0)] {
        let u = solved(&models::tv_l1(shape, &f, product / 32.0), 2000);
        let found = u[4 * 64 + 60] - u[4 * 64 + 3];
        assert!((found - jump).abs() <= 0.01, "lambda * 32 = {product}: jump {found}");
    }
    let r = 12.0;
    let (shape, f) = disc(64, r);
    for (factor, height) in [(0.8, 0.0), (1.25, 1.0)] {
        let u = solved(&models::tv_l1(shape, &f, factor * 2.0 / r), 2000);
        let middle = u[32 * 64 + 32];
        assert!((middle - height).abs() < 0.05, "lambda R / 2 = {factor}: {middle}");
    }
}

#[test]
fn htv_keeps_ramps() {
    let shape = Shape::new(20, 24, 1);
    let ramp: Vec<f64> = (0..480).map(|k| 0.5 * (k % 20) as f64 - 0.25 * (k / 20) as f64).collect();
    let lambda = || DataTerm::L2 { lambda: 1.0.into() };
    let problem = Problem::new(shape, &ramp, lambda()).with_hessian(2.0);
    let u = solved(&problem, 200);
    assert!(distance(&u, &ramp) < 1e-12, "{}", distance(&u, &ramp));
    assert!(problem.energy(&ramp).abs() < 1e-12);
}

#[test]
fn hybrid_has_both_limits() {
    let target: Vec<f64> = (0..3).flat_map(noisy).collect();
    let shape = Shape::new(SIZE, SIZE, 3);
    let rof = models::rof(shape, &target, 8.0).vectorial();
    let (a, b) = (solved(&models::hybrid(shape, &target, 1e-9, 8.0, 1.0), 600), solved(&rof, 600));
    assert!(distance(&a, &b) < 1e-5, "l1 -> 0: {}", distance(&a, &b));
    let l1 = models::tv_l1(shape, &target, 1.2).vectorial();
    let (a, b) = (solved(&models::hybrid(shape, &target, 1.2, 1e-9, 1.0), 2000), solved(&l1, 2000));
    let [ea, eb] = [&a, &b].map(|u| l1.energy(u));
    assert!((ea / eb - 1.0).abs() < 1e-6, "l2 -> 0: {ea} {eb}");
}

#[test]
fn energy_never_rises_without_over_relaxation() {
    for case in super::problems::cases() {
        let problem = case.problem();
        let penalties = Penalties { relaxation: 1.0, ..Penalties::for_problem(&problem) };
        let mut admm = Admm::with_penalties(&problem, penalties, None).expect("a good problem");
        // The iterates of a splitting approach the optimum in a norm of their own; the energy follows once the
        // splits agree with the estimate.
        admm.solve(Stop::Iterations(60));
        let mut last = problem.energy(&admm.solution());
        for k in 0..8 {
            admm.solve(Stop::Iterations(25));
            let energy = problem.energy(&admm.solution());
            assert!(energy <= last * (1.0 + 1e-9), "{} block {k}: {energy} after {last}", case.name);
            last = energy;
        }
    }
}
