//! Skips change no solution; weights may change between steps; results do not depend on threads.

use super::problems::{SIZE, noisy, stored};
use super::{distance, solved};
use crate::admm::{Admm, ChannelPlan, DataTerm, LinearStep, Penalties, Problem, Stop, Weight};
use crate::{Shape, models};

const RGB: Shape = Shape::new(SIZE, SIZE, 3);

#[test]
fn absent_terms_take_no_memory() {
    let target = noisy(0);
    let shape = Shape::new(SIZE, SIZE, 1);
    let bytes = |p: &Problem<'_, f64>| Admm::new(p).expect("a good problem").plan().bytes;
    let base = Problem::new(shape, &target, DataTerm::L2 { lambda: 8.0.into() });
    let gradient = base.clone().with_gradient(1.0);
    let off = gradient.clone().with_hessian(0.0);
    assert_eq!(bytes(&gradient), bytes(&off), "a weight of 0 is an absent term");
    assert!(bytes(&base) < bytes(&gradient) && bytes(&gradient) < bytes(&gradient.clone().with_hessian(1.0)));
    let plan = Admm::new(&off).expect("a good problem").plan().clone();
    assert!(plan.gradient && !plan.hessian && !plan.guide);
    assert!(
        plan.to_string().starts_with("terms: data gradient; linear step: sweep; channels solved: 1 of 1"),
        "{plan}"
    );
}

/// At most 60 bytes per pixel and channel in single precision, with all terms, on a real size.
#[test]
fn memory_is_bounded() {
    let shape = Shape::new(640, 360, 3);
    let target: Vec<f32> = (0..shape.len()).map(|k| (k % 97) as f32).collect();
    let guide = vec![0.0; 2 * target.len()];
    let hybrid = models::hybrid(shape, &target, 0.1, 0.5, 0.1);
    let all = hybrid.clone().with_hessian(0.1).with_guide(0.1, &guide);
    for (problem, most) in [(hybrid, 32.0), (all, 60.0)] {
        let admm = Admm::new(&problem).expect("a good problem");
        let per_sample = admm.plan().bytes as f64 / shape.len() as f64;
        println!("{}: {per_sample:.1} bytes per sample", admm.plan());
        assert!(per_sample <= most, "{per_sample}");
    }
}

#[test]
fn constant_and_equal_channels_are_not_solved() {
    let gray = noisy(0);
    let constant = vec![0.25; gray.len()];
    for vectorial in [false, true] {
        let build = |target: &[f64]| {
            let problem = Problem::new(RGB, target, DataTerm::L2 { lambda: 8.0.into() }).with_gradient(1.0);
            let problem = if vectorial { problem.vectorial() } else { problem };
            let mut admm = Admm::new(&problem).expect("a good problem");
            admm.solve(Stop::Iterations(1500));
            (admm.plan().channels.clone(), admm.solution(), problem.energy(&admm.solution()))
        };
        let (plan, u, energy) = build(&[gray.clone(), gray.clone(), gray.clone()].concat());
        use ChannelPlan::{Constant, SameAs, Solved};
        assert_eq!(plan, [Solved, SameAs(0), SameAs(0)]);
        assert_eq!(u[..1024], u[1024..2048]);
        // Perturbed so little that nothing is merged, the optimum is the same.
        let mut almost = [gray.clone(), gray.clone(), gray.clone()].concat();
        almost[1500] += 1e-9;
        almost[2500] -= 1e-9;
        let (plan, _, full) = build(&almost);
        assert_eq!(plan, [Solved; 3]);
        assert!((energy / full - 1.0).abs() < 1e-5, "{energy} {full}");
        let (plan, u, _) = build(&[gray.clone(), constant.clone(), noisy(1)].concat());
        assert_eq!(plan, [Solved, Constant, Solved]);
        assert!(u[1024..2048].iter().all(|v| *v == 0.25));
    }
}

#[test]
fn converged_channels_rest() {
    // A smooth channel converges at once, a noisy one later: the result is that of the channels alone.
    let smooth: Vec<f64> = (0..1024).map(|k| 0.5 + 1e-3 * f64::from((k % SIZE) as u32)).collect();
    let target = [smooth.clone(), noisy(0)].concat();
    let problem = models::rof(Shape::new(SIZE, SIZE, 2), &target, 8.0);
    let penalties = Penalties::for_problem(&problem);
    let stop = Stop::Tolerance { tolerance: 1e-5, limit: 2000 };
    let mut both = Admm::with_penalties(&problem, penalties, None).expect("a good problem");
    let report = both.solve(stop);
    assert!(report.converged && report.residual.is_some_and(|r| r < 1e-5), "{report:?}");
    let u = both.solution();
    for c in 0..2 {
        let alone = models::rof(Shape::new(SIZE, SIZE, 1), &target[c * 1024..][..1024], 8.0);
        let mut one = Admm::with_penalties(&alone, penalties, None).expect("a good problem");
        let single = one.solve(stop);
        assert!(single.iterations <= report.iterations);
        let d = distance(&one.solution(), &u[c * 1024..][..1024]);
        assert!(d < 1e-12, "channel {c}: {d}");
    }
}

#[test]
fn the_tolerance_stops_neither_at_once_nor_never() {
    let target = noisy(0);
    let problem = models::rof(Shape::new(SIZE, SIZE, 1), &target, 8.0);
    let mut last = 0;
    for tolerance in [1e-2, 1e-3, 1e-4] {
        let mut admm = Admm::new(&problem).expect("a good problem");
        let report = admm.solve(Stop::Tolerance { tolerance, limit: 1000 });
        assert!(report.converged && report.iterations >= 5 && report.iterations >= last, "{report:?}");
        last = report.iterations;
    }
    assert!(last > 10);
    let mut admm = Admm::new(&problem).expect("a good problem");
    let report = admm.solve(Stop::Tolerance { tolerance: 0.0, limit: 7 });
    assert!(!report.converged && report.iterations == 7);
}

