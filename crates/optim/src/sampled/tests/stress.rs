//! What must not break: huge and tiny values, plateaus, NaN, settings out of range.

use super::*;
use crate::sampled::{Annealing, Method, SampledError, Settings, Stop, minimize};

fn bowl(x: &[f64]) -> f64 {
    x[0] * x[0] + 2.0 * x[1] * x[1]
}

fn methods() -> [Method; 5] {
    [Method::adam(0.3), Method::NewtonCg { restart: 4 }, Method::l_bfgs(), Method::Bfgs, Method::Newton]
}

#[test]
fn the_size_of_the_loss_does_not_matter() {
    for method in methods() {
        let annealing = Annealing::linear(1.0, 0.02, 60);
        let settings = Settings { annealing, iterations: 60, seed: 4, ..Settings::default() };
        let run = |factor: f64| {
            let mut objective = smooth(2, |x| factor * bowl(x));
            minimize(&mut objective, &[2.0, -1.0], &method, &settings).expect("a run").theta
        };
        let plain = run(1.0);
        for factor in [1e-20, 1e20, 1e-150, 1e140] {
            let theta = run(factor);
            for k in 0..2 {
                assert!((theta[k] - plain[k]).abs() < 1e-3, "{method:?} {factor:e}: {theta:?} for {plain:?}");
            }
        }
    }
}

#[test]
fn plateaus_say_so_and_move_nothing() {
    for method in methods() {
        for level in [0.0, 7.0, -1e20] {
            let settings = Settings { patience: 3, ..Settings::default() };
            let outcome =
                minimize(&mut smooth(2, |_| level), &[2.0, -1.0], &method, &settings).expect("a run");
            assert_eq!(outcome.stop, Stop::NoInformation, "{method:?}");
            assert_eq!(outcome.theta, [2.0, -1.0], "{method:?}");
            assert_eq!(outcome.history.len(), 3);
        }
    }
    // Far from a step, an estimate without cancellation is not zero: it is marked.
    let far = SamplePoint { theta: &[1e3], ..AT };
    let e = value(smooth(1, step).gradient(far, estimator(7, Stencil::Plain, Kernel::Coordinates)));
    assert!(!e.informative && e.value[0] != 0.0, "{e:?}");
    assert!(
        value(smooth(1, step).gradient(AT, estimator(50, Stencil::Plain, Kernel::Coordinates))).informative
    );
}

#[test]
fn values_that_are_not_finite_are_named() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut calls = 0;
        let f = serial(move |x: &[f64], _| {
            calls += 1;
            Ok::<_, Infallible>(if calls == 6 { bad } else { x[0] })
        });
        let mut objective = SmoothedLoss::new(f, 2).expect("parameters");
        let at = SamplePoint { theta: &[0.5, 0.25], sigma: 0.1, seed: 3 };
        let error = objective
            .gradient(at, estimator(2, Stencil::Antithetic, Kernel::Coordinates))
            .expect_err("not finite");
        let SampledError::NonFinite { evaluation, ref point, value, .. } = error else {
            panic!("{error:?}");
        };
        assert_eq!((evaluation, point.len()), (5, 2));
        assert!(value.is_nan() == bad.is_nan() && (point[0] - 0.5).abs() < 1.0);
        assert!(error.to_string().contains("evaluation 5 of the black box"), "{error}");
    }
}

#[test]
fn failures_of_the_black_box_come_through() {
    let f = serial(|x: &[f64], _| if x[0] > 1.0 { Err("too far") } else { Ok(x[0]) });
    let mut objective = SmoothedLoss::new(f, 1).expect("parameters");
    let outcome = minimize(&mut objective, &[5.0], &Method::l_bfgs(), &Settings::default());
    assert_eq!(outcome, Err(SampledError::BlackBox("too far")));
    let f = crate::sampled::parallel(|x: &[f64], seed| if x[0] > 0.4 { Err((x[0], seed)) } else { Ok(1.0) });
    let mut objective = SmoothedLoss::new(f, 1).expect("parameters");
    let first = objective.gradient(AT, Estimator { samples: 500, ..Estimator::default() });
    for _ in 0..5 {
        assert_eq!(
            objective.gradient(AT, Estimator { samples: 500, ..Estimator::default() }),
            first,
            "the first by index"
        );
    }
}

