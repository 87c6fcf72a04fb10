//! Inputs at the edges: sizes, holes, offsets, magnitudes, values that are not finite; single precision.

use super::problems::{SIZE, cases, noisy, stored, uniform};
use super::{distance, solved};
use crate::admm::{Admm, DataTerm, LinearStep, Penalties, Problem, Stop, Weight};
use crate::{DenoiseError, Shape, mask_non_finite, models};

fn models_of(shape: Shape, target: &[f32]) -> Vec<Problem<'_, f32>> {
    vec![
        models::rof(shape, target, 8.0),
        models::tv_l1(shape, target, 1.0),
        models::htv_l2(shape, target, 8.0, 0.3, 0.3),
        models::hybrid(shape, target, 0.1, 0.5, 0.1).with_hessian(0.05),
        Problem::new(shape, target, DataTerm::Huber { lambda: 8.0.into(), delta: 0.1.into() })
            .with_gradient(0.3),
        models::hybrid(shape, target, 0.1, 0.5, 0.0),
    ]
}

#[test]
fn every_size_is_solved() {
    for (rows, width) in
        [(1, 1), (1, 2), (2, 1), (1, 17), (17, 1), (2, 2), (3, 3), (13, 127), (101, 11), (33, 65)]
    {
        let shape = Shape::new(width, rows, 3);
        let target: Vec<f32> = (0..shape.len()).map(|k| uniform(60, k) as f32).collect();
        for (k, problem) in models_of(shape, &target).into_iter().enumerate() {
            let before = problem.energy(&target);
            let u = solved(&problem, 250);
            assert!(u.iter().all(|v| v.is_finite()), "{shape}");
            assert!(
                problem.energy(&u) <= before * 1.001 + 1e-4,
                "{k}, {shape}: {} {before}",
                problem.energy(&u)
            );
        }
    }
}

#[test]
fn constants_are_fixed() {
    for value in [0.0, 0.3, -5.0, 1e4, 1e6] {
        let shape = Shape::new(23, 19, 3);
        let target = vec![value; shape.len()];
        for problem in models_of(shape, &target) {
            assert_eq!(solved(&problem, 10), target);
        }
        // With holes the channels are solved.
        let weight = Weight::Map((0..shape.pixels()).map(|k| (k % 2) as f32).collect());
        let u = solved(&models::htv_l2(shape, &target, weight, 0.3, 0.3), 20);
        assert!(distance(&u, &target) <= 1e-6 * f64::from(value.abs()), "{value}");
    }
}

#[test]
fn constant_solutions_end_a_solve() {
    // So weak a data term leaves the mean alone: against that, which has no contrast, every rounding would be a change.
    let shape = Shape::new(48, 40, 1);
    let noise: Vec<f64> = (0..shape.len()).map(|k| uniform(77, k)).collect();
    let mean = noise.iter().sum::<f64>() / noise.len() as f64;
    let single: Vec<f32> = noise.iter().map(|v| *v as f32).collect();
    let stop = Stop::Tolerance { tolerance: 1e-4, limit: 1000 };
    for step in [LinearStep::Exact, LinearStep::Sweep] {
        let mut double = Admm::owning(models::rof(shape, &noise, 0.5), step).expect("sound");
        let report = double.solve(stop);
        assert!(report.converged, "{step:?}: {report:?}");
        let far = double.solution().iter().map(|u| (u - mean).abs()).fold(0.0, f64::max);
        assert!(far < 1e-3, "{step:?}: {far} from the mean");
        let mut single = Admm::owning(models::rof(shape, &single, 0.5), step).expect("sound");
        let report = single.solve(stop);
        assert!(report.converged, "{step:?}, f32: {report:?}");
        let far = single.solution().iter().map(|u| (f64::from(*u) - mean).abs()).fold(0.0, f64::max);
        assert!(far < 1e-3, "{step:?}, f32: {far} from the mean");
    }
}

