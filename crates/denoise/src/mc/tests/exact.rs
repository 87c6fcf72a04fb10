//! What has no noise stays.

use super::*;
use crate::mc::Sequence;

const HEIGHT: usize = 96;
const WIDTH: usize = 128;
/// Whether a pixel shows the striped environment in the corner, the lamp, or the small lamp.
fn shown(i: usize) -> Option<f32> {
    let (x, y) = (i % WIDTH, i / WIDTH);
    match (x, y) {
        (90.., ..40) => Some(0.3 + 0.2 * ((x / 3) % 2) as f32),
        (40..56, 20..31) => Some(18.0),
        (20..22, 50..52) => Some(30.0),
        _ => None,
    }
}

/// A scene, its two noisy halves and the variance of their mean, with what is shown put in.
fn scene() -> (SyntheticFrame, [Vec<f32>; 2], Vec<f32>) {
    let mut scene = SyntheticFrame::new(WIDTH, HEIGHT, 0.0);
    let (mut a, mut b) = (scene.noisy(4, 1), scene.noisy(4, 2));
    let n = HEIGHT * WIDTH;
    for i in 0..3 * n {
        if let Some(value) = shown(i % n) {
            (a[i], b[i], scene.reference[i]) = (value, value, value);
            let environment = i % n % WIDTH >= 90;
            if environment {
                (scene.albedo[i], scene.normal[i], scene.position[i]) = (0.0, 0.0, 0.0);
                scene.depth[i % n] = 0.0;
            }
        }
    }
    let variance = a.iter().zip(&b).map(|(a, b)| 0.25 * (a - b) * (a - b)).collect();
    (scene, [a, b], variance)
}

#[test]
fn pixels_without_noise_come_out_as_they_went_in() {
    let (scene, [a, b], variance) = scene();
    let n = HEIGHT * WIDTH;
    let mean: Vec<f32> = a.iter().zip(&b).map(|(a, b)| 0.5 * (a + b)).collect();
    let plain = Frame::new(WIDTH, HEIGHT, &mean);
    for guides in [scene.guides(), crate::mc::Guides::default()] {
        let layer = Frame { variance: Some(&variance), ..plain.with_guides(guides) };
        let halves = Frame { color: &a, half: Some(&b), ..plain.with_guides(guides) };
        for (frame, model) in MODELS.iter().flat_map(|m| [(layer, *m), (halves, *m)]) {
            let d = denoise(&frame, &with(model)).expect("sound");
            let mut kept = 0;
            for i in (0..3 * n).filter(|i| shown(i % n).is_some()) {
                assert_eq!(Some(d.color[i]), shown(i % n), "{model:?}: pixel {}", i % n);
                kept += 1;
            }
            assert_eq!(kept, 3 * (38 * 40 + 16 * 11 + 4));
            assert!(d.plan.runs("noiseless") && d.plan.runs("noise"), "{}", d.plan);
        }
    }
    // Without a known noise nothing is claimed.
    assert!(!denoise(&plain, &Settings::default()).expect("sound").plan.runs("noiseless"));
    // The last frame of a sequence tells what is exact.
    let mut history = Sequence::new(Settings::default());
    for _ in 0..2 {
        let frame = Frame { variance: Some(&variance), ..plain.with_guides(scene.guides()) };
        history.push(&frame, scene.camera).expect("sound");
    }
    let d = history.denoise().expect("frames").expect("sound");
    assert!((0..3 * n).all(|i| shown(i % n).is_none_or(|v| d.color[i] == v)), "{}", d.plan);
}

#[test]
fn lamps_do_not_light_the_wall_around_them() {
    let (scene, [a, b], _) = scene();
    let frame = Frame { half: Some(&b), ..Frame::new(WIDTH, HEIGHT, &a).with_guides(scene.guides()) };
    let n = HEIGHT * WIDTH;
    for model in [Model::Auto, Model::Variational(VariationalModel::Hybrid)] {
        let u = denoise(&frame, &with(model)).expect("sound").color;
        let ring = (0..n).filter(|i| {
            let (x, y) = (i % WIDTH, i / WIDTH);
            (36..60).contains(&x) && (16..35).contains(&y) && shown(*i).is_none()
        });
        let [ours, truth] = ring.fold([0.0_f32; 2], |[s, t], i| [s + u[i], t + scene.reference[i]]);
        assert!(ours < 1.5 * truth, "{model:?}: {ours} around the lamp, {truth} in truth");
    }
}