/// Weights changed on the way: the end is the optimum of the new problem, and sooner than from the beginning.
#[test]
fn weights_change_without_losing_the_duals() {
    let target: Vec<f64> = (0..3).flat_map(noisy).collect();
    let problem = models::hybrid(RGB, &target, 0.5, 6.0, 1.0);
    let mut admm = Admm::new(&problem).expect("a good problem");
    let mut calls = 0;
    admm.solve_with(Stop::Iterations(200), |admm| {
        calls += 1;
        if calls == 3 {
            admm.set_data(DataTerm::Hybrid { l1: vec![0.0; 1024].into(), l2: 8.0.into() })
                .expect("a good weight");
        }
    });
    let optimum = stored("rof_vectorial")[0];
    let goal = models::rof(RGB, &target, 8.0).vectorial();
    let gap = goal.energy(&admm.solution()) / optimum - 1.0;
    assert!(gap.abs() < 1e-6, "{gap}");
    assert!(admm.set_hessian_weight(1.0).is_err(), "the term was off");
    assert!(admm.set_gradient_weight(-1.0).is_err());
    assert!(admm.set_gradient_weight(vec![1.0; 5]).is_err());
    admm.set_gradient_weight(vec![1.0; 1024]).expect("a map");
}

#[test]
fn a_warm_start_at_the_optimum_stays_there() {
    let target = noisy(0);
    let problem = models::rof(Shape::new(SIZE, SIZE, 1), &target, 8.0);
    let best = solved(&problem, 2000);
    let penalties = Penalties::for_problem(&problem);
    let mut admm = Admm::with_penalties(&problem, penalties, Some(&best)).expect("a good problem");
    assert!(distance(&admm.solution(), &best) < 1e-15);
    admm.solve(Stop::Iterations(30));
    let (warm, cold) = (problem.energy(&admm.solution()), problem.energy(&solved(&problem, 30)));
    assert!(warm < cold, "{warm} {cold}");
}

#[test]
fn threads_change_no_bit() {
    let target: Vec<f32> = (0..3).flat_map(noisy).map(|v| v as f32).collect();
    let map: Vec<f32> = (0..1024).map(|k| 0.2 + (k % 7) as f32 * 0.1).collect();
    let exact = models::hybrid(RGB, &target, 0.1, Weight::Map(map), 0.3).with_hessian(0.1);
    let sweep = models::hybrid(RGB, &target, 0.1, 0.5, 0.1);
    let run = |problem: &Problem<'_, f32>, threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let mut admm = Admm::new(problem).expect("a good problem");
            let report = admm.solve(Stop::Tolerance { tolerance: 1e-4, limit: 60 });
            (admm.solution(), report, problem.energy(&admm.solution()))
        })
    };
    for problem in [exact, sweep] {
        assert_eq!(run(&problem, 1), run(&problem, 3));
    }
}

/// The choice of the linear step: the sweep for soft problems without holes, by itself and when asked.
#[test]
fn the_linear_step_is_chosen() {
    let target = noisy(0);
    let shape = Shape::new(SIZE, SIZE, 1);
    let sweeps = |p: &Problem<'_, f64>| Admm::new(p).expect("a good problem").plan().sweep;
    assert!(sweeps(&models::rof(shape, &target, 8.0)));
    assert!(!sweeps(&models::rof(shape, &target, 0.1)), "stiff");
    assert!(!sweeps(&models::htv_l2(shape, &target, 8.0, 1.0, 1.0)), "Hessian");
    let holes: Vec<f64> = (0..1024).map(|k| (k % 3) as f64).collect();
    assert!(!sweeps(&models::rof(shape, &target, holes)), "holes");
    let hessian = models::htv_l2(shape, &target, 8.0, 1.0, 1.0);
    let penalties = Penalties::for_problem(&hessian);
    assert!(Admm::with_linear_step(&hessian, penalties, None, LinearStep::Sweep).is_err());
}

/// Bands of the sweep meet without a seam: heights around the band's, against the exact step.
#[test]
fn bands_of_the_sweep_meet() {
    for (rows, width) in
        [(47, 9), (48, 8), (49, 7), (50, 6), (51, 5), (97, 4), (99, 3), (145, 2), (150, 1), (1, 60), (2, 9)]
    {
        let shape = Shape::new(width, rows, 2);
        let target: Vec<f64> = (0..shape.len()).map(|k| ((k * k) % 17) as f64 / 17.0).collect();
        let problem = models::hybrid(shape, &target, 0.2, 4.0, 0.3);
        let penalties = Penalties::for_problem(&problem);
        let run = |linear| {
            let mut admm = Admm::with_linear_step(&problem, penalties, None, linear).expect("a good problem");
            admm.solve(Stop::Iterations(1500));
            admm.solution()
        };
        let d = distance(&run(LinearStep::Exact), &run(LinearStep::Sweep));
        assert!(d < 1e-6, "{rows}x{width}: {d}");
    }
}

#[test]
fn the_last_look_at_the_solution_is_the_same() {
    let shape = Shape::new(56, 40, 3);
    let target: Vec<f64> = (0..shape.len()).map(|k| (k % 83) as f64 * 0.01).collect();
    for linear in [LinearStep::Exact, LinearStep::Sweep] {
        for steps in [0, 7] {
            let mut admm = Admm::owning(models::hybrid(shape, &target, 0.1, 0.5, 0.1), linear).expect("good");
            admm.solve(Stop::Iterations(steps));
            let seen = admm.solution();
            assert_eq!(admm.into_solution(), seen, "{linear:?}, {steps} steps");
        }
    }
}
