//! Tests of the losses.

use super::curve::{LossScalar, tone};
use super::{Loss, PictureLayout, SAMPLE_MAX};
use photofit_gradcheck::{Uniform, check};

const ALL: [Loss; 6] =
    [Loss::LogSrgbL1, Loss::LogSrgbL2, Loss::Mse, Loss::Smape, Loss::RelativeL2, Loss::Ssim];

/// Radiance over several orders of magnitude, some of it negative; no two samples nearly equal.
fn images(random: &mut Uniform, n: usize) -> (Vec<f64>, Vec<f64>) {
    let mut x = Vec::with_capacity(n);
    let mut y = Vec::with_capacity(n);
    for _ in 0..n {
        let base =
            10f64.powf(random.range(-2.5, 1.5)) * if random.range(0.0, 1.0) < 0.15 { -0.05 } else { 1.0 };
        let ratio = random.range(0.05, 0.5) * random.range(-1.0, 1.0).signum();
        x.push(base);
        y.push(base * (1.0 + ratio));
    }
    (x, y)
}

#[test]
fn gradients_of_every_loss() {
    let mut random = Uniform::new(2);
    for (width, height, channels, read) in [
        (9, 7, 3, 0..3),
        (5, 4, 4, 0..3),
        (4, 17, 4, 1..4),
        (1, 1, 1, 0..1),
        (3, 2, 2, 0..2),
        (13, 12, 1, 0..1),
    ] {
        let n = width * height;
        let weights = random.vec(n, 0.1, 2.0);
        let (x, y) = images(&mut random, n * channels);
        for loss in ALL {
            for weighted in [false, true] {
                let layout = PictureLayout::new(width, height, channels).only(read.clone());
                let layout = if weighted { layout.weighted(&weights) } else { layout };
                let factor = random.range(0.5, 2.0);
                // Gradients accumulate.
                let before = random.vec(n * channels, -1.0, 1.0);
                let mut g = before.clone();
                let value = loss.value_and_gradient(&x, &y, &layout, factor, &mut g);
                assert!((value - factor * loss.value(&x, &y, &layout)).abs() < 1e-12, "{loss:?}");
                g.iter_mut().zip(&before).for_each(|(g, b)| *g -= b);
                check(&format!("{loss:?} {width}x{height}x{channels}"), &x, &g, 1e-6, 1e-5, |x| {
                    factor * loss.value(x, &y, &layout)
                });
            }
        }
    }
}

#[test]
fn ssim_gradient_across_bands() {
    // Taller than a band, so that windows reach over its border.
    let mut random = Uniform::new(2);
    let (width, height) = (2, 70);
    let (x, y) = images(&mut random, width * height);
    let layout = PictureLayout::new(width, height, 1);
    let mut g = vec![0.0; x.len()];
    Loss::Ssim.value_and_gradient(&x, &y, &layout, 1.0, &mut g);
    check("ssim over bands", &x, &g, 1e-6, 1e-5, |x| Loss::Ssim.value(x, &y, &layout));
}

#[test]
fn known_values() {
    let layout = PictureLayout::new(1, 1, 1);
    let value = |loss: Loss, x: f64, y: f64| loss.value(&[x], &[y], &layout);
    let g = |t: f64| if t <= 0.0031308 { 12.92 * t } else { 1.055 * t.powf(1.0 / 2.4) - 0.055 };
    let s = |x: f64| g(x.ln_1p());
    assert!((value(Loss::LogSrgbL1, 2.0, 0.001) - (s(2.0) - s(0.001))).abs() < 1e-12);
    assert!((value(Loss::LogSrgbL1, -2.0, 0.5) - (s(2.0) + s(0.5))).abs() < 1e-12);
    assert!((value(Loss::LogSrgbL2, 2.0, 0.5) - (s(2.0) - s(0.5)).powi(2)).abs() < 1e-12);
    assert!((value(Loss::Mse, 2.0, 0.5) - 2.25).abs() < 1e-12);
    assert!((value(Loss::Smape, 2.0, 0.5) - 1.5 / 2.51).abs() < 1e-12);
    assert!((value(Loss::RelativeL2, 2.0, 0.5) - 2.25 / 4.35).abs() < 1e-12);
    // A single pixel has no variance: SSIM is (2 a b + C1) / (a^2 + b^2 + C1).
    let (a, b) = (s(2.0), s(0.5));
    let expected = 1.0 - (2.0 * a * b + 1e-4) / (a * a + b * b + 1e-4);
    assert!((value(Loss::Ssim, 2.0, 0.5) - expected).abs() < 1e-12);
    let alpha = PictureLayout::new(1, 1, 4).only(3..4);
    assert!((Loss::Mse.value(&[9.0, 9.0, 9.0, 0.25], &[0.0, 0.0, 0.0, 0.75], &alpha) - 0.25).abs() < 1e-12);
}

