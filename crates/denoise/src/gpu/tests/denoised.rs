//! Whole pictures of the convex models, the way back, and the work of the kernels.

use super::{bits, own_device, random, tolerances, worst};
use crate::Shape;
use crate::admm::{Admm, LinearStep, Stop};
use crate::future::at_once;
use crate::mc::gpu::{DeviceModel, Means, record_score, record_way_back};
use crate::mc::synthetic::SyntheticFrame;
use crate::mc::{
    Denoised, Frame, Guides, Model, Sequence, Settings, VariationalModel, adaptive_weight, denoise,
    denoise_on, problem, score, way_back,
};
use photofit_gpu::{Gpu, assert_twin, test_device};
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
        let grey = noisy[..n].repeat(3);
        let grey = Frame::new(width, height, &grey);
        for model in MODELS {
            let frames =
                [("plain", plain), ("grey", grey), ("guided", guided), ("black", black), ("halves", halves)];
            for (what, frame) in frames {
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

/// Numbers from 0 to 1.
fn uniform(seed: u64, n: usize) -> Vec<f32> {
    random(seed, n, 1.0).iter().map(|v| v.abs()).collect()
}

/// What the way back takes: logarithms, and what the means are restored from.
#[derive(Clone)]
struct WayBack {
    shape: Shape,
    u: Vec<f32>,
    noisy: Vec<f32>,
    weight: Vec<f32>,
    black: Vec<usize>,
    sigma: f32,
}

impl WayBack {
    /// With holes. `bright`: one logarithm in twenty is about 13, a radiance of 1e6, which is most of any mean; else all are below
    /// .5, and the means of both pictures are alike and vary from place to place.
    fn new(width: usize, height: usize, bright: bool, black: bool) -> Self {
        let shape = Shape::new(width, height, 3);
        let n = shape.pixels();
        let place = |i: usize| {
            let (y, x, _) = shape.position(i);
            (0.6 + 0.6 * x as f32 / width as f32) * (1.0 + 0.5 * y as f32 / height as f32)
        };
        let (u, noisy) = match bright {
            true => (
                random(3, 3 * n, 1.0).iter().map(|v| if *v > 0.9 { 14.0 * v } else { *v }).collect(),
                uniform(4, 3 * n).iter().map(|v| 2.0 * v).collect(),
            ),
            false => (
                random(3, 3 * n, 1.0).iter().map(|v| 0.2 + 0.3 * v).collect(),
                uniform(4, 3 * n).iter().enumerate().map(|(i, v)| 0.5 * v * place(i)).collect(),
            ),
        };
        let weight: Vec<f32> = random(5, n, 1.0).iter().map(|v| f32::from(*v > -0.8)).collect();
        let black = (0..n).filter(|i| black && weight[*i] > 0.0 && i % 7 == 0).collect();
        Self { shape, u, noisy, weight, black, sigma: 8.0 }
    }

    fn on_device(&self) -> Vec<f32> {
        let gpu = test_device();
        let (noisy, weight, black) = (&self.noisy, &self.weight, &self.black);
        let planes = gpu.upload("estimate", &self.u).expect("room");
        let mut r = gpu.record("way back");
        let means = Means { noisy, weight, black, sigma: self.sigma };
        record_way_back(gpu, &mut r, self.shape, &planes, Some(&means)).expect("kernels");
        r.finish().expect("a recording").run().expect("a run");
        gpu.read(&planes).expect("values")
    }

    fn on_cpu(&self) -> Vec<f32> {
        let mut u = self.u.clone();
        way_back(&mut u, self.shape.width, Some((&self.noisy, &self.weight, &self.black)));
        u
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn the_way_back_agrees() {
    for (width, height) in [(1, 1), (7, 3), (64, 50), (90, 33)] {
        for (bright, black) in [(true, true), (true, false), (false, true), (false, false)] {
            let case = WayBack::new(width, height, bright, black);
            let (ours, theirs) = (case.on_cpu(), case.on_device());
            let what = format!("{}, bright {bright}, black {black}", case.shape);
            assert_twin("WAY_BACK", &what, error(&ours, &theirs), tolerances::WAY_BACK);
            if bright || width < 64 {
                continue;
            }
            // Where the ratio of the means is cut off, it says nothing of them.
            let ratios = case.u.iter().zip(&ours).filter(|(u, _)| **u > 0.0).map(|(u, v)| v / u.exp_m1());
            let ratios: Vec<f32> = ratios.collect();
            let free = ratios.iter().filter(|r| (0.501..1.999).contains(*r)).count();
            assert!(20 * free > 19 * ratios.len(), "{what}: {free} of {}", ratios.len());
        }
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn another_way_back_is_noticed() {
    let case = WayBack::new(64, 50, false, true);
    let ours = case.on_cpu();
    let distance = |other: WayBack| error(&ours, &other.on_device());
    assert!(distance(case.clone()) <= tolerances::WAY_BACK, "the same");
    let middle = 64 * 25 + 32;
    let mut hole = case.clone();
    hole.weight[middle] = 1.0 - hole.weight[middle];
    let mut black = case.clone();
    black.black.remove(100);
    let mut sample = case.clone();
    sample.noisy[middle] += 0.1;
    let mut logarithm = case.clone();
    logarithm.u[middle] += 1e-4;
    let sigma = WayBack { sigma: 7.99, ..case };
    for (what, other) in [
        ("a hole", hole),
        ("a class", black),
        ("a sample", sample),
        ("a logarithm", logarithm),
        ("a window", sigma),
    ] {
        let found = distance(other);
        assert!(found > tolerances::WAY_BACK, "{what} is noticed: {found:.1e}");
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn scores_agree() {
    let gpu = test_device();
    for (width, height) in [(1, 1), (7, 3), (64, 50), (301, 203)] {
        let n = width * height;
        let (u, other) = (uniform(1, 3 * n), uniform(2, 3 * n));
        let mask: Vec<f32> = random(3, n, 1.0).iter().map(|v| f32::from(*v > -0.8)).collect();
        let on_device = |u: &[f32]| {
            let up = |v: &[f32]| gpu.upload("planes", v).expect("room");
            let parts = (3 * n).div_ceil(64);
            let sums = gpu.upload("sums", &vec![7.0_f32; parts + 1]).expect("room");
            let mut r = gpu.record("score");
            record_score(&mut r, [&up(u), &up(&other), &up(&mask)], &sums, 1).expect("kernels");
            r.finish().expect("a recording").run().expect("a run");
            let sums = gpu.read(&sums).expect("values");
            assert_eq!(sums[0].to_bits(), 7.0_f32.to_bits(), "what is before them stays");
            sums[1..].iter().map(|v| f64::from(*v)).sum::<f64>()
        };
        let ours = score(&u, &other, &mask);
        let error = |theirs: f64| (ours - theirs).abs() / ours.max(f64::MIN_POSITIVE);
        assert_twin("SCORE", format!("{width} x {height}"), error(on_device(&u)), tolerances::SCORE);
        if n > 1000 {
            let mut bent = u.clone();
            let read = mask.iter().rposition(|m| *m > 0.0).expect("a sample");
            bent[2 * n + read] += 1.0;
            assert!(error(on_device(&bent)) > tolerances::SCORE, "another sample is noticed");
        }
    }
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

/// What [`work_of_a_frame`] tells of one picture. `planes`: bytes of a pixel that are uploaded, beside tables and parameters.
fn tell_work(gpu: &Gpu, what: &str, scene: &SyntheticFrame, noisy: &[f32], planes: f64) {
    let (shape, n) = (scene.shape, scene.shape.pixels());
    let (width, height) = (shape.width, shape.height);
    // What is uploaded, as denoising a picture does it.
    let settings = Settings { model: Model::Variational(VariationalModel::Hybrid), ..Settings::default() };
    let before = gpu.traffic();
    let frame = Frame::new(width, height, noisy).with_guides(scene.guides());
    let whole = denoise_on(gpu, &frame, &settings).expect("a sound frame");
    assert!(whole.plan.runs("device"), "{}", whole.plan);
    let after = gpu.traffic();
    let each = |bytes: u64| bytes as f64 / n as f64;
    let (up, down) = (after.uploaded - before.uploaded, after.read - before.read);
    println!("{shape}, {what}: uploaded {:.1} bytes a pixel, read {:.1}", each(up), each(down));
    assert!((planes..planes + 8.0).contains(&each(up)) && down == 12 * n as u64, "{up} up, {down} down");
    // The solver's part of it, by the same steps on either.
    let weight: Vec<f32> = (0..n).map(|i| f32::from(noisy[i].is_finite())).collect();
    let noisy: Vec<f32> = noisy.iter().map(|v| if v.is_finite() { *v } else { 0.0 }).collect();
    let logs: Vec<f32> = noisy.iter().map(|v| v.ln_1p()).collect();
    let sigma: Vec<f32> = uniform(1, n).iter().map(|v| 0.05 + 0.1 * v).collect();
    let alpha = adaptive_weight(VariationalModel::Hybrid.strength(), &sigma, &uniform(2, n));
    let problem = problem(VariationalModel::Hybrid, shape, &logs, &weight, alpha);
    let means = Means { noisy: &noisy, weight: &weight, black: &[], sigma: 8.0 };
    let began = Instant::now();
    let mut model = DeviceModel::new(gpu, None, &problem, 20, Some(&means)).expect("room");
    let made = began.elapsed();
    at_once(model.fetch()).expect("a run");
    let began = Instant::now();
    let theirs = at_once(model.fetch()).expect("a run");
    let ran = began.elapsed();
    let began = Instant::now();
    let mut admm = Admm::owning(problem.clone(), LinearStep::Exact).expect("a good problem");
    admm.solve(Stop::Iterations(20));
    let mut ours = admm.into_solution();
    way_back(&mut ours, width, Some((&noisy, &weight, &[])));
    let cpu = began.elapsed();
    println!("{}: made in {made:.1?}, run and read {ran:.1?}; CPU {cpu:.1?}", gpu.report().name);
    for k in model.report().expect("a run") {
        let ms = k.milliseconds.unwrap_or(f64::NAN);
        println!(
            "{}: {} x, {} threads, {} bytes, {ms:.2} ms",
            k.kernel, k.dispatches, k.invocations, k.bytes
        );
    }
    assert_twin("DENOISED", shape, error(&ours, &theirs), tolerances::DENOISED);
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn work_of_a_frame() {
    let size =
        |name: &str, otherwise: usize| std::env::var(name).map_or(otherwise, |v| v.parse().expect("a size"));
    let (width, height) = (size("PHOTOFIT_FRAME_WIDTH", 160), size("PHOTOFIT_FRAME_HEIGHT", 90));
    let scene = SyntheticFrame::new(width, height, 0.0);
    let mut noisy = scene.noisy(1, 1);
    // By itself: the traffic is counted.
    let gpu = own_device();
    // Alpha, logarithms, irradiance, weights of the means.
    tell_work(&gpu, "all samples finite", &scene, &noisy, 32.0);
    (0..width * height).step_by(97).for_each(|i| noisy[i] = f32::NAN);
    // Two weights of the data term.
    tell_work(&gpu, "with holes", &scene, &noisy, 40.0);
}
