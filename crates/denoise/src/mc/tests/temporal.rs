//! Accumulation over time.

use super::*;
use crate::mc::{Accumulator, Camera, Sequence, TemporalFrame, TemporalSettings};
use photofit_sampling::Rng;

const FRONT: Camera =
    Camera { world_to_pixel: [[64.0, 0.0, -32.0, 0.0], [0.0, -64.0, -24.0, 0.0], [0.0, 0.0, -1.0, 0.0]] };

/// A wall at z = -2 seen by [`FRONT`].
struct Wall {
    position: Vec<f32>,
    normal: Vec<f32>,
    weight: Vec<f32>,
}

impl Wall {
    fn new(width: usize, height: usize) -> Self {
        let n = height * width;
        let position = FRONT.positions(&vec![1.0; n], width).expect("invertible");
        let position = (0..3 * n).map(|i| position[i] * 2.0 / -position[2 * n + i % n]).collect();
        let normal = (0..3 * n).map(|i| if i / n == 2 { 1.0 } else { 0.0 }).collect();
        Self { position, normal, weight: vec![1.0; n] }
    }

    /// Adds a frame of it to a history.
    fn add(&self, history: &mut Accumulator, irradiance: &[f32]) {
        let frame = TemporalFrame {
            irradiance,
            weight: &self.weight,
            normal: &self.normal,
            position: &self.position,
            camera: FRONT,
        };
        history.add(&frame).expect("sound");
    }
}

#[test]
fn an_exponential_mean_has_its_known_deviation() {
    let (width, height) = (64, 48);
    let n = height * width;
    let wall = Wall::new(width, height);
    let mut rng = Rng::new(7, 0);
    for minimum in [0.05_f32, 0.2] {
        let mut history =
            Accumulator::new(width, height, TemporalSettings { minimum, ..TemporalSettings::default() });
        for _ in 0..(8.0 / minimum) as usize {
            let irradiance: Vec<f32> = (0..3 * n).map(|_| 1.0 + 0.3 * rng.normal()).collect();
            wall.add(&mut history, &irradiance);
        }
        let mean = history.mean();
        let level = mean.iter().map(|v| f64::from(*v)).sum::<f64>() / mean.len() as f64;
        let spread = mean.iter().map(|v| (f64::from(*v) - level).powi(2)).sum::<f64>() / mean.len() as f64;
        let expected = 0.3 * f64::from(minimum / (2.0 - minimum)).sqrt();
        assert!((spread.sqrt() / expected - 1.0).abs() < 0.03, "{} against {expected}", spread.sqrt());
        assert!((level - 1.0).abs() < 0.005);
    }
}

#[test]
fn a_plain_mean_and_its_variance_follow_the_number_of_frames() {
    let (width, height) = (96, 64);
    let n = height * width;
    let wall = Wall::new(width, height);
    let mut rng = Rng::new(8, 0);
    // Deviation grows from left to right.
    let sigma: Vec<f32> = (0..n).map(|i| 0.1 + 0.5 * (i % width) as f32 / width as f32).collect();
    let frames = 12;
    let mut history = Accumulator::new(
        width,
        height,
        TemporalSettings { minimum: 0.0, change: f32::INFINITY, ..Default::default() },
    );
    for _ in 0..frames {
        // Channels of their own: the variance is the mean of theirs, not that of their mean.
        let irradiance: Vec<f32> = (0..3 * n).map(|i| 1.0 + sigma[i % n] * rng.normal()).collect();
        wall.add(&mut history, &irradiance);
    }
    assert!(history.counts().iter().all(|c| (*c - frames as f32).abs() < 1e-3));
    assert!(history.effective().iter().all(|c| (*c - frames as f32).abs() < 1e-2));
    let variance: Vec<f32> = history.variance().into_iter().map(|v| v.expect("several frames")).collect();
    let map = crate::mc::log_sigma(&vec![1.0; n], &variance, &wall.weight, width);
    // Truth: sigma / sqrt(frames) of the mean, over 1 + mean.
    let truth: Vec<f32> = sigma.iter().map(|s| s / (frames as f32).sqrt() / 2.0).collect();
    let mut ratio: Vec<f32> = map.iter().zip(&truth).map(|(a, b)| a / b).collect();
    ratio.sort_unstable_by(f32::total_cmp);
    assert!((0.8..1.2).contains(&ratio[n / 2]), "median ratio {}", ratio[n / 2]);
    let correlation = correlation(&map, &truth);
    assert!(correlation > 0.75, "{correlation}");
}

