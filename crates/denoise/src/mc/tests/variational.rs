//! The convex models on maps of weights.

use crate::Shape;
use crate::admm::{Admm, DataTerm, Problem, Stop};
use crate::mc::{VariationalModel, solve_variational};
use crate::models;

fn picture(shape: Shape) -> Vec<f32> {
    (0..shape.len())
        .map(|i| {
            let (y, x, c) = shape.position(i);
            let step = if x > y { 0.6 } else { 0.1 };
            step + 0.2 * c as f32 + 0.15 * ((i * 7919 % 97) as f32 / 97.0 - 0.5)
        })
        .collect()
}

#[test]
fn the_hybrid_tends_to_its_parts() {
    let shape = Shape::new(28, 24, 3);
    let target = picture(shape);
    let solve = |problem: &Problem<'_, f32>| {
        let mut admm = Admm::new(problem).expect("sound");
        admm.solve(Stop::Iterations(600));
        admm.solution()
    };
    let far = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    let rof = solve(&models::rof(shape, &target, 2.0).vectorial());
    let no_l1 = solve(&models::hybrid(shape, &target, 1e-5, 2.0, 1.0));
    assert!(far(&rof, &no_l1) < 1e-3, "{}", far(&rof, &no_l1));
    let l1 = models::tv_l1(shape, &target, 1.3).vectorial();
    let no_l2 = solve(&models::hybrid(shape, &target, 1.3, 1e-5, 1.0));
    let (a, b) = (l1.energy(&solve(&l1)), l1.energy(&no_l2));
    assert!((a / b - 1.0).abs() < 2e-3, "{a} against {b}");
}

#[test]
fn published_weights_stay_finite_and_lower_the_energy() {
    // l1 = .1, l2 = .5, alpha = .5 or 1, as published: the printed algorithm divides by zero at the mean.
    let shape = Shape::new(45, 31, 3);
    let target = picture(shape);
    let weight = vec![1.0; shape.pixels()];
    for alpha in [0.5_f32, 1.0] {
        let u = solve_variational(
            VariationalModel::Hybrid,
            shape,
            &target,
            &weight,
            &vec![alpha; shape.pixels()],
            100,
        )
        .expect("sound");
        assert!(u.iter().all(|v| v.is_finite()));
        let problem = Problem::new(shape, &target, DataTerm::Hybrid { l1: 0.1.into(), l2: 0.5.into() })
            .with_gradient(alpha)
            .vectorial();
        assert!(problem.energy(&u) < 0.8 * problem.energy(&target));
        // Nothing nearby is better.
        let mut other = u.clone();
        for k in 0..40 {
            other[k * 97 % shape.len()] += if k % 2 == 0 { 0.05 } else { -0.05 };
        }
        assert!(problem.energy(&other) > problem.energy(&u));
    }
}
