//! Adam without filters: known values, bounds, rows, determinism.

use crate::{OptimError, Optimizer, Rows, Temporal};
use photofit_gradcheck::Uniform;
use rayon::prelude::*;

fn config(beta1: f64) -> Temporal {
    Temporal {
        beta1,
        beta2: 1.0 - (1.0 - beta1) * (1.0 - beta1),
        relative_epsilon: 0.0,
        bias_correction: false,
        ..Temporal::adam()
    }
}

#[test]
fn agrees_with_the_textbook() {
    let mut rng = Uniform::new(1);
    let n = 37;
    let mut adam = Optimizer::new("x", n, Temporal { relative_epsilon: 0.0, ..Temporal::adam() }).unwrap();
    let mut x = rng.vec(n, -1.0, 1.0);
    let (mut y, mut m, mut v) = (x.clone(), vec![0.0; n], vec![0.0; n]);
    for t in 1..60 {
        let g = rng.vec(n, -3.0, 3.0);
        adam.step(&mut x, &g, 0.02).unwrap();
        for i in 0..n {
            m[i] = 0.9 * m[i] + 0.1 * g[i];
            v[i] = 0.999 * v[i] + 0.001 * g[i] * g[i];
            let (mh, vh) = (m[i] / (1.0 - 0.9_f64.powi(t)), v[i] / (1.0 - 0.999_f64.powi(t)));
            y[i] -= 0.02 * mh / vh.sqrt();
            assert!((x[i] - y[i]).abs() < 1e-12, "step {t} parameter {i}");
        }
        let mean = v.iter().sum::<f64>() / n as f64;
        assert!((adam.state().mean_square / mean - 1.0).abs() < 1e-12, "mean of v at step {t}");
    }
}

#[test]
fn finds_the_optimum_of_a_quadratic_at_any_gradient_scale() {
    let mut first: Option<Vec<f32>> = None;
    for scale in [0.0_f32, -66.0, 66.0].map(f32::exp2) {
        let mut x = vec![3.0_f32, -2.0, 5.0];
        let mut adam = Optimizer::new("x", 3, Temporal::adam()).unwrap();
        for t in 0..800 {
            let g: Vec<f32> = x.iter().zip([1.0, 0.01, 5.0]).map(|(x, c)| c * (x - 1.0) * scale).collect();
            adam.step(&mut x, &g, 0.1 * 0.99_f32.powi(t)).unwrap();
        }
        assert!(x.iter().all(|x| (x - 1.0).abs() < 2e-3), "scale {scale}: {x:?}");
        // Gradients times a power of two, 1.4e-20 or 7e19: the same bits.
        assert_eq!(first.get_or_insert(x.clone()), &x, "scale {scale}");
    }
}

#[test]
fn extreme_gradients_move_by_the_rate() {
    for g in [1e-20_f32, 1e20, 1e-38, 3e38, 1e-44] {
        let mut x = [0.0_f32; 2];
        let mut adam = Optimizer::new("x", 2, Temporal::adam()).unwrap();
        for t in 1..=20 {
            adam.step(&mut x, &[g, -g], 0.5).unwrap();
            for (x, sign) in x.iter().zip([-0.5, 0.5]) {
                assert!((x / (sign * t as f32) - 1.0).abs() < 1e-4, "gradient {g} step {t}: {x}");
            }
        }
    }
}

#[test]
fn a_change_of_scale_during_the_run_is_survived() {
    for (before, after) in [(1.0_f32, 1e25), (1e25, 1.0), (0.0, 1e-30), (1e-30, 1e30)] {
        let mut x = [0.0_f32];
        let mut adam = Optimizer::new("x", 1, Temporal::adam()).unwrap();
        for t in 0..40 {
            adam.step(&mut x, &[if t < 20 { before } else { after }], 0.01).unwrap();
            assert!(
                x[0].is_finite() && x[0].abs() <= 0.01 * 4.0 * (t + 1) as f32,
                "{before} to {after}: {x:?}"
            );
        }
        assert!(adam.state().m[0].is_finite() && adam.state().v[0].is_finite(), "{before} to {after}");
        assert!(x[0] < -0.01, "{before} to {after}: {x:?}");
    }
}

