//! Metrics against stored values of independent implementations, and their limits.
//!
//! The stored values come from `flip_evaluator` 1.7 (FLIP) and scikit-image 0.26 (SSIM, PSNR) on the procedural images
//! below. Tolerance 1e-4: both sides work in single precision, and the powers of FLIP magnify rounding near 0.

use super::*;
use crate::DEFAULT_PIXELS_PER_DEGREE;

const W: usize = 48;
const H: usize = 36;
const TOLERANCE: f64 = 1e-4;

fn image(f: impl Fn(u64, u64, u64) -> u64) -> Image {
    Image::from_fn(W, H, 3, |x, y, c| f(x as u64, y as u64, c as u64) as f32 / 255.0)
}

/// A hash of the position, 0 to 255.
fn noise(x: u64, y: u64, c: u64, seed: u64) -> u64 {
    const MULTIPLIER: u64 = 0x045d_9f3b;
    let h = (x * 73_856_093) ^ (y * 19_349_663) ^ (c * 83_492_791) ^ (seed * 2_654_435_761);
    let h = ((h & 0xffff_ffff) * MULTIPLIER) & 0xffff_ffff;
    (((h ^ (h >> 16)) * MULTIPLIER) & 0xffff_ffff) >> 24
}

fn ramp(x: u64, y: u64, c: u64) -> u64 {
    (x * 5 + y * 3 + c * 40) % 256
}

fn stripe(x: u64, c: u64) -> u64 {
    if (x / 3).is_multiple_of(2) { 200 - c * 60 } else { 40 + c * 50 }
}

/// One pair of images with its stored values.
struct Case {
    name: &'static str,
    reference: Image,
    test: Image,
    /// FLIP at the default and at 20 pixels per degree: mean, value at (12, 9), value at (0, 35).
    flip: [[f64; 3]; 2],
    /// SSIM: mean without edges, mean of the map, value at (12, 9), value at (0, 35).
    ssim: [f64; 4],
    psnr: f64,
}

fn cases() -> [Case; 4] {
    let inverted = |x, y, c| {
        let inside = (10..25).contains(&x) && (8..20).contains(&y);
        if inside { 255 - ramp(x, y, c) } else { ramp(x, y, c) }
    };
    [
        Case {
            name: "noise",
            reference: image(|x, y, c| noise(x, y, c, 1)),
            test: image(|x, y, c| noise(x, y, c, 2)),
            flip: [[0.457_898, 0.685_213, 0.283_470], [0.843_628, 0.964_562, 0.750_590]],
            ssim: [0.018_633, 0.016_063, 0.033_831, -0.172_869],
            psnr: 7.819_154,
        },
        Case {
            name: "inverted",
            reference: image(ramp),
            test: image(inverted),
            flip: [[0.133_226, 0.568_887, 0.0], [0.104_479, 0.700_689, 0.0]],
            ssim: [0.682_682, 0.816_319, 0.004_944, 1.0],
            psnr: 17.042_954,
        },
        Case {
            name: "grain",
            reference: image(ramp),
            test: image(|x, y, c| (ramp(x, y, c) * 7 + noise(x, y, c, 5)) >> 3),
            flip: [[0.234_999, 0.120_017, 0.220_377], [0.293_815, 0.106_537, 0.351_566]],
            ssim: [0.747_777, 0.729_419, 0.725_479, 0.556_705],
            psnr: 25.671_619,
        },
        Case {
            name: "stripes",
            reference: image(|x, _, c| stripe(x, c)),
            test: image(|x, _, c| stripe(x + 1, c)),
            flip: [[0.313_690, 0.222_945, 0.234_586], [0.552_067, 0.468_416, 0.147_305]],
            ssim: [0.336_548, 0.326_011, 0.310_200, 0.433_895],
            psnr: 12.662_636,
        },
    ]
}

