//! Gradient descent and the pooled variants of Adam: known values, bounds, determinism.

use crate::{OptimError, Optimizer, Rows, SecondMoment, State, Temporal};
use photofit_gradcheck::Uniform;

#[test]
fn momentum_finds_the_optimum_of_an_ill_conditioned_quadratic() {
    let scales = [1.0, 0.05];
    for (momentum, limit) in [(0.0, 2.0), (0.9, 4e-4)] {
        let mut x = [3.0_f64, -2.0];
        let mut descent = Optimizer::new("x", 2, Temporal::descent(momentum)).unwrap();
        for _ in 0..300 {
            let g = [scales[0] * (x[0] - 1.0), scales[1] * (x[1] - 2.0)];
            descent.step(&mut x, &g, 0.1 / (1.0 - momentum)).unwrap();
        }
        let error = (x[0] - 1.0).abs().max((x[1] - 2.0).abs());
        assert!(error < limit, "momentum {momentum}: {error}");
        // The comparison must be able to fail: without momentum the flat direction is far from done.
        assert!(momentum > 0.0 || error > 0.1, "{error}");
    }
}

#[test]
fn descent_moves_by_the_gradient_at_any_scale() {
    for scale in [1e-30_f32, 1.0, 1e30] {
        for momentum in [0.0, 0.5] {
            let mut x = [0.0_f32, 0.0];
            let mut descent = Optimizer::new("x", 2, Temporal::descent(momentum)).unwrap();
            descent.step(&mut x, &[2.0 * scale, -scale], 0.25).unwrap();
            assert!(
                (x[0] / scale + 0.5).abs() < 1e-6 && (x[1] / scale - 0.25).abs() < 1e-6,
                "{scale}: {x:?}"
            );
        }
    }
}

#[test]
fn uniform_adam_finds_the_optimum_of_a_quadratic_at_any_scale() {
    for scale in [1e-20_f32, 1.0, 1e20] {
        let mut x = [3.0_f32, -2.0, 0.5];
        let mut adam = Optimizer::new("x", 3, Temporal::uniform_adam()).unwrap();
        for t in 0..600 {
            let g = [x[0] - 1.0, x[1] - 1.0, x[2] - 1.0].map(|d| d * scale);
            adam.step(&mut x, &g, 0.1 * 0.99_f32.powi(t)).unwrap();
        }
        assert!(x.iter().all(|x| (x - 1.0).abs() < 1e-3), "scale {scale}: {x:?}");
    }
}

#[test]
fn uniform_adam_keeps_the_direction_and_moves_by_the_rate() {
    let mut x = [0.0_f64; 3];
    let mut adam = Optimizer::new("x", 3, Temporal::uniform_adam()).unwrap();
    adam.step(&mut x, &[1.0, -4.0, 2.0], 0.5).unwrap();
    for (x, expected) in x.iter().zip([-0.125, 0.5, -0.25]) {
        assert!((x - expected).abs() < 1e-12, "{x} against {expected}");
    }
    let mut still = [1.0_f32; 2];
    let mut adam = Optimizer::new("still", 2, Temporal::uniform_adam()).unwrap();
    adam.step(&mut still, &[0.0; 2], 0.5).unwrap();
    assert_eq!(still, [1.0; 2]);
}

fn paired(second: SecondMoment, b1: f64) -> Temporal {
    Temporal { second, relative_epsilon: 0.0, bias_correction: false, ..Temporal::adam() }.paired(b1)
}

/// Largest component, and largest 3-vector, of 200 steps at rate one under gradients of changing size.
fn longest(second: SecondMoment, b1: f64) -> [f64; 2] {
    let mut rng = Uniform::new(7);
    let mut x = vec![0.0_f64; 15];
    let mut adam = Optimizer::new("x", 15, paired(second, b1)).unwrap();
    let mut longest = [0.0_f64; 2];
    let growth = if b1 > 0.0 { (1.0 - (1.0 - b1) * (1.0 - b1)) / b1 } else { 1.0 };
    for t in 0..200 {
        let mut g: Vec<f64> =
            (0..15).map(|i| rng.range(-1.0, 1.0 + 0.1 * f64::from(i)).powi(1 + t % 5)).collect();
        // The direction that reaches the bound.
        let reach = growth.powi(t - 199);
        (g[0], g[1], g[2]) = (reach * 0.6, reach * 0.8, 0.0);
        let before = x.clone();
        adam.step(&mut x, &g, 1.0).unwrap();
        for (x, y) in x.chunks(3).zip(before.chunks(3)) {
            let square: f64 = x.iter().zip(y).map(|(x, y)| (x - y).powi(2)).sum();
            longest[1] = longest[1].max(square.sqrt());
            longest[0] = x.iter().zip(y).fold(longest[0], |a, (x, y)| a.max((x - y).abs()));
        }
    }
    longest
}

#[test]
fn the_temporal_bound_holds_for_pooled_second_moments() {
    for (b1, stated) in [(0.0, 1.0), (0.2, 1.061), (0.5, 1.225), (0.9, 2.345)] {
        let bound = Temporal::adam().paired(b1).bound();
        assert!((bound - stated).abs() < 1e-3, "b1 {b1}");
        let [component, _] = longest(SecondMoment::GlobalMax, b1);
        assert!(component <= bound * (1.0 + 1e-12), "global max, b1 {b1}: {component} above {bound}");
        let [_, vector] = longest(SecondMoment::PerVector(3), b1);
        assert!(vector <= bound * (1.0 + 1e-12), "vector, b1 {b1}: {vector} above {bound}");
        assert!(vector >= 0.97 * bound, "vector, b1 {b1}: the bound {bound} is not tested by {vector}");
        // Adam bounds components only: its vectors are longer.
        let [_, adam] = longest(SecondMoment::PerEntry, b1);
        assert!(adam > 1.2 * bound, "{adam}");
    }
}