#[test]
fn a_lone_gradient_moves_by_exactly_the_rate() {
    // Relation 1 - b1 = sqrt(1 - b2).
    for b1 in [0.0, 0.2, 0.5, 0.9] {
        let mut x = [1.0_f64, 1.0];
        let mut adam = Optimizer::new("x", 2, config(b1)).unwrap();
        adam.step(&mut x, &[0.0, 0.0], 0.125).unwrap();
        adam.step(&mut x, &[-7.3, 1e-3], 0.125).unwrap();
        assert!((x[0] - 1.125).abs() < 1e-12 && (x[1] - 0.875).abs() < 1e-12, "b1 {b1}: {x:?}");
    }
}

#[test]
fn the_temporal_bound_is_kept_and_nearly_reached() {
    for (b1, stated) in [(0.0_f64, 1.0), (0.2, 1.061), (0.5, 1.225), (0.9, 2.345)] {
        let bound = ((2.0 - b1) / (2.0 * (1.0 - b1))).sqrt();
        assert!((bound - stated).abs() < 1e-3, "b1 {b1}");
        let b2 = 1.0 - (1.0 - b1) * (1.0 - b1);
        let mut rng = Uniform::new(3);
        let mut adam = Optimizer::new("x", 64, config(b1)).unwrap();
        // Parameter 0 gets the gradients that reach the bound, growing like (b2/b1)^-age.
        let growth = if b1 > 0.0 { b2 / b1 } else { 1.0 };
        let (mut x, mut largest) = (vec![0.0_f64; 64], 0.0_f64);
        for t in 0..120 {
            let mut g: Vec<f64> = (0..64).map(|i| rng.range(-1.0, 1.0).powi(1 + i % 7)).collect();
            g[0] = growth.powi(t - 119);
            let before = x.clone();
            adam.step(&mut x, &g, 1.0).unwrap();
            for i in 0..64 {
                largest = largest.max((x[i] - before[i]).abs());
            }
        }
        assert!(largest <= bound * (1.0 + 1e-9), "b1 {b1}: {largest} above {bound}");
        assert!(largest >= bound * 0.98, "b1 {b1}: {largest} far below {bound}, the bound is not tested");
    }
}

#[test]
fn without_memory_the_step_is_the_sign() {
    let mut x = [0.0_f32; 3];
    let mut adam = Optimizer::new("x", 3, Temporal { beta1: 0.0, beta2: 0.0, ..Temporal::adam() }).unwrap();
    assert!(adam.state().m.is_empty() && adam.state().v.is_empty());
    adam.step(&mut x, &[2e-12, -3e-9, 0.0], 0.25).unwrap();
    assert!((x[0] + 0.25).abs() < 1e-3 && (x[1] - 0.25).abs() < 1e-5 && x[2] == 0.0, "{x:?}");
}

#[test]
fn non_finite_gradients_change_nothing() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut x = vec![0.5_f32; 50_000];
        let mut adam = Optimizer::new("base_color", x.len(), Temporal::adam()).unwrap();
        let mut g = vec![0.1_f32; x.len()];
        adam.step(&mut x, &g, 0.1).unwrap();
        let (before, state) = (x.clone(), adam.state().clone());
        (g[41_234], g[49_999]) = (bad, bad);
        match adam.step(&mut x, &g, 0.1).unwrap_err() {
            OptimError::NonFiniteGradient { group, index, .. } => {
                assert_eq!((group.as_str(), index), ("base_color", 41_234))
            }
            other => panic!("{other}"),
        }
        assert_eq!((&x, adam.state()), (&before, &state));
        let rates = [0.1_f32; 5];
        let mut touched = vec![true; 10_000];
        assert!(adam.step_rows(&mut x, &g, &Rows { rates: &rates, touched: Some(&touched) }).is_err());
        assert_eq!((&x, adam.state()), (&before, &state));
        // Untouched rows are not read.
        (touched[41_234 / 5], touched[49_999 / 5]) = (false, false);
        adam.step_rows(&mut x, &g, &Rows { rates: &rates, touched: Some(&touched) }).unwrap();
        assert_eq!((x[41_234], x[49_999]), (before[41_234], before[49_999]));
        assert_ne!(x[0], before[0]);
    }
}