#[test]
fn equal_images_have_no_loss_and_no_gradient() {
    let mut random = Uniform::new(3);
    let (x, _) = images(&mut random, 8 * 8 * 3);
    let layout = PictureLayout::new(8, 8, 3);
    for loss in ALL {
        let mut g = vec![0.0; x.len()];
        let value = loss.value_and_gradient(&x, &x, &layout, 1.0, &mut g);
        assert!(value.abs() < 1e-12, "{loss:?}: {value}");
        assert!(g.iter().all(|g| g.abs() < 1e-12), "{loss:?}");
        let mut other = x.clone();
        other[100] *= 1.01;
        other[101] *= 1.01;
        other[100 / 3 * 3 + 2] *= 1.01;
        assert!(loss.value(&other, &x, &layout) > 1e-12, "{loss:?} sees no difference");
    }
}

#[test]
fn ssim_of_the_negated_texture_is_near_two() {
    let a: Vec<f64> = (0..400).map(|i| if (i + i / 20) % 2 == 0 { 1.0 } else { -1.0 }).collect();
    let b: Vec<f64> = a.iter().map(|v| -v).collect();
    let value = Loss::Ssim.value(&a, &b, &PictureLayout::new(20, 20, 1));
    assert!(value > 1.5, "{value}");
}

#[test]
fn single_precision_agrees_with_double() {
    let mut random = Uniform::new(4);
    let (width, height) = (61, 33);
    let (x, y) = images(&mut random, width * height * 3);
    let narrow = |v: &[f64]| v.iter().map(|v| *v as f32).collect::<Vec<f32>>();
    let wide = |v: &[f32]| v.iter().map(|v| f64::from(*v)).collect::<Vec<f64>>();
    let (x32, y32) = (narrow(&x), narrow(&y));
    let (x, y) = (wide(&x32), wide(&y32));
    for loss in ALL {
        let (mut g, mut g32) = (vec![0.0; x.len()], vec![0.0; x.len()]);
        let a = loss.value_and_gradient(&x, &y, &PictureLayout::new(width, height, 3), 1.0, &mut g);
        let b = loss.value_and_gradient(&x32, &y32, &PictureLayout::new(width, height, 3), 1.0, &mut g32);
        let tolerance = if loss == Loss::Ssim { 1e-4 } else { 2e-6 };
        assert!((a - b).abs() < tolerance * a, "{loss:?}: {a} {b}");
        let norm: f64 = g.iter().map(|v| v * v).sum();
        let error: f64 = g.iter().zip(&g32).map(|(a, b)| (a - f64::from(*b)).powi(2)).sum();
        assert!(error.sqrt() < 20.0 * tolerance * norm.sqrt(), "{loss:?}: {:.2e}", (error / norm).sqrt());
    }
}

#[test]
fn the_fast_curve_is_accurate_and_monotone() {
    let mut last = -1.0;
    for i in 0..200_000 {
        let x = 10f64.powf(-8.0 + 12.8 * f64::from(i) / 200_000.0) as f32;
        let (s, d) = f32::log_srgb::<false>(x);
        let (es, ed) = f64::log_srgb::<false>(f64::from(x));
        assert!((f64::from(s) - es).abs() < 1e-7 + 5e-7 * es, "S({x}) = {s}, not {es}");
        assert!((f64::from(d) - ed).abs() < 2e-6 * ed, "S'({x}) = {d}, not {ed}");
        assert!(f64::from(s) > last - 2e-7, "S falls at {x}");
        last = f64::from(s);
    }
    assert_eq!(f32::log_srgb::<false>(0.0), (0.0, 12.92));
}