#[test]
fn equal_samples_by_chance_and_black_ones_are_noise() {
    // Half of the samples see a light of one colour: a pixel of two has no variance in half of all cases.
    let n = HEIGHT * WIDTH;
    let hit = |i: usize, s: u64| {
        let hash = ((i as u64) << 8 | s).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        if (hash ^ (hash >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 63 == 0 { 1.0 } else { 0.0 }
    };
    let side = |s: u64| (0..3 * n).map(|i| hit(i % n, s)).collect::<Vec<f32>>();
    let (a, b) = (side(0), side(1));
    let frame = Frame { half: Some(&b), ..Frame::new(WIDTH, HEIGHT, &a) };
    let d = denoise(&frame, &Settings::default()).expect("sound");
    let why = &d.plan.step("noiseless").expect("a line").why;
    assert!(why.starts_with("0 pixels"), "{why}");
    let far = |v: &f32| (v - 0.5).abs();
    let (most, rms) =
        (d.color.iter().map(far).fold(0.0, f32::max), d.color.iter().map(|v| far(v).powi(2)).sum::<f32>());
    let rms = (rms / d.color.len() as f32).sqrt();
    // Twenty-four other sets of samples reach .025 to .034 and at most .165 to .277.
    assert!(rms < 0.037 && most < 0.3, "of noise of .35: {rms}, at most {most}");
}

#[test]
fn a_shown_environment_stays_and_fog_is_noise() {
    // Four samples a pixel of edges, waves and a slope, at random places of the pixel; or of a medium, anywhere.
    let n = HEIGHT * WIDTH;
    let mut rng = photofit_gradcheck::Uniform::new(3);
    let environment = |x: f32, y: f32| {
        let edges = if (x + 0.4 * y).rem_euclid(37.0) < 9.0 { 1.1 } else { 0.3 };
        edges + 0.2 * (0.7 * x).sin() * (0.5 * y).cos() + 0.002 * x
    };
    let mut samples = |fog: bool| {
        let (mut color, mut variance) = (vec![0.0; 3 * n], vec![0.0; 3 * n]);
        for i in 0..n {
            let values: [f32; 4] = std::array::from_fn(|_| {
                let at = rng.vec(2, 0.0, 1.0);
                match fog {
                    true => (0.3 + 0.004 * (i % WIDTH) as f32) * (2.0 * at[0]) as f32,
                    false => {
                        environment((i % WIDTH) as f32 + at[0] as f32, (i / WIDTH) as f32 + at[1] as f32)
                    }
                }
            });
            let mean = values.iter().sum::<f32>() / 4.0;
            let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / (3.0 * 4.0);
            (0..3).for_each(|c| (color[c * n + i], variance[c * n + i]) = (mean, square));
        }
        (color, variance)
    };
    // A wall in the lowest rows, or there would be nothing that rays miss.
    let wall = |i: usize| i % n >= (HEIGHT - 8) * WIDTH;
    let normal: Vec<f32> = (0..3 * n).map(|i| if wall(i) { 0.6 } else { 0.0 }).collect();
    let guides = crate::mc::Guides { normal: Some(&normal), ..Default::default() };
    for fog in [false, true] {
        let (color, variance) = samples(fog);
        let frame =
            Frame { variance: Some(&variance), ..Frame::new(WIDTH, HEIGHT, &color).with_guides(guides) };
        let d = denoise(&frame, &Settings::default()).expect("sound");
        let open = (0..3 * n).filter(|i| !wall(*i));
        let kept =
            open.filter(|i| d.color[*i] == color[*i]).count() as f64 / (3 * WIDTH * (HEIGHT - 8)) as f64;
        match fog {
            false => assert!(kept > 0.999, "{kept}"),
            true => assert!(kept < 0.02, "{kept}"),
        }
    }
}

#[test]
fn pixels_that_show_a_part_of_a_lamp_do_not_reach_the_wall() {
    // A lamp that covers a quarter to three quarters of the pixels around it, by the chance of four samples.
    let (mut scene, [mut a, mut b], _) = scene();
    let n = HEIGHT * WIDTH;
    let mut rng = photofit_gradcheck::Uniform::new(5);
    let rim = |i: usize| {
        let (x, y) = (i % WIDTH, i / WIDTH);
        (39..57).contains(&x) && (19..32).contains(&y) && shown(i).is_none()
    };
    for i in (0..n).filter(|i| rim(*i)) {
        let share = |r: f64| 0.25 + 0.25 * (r * 2.999).floor() as f32;
        let covered = [share(rng.range(0.0, 1.0)), share(rng.range(0.0, 1.0))];
        for k in [i, n + i, 2 * n + i] {
            for (side, c) in [&mut a, &mut b].into_iter().zip(covered) {
                side[k] = c * 18.0 + (1.0 - c) * side[k];
            }
            scene.reference[k] = 9.0 + 0.5 * scene.reference[k];
        }
    }
    let variance: Vec<f32> = a.iter().zip(&b).map(|(a, b)| 0.25 * (a - b) * (a - b)).collect();
    let mean: Vec<f32> = a.iter().zip(&b).map(|(a, b)| 0.5 * (a + b)).collect();
    let frame = Frame::new(WIDTH, HEIGHT, &mean).with_guides(scene.guides());
    let layer = Frame { variance: Some(&variance), ..frame };
    let halves = Frame { color: &a, half: Some(&b), ..frame };
    for frame in [layer, halves] {
        let u = denoise(&frame, &Settings::default()).expect("sound").color;
        let beside = (0..n).filter(|i| {
            let (x, y) = (i % WIDTH, i / WIDTH);
            (35..61).contains(&x) && (15..36).contains(&y) && shown(*i).is_none() && !rim(*i)
        });
        let [ours, truth] = beside.fold([0.0_f32; 2], |[s, t], i| [s + u[i], t + scene.reference[i]]);
        assert!(ours < 1.25 * truth, "{ours} beside the lamp, {truth} in truth");
        let kept = (0..n).filter(|i| rim(*i)).all(|i| (u[i] - mean[i]).abs() <= 1e-5 * mean[i]);
        assert!(kept, "what shows the lamp keeps its light");
    }
}

#[test]
fn noise_around_a_dim_lamp_is_no_part_of_it() {
    // A lamp barely brighter than the noisy wall around it.
    let (_, [mut a, mut b], _) = scene();
    let n = HEIGHT * WIDTH;
    let lamp = |i: usize| (40..56).contains(&(i % WIDTH)) && (20..31).contains(&(i / WIDTH));
    let ring = |i: usize| (38..58).contains(&(i % WIDTH)) && (18..33).contains(&(i / WIDTH)) && !lamp(i);
    let count = (0..n).filter(|i| ring(*i)).count();
    let wall = (0..3 * n).filter(|i| ring(i % n)).map(|i| a[i] + b[i]).sum::<f32>() / (6 * count) as f32;
    for i in (0..3 * n).filter(|i| lamp(i % n)) {
        (a[i], b[i]) = (1.1 * wall, 1.1 * wall);
    }
    let frame = Frame { half: Some(&b), ..Frame::new(WIDTH, HEIGHT, &a) };
    let u = denoise(&frame, &Settings::default()).expect("sound").color;
    let kept = (0..n).filter(|i| ring(*i) && (u[*i] - 0.5 * (a[*i] + b[*i])).abs() <= 1e-6 * u[*i]).count();
    assert!(kept * 20 < count, "{kept} of {count} pixels beside the lamp keep their noise");
}