#[test]
fn wrong_shapes_and_settings_are_refused() {
    let mut adam = Optimizer::<f32>::new("x", 4, Temporal::adam()).unwrap();
    let mut x = [0.0_f32; 4];
    for (rows, grads) in [
        (Rows { rates: &[0.1, 0.1, 0.1], touched: None }, 4),
        (Rows { rates: &[], touched: None }, 4),
        (Rows { rates: &[0.1, 0.1], touched: Some(&[true]) }, 4),
        (Rows { rates: &[0.1, -0.1], touched: None }, 4),
        (Rows { rates: &[0.1, f32::INFINITY], touched: None }, 4),
        (Rows { rates: &[0.1], touched: None }, 3),
    ] {
        assert!(adam.step_rows(&mut x, &[1.0; 4][..grads], &rows).is_err(), "{rows:?}");
    }
    assert_eq!((x, adam.state().step), ([0.0; 4], 0));
    for bad in [
        Temporal { beta1: 1.0, ..Temporal::adam() },
        Temporal { beta2: f64::NAN, ..Temporal::adam() },
        Temporal { relative_epsilon: -1.0, ..Temporal::adam() },
    ] {
        assert!(Optimizer::<f32>::new("x", 1, bad).is_err(), "{bad:?}");
    }
    let mut state = adam.state().clone();
    state.v[1] = f32::NAN;
    assert!(adam.restore(state).is_err());
    Optimizer::<f32>::new("empty", 0, Temporal::adam()).unwrap().step(&mut [], &[], 0.1).unwrap();
}

#[test]
fn rows_wait_untouched() {
    let (width, rows) = (4, 50);
    let rates = [0.1_f32, 0.0, 0.2, 0.1];
    let mut rng = Uniform::new(4);
    let mut adam = Optimizer::new("texels", width * rows, Temporal::adam()).unwrap();
    let mut x: Vec<f32> = rng.vec(width * rows, 0.0, 1.0).iter().map(|x| *x as f32).collect();
    let start = x.clone();
    let mut seen = vec![0_u32; rows];
    for _ in 0..30 {
        let touched: Vec<bool> = (0..rows).map(|r| r > 0 && rng.range(0.0, 1.0) < 0.3).collect();
        // Gradients of one sign, and only of one size: every touched sample moves by its full rate.
        let g = vec![2.5_f32; width * rows];
        let before = x.clone();
        adam.step_rows(&mut x, &g, &Rows { rates: &rates, touched: Some(&touched) }).unwrap();
        for r in 0..rows {
            seen[r] += u32::from(touched[r]);
            for c in 0..width {
                let i = r * width + c;
                let moved = if touched[r] { rates[c] } else { 0.0 };
                assert!((before[i] - x[i] - moved).abs() < 1e-5, "row {r} channel {c}");
                assert!(touched[r] || before[i].to_bits() == x[i].to_bits(), "row {r} keeps its bits");
            }
        }
    }
    assert_eq!(adam.state().row_steps, seen);
    assert!(seen[1..].iter().any(|s| *s > 5) && seen[0] == 0);
    assert_eq!(x[..width], start[..width]);
    assert!(
        (0..rows).all(|r| x[r * width + 1].to_bits() == start[r * width + 1].to_bits()),
        "frozen channel"
    );
    let (before, state) = (x.clone(), adam.state().clone());
    let none = vec![false; rows];
    adam.step_rows(&mut x, &vec![f32::NAN; width * rows], &Rows { rates: &rates, touched: Some(&none) })
        .unwrap();
    assert_eq!((&x, adam.state()), (&before, &state), "nothing touched, nothing changed");
}

#[test]
fn rows_all_touched_equal_the_dense_step() {
    let mut rng = Uniform::new(5);
    let n = 16 * 2000;
    let mut a = (vec![0.0_f32; n], Optimizer::new("a", n, Temporal::adam()).unwrap());
    let mut b = (a.0.clone(), Optimizer::new("a", n, Temporal::adam()).unwrap());
    let rates = [0.01_f32; 16];
    let touched = vec![true; 2000];
    for t in 0..6 {
        let g: Vec<f32> = rng.vec(n, -1.0, 1.0).iter().map(|g| *g as f32).collect();
        a.1.step_rows(&mut a.0, &g, &Rows { rates: &rates, touched: None }).unwrap();
        let touched = (t > 1).then_some(&touched[..]);
        b.1.step_rows(&mut b.0, &g, &Rows { rates: &rates, touched }).unwrap();
    }
    assert_eq!(a.0, b.0);
    // A plain step after rows have their counts still moves every row.
    let g = vec![1.0_f32; n];
    b.1.step(&mut b.0, &g, 0.01).unwrap();
    assert!(b.1.state().row_steps.iter().all(|s| *s == 7));
}

