//! The printed forms of the algorithms, which are wrong, must not pass for the right ones; and the two boundaries, the
//! fused and the plain solver, must agree.

use super::problems::{SIZE, clean, noisy, stored};
use super::reference::{Plain, Printed};
use super::{distance, solved};
use crate::Shape;
use crate::admm::{DataTerm, Problem};
use crate::operators::Boundary;
use crate::transform::Symbol;

const SHAPE: Shape = Shape::new(SIZE, SIZE, 1);

fn plain(target: &[f64], alpha: f64, beta: f64) -> Plain<'_> {
    Plain {
        rows: SIZE,
        width: SIZE,
        target,
        l1: vec![0.0; target.len()],
        l2: vec![8.0; target.len()],
        alpha,
        beta,
        t: [8.0, 15.0 * alpha, 30.0 * beta],
        boundary: Boundary::Neumann,
        masked: true,
        printed: Printed::None,
    }
}

#[test]
fn both_boundaries_and_both_solvers_have_one_optimum() {
    let target = noisy(0);
    for (alpha, beta) in [(1.0, 0.0), (0.5, 1.0)] {
        let data = DataTerm::L2 { lambda: 8.0.into() };
        let mut problem = Problem::new(SHAPE, &target, data).with_gradient(alpha);
        if beta > 0.0 {
            problem = problem.with_hessian(beta);
        }
        let fused = solved(&problem, 3000);
        for boundary in [Boundary::Neumann, Boundary::Periodic] {
            let u = Plain { boundary, ..plain(&target, alpha, beta) }.run(4000);
            let gap = problem.energy(&u) / problem.energy(&fused) - 1.0;
            println!("{boundary:?} {alpha} {beta}: {gap:.1e} {:.1e}", distance(&u, &fused));
            assert!(gap.abs() < 2e-6 && distance(&u, &fused) < 2e-3, "{boundary:?}: {gap}");
        }
    }
}

/// Sizes that need padding, and odd ones: the optimum is that of the plain solver, which has no padding.
#[test]
fn padding_changes_no_optimum() {
    for (rows, width) in [(17, 31), (31, 17), (23, 7), (5, 67), (1, 37), (37, 1)] {
        let target: Vec<f64> = noisy(0)[..rows * width].to_vec();
        let problem = Problem::new(Shape::new(width, rows, 1), &target, DataTerm::L2 { lambda: 8.0.into() })
            .with_gradient(0.5)
            .with_hessian(0.3);
        let u = Plain { rows, width, ..plain(&target, 0.5, 0.3) }.run(3000);
        let fused = solved(&problem, 2000);
        let gap = problem.energy(&fused) / problem.energy(&u) - 1.0;
        assert!(gap.abs() < 1e-5 && distance(&u, &fused) < 2e-3, "{rows}x{width}: {gap}");
    }
}

#[test]
fn unmasked_borders_bend_a_ramp() {
    let ramp: Vec<f64> =
        (0..SIZE * SIZE).map(|k| 0.03 * (k % SIZE) as f64 - 0.02 * (k / SIZE) as f64).collect();
    let run = |masked, boundary| {
        let u = Plain { masked, boundary, ..plain(&ramp, 0.0, 4.0) }.run(400);
        distance(&u, &ramp)
    };
    for boundary in [Boundary::Neumann, Boundary::Periodic] {
        assert!(run(true, boundary) < 1e-12, "{boundary:?}, masked: {}", run(true, boundary));
        assert!(run(false, boundary) > 0.01, "{boundary:?}, unmasked: {}", run(false, boundary));
    }
}

