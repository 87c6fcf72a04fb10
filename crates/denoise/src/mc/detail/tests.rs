//! Shadows come back, noise stays out; gains against a grid; the standard error of products.

use super::*;
use photofit_sampling::Rng;

const WIDTH: usize = 96;
const N: usize = WIDTH * 64;

fn rms(u: &[f32], v: &[f32]) -> f64 {
    (u.iter().zip(v).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / u.len() as f64).sqrt()
}

fn restored(noisy: &[f32], weight: &[f32], variance: Option<&[f32]>, start: &[f32]) -> Vec<f32> {
    let detail = Detail {
        width: WIDTH,
        irradiance: noisy,
        weight,
        variance,
        independent: true,
        features: &[],
        apart: &[],
        history: None,
    };
    let mut u = start.to_vec();
    let shares = restore_detail(&detail, &mut u);
    match shares {
        Shares::Gaussian(share) => assert!(variance.is_none() && (0.0..=1.0).contains(&share)),
        Shares::Bilateral { means, own } => {
            assert!(means.iter().chain([&own]).all(|share| (0.0..=1.0).contains(share)));
        }
    }
    u
}

#[test]
fn a_shadow_comes_back_and_noise_stays_out() {
    let sigma = 0.2_f32;
    let truth: Vec<f32> = (0..3 * N).map(|i| if i % WIDTH < 40 { 0.5 } else { 1.0 }).collect();
    let mut rng = Rng::new(3, 0);
    let noisy: Vec<f32> = truth.iter().map(|t| t + sigma * rng.normal()).collect();
    let (flat, mut weight, variance) = (vec![0.8; 3 * N], vec![1.0; N], vec![sigma * sigma; N]);
    for variance in [Some(&variance[..]), None] {
        let u = restored(&noisy, &weight, variance, &flat);
        println!("shadow {:.4} of {:.4}", rms(&u, &truth), rms(&flat, &truth));
        assert!(rms(&u, &truth) < 0.3 * rms(&flat, &truth), "{} {variance:?}", rms(&u, &truth));
        // Nothing is missing from the truth: the noise must not come in.
        let u = restored(&noisy, &weight, variance, &truth);
        println!("noise {:.4} of {sigma}", rms(&u, &truth));
        assert!(rms(&u, &truth) < 0.35 * f64::from(sigma), "{}", rms(&u, &truth));
    }
    // Holes stay, and have no part in what is around.
    let mut holed = noisy;
    let hole = 20 * WIDTH + 20;
    (0..3).for_each(|c| holed[c * N + hole] = 1e6);
    weight[hole] = 0.0;
    let u = restored(&holed, &weight, Some(&variance), &flat);
    assert!(u[hole] == 0.8 && (u[hole + 1] - 0.5).abs() < 0.2, "{} {}", u[hole], u[hole + 1]);
}

#[test]
fn gains_fit_as_well_as_the_best_of_a_grid() {
    let mut rng = Rng::new(11, 0);
    for case in 0..400 {
        // Samples of w, d and r, of all correlations; parallel and absent means too.
        let mut products = [0.0_f32; 5];
        let [a, b, c] = [0; 3].map(|_| rng.uniform(-2.0, 2.0));
        for _ in 0..8 {
            let w = if case % 10 == 0 { 0.0 } else { rng.normal() };
            let own = if case % 10 < 3 { 0.0 } else { rng.normal() };
            let d = if case % 10 == 1 { 0.0 } else { c * w + own };
            let r = a * w + b * d + rng.normal();
            for (sum, v) in products.iter_mut().zip([w * w, r * w, d * d, r * d, w * d]) {
                *sum += v;
            }
        }
        let [ww, rw, dd, rd, wd] = products.map(f64::from);
        let error = |g: f64, h: f64| g * (g * ww - 2.0 * rw) + h * (h * dd - 2.0 * rd) + 2.0 * g * h * wd;
        let [g, h] = gains(products).map(f64::from);
        assert!((0.0..=1.0).contains(&g) && (0.0..=1.0).contains(&h), "{g} {h}");
        let steps = || (0..=100).map(|k| f64::from(k) / 100.0);
        let least = steps().flat_map(|g| steps().map(move |h| error(g, h))).fold(f64::MAX, f64::min);
        let rounding = 1e-5 * (1.0 + ww + dd + rw.abs() + rd.abs());
        assert!(error(g, h) <= least + rounding, "{products:?}: {} above {least}", error(g, h));
    }
}

#[test]
fn the_standard_error_of_products_counts_pairs_twice() {
    const BLOCKS: usize = 48;
    let width = 4 * BLOCKS;
    let n = width * width;
    // White noise, likeness from another picture of it; channels that are independent, and that are equal.
    for equal in [false, true] {
        let mut rng = Rng::new(17, u64::from(equal));
        let (mut squares, mut expected) = ([0.0_f64; 2], [0.0_f64; 2]);
        for _ in 0..8 {
            let mut noise = || {
                let first: Vec<f32> = (0..n).map(|_| rng.normal()).collect();
                (0..3)
                    .flat_map(|_| {
                        first.iter().map(|v| if equal { *v } else { rng.normal() }).collect::<Vec<_>>()
                    })
                    .collect()
            };
            let [values, other]: [Vec<f32>; 2] = [noise(), noise()];
            let frames = vec![f32::MAX; n];
            let (weight, flat, variance) = (vec![1.0; n], vec![1.0; 3 * n], vec![0.01; n]);
            let around = |v: &[f32]| v.iter().map(|v| 1.0 + 0.1 * v).collect::<Vec<f32>>();
            let (irradiance, history) = (around(&values), around(&other));
            let detail = Detail {
                width,
                irradiance: &irradiance,
                weight: &weight,
                variance: Some(&variance),
                independent: true,
                features: &[],
                apart: &[],
                history: Some(History { irradiance: &history, variance: &variance, frames: &frames }),
            };
            let residual = Residual::of(&detail, &flat, &variance);
            let alike = Residual::of(&Detail { irradiance: &history, ..detail }, &flat, &variance);
            let (_, products) = residual.explained(&detail, &alike);
            // Without the borders, where the window is cut.
            for block in (0..products.blocks())
                .filter(|b| [b % BLOCKS, b / BLOCKS].iter().all(|k| (8..BLOCKS - 8).contains(k)))
            {
                for (k, (sum, square)) in [(1, 5), (3, 6)].into_iter().enumerate() {
                    squares[k] += f64::from(products.at(sum, block)).powi(2);
                    expected[k] += f64::from(products.at(square, block));
                }
            }
        }
        for (squares, expected) in squares.iter().zip(&expected) {
            let share = squares / expected;
            println!("{share:.3} of the squares, channels equal: {equal}");
            assert!((share / f64::from(CHANCE) - 1.0).abs() < 0.1, "{share} for {CHANCE}");
        }
    }
}

#[test]
fn a_pixel_of_many_samples_is_its_own() {
    // Texture of single pixels, which no mean shows, with noise far below it.
    let mut rng = Rng::new(5, 0);
    let truth: Vec<f32> = (0..3 * N).map(|i| 0.8 + 0.3 * ((i % N) as f32 * 2.4).sin()).collect();
    let noisy: Vec<f32> = truth.iter().map(|t| t + 0.01 * rng.normal()).collect();
    let u = restored(&noisy, &vec![1.0; N], Some(&vec![1e-4; N]), &vec![0.8; 3 * N]);
    assert!(rms(&u, &truth) < 0.015, "{}", rms(&u, &truth));
}
