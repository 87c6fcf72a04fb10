//! Inputs at the edge of what a renderer can produce.

use super::*;
use crate::mc::Guides;

fn sound(u: &[f32], what: &str) {
    assert!(u.iter().all(|v| v.is_finite() && *v >= 0.0), "{what}: a value that is not finite or negative");
}

#[test]
fn holes_are_counted_and_filled() {
    let scene = SyntheticFrame::new(83, 61, 0.0);
    let n = 61 * 83;
    let mut noisy = scene.noisy(4, 1);
    let clean = noisy.clone();
    for (k, v) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e38].into_iter().enumerate() {
        noisy[(k % 3) * n + 700 * (k + 1)] = v;
    }
    for model in MODELS {
        let d = run(&scene, &noisy, true, model);
        assert_eq!(d.holes, 4, "{model:?}");
        sound(&d.color, "holes");
        let other = run(&scene, &clean, true, model).color;
        let difference = display_rmse(&d.color, &other);
        assert!(difference < 0.02, "{model:?}: four holes change the picture by {difference}");
    }
    for model in MODELS {
        let d = run(&scene, &vec![f32::NAN; 3 * n], true, model);
        assert_eq!(d.holes, n, "{model:?}");
        sound(&d.color, "all holes");
    }
}

#[test]
fn large_holes_take_the_colour_of_what_is_left() {
    let (width, height) = (200, 200);
    let mut color = vec![0.5; 3 * height * width];
    for i in 0..height * width {
        if i % width < 190 {
            color[i] = f32::NAN;
        } else {
            color[i] += 0.01 * ((i * 7919) % 13) as f32;
        }
    }
    let d = denoise(&Frame::new(width, height, &color), &Settings::default()).expect("sound");
    assert!(d.color.iter().all(|v| (v - 0.55).abs() < 0.1), "no black far from the samples");
}

#[test]
fn any_size_and_any_guide_will_do() {
    for (height, width) in [(1, 1), (1, 37), (41, 1), (2, 2), (7, 9), (8, 8), (13, 101), (97, 53)] {
        let scene = SyntheticFrame::new(width, height, 0.0);
        let noisy = scene.noisy(1, 9);
        for model in MODELS {
            sound(&run(&scene, &noisy, true, model).color, "guided");
            sound(&run(&scene, &noisy, false, model).color, "unguided");
        }
        let bad: Vec<f32> =
            scene.normal.iter().enumerate().map(|(i, v)| if i % 5 == 0 { f32::NAN } else { *v }).collect();
        let zero = vec![0.0; 3 * height * width];
        let guides =
            Guides { normal: Some(&bad), albedo: Some(&zero), depth: Some(&scene.depth), position: None };
        let d = denoise(&Frame::new(width, height, &noisy).with_guides(guides), &Settings::default())
            .expect("sound");
        sound(&d.color, "bad guides");
        assert!(!d.plan.runs("albedo"), "a constant albedo is skipped");
    }
}

#[test]
fn results_scale_with_the_radiance() {
    let scene = SyntheticFrame::new(80, 64, 0.0);
    let noisy = scene.noisy(1, 2);
    for model in MODELS {
        let reference = run(&scene, &noisy, true, model).color;
        for scale in [1e-6_f32, 1e6] {
            let bright: Vec<f32> = noisy.iter().map(|v| v * scale).collect();
            let u = run(&scene, &bright, true, model).color;
            let worst =
                u.iter().zip(&reference).map(|(u, r)| (u / scale - r).abs() / (r + 0.01)).fold(0.0, f32::max);
            assert!(worst < 0.02, "{model:?} at {scale}: relative difference {worst}");
        }
    }
}

#[test]
fn a_large_offset_and_constant_pictures_stay() {
    for value in [0.0_f32, 1e-20, 1.0, 1e4, 1e6] {
        let color = vec![value; 3 * 40 * 56];
        for model in MODELS {
            let d = denoise(&Frame::new(56, 40, &color), &with(model)).expect("sound");
            let worst = d.color.iter().map(|v| (v - value).abs()).fold(0.0, f32::max);
            assert!(worst <= 1e-5 * value, "{model:?}: {value} became {worst} off");
        }
    }
    let color: Vec<f32> = (0..3 * 40 * 56).map(|i| 1e4 + ((i * 7919) % 17) as f32).collect();
    let d = denoise(&Frame::new(56, 40, &color), &Settings::default()).expect("sound");
    assert!(d.color.iter().all(|v| (v - 10_008.0).abs() < 8.0), "the mean stays");
}

#[test]
fn flat_regions_are_skipped_and_kept_to_the_bit() {
    let scene = SyntheticFrame::new(128, 96, 0.0);
    let mut noisy = scene.noisy(1, 3);
    for c in 0..3 {
        for y in 0..96 {
            noisy[c * 96 * 128 + y * 128..][..64].fill(0.25);
        }
    }
    let d = denoise(
        &Frame::new(128, 96, &noisy).with_guides(Guides { albedo: None, ..scene.guides() }),
        &Settings::default(),
    )
    .expect("sound");
    let why = &d.plan.step("regression").expect("it runs").why;
    assert!(why.contains("84 flat"), "12 x 7 cells with equal neighbours: {why}");
    // Edges are smoothed afterwards, but not inside a flat region.
    assert!(d.color[40 * 128 + 20..40 * 128 + 40].iter().all(|v| (v - 0.25).abs() < 1e-6));
}

#[test]
fn wrong_lengths_are_refused_with_their_name() {
    let color = vec![0.0; 3 * 12];
    let short = vec![0.0; 11];
    let frame = Frame::new(4, 3, &color).with_guides(Guides { depth: Some(&short), ..Guides::default() });
    let error = denoise(&frame, &Settings::default()).expect_err("too short");
    assert_eq!(error.to_string(), "the depth has 11 values, expected 12 (4 x 3 pixels x 3 channels)");
    assert!(denoise(&Frame::new(4, 0, &[]), &Settings::default()).is_err());
    assert!(denoise(&Frame::new(4, 5, &color), &Settings::default()).is_err());
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let scene = SyntheticFrame::new(111, 75, 0.0);
    let noisy = scene.noisy(1, 6);
    for model in MODELS {
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| run(&scene, &noisy, true, model).color)
        };
        assert!(on(1) == on(3), "{model:?}");
    }
}