#[test]
fn printed_forms_miss_the_optimum() {
    let target = noisy(0);
    let rof = Problem::new(SHAPE, &target, DataTerm::L2 { lambda: 8.0.into() }).with_gradient(1.0);
    let excess =
        |problem: &Problem<'_, f64>, optimum: f64, p: Plain<'_>| problem.energy(&p.run(1500)) / optimum - 1.0;
    let optimum = stored("rof")[0];
    assert!(excess(&rof, optimum, plain(&target, 1.0, 0.0)) < 1e-5);
    for printed in [Printed::DoubledWeight, Printed::ComponentShrink] {
        let e = excess(&rof, optimum, Plain { printed, ..plain(&target, 1.0, 0.0) });
        println!("{printed:?}: {:+.1}%", 100.0 * e);
        assert!(e > 0.005, "{printed:?}: {e}");
    }
    let htv = Problem::new(SHAPE, &target, DataTerm::L2 { lambda: 8.0.into() })
        .with_gradient(0.5)
        .with_hessian(1.0);
    let optimum = htv.energy(&plain(&target, 0.5, 1.0).run(3000));
    let e = excess(&htv, optimum, Plain { printed: Printed::MixedIsYy, ..plain(&target, 0.5, 1.0) });
    println!("the mixed derivative as yy: {:+.1}%", 100.0 * e);
    assert!(e > 0.01 || e.is_nan(), "{e}");
    // The square that pulls to the estimate leaves pure TV-L1.
    let hybrid =
        Problem::new(SHAPE, &target, DataTerm::Hybrid { l1: 0.6.into(), l2: 4.0.into() }).with_gradient(1.0);
    let right =
        Plain { l1: vec![0.6; target.len()], l2: vec![4.0; target.len()], ..plain(&target, 1.0, 0.0) };
    let optimum = hybrid.energy(&solved(&hybrid, 3000));
    let right = excess(&hybrid, optimum, right);
    let wrong = Plain {
        l1: vec![0.6; target.len()],
        l2: vec![4.0; target.len()],
        printed: Printed::PullToEstimate,
        ..plain(&target, 1.0, 0.0)
    };
    let wrong = excess(&hybrid, optimum, wrong);
    println!("pull to the estimate: {:+.1}%, right {:+.4}%", 100.0 * wrong, 100.0 * right);
    assert!(right.abs() < 1e-4 && wrong > 0.01, "{right} {wrong}");
}

#[test]
fn a_minus_in_the_symbol_diverges() {
    let target: Vec<f64> = clean(0)[..16 * SIZE].iter().step_by(2).copied().collect();
    let p = Plain {
        rows: 16,
        width: 16,
        l1: vec![0.0; 256],
        l2: vec![8.0; 256],
        printed: Printed::MinusHessian,
        ..plain(&target, 0.5, 1.0)
    };
    let size = |u: Vec<f64>| u.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
    let (five, ten) = (size(p.run(5)), size(p.run(10)));
    assert!(ten > 10.0 * five || !ten.is_finite(), "{five} {ten}");
}

/// The printed symbol `l2 - t1 + ...` with the printed parameters `l2 = t1 = .5` is zero at the mean; the right one is
/// positive everywhere.
#[test]
fn the_printed_parameters_need_the_right_symbol() {
    let (l2, t1, t2) = (0.5, 0.5, 5.0);
    let printed = |l: f64| l2 - t1 + t2 * l;
    assert!(printed(0.0).abs() < 1e-15);
    assert!(Symbol { c0: t1, c1: t2, c2: 0.0 }.at(0.0) > 0.0);
}

/// `|r| > -delta` holds for every residual; the right test is one-sided.
#[test]
fn the_printed_huber_test_is_always_true() {
    let huber = DataTerm::Huber { lambda: 2.0.into(), delta: 0.1.into() };
    for r in [-3.0, -0.2, -0.05, 0.0, 0.3, 2.0_f64] {
        assert!(r.abs() > -0.1);
        let square = r * r;
        let value = huber.value(0, r, SHAPE);
        if r < -0.1 {
            assert!((value - 2.0 * 0.1 * (-r - 0.05)).abs() < 1e-15, "behind: a line at {r}");
        } else {
            assert!((value - square).abs() < 1e-15, "in front: a square at {r}");
        }
    }
}