fn correlation(a: &[f32], b: &[f32]) -> f64 {
    let mean = |v: &[f32]| v.iter().map(|v| f64::from(*v)).sum::<f64>() / v.len() as f64;
    let (ma, mb) = (mean(a), mean(b));
    let sum = |f: &dyn Fn(f64, f64) -> f64| {
        a.iter().zip(b).map(|(a, b)| f(f64::from(*a) - ma, f64::from(*b) - mb)).sum::<f64>()
    };
    sum(&|a, b| a * b) / (sum(&|a, _| a * a) * sum(&|_, b| b * b)).sqrt()
}

/// Mean error over the pixels that the sphere uncovers when the camera moves.
fn ghost(settings: TemporalSettings) -> f64 {
    let (width, height) = (128, 96);
    let n = height * width;
    // The sphere is bright, the rest dark: a ghost is bright on dark.
    let views: Vec<SyntheticFrame> =
        (0..6).map(|k| SyntheticFrame::new(width, height, 0.06 * f64::from(k))).collect();
    let radiance = |f: &SyntheticFrame, i: usize| if f.albedo[i] == 0.8 { 1.0 } else { 0.0 };
    let mut history = Accumulator::new(width, height, settings);
    for f in &views {
        let irradiance: Vec<f32> = (0..3 * n).map(|i| radiance(f, i % n)).collect();
        let frame = TemporalFrame {
            irradiance: &irradiance,
            weight: &vec![1.0; n],
            normal: &f.normal,
            position: &f.position,
            camera: f.camera,
        };
        history.add(&frame).expect("sound");
    }
    let (last, mean) = (&views[5], history.mean());
    let near: Vec<usize> = (0..n)
        .filter(|&i| {
            let was = views[..5].iter().any(|f| radiance(f, i) > 0.5);
            was && radiance(last, i) < 0.5
        })
        .collect();
    assert!(near.len() > 100, "pixels are uncovered");
    near.iter().map(|&i| f64::from(mean[i])).sum::<f64>() / near.len() as f64
}

#[test]
fn tests_of_plane_and_normal_leave_no_ghosts() {
    let with = ghost(TemporalSettings::default());
    let without =
        ghost(TemporalSettings { plane: f32::INFINITY, normal: -2.0, change: f32::INFINITY, minimum: 0.05 });
    assert!(with.abs() <= 0.02, "{with}");
    assert!(without >= 0.05, "{without}");
}

#[test]
fn a_sequence_is_better_than_its_last_frame() {
    let (width, height) = (128, 96);
    let mut sequence = Sequence::new(Settings::default());
    assert!(sequence.denoise().is_none());
    let mut last = None;
    for k in 0..6 {
        let f = SyntheticFrame::new(width, height, 0.02 * f64::from(k));
        let noisy = f.noisy(1, 20 + k as u64);
        // Positions are recovered from depths.
        let guides = crate::mc::Guides { position: None, ..f.guides() };
        sequence.push(&Frame::new(width, height, &noisy).with_guides(guides), f.camera).expect("sound");
        last = Some((f, noisy));
    }
    let (f, noisy) = last.expect("six frames");
    let many = sequence.denoise().expect("frames").expect("sound");
    let one = run(&f, &noisy, true, Model::Auto);
    let (many_error, one_error) =
        (display_rmse(&many.color, &f.reference), display_rmse(&one.color, &f.reference));
    // One sample in a thousand is 40 times as bright, and no variance tells it: of that noise the last frame brings some back.
    assert!(many_error < 0.95 * one_error, "{many_error} against {one_error}");
    assert!(many.plan.runs("history") && !one.plan.runs("history"), "{}", many.plan);
    // Another size, and no way to find positions.
    let small = SyntheticFrame::new(20, 20, 0.0);
    let noisy = small.noisy(1, 1);
    assert!(sequence.push(&Frame::new(20, 20, &noisy).with_guides(small.guides()), small.camera).is_err());
    let error = Sequence::new(Settings::default()).push(&Frame::new(20, 20, &noisy), small.camera);
    assert!(error.expect_err("no positions").to_string().contains("positions"));
}

/// A view of the scene under light that `factor` of the pixel multiplies: the mean of 16 samples, and its variance.
fn sampled(f: &SyntheticFrame, seed: u64, factor: impl Fn(usize) -> f32) -> [Vec<f32>; 2] {
    let n = f.shape.pixels();
    let (mut mean, mut square) = (vec![0.0_f32; 3 * n], vec![0.0_f32; 3 * n]);
    for k in 0..16 {
        for (i, v) in f.noisy(1, 16 * seed + k).into_iter().enumerate() {
            let v = factor(i % n) * v / 16.0;
            mean[i] += v;
            square[i] += v * v;
        }
    }
    let variance = mean.iter().zip(&square).map(|(m, s)| (s - m * m / 16.0).max(0.0) * 16.0 / 15.0).collect();
    [mean, variance]
}