#[test]
fn all_holes_leave_a_constant_or_the_start() {
    let shape = Shape::new(17, 15, 1);
    let target = vec![f32::NAN; shape.len()];
    let problem = models::rof(shape, &target, 0.0);
    let u = solved(&problem, 50);
    assert!(u.iter().all(|v| *v == 0.0), "nothing is known");
    let start: Vec<f32> = (0..shape.len()).map(|k| (k % 5) as f32).collect();
    let problem = models::htv_l2(shape, &target, 0.0, 1.0, 1.0);
    let penalties = Penalties::for_problem(&problem);
    let mut admm = Admm::with_penalties(&problem, penalties, Some(&start)).expect("all holes");
    let before = problem.energy(&admm.solution());
    admm.solve(Stop::Iterations(300));
    let after = problem.energy(&admm.solution());
    assert!(after.is_finite() && after < 0.1 * before, "{before} {after}");
}

#[test]
fn values_that_are_not_finite_are_reported_or_masked() {
    let shape = Shape::new(SIZE, SIZE, 3);
    let mut target: Vec<f32> = (0..3).flat_map(noisy).map(|v| v as f32).collect();
    let clean = target.clone();
    target[1024 + 5 * SIZE + 7] = f32::NAN;
    target[9 * SIZE + 2] = f32::INFINITY;
    let error = Admm::new(&models::hybrid(shape, &target, 0.1, 0.5, 0.1)).expect_err("a NaN");
    assert_eq!(error.to_string(), "target is inf at row 9, column 2, channel 0");
    let mut weight = vec![8.0; 1024];
    assert_eq!(mask_non_finite(&mut target, &mut weight, shape), 2);
    let problem = models::rof(shape, &target, weight).vectorial();
    let u = solved(&problem, 100);
    let whole = solved(&models::rof(shape, &clean, 8.0).vectorial(), 100);
    assert!(distance(&u, &whole) < 0.2, "two pixels of many: {}", distance(&u, &whole));
    // Left in place, they are holes by their weight alone.
    let mut raw = clean.clone();
    raw[0] = f32::NAN;
    let mut weight = vec![8.0; 1024];
    weight[0] = 0.0;
    let mut admm = Admm::new(&models::rof(shape, &raw, weight)).expect("a hole");
    admm.solve(Stop::Iterations(20));
    assert!(admm.solution().iter().all(|v| v.is_finite()));
    assert!(admm.set_data(DataTerm::L2 { lambda: 8.0.into() }).is_err(), "the NaN would be read");
}

#[test]
fn single_precision_follows_double_precision() {
    for case in cases() {
        let problem = case.problem();
        let optimum = stored(case.name)[0];
        let target: Vec<f32> = case.target.iter().map(|v| *v as f32).collect();
        let guide: Vec<f32> = case.guide.iter().map(|v| *v as f32).collect();
        let single = |w: &Weight<f64>| match w {
            Weight::Uniform(v) => Weight::Uniform(*v as f32),
            Weight::Map(v) => Weight::Map(v.iter().map(|v| *v as f32).collect()),
        };
        let data = match &problem.data {
            DataTerm::L2 { lambda } => DataTerm::L2 { lambda: single(lambda) },
            DataTerm::L1 { lambda } => DataTerm::L1 { lambda: single(lambda) },
            DataTerm::Hybrid { l1, l2 } => DataTerm::Hybrid { l1: single(l1), l2: single(l2) },
            DataTerm::Huber { lambda, delta } => {
                DataTerm::Huber { lambda: single(lambda), delta: single(delta) }
            }
        };
        let mut small = Problem::new(case.shape, &target, data);
        small.coupling = problem.coupling;
        small.alpha = problem.alpha.as_ref().map(single);
        small.beta = problem.beta.as_ref().map(single);
        if let Some(g) = &problem.guide {
            small = small.with_guide(single(&g.weight), &guide);
        }
        let u = solved(&small, 400);
        let gap = problem.energy(&u.iter().map(|v| f64::from(*v)).collect::<Vec<_>>()) / optimum - 1.0;
        println!("{:16} {gap:.1e}", case.name);
        assert!(gap.abs() < 2e-5, "{}: {gap}", case.name);
    }
}