#[test]
fn a_restored_state_continues_to_the_same_bits() {
    let mut rng = Uniform::new(8);
    let mut step = |x: &mut (Vec<f32>, Optimizer<f32>), y: Option<&mut (Vec<f32>, Optimizer<f32>)>| {
        let g: Vec<f32> = rng.vec(64, -1e-12, 1e-12).iter().map(|g| *g as f32).collect();
        let touched: Vec<bool> = (0..16).map(|_| rng.range(0.0, 1.0) < 0.5).collect();
        let rows = Rows { rates: &[0.1_f32, 0.0, 0.05, 0.2], touched: Some(&touched) };
        x.1.step_rows(&mut x.0, &g, &rows).unwrap();
        if let Some(y) = y {
            y.1.step_rows(&mut y.0, &g, &rows).unwrap();
        }
    };
    let mut a = (vec![0.5_f32; 64], Optimizer::new("a", 64, Temporal::adam()).unwrap());
    (0..15).for_each(|_| step(&mut a, None));
    let mut b = (a.0.clone(), Optimizer::new("a", 64, Temporal::adam()).unwrap());
    b.1.restore(a.1.state().clone()).unwrap();
    (0..15).for_each(|_| step(&mut a, Some(&mut b)));
    assert_eq!((&a.0, a.1.state()), (&b.0, b.1.state()));
}

#[test]
fn threads_do_not_change_a_bit() {
    let n = 16 * 5000;
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut rng = Uniform::new(9);
            let mut x = vec![0.0_f32; n];
            let mut adam = Optimizer::new("x", n, Temporal::adam()).unwrap();
            for _ in 0..4 {
                let g: Vec<f32> = rng.vec(n, -1.0, 1.0).iter().map(|g| *g as f32).collect();
                adam.step(&mut x, &g, 0.01).unwrap();
            }
            (x, adam.state().clone())
        })
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn moments_without_gradients_do_not_become_subnormal() {
    let mut x = [0.0_f32; 2];
    let mut adam = Optimizer::new("x", 2, Temporal { beta2: 0.9, ..Temporal::adam() }).unwrap();
    adam.step(&mut x, &[1.0, 1.0], 0.1).unwrap();
    for _ in 0..2000 {
        adam.step(&mut x, &[1.0, 0.0], 0.1).unwrap();
        assert!(!adam.state().m[1].is_subnormal() && !adam.state().v[1].is_subnormal());
    }
    assert_eq!((adam.state().m[1], adam.state().v[1]), (0.0, 0.0));
}

#[test]
#[ignore = "measurement"]
fn time_of_sixteen_million_parameters() {
    let n = 1 << 24;
    let mut x = vec![0.5_f32; n];
    let g: Vec<f32> = (0..n).map(|i| (i % 1001) as f32 * 1e-6).collect();
    let mut adam = Optimizer::new("x", n, Temporal::adam()).unwrap();
    let mut copy = vec![0.0_f32; n];
    let rates = [0.01_f32; 16];
    let tenth: Vec<bool> = (0..n / 16).map(|r| (r / 64) % 10 == 0).collect();
    let mut best = [f64::INFINITY; 4];
    let time = |best: &mut f64, f: &mut dyn FnMut()| {
        let start = std::time::Instant::now();
        f();
        *best = best.min(start.elapsed().as_secs_f64());
    };
    for _ in 0..6 {
        time(&mut best[0], &mut || {
            copy.par_chunks_mut(1 << 14).zip(g.par_chunks(1 << 14)).for_each(|(c, g)| c.copy_from_slice(g))
        });
        time(&mut best[1], &mut || adam.step(&mut x, &g, 0.01).unwrap());
        let all = Rows { rates: &rates, touched: None };
        time(&mut best[2], &mut || adam.step_rows(&mut x, &g, &all).unwrap());
    }
    let some = Rows { rates: &rates, touched: Some(&tenth) };
    for _ in 0..6 {
        time(&mut best[3], &mut || adam.step_rows(&mut x, &g, &some).unwrap());
    }
    let [copied, dense, rows, lazy] = best.map(|s| s * 1e3);
    println!(
        "16M: copy {copied:.1} ms ({:.1} GB/s), dense {dense:.1} ms ({:.1} GB/s), rows {rows:.1} ms, a tenth of the rows {lazy:.1} ms",
        n as f64 * 8e-6 / copied,
        n as f64 * 32e-6 / dense
    );
    assert!(copy[5] >= 0.0);
}