/// The names of all values of `case` that its images do not reproduce.
fn mismatches(case: &Case) -> Vec<String> {
    let mut wrong = Vec::new();
    let mut compare = |what: String, got: f64, stored: f64| {
        if got.is_nan() || (got - stored).abs() > TOLERANCE {
            wrong.push(format!("{} {what}: {got:.6}, stored {stored:.6}", case.name));
        }
    };
    let at = |map: &Image, x: usize, y: usize| f64::from(map.pixel(x, y)[0]);
    for (ppd, stored) in [DEFAULT_PIXELS_PER_DEGREE, 20.0].into_iter().zip(case.flip) {
        let result = flip(&case.reference, &case.test, ppd);
        let values = [result.mean, at(&result.map, 12, 9), at(&result.map, 0, 35)];
        for (i, (got, stored)) in values.into_iter().zip(stored).enumerate() {
            compare(format!("flip {ppd} [{i}]"), got, stored);
        }
    }
    let result = ssim(&case.reference, &case.test);
    let full = result.mean_over(&[true; W * H]).unwrap();
    let values = [result.mean, full, at(&result.map, 12, 9), at(&result.map, 0, 35)];
    for (i, (got, stored)) in values.into_iter().zip(case.ssim).enumerate() {
        compare(format!("ssim [{i}]"), got, stored);
    }
    compare("psnr".into(), psnr(&case.reference, &case.test), case.psnr);
    let stored_mse = 10.0_f64.powf(-0.1 * case.psnr);
    compare("mse".into(), mse(&case.reference, &case.test), stored_mse);
    compare("rmse".into(), rmse(&case.reference, &case.test), stored_mse.sqrt());
    compare("squared error".into(), squared_error(&case.reference, &case.test).mean, stored_mse);
    wrong
}

#[test]
fn metrics_agree_with_independent_implementations() {
    for case in cases() {
        let wrong = mismatches(&case);
        assert!(wrong.is_empty(), "{wrong:#?}");
    }
}

#[test]
fn a_perturbed_side_fails_every_comparison() {
    for mut case in cases() {
        // One block of 6 x 6 pixels around (12, 9) becomes brighter or darker.
        for y in 6..12 {
            for x in 9..15 {
                for v in case.test.pixel_mut(x, y) {
                    *v += if *v < 0.5 { 0.3 } else { -0.3 };
                }
            }
        }
        let wrong = mismatches(&case).join("\n");
        for metric in ["flip 67", "flip 20", "ssim [0]", "ssim [2]", "psnr", " mse", "rmse", "squared error"]
        {
            assert!(wrong.contains(metric), "{}: {metric} did not notice:\n{wrong}", case.name);
        }
    }
}

#[test]
fn equal_images_are_perfect() {
    let [Case { reference, .. }, ..] = cases();
    assert_eq!(flip(&reference, &reference, DEFAULT_PIXELS_PER_DEGREE).mean, 0.0);
    assert_eq!(ssim(&reference, &reference).mean, 1.0);
    assert_eq!(psnr(&reference, &reference), f64::INFINITY);
    assert_eq!(rmse(&reference, &reference), 0.0);
}

#[test]
fn flip_spans_zero_to_one_and_is_symmetric() {
    let green = Image::from_fn(12, 12, 3, |_, _, c| if c == 1 { 1.0 } else { 0.0 });
    let blue = Image::from_fn(12, 12, 3, |_, _, c| if c == 2 { 1.0 } else { 0.0 });
    assert!((flip(&green, &blue, 67.0).mean - 1.0).abs() < 1e-5, "the most different colours");
    for case in cases() {
        let (ab, ba) = (flip(&case.reference, &case.test, 67.0), flip(&case.test, &case.reference, 67.0));
        assert!((ab.mean - ba.mean).abs() < 1e-6, "{}", case.name);
        assert!(ab.map.data.iter().all(|v| (0.0..=1.0).contains(v)), "{}", case.name);
    }
}