#[test]
fn a_sequence_is_not_behind_a_clean_last_frame() {
    let (width, height) = (128, 96);
    let mut sequence = Sequence::new(Settings::default());
    let (mut one, mut truth) = (Vec::new(), Vec::new());
    for k in 0..6_u32 {
        let f = SyntheticFrame::new(width, height, 0.02 * f64::from(k));
        let [color, variance] = sampled(&f, 40 + u64::from(k), |_| 1.0);
        let mut frame = Frame::new(width, height, &color).with_guides(f.guides());
        frame.variance = Some(&variance);
        sequence.push(&frame, f.camera).expect("sound");
        one = denoise(&frame, &Settings::default()).expect("sound").color;
        truth = f.reference;
    }
    let many = sequence.denoise().expect("frames").expect("sound").color;
    let (many, one) = (display_rmse(&many, &truth), display_rmse(&one, &truth));
    println!("six frames {many:.5}, the last {one:.5}");
    assert!(many < one, "{many} against {one}");
}

#[test]
fn what_only_the_last_frame_shows_comes_back() {
    let (width, height) = (128, 96);
    // Stripes of light, too fine for the test of what changed.
    let stripes = |i: usize| 1.0 + 0.4 * ((i % width) as f32 * std::f32::consts::TAU / 12.0).sin();
    let f = SyntheticFrame::new(width, height, 0.0);
    let n = f.shape.pixels();
    for known in [true, false] {
        let mut sequence = Sequence::new(Settings::default());
        for k in 0..6 {
            let [color, variance] = sampled(&f, 70 + k, |i| if k == 5 { stripes(i) } else { 1.0 });
            let mut frame = Frame::new(width, height, &color).with_guides(f.guides());
            frame.variance = Some(&variance).filter(|_| known).map(|v| &v[..]);
            sequence.push(&frame, f.camera).expect("sound");
        }
        let found = sequence.denoise().expect("frames").expect("sound").color;
        // The amplitude of the stripes that is there, of 1.
        let (mut there, mut all) = (0.0, 0.0);
        for i in 0..3 * n {
            let s = stripes(i % n) - 1.0;
            there += (found[i] - f.reference[i]) * s;
            all += f.reference[i] * s * s;
        }
        println!("stripes {:.3}", there / all);
        assert!(there > 0.5 * all, "{} of the stripes, variance {known}", there / all);
    }
}

#[test]
fn what_was_not_seen_before_is_denoised_as_a_single_frame() {
    let (width, height) = (128, 96);
    let f = SyntheticFrame::new(width, height, 0.0);
    let n = f.shape.pixels();
    let frames = [1, 2].map(|seed| sampled(&f, 90 + seed, |_| 1.0));
    let frame = |k: usize| {
        let mut frame = Frame::new(width, height, &frames[k][0]).with_guides(f.guides());
        frame.variance = Some(&frames[k][1]);
        frame
    };
    let one = denoise(&frame(1), &Settings::default()).expect("sound").color;
    // The first frame saw another place from this column on.
    let after = |column: usize| {
        let mut elsewhere = f.position.clone();
        (0..3 * n).filter(|i| i % width >= column).for_each(|i| elsewhere[i] += 1000.0);
        let mut sequence = Sequence::new(Settings::default());
        let guides = crate::mc::Guides { position: Some(&elsewhere), ..f.guides() };
        sequence.push(&frame(0).with_guides(guides), f.camera).expect("sound");
        sequence.push(&frame(1), f.camera).expect("sound");
        sequence.denoise().expect("frames").expect("sound")
    };
    let cut = after(0);
    // But for the exposure, which is that of the first frame.
    let (apart, own) = (display_rmse(&cut.color, &one), display_rmse(&one, &f.reference));
    println!("cut {apart:.6}, error {own:.6}");
    assert!(apart < 0.05 * own && !cut.plan.runs("mean"), "{apart} {own} {}", cut.plan);
    // Two halves are its own then, too.
    let halves = [0, 1].map(|k| [0, 1].map(|half| sampled(&f, 94 + 2 * k + half, |_| 1.0)[0].clone()));
    let frame_of = |k: usize| {
        let [color, half] = &halves[k];
        let mut frame = Frame::new(width, height, color).with_guides(f.guides());
        frame.half = Some(half);
        frame
    };
    let alone = denoise(&frame_of(1), &Settings::default()).expect("sound").color;
    let mut sequence = Sequence::new(Settings::default());
    let elsewhere: Vec<f32> = f.position.iter().map(|p| p + 1000.0).collect();
    let guides = crate::mc::Guides { position: Some(&elsewhere), ..f.guides() };
    sequence.push(&frame_of(0).with_guides(guides), f.camera).expect("sound");
    sequence.push(&frame_of(1), f.camera).expect("sound");
    let cut = sequence.denoise().expect("frames").expect("sound").color;
    let (apart, own) = (display_rmse(&cut, &alone), display_rmse(&alone, &f.reference));
    println!("cut with halves {apart:.6}, error {own:.6}");
    assert!(apart < 0.05 * own, "{apart} {own}");
    let pan = after(width / 2).color;
    let error = |color: &[f32]| {
        let new = |i: &usize| i % width >= width / 2;
        let squares = (0..3 * n).filter(new).map(|i| f64::from(color[i] - f.reference[i]).powi(2));
        squares.sum::<f64>().sqrt()
    };
    println!("new half {:.4}, of a single frame {:.4}", error(&pan), error(&one));
    assert!(error(&pan) < 1.05 * error(&one), "{} and {}", error(&pan), error(&one));
}