/// Turns 3-vectors about the axis (1, 2, 3) by one radian.
fn turn(v: &[f64]) -> Vec<f64> {
    let k = [1.0, 2.0, 3.0].map(|k: f64| k / 14.0_f64.sqrt());
    let (sin, cos) = 1.0_f64.sin_cos();
    let turned = |v: &[f64]| {
        let dot = k[0] * v[0] + k[1] * v[1] + k[2] * v[2];
        let cross = [k[1] * v[2] - k[2] * v[1], k[2] * v[0] - k[0] * v[2], k[0] * v[1] - k[1] * v[0]];
        [0, 1, 2].map(|i| v[i] * cos + cross[i] * sin + k[i] * dot * (1.0 - cos))
    };
    v.chunks(3).flat_map(turned).collect()
}

#[test]
fn vector_adam_does_not_depend_on_the_axes_and_adam_does() {
    let distance = |second: SecondMoment| {
        let mut rng = Uniform::new(3);
        let (mut x, mut y) = (vec![0.0; 12], vec![0.0; 12]);
        let temporal = Temporal { second, ..Temporal::adam() };
        let (mut a, mut b) =
            (Optimizer::new("x", 12, temporal).unwrap(), Optimizer::new("y", 12, temporal).unwrap());
        for _ in 0..20 {
            let g = rng.vec(12, -1.0, 1.0);
            a.step(&mut x, &g, 0.1).unwrap();
            b.step(&mut y, &turn(&g), 0.1).unwrap();
        }
        turn(&x).iter().zip(&y).fold(0.0_f64, |w, (x, y)| w.max((x - y).abs()))
    };
    assert!(distance(SecondMoment::PerVector(3)) < 1e-12);
    assert!(distance(SecondMoment::PerEntry) > 0.05);
}

#[test]
fn rates_per_channel_work_everywhere() {
    let rates = [0.1, 0.0, 0.2];
    for second in
        [SecondMoment::None, SecondMoment::GlobalMax, SecondMoment::PerVector(3), SecondMoment::PerVector(2)]
    {
        let temporal = Temporal { second, ..Temporal::adam() };
        let mut optimizer = Optimizer::new("x", 6000 * 3, temporal).unwrap();
        let mut x = vec![0.0_f64; 6000 * 3];
        for _ in 0..3 {
            optimizer
                .step_rows(&mut x, &vec![1.0; 6000 * 3], &Rows { rates: &rates, touched: None })
                .unwrap();
        }
        for row in x.chunks(3) {
            assert!(row[1] == 0.0 && row[0] < 0.0, "{second:?}: {row:?}");
            if second != SecondMoment::PerVector(2) {
                assert!((row[2] / row[0] - 2.0).abs() < 1e-9, "{second:?}: {row:?}");
            }
        }
        let touched = vec![true; 6000];
        let rows = Rows { rates: &rates, touched: Some(&touched) };
        let error = optimizer.step_rows(&mut x, &vec![1.0; 6000 * 3], &rows).unwrap_err();
        assert!(matches!(error, OptimError::Combination { .. }), "{error}");
    }
}

#[test]
fn bad_gradients_and_settings_are_refused() {
    for second in [SecondMoment::None, SecondMoment::GlobalMax, SecondMoment::PerVector(2)] {
        let temporal = Temporal { second, ..Temporal::adam() };
        let mut x = vec![1.0_f32; 40_000];
        let mut optimizer = Optimizer::new("positions", x.len(), temporal).unwrap();
        let mut g = vec![0.5_f32; x.len()];
        optimizer.step(&mut x, &g, 0.1).unwrap();
        let (before, state) = (x.clone(), optimizer.state().clone());
        g[33_333] = f32::NAN;
        let error = optimizer.step(&mut x, &g, 0.1).unwrap_err();
        assert_eq!(error.to_string(), "gradient 33333 of parameter group `positions` is NaN");
        assert!(optimizer.step(&mut x, &before, f32::NAN).is_err());
        assert!(optimizer.step(&mut x, &[0.0], 0.1).is_err());
        assert_eq!((&x, optimizer.state()), (&before, &state));
    }
    assert!(Optimizer::<f32>::new("x", 1, Temporal::descent(1.0)).is_err());
    assert!(Optimizer::<f32>::new("x", 4, Temporal::vector_adam(3)).is_err());
    assert!(Optimizer::<f32>::new("x", 4, Temporal::vector_adam(0)).is_err());
}

#[test]
fn restored_states_continue_to_the_same_bits() {
    for second in [SecondMoment::None, SecondMoment::GlobalMax, SecondMoment::PerVector(5)] {
        let temporal = Temporal { second, ..Temporal::adam() };
        let new = || Optimizer::new("a", 50, temporal).unwrap();
        let mut rng = Uniform::new(2);
        let gradients: Vec<Vec<f32>> =
            (0..20).map(|_| rng.vec(50, -1.0, 1.0).iter().map(|g| *g as f32).collect()).collect();
        let mut a = (vec![0.0_f32; 50], new());
        gradients[..10].iter().for_each(|g| a.1.step(&mut a.0, g, 0.01).unwrap());
        let mut b = (a.0.clone(), new());
        b.1.restore(a.1.state().clone()).unwrap();
        for g in &gradients[10..] {
            a.1.step(&mut a.0, g, 0.01).unwrap();
            b.1.step(&mut b.0, g, 0.01).unwrap();
        }
        assert_eq!((&a.0, a.1.state()), (&b.0, b.1.state()));
        assert!(b.1.restore(State::default()).is_err());
    }
}
