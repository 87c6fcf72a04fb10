//! Whole pictures of the convex models, and the work of the kernels.

use super::{bits, random, tolerances, worst};
use crate::Shape;
use crate::admm::{Admm, LinearStep, Stop};
use crate::mc::gpu::{DeviceModel, Means, record_way_back};
use crate::mc::synthetic::SyntheticFrame;
use crate::mc::{
    Denoised, Frame, Guides, Model, Sequence, Settings, VariationalModel, denoise, denoise_on, way_back,
};
use crate::models;
use photofit_gpu::{Caps, Choice, Gpu, assert_twin, test_device};
use std::time::Instant;

const MODELS: [VariationalModel; 3] =
    [VariationalModel::Rof, VariationalModel::TvL1, VariationalModel::Hybrid];

/// The largest difference, relative to the value and a floor of a hundredth of the mean.
fn error(ours: &[f32], theirs: &[f32]) -> f64 {
    assert_eq!(ours.len(), theirs.len(), "as many values");
    let floor = ours.iter().map(|v| f64::from(v.abs())).sum::<f64>() / ours.len() as f64 / 100.0;
    let of = |(a, b): (&f32, &f32)| {
        let d = f64::from(a - b).abs();
        if d > 0.0 { d / (f64::from(a.abs()) + floor) } else { d }
    };
    worst(ours.iter().zip(theirs).map(of))
}