/// An offset of 1e4 and a radiance of 1e6 cost single precision only the digits of the input.
#[test]
fn offsets_and_magnitudes() {
    let shape = Shape::new(SIZE, SIZE, 1);
    let target: Vec<f32> = noisy(0).iter().map(|v| *v as f32).collect();
    let plain = solved(&models::htv_l2(shape, &target, 8.0, 0.5, 0.2), 100);
    let lifted: Vec<f32> = target.iter().map(|v| v + 1e4).collect();
    let u = solved(&models::htv_l2(shape, &lifted, 8.0, 0.5, 0.2), 100);
    let worst = u
        .iter()
        .zip(&plain)
        .map(|(a, b)| f64::from(*a) - 1e4 - f64::from(*b))
        .fold(0.0, |m: f64, d| m.max(d.abs()));
    assert!(worst < 2e-3, "an offset of 1e4 has 1e-3 between its neighbours: {worst}");
    let bright: Vec<f32> = target.iter().map(|v| v * 1e6).collect();
    let u = solved(&models::htv_l2(shape, &bright, 8.0, 0.5e6, 0.2e6), 100);
    let back: Vec<f32> = u.iter().map(|v| v / 1e6).collect();
    assert!(distance(&back, &plain) < 1e-5, "{}", distance(&back, &plain));
    // One firefly of 1e6 among ordinary pixels.
    let mut spiked = target.clone();
    spiked[500] = 1e6;
    let u = solved(&models::tv_l1(shape, &spiked, 1.0), 2000);
    assert!(u.iter().all(|v| v.is_finite()));
}

#[test]
fn the_printed_parameters_stay_finite() {
    let shape = Shape::new(SIZE, SIZE, 3);
    let target: Vec<f32> = (0..3).flat_map(noisy).map(|v| v as f32).collect();
    let problem = models::hybrid(shape, &target, 0.1, 0.5, 0.5);
    let penalties = Penalties { data: 0.5, gradient: 5.0, hessian: 0.0, guide: 0.0, relaxation: 1.7 };
    let mut admm = Admm::with_penalties(&problem, penalties, None).expect("a good problem");
    let report = admm.solve(Stop::Tolerance { tolerance: 4e-3, limit: 20 });
    let u = admm.solution();
    assert!(u.iter().all(|v| v.is_finite()) && problem.energy(&u) < problem.energy(&target), "{report:?}");
}

#[test]
fn bad_weights_are_refused() {
    let shape = Shape::new(5, 4, 1);
    let target = [1.0_f64, 2.0, 3.0, 4.0, 5.0].repeat(4);
    let error = |p: &Problem<'_, f64>| Admm::new(p).expect_err("a bad problem").to_string();
    assert_eq!(
        error(&models::rof(shape, &target[1..], 1.0)),
        "target has 19 values, expected 20 (5 x 4 pixels x 1 channels)"
    );
    assert_eq!(
        error(&models::rof(shape, &target, -1.0)),
        "lambda is -1, but must be finite and not negative"
    );
    let mut map = vec![1.0; 20];
    map[7] = f64::NAN;
    assert_eq!(
        error(&models::rof(shape, &target, 1.0).with_gradient(map)),
        "alpha is NaN at row 1, column 2, channel 0"
    );
    assert!(error(&models::rof(Shape::new(5, 0, 1), &[], 1.0)).contains("no pixels"));
    let g = vec![0.0; 39];
    assert!(
        error(&models::rof(shape, &target, 1.0).with_guide(1.0, &g))
            .starts_with("the target gradient has 39")
    );
    let penalties = Penalties { data: 1.0, gradient: 0.0, hessian: 0.0, guide: 0.0, relaxation: 1.7 };
    let refused = Admm::with_penalties(&models::rof(shape, &target, 1.0), penalties, None);
    assert!(matches!(refused, Err(DenoiseError::Setting { setting: "the penalty of the gradient", .. })));
    let penalties = Penalties { gradient: 1.0, relaxation: 2.0, ..penalties };
    assert!(Admm::with_penalties(&models::rof(shape, &target, 1.0), penalties, None).is_err());
}
