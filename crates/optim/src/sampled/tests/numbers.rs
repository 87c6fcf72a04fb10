//! Seeds: what is common, what is fresh, what is reproduced.

use std::sync::Mutex;

use super::*;
use crate::sampled::{Batch, parallel};

#[test]
fn members_of_a_group_share_a_seed_and_groups_do_not() {
    let mut seen: Vec<(f64, u64)> = Vec::new();
    let f = serial(|x: &[f64], seed| {
        seen.push((x[0], seed));
        Ok::<_, Infallible>(0.0)
    });
    let mut objective = SmoothedLoss::new(f, 1).expect("parameters");
    value(objective.gradient(AT, estimator(3, Stencil::FourPoint, Kernel::Coordinates)));
    drop(objective);
    let seeds: Vec<u64> = seen.chunks_exact(4).map(|g| g[0].1).collect();
    assert!(seen.chunks_exact(4).all(|g| g.iter().all(|p| p.1 == g[0].1)));
    assert!(seeds[0] != seeds[1] && seeds[1] != seeds[2] && seeds[0] != seeds[2]);
    // Mirrored about theta.
    assert!(seen.chunks_exact(2).all(|p| ((p[0].0 + p[1].0) / 2.0 - 0.4).abs() < 1e-15));
}

#[test]
fn noise_of_the_renderer_cancels_within_a_group_only_if_it_is_the_same() {
    // A loss with noise that depends on the seed alone.
    let noise = |seed: u64| 10.0 * (seed as f64 / u64::MAX as f64 - 0.5);
    let common = serial(move |x: &[f64], seed| Ok::<_, Infallible>(quadratic(x) + noise(seed)));
    let mut calls = 0_u64;
    let fresh = serial(move |x: &[f64], seed: u64| {
        calls += 1;
        Ok::<_, Infallible>(quadratic(x) + noise(seed ^ calls.wrapping_mul(0x9e37_79b9_7f4a_7c15)))
    });
    let estimator = estimator(5000, Stencil::FourPoint, Kernel::Coordinates);
    let clean = value(smooth(1, quadratic).hessian(AT, estimator)).variance[0];
    let common = value(SmoothedLoss::new(common, 1).expect("parameters").hessian(AT, estimator)).variance[0];
    let fresh = value(SmoothedLoss::new(fresh, 1).expect("parameters").hessian(AT, estimator)).variance[0];
    assert!((common / clean - 1.0).abs() < 1e-9, "{common} {clean}");
    assert!(fresh > 1.3 * clean, "{fresh} {clean}");
}

#[test]
fn estimates_are_a_function_of_the_seed() {
    let estimator = Estimator { samples: 100, ..Estimator::default() };
    let run = |seed| value(smooth(1, step).gradient(SamplePoint { seed, ..AT }, estimator));
    assert_eq!(run(3), run(3));
    assert_ne!(run(3).value, run(4).value);
}

#[test]
fn threads_and_batches_do_not_change_the_bits() {
    let f = |x: &[f64], seed: u64| Ok::<_, Infallible>(quadratic(x) * (x[1] + (seed % 7) as f64).sin());
    let at = SamplePoint { theta: &[0.3, -0.2], sigma: 0.4, seed: 11 };
    let estimator = Estimator { samples: 9000, ..Estimator::default() };
    let one = value(SmoothedLoss::new(serial(f), 2).expect("parameters").gradient(at, estimator));
    let many = value(SmoothedLoss::new(parallel(f), 2).expect("parameters").gradient(at, estimator));
    assert_eq!(one, many);
    assert_eq!(one.evaluations, 2 * 2 * 9000);
}

/// Counts what a batch holds.
struct Whole<'a>(&'a Mutex<Vec<usize>>);

impl BlackBox for Whole<'_> {
    type Error = Infallible;

    fn evaluate(&mut self, batch: &Batch<'_>, values: &mut [f64]) -> Result<(), Infallible> {
        self.0.lock().expect("one thread").push(batch.len());
        (0..batch.len()).for_each(|i| values[i] = step(batch.point(i)));
        Ok(())
    }
}

#[test]
fn all_points_of_an_estimate_come_in_one_batch_of_bounded_size() {
    let batches = Mutex::new(Vec::new());
    let mut objective = SmoothedLoss::new(Whole(&batches), 3).expect("parameters");
    let at = SamplePoint { theta: &[0.0; 3], sigma: 1.0, seed: 0 };
    value(objective.gradient(at, estimator(5, Stencil::Antithetic, Kernel::Coordinates)));
    assert_eq!(*batches.lock().expect("one thread"), vec![30]);
    value(objective.gradient(at, estimator(20_000, Stencil::Antithetic, Kernel::Coordinates)));
    assert!(batches.lock().expect("one thread").iter().all(|n| *n <= 1 << 14));
    assert_eq!(objective.evaluations(), 30 + 120_000);
}

#[test]
fn single_precision_parameters_are_served() {
    let f = serial(|x: &[f32], _| Ok::<_, Infallible>(x[0] * x[0]));
    let e = value(
        SmoothedLoss::new(f, 1)
            .expect("parameters")
            .gradient(AT, estimator(20_000, Stencil::FourPoint, Kernel::Coordinates)),
    );
    assert!((e.value[0] - 0.8).abs() < 0.01, "{e:?}");
}