#[test]
fn settings_out_of_range_are_errors() {
    let bad_place = [
        SamplePoint { sigma: 0.0, ..AT },
        SamplePoint { sigma: f64::NAN, ..AT },
        SamplePoint { sigma: -1.0, ..AT },
        SamplePoint { theta: &[0.0, 1.0], ..AT },
        SamplePoint { theta: &[f64::NAN], ..AT },
        SamplePoint { theta: &[], ..AT },
    ];
    for at in bad_place {
        assert!(
            matches!(smooth(1, step).gradient(at, Estimator::default()), Err(SampledError::Setting(_))),
            "{at:?}"
        );
        assert!(
            matches!(
                smooth(1, step).curvature(at, &[1.0], Estimator::default()),
                Err(SampledError::Setting(_))
            ),
            "{at:?}"
        );
    }
    assert!(smooth(1, step).gradient(AT, Estimator { samples: 0, ..Estimator::default() }).is_err());
    assert!(smooth(1, step).curvature(AT, &[1.0, 2.0], Estimator::default()).is_err());
    let f = || serial(|_: &[f64], _| Ok::<_, Infallible>(0.0));
    assert!(SmoothedLoss::new(f(), 0).is_err());
    for scale in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(SmoothedLoss::with_scales(f(), vec![1.0, scale]).is_err(), "{scale}");
    }
    let base = Settings::default();
    for settings in [
        Settings { trust: 0.0, ..base.clone() },
        Settings { patience: 0, ..base.clone() },
        Settings { annealing: Annealing { stages: 0, ..base.annealing }, ..base.clone() },
        Settings { annealing: Annealing { end: 0.0, ..base.annealing }, ..base.clone() },
        Settings { gradient: Estimator { samples: 0, ..base.gradient }, ..base.clone() },
    ] {
        assert!(
            minimize(&mut smooth(1, step), &[0.0], &Method::l_bfgs(), &settings).is_err(),
            "{settings:?}"
        );
    }
    for method in [Method::adam(f64::NAN), Method::NewtonCg { restart: 0 }, Method::LBfgs { memory: 0 }] {
        assert!(minimize(&mut smooth(1, step), &[0.0], &method, &base).is_err(), "{method:?}");
    }
    assert!(
        minimize(&mut smooth(1, step), &[0.0, 1.0], &Method::Newton, &base).is_err(),
        "two starts for one"
    );
}

#[test]
fn directions_without_length_cost_nothing() {
    let mut objective = smooth(2, bowl);
    let at = SamplePoint { theta: &[0.1, 0.2], sigma: 0.5, seed: 1 };
    assert_eq!(value(objective.curvature(at, &[0.0, 0.0], Estimator::default())).value, [0.0]);
    assert_eq!(value(objective.hessian_product(at, &[0.0, 0.0], Estimator::default())).value, [0.0, 0.0]);
    assert_eq!(objective.evaluations(), 0);
    // Lengths whose squares vanish or overflow are lengths all the same.
    let estimator = estimator(2000, Stencil::FourPoint, Kernel::Coordinates);
    for size in [1e-170, 1e170] {
        let e = value(objective.hessian_product(at, &[size, 0.0], estimator));
        assert!((e.value[0] / size - 2.0).abs() < 0.5, "{size:e}: {:?}", e.value);
    }
}

#[test]
fn sigma_below_the_resolution_of_theta_is_a_plateau() {
    let at = SamplePoint { theta: &[1.0, 1.0], sigma: 1e-300, seed: 1 };
    assert!(!value(smooth(2, bowl).gradient(at, Estimator::default())).informative);
    // At zero it is not: the smallest steps still count.
    let at = SamplePoint { theta: &[0.0, 0.0], sigma: 1e-120, seed: 1 };
    let slope = |x: &[f64]| 3.0 * x[0] - x[1];
    let e = value(smooth(2, slope).gradient(at, estimator(20_000, Stencil::FourPoint, Kernel::Coordinates)));
    assert!((e.value[0] - 3.0).abs() < 0.1 && (e.value[1] + 1.0).abs() < 0.1, "{e:?}");
}