#[test]
fn tiny_empty_and_wild_images_have_finite_metrics() {
    for (w, h) in [(0, 0), (1, 1), (1, 9), (11, 11), (12, 2)] {
        let a = Image::new(w, h, 3).map(|_| 0.25);
        let b = a.map(|_| 0.75);
        for result in [flip(&a, &b, 67.0), ssim(&a, &b), squared_error(&a, &b)] {
            assert!(result.mean.is_finite() && result.map.is_finite(), "{w} x {h}");
            assert_eq!(result.map.pixels(), w * h);
        }
    }
    let wild =
        Image::from_data(3, 1, 3, vec![f32::NAN, 1e30, -1e30, 0.5, f32::INFINITY, 0.5, 2.0, -3.0, 0.0]);
    let result = flip(&wild, &Image::new(3, 1, 3), 67.0);
    assert!(result.map.data.iter().all(|v| (0.0..=1.0).contains(v)), "{:?}", result.map.data);
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let [Case { reference, test, .. }, ..] = cases();
    let big = |i: &Image| crate::resize_bilinear(i, 300, 200);
    let (reference, test) = (big(&reference), big(&test));
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| (flip(&reference, &test, 67.0), ssim(&reference, &test)))
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn masked_means_count_only_the_mask() {
    let a = Image::new(4, 2, 1);
    let b = Image::from_fn(4, 2, 1, |x, y, _| (x + 4 * y) as f32);
    let result = squared_error(&a, &b);
    let mask: Vec<bool> = (0..8).map(|i| i == 2 || i == 5).collect();
    assert_eq!(result.mean_over(&mask), Some(14.5));
    assert_eq!(result.mean_over(&[false; 8]), None);
}

#[test]
fn dilation_reaches_radius_steps() {
    let (w, h) = (11, 8);
    let set = [(2_usize, 3_usize), (9, 7)];
    let mask: Vec<bool> = (0..w * h).map(|i| set.contains(&(i % w, i / w))).collect();
    for radius in 0..6 {
        let grown = dilate(&mask, w, h, radius);
        for (i, got) in grown.iter().enumerate() {
            let near = |(x, y): &(usize, usize)| (i % w).abs_diff(*x) + (i / w).abs_diff(*y) <= radius;
            assert_eq!(*got, set.iter().any(near), "radius {radius} at {i}");
        }
    }
    assert_eq!(dilate(&[false; 6], 3, 2, 100), [false; 6]);
}

#[test]
fn the_error_of_halves_is_that_without_noise() {
    let (w, h) = (160, 160);
    let mut state = 1_u64;
    let mut noise = || {
        state = state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(0x1405_7b7e_f767_814f);
        ((state >> 40) as f32 / (1 << 24) as f32 - 0.5) * 0.8
    };
    let mut noisy = |value: f32| Image::from_fn(w, h, 3, |_, _, _| value + noise());
    let (r, t) = ([noisy(0.4), noisy(0.4)], [noisy(0.5), noisy(0.5)]);
    let found = squared_error_of_halves([&r[0], &r[1]], [&t[0], &t[1]]);
    // Of pixels with three channels each; noise of either difference has the variance 2 * 0.8^2 / 12.
    let variance = 2.0 * 0.8_f64.powi(2) / 12.0;
    let of_product = variance * variance + 2.0 * variance * 0.1_f64.powi(2);
    let sigma = (of_product / (3 * w * h) as f64).sqrt();
    assert!((found.mean - 0.01).abs() < 4.0 * sigma, "{} for .01, sigma {sigma}", found.mean);
    assert!(squared_error(&r[0], &t[0]).mean > 0.01 + 0.9 * variance, "the plain error has the noise in it");
    // Three channels each, whose mean a pixel is.
    let told = found.standard_error_over(&vec![true; w * h]).unwrap();
    assert!((told / sigma - 1.0).abs() < 0.05, "{told} for {sigma}");
    assert_eq!(found.standard_error_over(&vec![false; w * h]), None);
    let same = squared_error_of_halves([&r[0], &r[0]], [&t[0], &t[0]]);
    assert_eq!(same.map.data, squared_error(&r[0], &t[0]).map.data);
}