fn both(frame: &Frame<'_>, settings: &Settings) -> [Denoised; 2] {
    let ours = denoise(frame, settings).expect("a sound frame");
    let theirs = denoise_on(test_device(), frame, settings).expect("a sound frame");
    assert!(theirs.plan.runs("device") && !ours.plan.runs("device"), "{}", theirs.plan);
    assert_eq!(
        (ours.holes, ours.fireflies, ours.strength),
        (theirs.holes, theirs.fireflies, theirs.strength)
    );
    [ours, theirs]
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn pictures_agree() {
    for (width, height) in [(64, 48), (75, 41)] {
        let scene = SyntheticFrame::new(width, height, 0.0);
        let (mut noisy, other) = (scene.noisy(4, 3), scene.noisy(4, 4));
        (noisy[100], noisy[500]) = (f32::NAN, f32::INFINITY);
        let mut lamps = scene.albedo.clone();
        let n = scene.shape.pixels();
        (0..3).for_each(|c| lamps[c * n + 1000..c * n + 1200].fill(0.0));
        let plain = Frame::new(width, height, &noisy);
        let guided = plain.with_guides(scene.guides());
        let black = plain.with_guides(Guides { albedo: Some(&lamps), ..scene.guides() });
        let halves = Frame { half: Some(&other), ..guided };
        for model in MODELS {
            for (what, frame) in [("plain", plain), ("guided", guided), ("black", black), ("halves", halves)]
            {
                for restore_mean in [true, false] {
                    let settings =
                        Settings { model: Model::Variational(model), restore_mean, ..Settings::default() };
                    let [ours, theirs] = both(&frame, &settings);
                    let what = format!("{model:?} {what}, {width} x {height}");
                    assert_twin("DENOISED", &what, error(&ours.color, &theirs.color), tolerances::DENOISED);
                    let [_, again] = both(&frame, &settings);
                    assert_eq!(bits(&theirs.color), bits(&again.color), "{what}: the same bits");
                }
            }
        }
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn another_picture_is_noticed() {
    let scene = SyntheticFrame::new(64, 48, 0.0);
    let noisy = scene.noisy(4, 3);
    let frame = Frame::new(64, 48, &noisy).with_guides(scene.guides());
    let settings = |strength: f32, restore_mean: bool| Settings {
        model: Model::Variational(VariationalModel::Hybrid),
        strength: Some(strength),
        restore_mean,
        ..Settings::default()
    };
    let ours = denoise(&frame, &settings(4.0, true)).expect("a sound frame").color;
    let theirs = |s: Settings| denoise_on(test_device(), &frame, &s).expect("a sound frame").color;
    assert!(error(&ours, &theirs(settings(4.0, true))) <= tolerances::DENOISED, "the same");
    assert!(error(&ours, &theirs(settings(4.01, true))) > tolerances::DENOISED, "another strength");
    assert!(error(&ours, &theirs(settings(4.0, false))) > tolerances::DENOISED, "darker");
    let steps = Settings { iterations: 19, ..settings(4.0, true) };
    assert!(error(&ours, &theirs(steps)) > tolerances::DENOISED, "a step less");
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn broken_and_small_pictures_agree() {
    for (width, height) in [(1, 1), (2, 1), (1, 5), (3, 3), (9, 17)] {
        let n = width * height;
        let some: Vec<f32> = random(7, 3 * n, 1.0).iter().map(|v| v.abs()).collect();
        let pictures = [
            some.clone(),
            vec![0.0; 3 * n],
            vec![f32::NAN; 3 * n],
            some.iter().map(|v| v * 1e30).collect(),
            some.iter().map(|v| v * 1e-30).collect(),
            some.iter().enumerate().map(|(i, v)| if i % 3 == 0 { 1e6 } else { *v }).collect(),
            some.iter().enumerate().map(|(i, v)| if i % 2 == 0 { f32::INFINITY } else { *v }).collect(),
        ];
        for (k, picture) in pictures.iter().enumerate() {
            for model in MODELS {
                let settings = Settings { model: Model::Variational(model), ..Settings::default() };
                let [ours, theirs] = both(&Frame::new(width, height, picture), &settings);
                assert!(theirs.color.iter().all(|v| v.is_finite() && *v >= 0.0), "picture {k}");
                let what = format!("{model:?}, picture {k}, {width} x {height}");
                assert_twin("DENOISED", what, error(&ours.color, &theirs.color), tolerances::DENOISED);
            }
        }
    }
    let short = denoise_on(test_device(), &Frame::new(4, 4, &[0.0; 5]), &Settings::default());
    assert_eq!(short.err(), denoise(&Frame::new(4, 4, &[0.0; 5]), &Settings::default()).err());
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn the_way_back_agrees() {
    let gpu = test_device();
    for (width, height) in [(1, 1), (7, 3), (64, 50), (90, 33)] {
        let shape = Shape::new(width, height, 3);
        let n = shape.pixels();
        // Logarithms from -1 to 14: radiance of 1e6.
        let u: Vec<f32> =
            random(3, 3 * n, 1.0).iter().map(|v| if *v > 0.9 { 14.0 * v } else { *v }).collect();
        let noisy: Vec<f32> = random(4, 3 * n, 2.0).iter().map(|v| v.abs()).collect();
        let weight: Vec<f32> = random(5, n, 1.0).iter().map(|v| f32::from(*v > -0.8)).collect();
        let black: Vec<usize> = (0..n).filter(|i| weight[*i] > 0.0 && i % 7 == 0).collect();
        for black in [&black[..], &[]] {
            let means = Means { noisy: &noisy, weight: &weight, black, sigma: 8.0 };
            let planes = gpu.upload("estimate", &u).expect("room");
            let mut r = gpu.record("way back");
            record_way_back(gpu, &mut r, shape, &planes, Some(&means)).expect("kernels");
            r.finish().expect("a recording").run().expect("a run");
            let mut ours = u.clone();
            way_back(&mut ours, width, Some((&noisy, &weight, black)));
            let theirs = gpu.read(&planes).expect("values");
            assert_twin("WAY_BACK", shape, error(&ours, &theirs), tolerances::WAY_BACK);
        }
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn what_a_device_cannot_do_runs_on_the_cpu_and_is_told() {
    let scene = SyntheticFrame::new(64, 48, 0.0);
    let noisy = scene.noisy(4, 3);
    let frame = Frame::new(64, 48, &noisy).with_guides(scene.guides());
    let name = std::env::var("PHOTOFIT_TEST_GPU").map_or(Choice::Any, Choice::Named);
    let small = Gpu::within(&name, Caps { binding: 1 << 14, memory: u64::MAX }).expect("a device");
    let hybrid = Model::Variational(VariationalModel::Hybrid);
    let tgv = Model::Variational(VariationalModel::Tgv);
    for (gpu, model, told) in [
        (&small, hybrid, "bytes"),
        (test_device(), Model::Auto, "no kernels"),
        (test_device(), tgv, "no kernels"),
        (test_device(), Model::Atrous, "no kernels"),
    ] {
        let settings = Settings { model, ..Settings::default() };
        let theirs = denoise_on(gpu, &frame, &settings).expect("a sound frame");
        let line = theirs.plan.step("device").expect("a line");
        assert!(!line.runs && line.why.contains(told) && line.why.contains("CPU"), "{}", line.why);
        let ours = denoise(&frame, &settings).expect("a sound frame");
        assert_eq!(bits(&ours.color), bits(&theirs.color), "as the CPU");
    }
    // A device that is lost.
    let lost = Gpu::new(&name).expect("a device");
    lost.destroy();
    let theirs = denoise_on(&lost, &frame, &Settings { model: hybrid, ..Settings::default() });
    let plan = theirs.expect("a sound frame").plan;
    assert!(!plan.runs("device") && plan.step("device").is_some_and(|s| s.why.contains("lost")), "{plan}");
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn sequences_agree() {
    let settings = Settings { model: Model::Variational(VariationalModel::Hybrid), ..Settings::default() };
    let mut sequence = Sequence::new(settings);
    for k in 0..3 {
        let scene = SyntheticFrame::new(64, 48, 0.05 * k as f64);
        let noisy = scene.noisy(1, k);
        let frame = Frame::new(64, 48, &noisy).with_guides(scene.guides());
        sequence.push(&frame, scene.camera).expect("a sound frame");
    }
    let ours = sequence.denoise().expect("frames").expect("sound");
    let theirs = sequence.denoise_on(test_device()).expect("frames").expect("sound");
    assert!(theirs.plan.runs("device"));
    assert_twin("DENOISED", "a sequence", error(&ours.color, &theirs.color), tolerances::DENOISED);
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn work_of_a_frame() {
    let gpu = test_device();
    let size =
        |name: &str, otherwise: usize| std::env::var(name).map_or(otherwise, |v| v.parse().expect("a size"));
    let (width, height) = (size("PHOTOFIT_FRAME_WIDTH", 160), size("PHOTOFIT_FRAME_HEIGHT", 90));
    let scene = SyntheticFrame::new(width, height, 0.0);
    let noisy = scene.noisy(1, 1);
    let (shape, n) = (scene.shape, scene.shape.pixels());
    let logs: Vec<f32> = noisy.iter().map(|v| v.ln_1p()).collect();
    let weight = vec![1.0; n];
    let problem = models::hybrid(shape, &logs, 0.1, 0.5, 0.3);
    let means = Means { noisy: &noisy, weight: &weight, black: &[], sigma: 8.0 };
    let before = gpu.traffic();
    let began = Instant::now();
    let mut model = DeviceModel::new(gpu, &problem, 20, Some(&means)).expect("room");
    let made = began.elapsed();
    model.run().expect("a run");
    let first = gpu.traffic();
    let began = Instant::now();
    let theirs = model.run().expect("a run");
    let ran = began.elapsed();
    let began = Instant::now();
    let mut admm = Admm::owning(problem.clone(), LinearStep::Exact).expect("a good problem");
    admm.solve(Stop::Iterations(20));
    let mut ours = admm.into_solution();
    way_back(&mut ours, width, Some((&noisy, &weight, &[])));
    let cpu = began.elapsed();
    println!("{shape} on {}: made in {made:.1?}, run and read {ran:.1?}; CPU {cpu:.1?}", gpu.report().name);
    let (up, down) = (first.uploaded - before.uploaded, first.read - before.read);
    println!("uploaded {up} bytes, read {down}, submissions {}", first.submissions - before.submissions);
    for k in model.report().expect("a run") {
        let ms = k.milliseconds.unwrap_or(f64::NAN);
        println!(
            "{}: {} x, {} threads, {} bytes, {ms:.2} ms",
            k.kernel, k.dispatches, k.invocations, k.bytes
        );
    }
    assert_twin("DENOISED", shape, error(&ours, &theirs), tolerances::DENOISED);
}
