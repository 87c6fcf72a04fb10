//! Relations that published experiments report, on the synthetic scene.

use super::*;
use crate::mc::{VariationalModel, demodulate, divisor, remodulate};

const MODELS: [Model; 4] = [
    Model::Auto,
    Model::Variational(VariationalModel::Rof),
    Model::Variational(VariationalModel::Hybrid),
    Model::Atrous,
];

#[test]
fn guides_lower_the_error_of_every_model() {
    let scene = SyntheticFrame::new(160, 120, 0.0);
    for samples in [1, 4] {
        let noisy = scene.noisy(samples, 1);
        let before = display_rmse(&noisy, &scene.reference);
        for model in MODELS {
            let error = |guided| display_rmse(&run(&scene, &noisy, guided, model).color, &scene.reference);
            let (without, with) = (error(false), error(true));
            assert!(
                with < 0.9 * without,
                "{model:?}, {samples} samples: {with} with guides, {without} without"
            );
            // The logarithm of a single sample, four in ten of which are 0, is far from that of the mean.
            let share = match model {
                Model::Variational(_) if samples == 1 => 0.4,
                _ => 0.3,
            };
            assert!(with < share * before, "{model:?}, {samples} samples: {with} from {before}");
        }
    }
}

#[test]
fn the_automatic_model_is_the_best_and_improves_with_samples() {
    let scene = SyntheticFrame::new(192, 144, 0.0);
    let error = |samples, model| {
        display_rmse(&run(&scene, &scene.noisy(samples, 2), true, model).color, &scene.reference)
    };
    for samples in [1, 4] {
        let ours = error(samples, Model::Auto);
        for other in &MODELS[1..] {
            let theirs = error(samples, *other);
            assert!(ours < theirs, "{samples} samples: {ours} against {theirs} of {other:?}");
        }
    }
    // With halves the noise is known: the jagged albedo gives way to the samples as they become many.
    let steps = [1, 4, 16, 64].map(|s| {
        let (a, b) = (scene.noisy(s, 2), scene.noisy(s, 3));
        let frame = Frame { half: Some(&b), ..Frame::new(192, 144, &a).with_guides(scene.guides()) };
        display_rmse(&denoise(&frame, &with(Model::Auto)).expect("sound").color, &scene.reference)
    });
    assert!(steps.windows(2).all(|w| w[1] < w[0]), "{steps:?}");
    let many: Vec<f32> =
        scene.noisy(64, 2).iter().zip(scene.noisy(64, 3)).map(|(a, b)| 0.5 * (a + b)).collect();
    let plain = display_rmse(&many, &scene.reference);
    assert!(steps[3] < 0.95 * plain, "{} from {plain}", steps[3]);
}

#[test]
fn an_absolute_data_term_is_darker_than_a_quadratic_one() {
    let scene = SyntheticFrame::new(128, 96, 0.0);
    let noisy = scene.noisy(1, 3);
    let mean = |model| {
        let frame = Frame::new(128, 96, &noisy).with_guides(scene.guides());
        let settings = Settings { restore_mean: false, ..with(Model::Variational(model)) };
        let u = denoise(&frame, &settings).expect("sound").color;
        u.iter().map(|v| f64::from(*v)).sum::<f64>()
    };
    let (l1, l2) = (mean(VariationalModel::TvL1), mean(VariationalModel::Rof));
    assert!(l1 < 0.97 * l2, "{l1} against {l2}");
}

#[test]
fn restoring_the_mean_brings_the_light_back() {
    let scene = SyntheticFrame::new(128, 96, 0.0);
    let noisy = scene.noisy(4, 4);
    let frame = Frame::new(128, 96, &noisy).with_guides(scene.guides());
    let sum = |v: &[f32]| v.iter().map(|v| f64::from(*v)).sum::<f64>();
    let ratio = |restore_mean| {
        let model = Model::Variational(VariationalModel::Hybrid);
        let settings = Settings { restore_mean, ..with(model) };
        sum(&denoise(&frame, &settings).expect("sound").color) / sum(&scene.reference)
    };
    let (plain, restored) = (ratio(false), ratio(true));
    println!("light: {plain:.3} without, {restored:.3} with the mean restored");
    assert!(plain < 0.95 && (restored - 1.0).abs() < 0.05, "{plain} -> {restored}");
}

#[test]
fn fireflies_are_clamped_and_counted() {
    let scene = SyntheticFrame::new(128, 96, 0.0);
    let mut noisy = scene.noisy(4, 5);
    for k in 0..12 {
        let i = (8 * k + 3) * 128 + 9 * k + 5;
        (0..3).for_each(|c| noisy[c * 96 * 128 + i] = 500.0);
    }
    let frame = Frame::new(128, 96, &noisy).with_guides(scene.guides());
    let run = |fireflies| denoise(&frame, &Settings { fireflies, ..Settings::default() }).expect("sound");
    let (on, off) = (run(true), run(false));
    assert!(on.fireflies >= 12 && off.fireflies == 0 && !off.plan.runs("fireflies"));
    let error = |d: &Denoised| display_rmse(&d.color, &scene.reference);
    assert!(error(&on) < 0.5 * error(&off), "{} against {}", error(&on), error(&off));
}

#[test]
fn demodulation_gives_every_light_back() {
    // Black emitters, dark texels and more than all light reflected.
    let albedo = [0.0_f32, 1e-6, 0.03, 0.05, 0.7, 1.5, 0.0, 0.2, 1.0];
    let color = [7.5_f32, 0.3, 0.2, 0.1, 3.0, 2.0, 1e6, 0.0, 1e-7];
    let d = divisor(&albedo);
    let mut u = color.to_vec();
    demodulate(&mut u, &d);
    remodulate(&mut u, &d);
    for (u, c) in u.iter().zip(color) {
        assert!((u - c).abs() <= 1e-6 * c, "{u} against {c}");
    }
    // Through the whole chain: an emitter on black keeps its light.
    let (width, height) = (64, 64);
    let lamp = |i: usize| (16..48).contains(&(i % width)) && (16..48).contains(&(i / width % height));
    let pick = |on, off| (0..3 * 64 * 64).map(|i| if lamp(i) { on } else { off }).collect::<Vec<f32>>();
    let (color, albedo) = (pick(5.0, 0.2), pick(0.0, 0.5));
    for model in MODELS {
        let guides = crate::mc::Guides { albedo: Some(&albedo), ..Default::default() };
        let u = denoise(&Frame::new(width, height, &color).with_guides(guides), &with(model))
            .expect("sound")
            .color;
        assert!((u[32 * width + 32] - 5.0).abs() < 0.25, "{model:?}: {}", u[32 * width + 32]);
    }
}