#[test]
fn logarithms_of_single_samples_are_too_dark() {
    // Bernoulli noise of mean 1: the mean of log(1 + x) returns .60 after the exponential, the log of the mean 1.
    let p = 0.25_f64;
    let early = (p * (1.0 + 1.0 / p).ln()).exp() - 1.0;
    assert!(early < 0.6);
    let (width, height) = (64, 48);
    let n = height * width;
    let wall = Wall::new(width, height);
    let mut rng = Rng::new(11, 0);
    let mut history =
        Accumulator::new(width, height, TemporalSettings { minimum: 0.0, ..TemporalSettings::default() });
    for _ in 0..64 {
        let gray: Vec<f32> =
            (0..n).map(|_| if rng.next_f64() < p { (1.0 / p) as f32 } else { 0.0 }).collect();
        let irradiance = gray.repeat(3);
        wall.add(&mut history, &irradiance);
    }
    let late = history.mean().iter().map(|v| f64::from(v.ln_1p())).sum::<f64>() / (3 * n) as f64;
    let late = late.exp() - 1.0;
    assert!((late - 1.0).abs() < 0.03, "{late} after accumulation, {early} before");
}

#[test]
fn light_that_moves_over_a_surface_leaves_no_ghost() {
    let (width, height) = (64, 48);
    let n = height * width;
    let wall = Wall::new(width, height);
    // A spot of light that jumps to the right before the last frame.
    let light = |i: usize, x: f32| {
        let d = ((i % width) as f32 - x).hypot((i / width) as f32 - 24.0);
        if d < 6.0 { 3.0 } else { 1.0 }
    };
    let error = |change: f32| {
        let mut rng = Rng::new(9, 0);
        let mut history = Accumulator::new(width, height, TemporalSettings { change, ..Default::default() });
        for x in [20.0, 20.0, 20.0, 20.0, 20.0, 40.0] {
            let gray: Vec<f32> = (0..n).map(|i| light(i, x) * (1.0 + 0.5 * rng.normal())).collect();
            let irradiance = gray.repeat(3);
            wall.add(&mut history, &irradiance);
        }
        // Bias of both places, and noise of the rest.
        let mean = history.mean();
        let of = |keep: &dyn Fn(f32) -> bool, square: bool| {
            let inside = |i: &usize| keep(light(*i, 20.0).max(light(*i, 40.0)));
            let (sum, count) = (0..n).filter(inside).fold((0.0, 0.0), |(s, c), i| {
                let d = mean[i] - light(i, 40.0);
                (s + if square { d * d } else { d.abs() }, c + 1.0)
            });
            sum / count
        };
        (of(&|l| l > 1.0, false), of(&|l| l == 1.0, true).sqrt(), history.effective())
    };
    let (kept, before, _) = error(f32::INFINITY);
    let (found, after, effective) = error(TemporalSettings::default().change);
    assert!(kept > 1.2, "{kept}");
    // Half of what the light is off by would be the noise of one frame.
    assert!(found < 0.8 * kept, "{found} with, {kept} without");
    assert!(after < 1.15 * before, "{after} {before}: what did not change keeps its history");
    assert!(effective[24 * width + 40] < 2.0 && effective[5 * width + 5] > 5.0);
}
