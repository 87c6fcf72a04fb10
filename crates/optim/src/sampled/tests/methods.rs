//! Minimisation: every method on small problems, its stop rules and traps.

use std::ops::ControlFlow;

use super::*;
use crate::sampled::{Advance, Annealing, Curve, Method, Settings, Stop, minimize, minimize_watched};

fn all_methods() -> Vec<Method> {
    vec![Method::adam(0.5), Method::NewtonCg { restart: 5 }, Method::l_bfgs(), Method::Bfgs, Method::Newton]
}

/// Settings that suit a method: Adam wants many small stages, the others a few that they end themselves.
fn settings_for(method: &Method, seed: u64) -> Settings {
    let annealing = match method {
        Method::Adam { .. } => Annealing::linear(1.0, 0.01, 200),
        _ => Annealing::settled(1.0, 0.01, 6),
    };
    Settings { annealing, seed, iterations: 400, ..Settings::default() }
}

fn bowl(x: &[f64]) -> f64 {
    5.0 * x[0] * x[0] + 5.0 * x[1] * x[1] + 7.5 * x[0] * x[1]
}

fn well(x: &[f64]) -> f64 {
    -(-0.5 * x.iter().map(|x| x * x).sum::<f64>()).exp()
}

fn distance(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

#[test]
fn every_method_finds_the_minimum_of_a_bowl_and_of_a_well() {
    for (name, f, start) in [("bowl", bowl as fn(&[f64]) -> f64, [3.0, -4.0]), ("well", well, [1.5, 2.0])] {
        for method in all_methods() {
            for seed in 0..5 {
                let outcome = minimize(&mut smooth(2, f), &start, &method, &settings_for(&method, seed))
                    .expect("a run");
                let left = distance(&outcome.theta);
                assert!(left < 0.03, "{name} {method:?} seed {seed}: {left} left, {:?}", outcome.stop);
                assert_eq!(outcome.history.last().map(|r| r.evaluations), Some(outcome.evaluations));
            }
        }
    }
}

#[test]
fn l_bfgs_reaches_one_percent_within_the_evaluations_of_the_specification() {
    // 20 seeds each; the number of evaluations is the median's bound.
    for (name, f, radius, most) in
        [("QUAD", bowl as fn(&[f64]) -> f64, 5.0, 332), ("-Gaussian", well, 2.5, 152)]
    {
        let mut spent: Vec<u64> = (0..20)
            .map(|seed| {
                let angle = seed as f64;
                let start = [radius * angle.cos(), radius * angle.sin()];
                let mut objective = smooth(2, f);
                let settings = settings_for(&Method::l_bfgs(), seed);
                let outcome = minimize_watched(&mut objective, &start, &Method::l_bfgs(), &settings, |p| {
                    if distance(p.theta) <= 0.01 * radius {
                        ControlFlow::Break(())
                    } else {
                        ControlFlow::Continue(())
                    }
                })
                .expect("a run");
                assert_eq!(outcome.stop, Stop::Cancelled, "{name} seed {seed} ends at {:?}", outcome.theta);
                outcome.evaluations
            })
            .collect();
        spent.sort_unstable();
        println!("{name}: median {}, most {}", spent[10], spent[19]);
        assert!(spent[10] <= most, "{name}: {spent:?}");
    }
}

#[test]
fn runs_are_reproduced_to_the_bit() {
    for method in all_methods() {
        let run = |seed| {
            minimize(&mut smooth(2, bowl), &[3.0, -4.0], &method, &settings_for(&method, seed))
                .expect("a run")
        };
        assert_eq!(run(1), run(1), "{method:?}");
        assert_ne!(run(1).theta, run(2).theta, "{method:?}");
    }
}

#[test]
fn one_parameter_and_a_thousand() {
    for method in all_methods() {
        let mut objective = smooth(1, quadratic);
        let outcome = minimize(&mut objective, &[4.0], &method, &settings_for(&method, 1)).expect("a run");
        assert!((outcome.theta[0] - 1.0 / 3.0).abs() < 0.03, "{method:?}: {:?}", outcome.theta);
    }
    let n = 1000;
    let f = |x: &[f64]| {
        x.iter().enumerate().map(|(i, x)| (1.0 + (i % 7) as f64) * (x - 0.1).powi(2)).sum::<f64>()
    };
    for method in [Method::adam(0.2), Method::NewtonCg { restart: 20 }, Method::l_bfgs()] {
        let gradient = Estimator { samples: 1, stencil: Stencil::FourPoint, ..Estimator::default() };
        let annealing = Annealing::linear(0.3, 0.02, if method == Method::adam(0.2) { 30 } else { 4 });
        let annealing = Annealing {
            advance: if annealing.stages > 4 { Advance::Every(1) } else { Advance::Every(5) },
            ..annealing
        };
        let settings = Settings { trust: 100.0, iterations: 30, gradient, annealing, ..Settings::default() };
        let outcome = minimize(&mut smooth(n, f), &vec![1.0; n], &method, &settings).expect("a run");
        let left = f(&outcome.theta) / f(&vec![1.0; n]);
        assert!(left < 1e-2, "{method:?}: {left}");
    }
    assert!(minimize(&mut smooth(11, bowl), &[1.0; 11], &Method::Newton, &Settings::default()).is_err());
}

#[test]
fn scales_make_units_irrelevant() {
    // The same bowl in millimetres and kilometres.
    let unit = [1e-3, 1e3];
    let f = serial(move |x: &[f64], _| Ok::<_, Infallible>(bowl(&[x[0] / unit[0], x[1] / unit[1]])));
    for method in all_methods() {
        let mut objective = SmoothedLoss::with_scales(f.clone(), unit.to_vec()).expect("scales");
        let start = [3.0 * unit[0], -4.0 * unit[1]];
        let ours = minimize(&mut objective, &start, &method, &settings_for(&method, 2)).expect("a run");
        let plain =
            minimize(&mut smooth(2, bowl), &[3.0, -4.0], &method, &settings_for(&method, 2)).expect("a run");
        for k in 0..2 {
            let difference = (ours.theta[k] / unit[k] - plain.theta[k]).abs();
            assert!(difference < 1e-6, "{method:?}: {difference}");
        }
    }
}

#[test]
fn stop_rules() {
    let run = |settings: &Settings| {
        minimize(&mut smooth(2, bowl), &[3.0, -4.0], &Method::l_bfgs(), settings).expect("a run")
    };
    let base = settings_for(&Method::l_bfgs(), 1);
    assert_eq!(run(&base).stop, Stop::Settled);
    let few = run(&Settings { iterations: 3, ..base.clone() });
    assert_eq!((few.stop, few.history.len()), (Stop::Iterations, 3));
    let short = run(&Settings { evaluations: 20, ..base.clone() });
    assert_eq!((short.stop, short.evaluations), (Stop::Evaluations, 32));
    let every =
        Annealing { start: 0.5, end: 0.1, stages: 2, curve: Curve::Linear, advance: Advance::Every(20) };
    let noisy = run(&Settings { annealing: every, signal_to_noise: Some(1e9), ..base.clone() });
    assert_eq!((noisy.stop, noisy.history.len()), (Stop::SignalToNoise, 25));
    let kept = run(&Settings { keep_theta: true, ..base });
    assert_eq!(kept.history.last().map(|r| r.theta.clone()), Some(kept.theta));
    assert_eq!(kept.history.windows(2).filter(|w| w[1].sigma > w[0].sigma).count(), 0);
}

#[test]
fn negative_curvature_leads_to_the_boundary() {
    // A saddle: the first Newton-CG step from (0.1, 0) along x has negative curvature.
    let saddle = |x: &[f64]| -x[0] * x[0];
    let settings =
        Settings { trust: 1.5, iterations: 1, ..settings_for(&Method::NewtonCg { restart: 3 }, 1) };
    for method in [Method::NewtonCg { restart: 3 }, Method::Newton] {
        let outcome = minimize(&mut smooth(1, saddle), &[0.3], &method, &settings).expect("a run");
        let moved = outcome.theta[0] - 0.3;
        assert!(moved > 0.2 && moved <= 1.5 + 1e-12, "{method:?} moved by {moved}");
    }
}

#[test]
fn adam_follows_sigma() {
    let method = Method::adam(0.5);
    let settings = Settings { iterations: 30, ..settings_for(&method, 1) };
    let outcome = minimize(&mut smooth(1, |x| x[0]), &[0.0], &method, &settings).expect("a run");
    let (first, last) = (&outcome.history[0], &outcome.history[29]);
    assert!((first.step - 0.5).abs() < 1e-3, "{first:?}");
    assert!((last.step / first.step / (last.sigma / first.sigma) - 1.0).abs() < 0.05, "{first:?} {last:?}");
}