#[test]
fn the_curve_is_odd_and_clamped() {
    for x in [0.0_f32, 1e-6, 0.002, 0.5, 30.0] {
        let ((a, da), (b, db)) = (tone::<f32, false>(x), tone::<f32, false>(-x));
        assert_eq!((a, da), (-b, db));
    }
    assert_eq!(tone::<f32, false>(f32::INFINITY), (tone::<f32, false>(SAMPLE_MAX as f32).0, 0.0));
    assert!(tone::<f32, false>(f32::NAN).0.is_nan());
}

#[test]
fn infinities_are_clamped_and_nan_is_shown() {
    let layout = PictureLayout::new(2, 1, 1);
    for loss in ALL {
        let mut g = [0.0_f32; 2];
        let value =
            loss.value_and_gradient(&[f32::INFINITY, 0.5], &[1.0, f32::NEG_INFINITY], &layout, 1.0, &mut g);
        assert!(value.is_finite() && value > 0.0, "{loss:?}: {value}");
        assert!(g.iter().all(|g| g.is_finite()), "{loss:?}: {g:?}");
        assert_eq!(g[0], 0.0, "{loss:?}: no gradient beyond the clamp");
        assert!(loss.value(&[0.1, f32::NAN], &[1.0, 1.0], &layout).is_nan(), "{loss:?} hides NaN");
        assert_eq!(loss.value::<f32>(&[], &[], &PictureLayout::new(0, 5, 3)), 0.0);
    }
}

#[test]
fn masked_samples_are_not_looked_at() {
    let (x, y) = ([0.3_f32, f32::NAN, 0.7, f32::NAN], [0.4_f32, 1.0, 0.2, 0.0]);
    let weights = [1.0_f32, 0.0];
    let mut g = [0.0; 4];
    let layout = PictureLayout::new(2, 1, 2).only(0..1).weighted(&weights);
    let value = Loss::Mse.value_and_gradient(&x, &y, &layout, 1.0, &mut g);
    assert!((value - 0.01 / 2.0).abs() < 1e-7, "{value}");
    assert!((g[0] + 0.1).abs() < 1e-6 && g[1..] == [0.0; 3], "{g:?}");
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let mut random = Uniform::new(5);
    let (width, height) = (150, 200);
    let (x, y) = images(&mut random, width * height * 3);
    let (x, y): (Vec<f32>, Vec<f32>) =
        (x.iter().map(|v| *v as f32).collect(), y.iter().map(|v| *v as f32).collect());
    let layout = PictureLayout::new(width, height, 3);
    for loss in ALL {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut g = vec![0.0; x.len()];
                let value = loss.value_and_gradient(&x, &y, &layout, 1.0, &mut g);
                (value.to_bits(), g)
            })
        };
        let one = run(1);
        assert_eq!(one, run(3), "{loss:?}");
        assert_eq!(one.0, loss.value(&x, &y, &layout).to_bits(), "{loss:?}: value alone");
    }
}

#[test]
#[ignore = "measures time: cargo test --release -p photofit-raster --lib loss -- --ignored --nocapture"]
fn bench() {
    let mut random = Uniform::new(6);
    let (x, y) = images(&mut random, 512 * 512 * 3);
    let (x, y): (Vec<f32>, Vec<f32>) =
        (x.iter().map(|v| *v as f32).collect(), y.iter().map(|v| *v as f32).collect());
    let mut g = vec![0.0; x.len()];
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for loss in ALL {
        let mut best = f64::INFINITY;
        for _ in 0..10 {
            let start = std::time::Instant::now();
            pool.install(|| loss.value_and_gradient(&x, &y, &PictureLayout::new(512, 512, 3), 1.0, &mut g));
            best = best.min(start.elapsed().as_secs_f64());
        }
        println!("{loss:?}: {:.2} ms for 512x512x3 on one thread", best * 1e3);
    }
}
