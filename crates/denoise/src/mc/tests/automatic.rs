//! Parameters that choose themselves.

use super::*;
use crate::Shape;
use crate::mc::coherence::auxiliary_weight;
use crate::mc::frame::Features;
use crate::mc::{
    SHARPNESS, Stage, VariationalModel, adaptive_weight, blended_weight, choose_by_halves, solve_variational,
};

/// Two halves of a noisy scene in the log domain, its truth, and the deviation of their mean's noise.
struct Case {
    shape: Shape,
    halves: [Vec<f32>; 2],
    truth: Vec<f32>,
    sigma: Vec<f32>,
    auxiliary: Vec<f32>,
}

fn case(seed: u64, samples: u32) -> Case {
    let scene = SyntheticFrame::new(128, 96, 0.0);
    let n = scene.shape.pixels();
    let log = |v: &[f32]| v.iter().map(|v| v.ln_1p()).collect::<Vec<f32>>();
    let halves = [log(&scene.noisy(samples, seed)), log(&scene.noisy(samples, seed + 1000))];
    let sigma: Vec<f32> = {
        let planes = halves[0].chunks(n).map(|u| crate::mc::mad_sigma(u, 128, 96));
        planes.fold(vec![0.0; n], |mut a, s| {
            a.iter_mut().zip(s).for_each(|(a, s)| *a += s / 3.0);
            a
        })
    };
    let features = Features {
        normal: Some((&scene.normal[..]).into()),
        albedo: Some((&scene.albedo[..]).into()),
        depth: Some((&scene.depth[..]).into()),
        position: None,
    };
    let auxiliary = auxiliary_weight(&features, scene.shape, SHARPNESS);
    Case { shape: scene.shape, halves, truth: log(&scene.reference), sigma, auxiliary }
}

fn error(u: &[f32], truth: &[f32]) -> f64 {
    let sum: f64 = u.iter().zip(truth).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    (sum / u.len() as f64).sqrt()
}

#[test]
fn halves_choose_what_an_oracle_would() {
    let grid: Vec<f32> = (0..8).map(|k| 0.5 * 2.0_f32.powi(k)).collect();
    for (seed, samples) in [(1, 4), (2, 16)] {
        let case = case(seed, samples);
        let weight = vec![1.0; case.shape.pixels()];
        let solve = |c: f32, target: &[f32]| {
            let alpha = adaptive_weight(c, &case.sigma, &case.auxiliary);
            solve_variational(VariationalModel::Hybrid, case.shape, target, &weight, &alpha, 30)
        };
        let (chosen, _) =
            choose_by_halves(&grid, [&case.halves[0], &case.halves[1]], &weight, solve).expect("sound");
        // The oracle scores against the expectation of the halves, as far as 512 more samples tell it.
        let expectation: Vec<f32> = {
            let scene = SyntheticFrame::new(128, 96, 0.0);
            let mut sum = vec![0.0_f32; case.truth.len()];
            for k in 0..48 {
                let s = scene.noisy(samples, 5000 + k);
                sum.iter_mut().zip(s).for_each(|(a, v)| *a += v.ln_1p() / 48.0);
            }
            sum
        };
        let errors: Vec<f64> =
            grid.iter().map(|c| error(&solve(*c, &case.halves[0]).expect("sound"), &expectation)).collect();
        let best = (0..grid.len()).min_by(|a, b| errors[*a].total_cmp(&errors[*b])).expect("a grid");
        let k = grid.iter().position(|c| *c == chosen).expect("of the grid");
        assert!(k.abs_diff(best) <= 1, "{samples} samples: chose {chosen}, the oracle {}", grid[best]);
        assert!(errors[k] <= 1.1 * errors[best], "{samples} samples: {} against {}", errors[k], errors[best]);
    }
}

#[test]
fn weights_that_follow_the_noise_are_as_good_as_the_best_alpha() {
    let case = case(5, 4);
    let weight = vec![1.0; case.shape.pixels()];
    let best = |alphas: &dyn Fn(f32) -> Vec<f32>| {
        (-4..9)
            .map(|k| 0.25 * 1.5_f32.powi(k))
            .map(|a| {
                let u = solve_variational(
                    VariationalModel::Hybrid,
                    case.shape,
                    &case.halves[0],
                    &weight,
                    &alphas(a),
                    30,
                );
                error(&u.expect("sound"), &case.truth)
            })
            .fold(f64::INFINITY, f64::min)
    };
    let adaptive = best(&|c| adaptive_weight(8.0 * c, &case.sigma, &case.auxiliary));
    let plain = best(&|c| case.auxiliary.iter().map(|w| c * w).collect());
    let published =
        best(&|c| blended_weight(&case.auxiliary, &case.sigma, 3.0).iter().map(|w| c * w).collect());
    // The truth chooses one number for each; only that of the first holds for other pictures.
    assert!(adaptive < 1.03 * plain, "{adaptive} against alpha0 W_aux {plain}");
    assert!(adaptive < 1.03 * published, "{adaptive} against alpha0 W {published}");
}

#[test]
fn the_map_of_the_guides_alone_does_not_raise_the_error() {
    // Of radiance that is not divided by the albedo: nothing else takes the edges out.
    for (seed, samples) in [(1, 1), (3, 4), (4, 16)] {
        let case = case(seed, samples);
        let flat = vec![1.0; case.shape.pixels()];
        let of = |alpha: &[f32]| {
            let u =
                solve_variational(VariationalModel::Hybrid, case.shape, &case.halves[0], &flat, alpha, 30);
            error(&u.expect("sound"), &case.truth)
        };
        // At the default strength, and with one weight for the picture that the truth likes best.
        let c = VariationalModel::Hybrid.strength();
        let followed = |map: &[f32]| of(&adaptive_weight(c, &case.sigma, map));
        let scaled = |map: &[f32], a: f32| of(&map.iter().map(|w| a * w).collect::<Vec<f32>>());
        let best =
            |map: &[f32]| (-4..6).map(|k| scaled(map, 0.25 * 1.5_f32.powi(k))).fold(f64::INFINITY, f64::min);
        let (with, without) = (followed(&case.auxiliary), followed(&flat));
        println!("{samples} samples: {with:.4} with the map, {without:.4} without");
        assert!(with <= without, "{samples} samples: {with} with the map, {without} without");
        let (with, without) = (best(&case.auxiliary), best(&flat));
        println!("{samples} samples, one weight: {with:.4} with the map, {without:.4} without");
        assert!(
            with <= 1.01 * without,
            "{samples} samples, one weight: {with} with the map, {without} without"
        );
    }
}

#[test]
fn stages_can_be_left_out() {
    let scene = SyntheticFrame::new(96, 64, 0.0);
    let (a, b) = (scene.noisy(1, 1), scene.noisy(1, 2));
    let n = scene.shape.len();
    let mean: Vec<f32> = a.iter().zip(&b).map(|(a, b)| 0.5 * (a + b)).collect();
    let variance: Vec<f32> = (0..n).map(|i| 0.25 * (a[i] - b[i]).powi(2)).collect();
    let known = Frame { variance: Some(&variance), ..Frame::new(96, 64, &mean).with_guides(scene.guides()) };
    let zeros = vec![0.0; n];
    let unknown = Frame { variance: Some(&zeros), ..known };
    let run = |frame: &Frame<'_>, model, without: Option<Stage>| {
        let without = without.into_iter().collect();
        denoise(frame, &Settings { without, ..with(model) }).expect("sound")
    };
    let hybrid = Model::Variational(VariationalModel::Hybrid);
    for stage in Stage::ALL {
        let model = if stage == Stage::Coherence { hybrid } else { Model::Auto };
        let frame = if stage == Stage::Antialiasing { &unknown } else { &known };
        let (all, less) = (run(frame, model, None), run(frame, model, Some(stage)));
        assert!(less.color.iter().all(|v| v.is_finite()), "{stage}");
        // This scene has neither lamps nor highlights nor silent windows.
        let absent = [Stage::Noiseless, Stage::Highlights, Stage::ZeroAlbedo, Stage::Edges].contains(&stage);
        assert!(absent || all.color != less.color, "{stage} changes nothing");
    }
    let why = |d: &Denoised, step: &str| d.plan.step(step).expect("a line").why.clone();
    let less = run(&known, Model::Auto, Some(Stage::Detail));
    assert!(!less.plan.runs("detail") && why(&less, "detail").contains("left out"));
}

#[test]
fn halves_and_variance_layers_reach_the_plan() {
    let scene = SyntheticFrame::new(80, 64, 0.0);
    let (a, b) = (scene.noisy(2, 1), scene.noisy(2, 2));
    let n = scene.shape.len();
    // A sample has 3.68 times the squared radiance as its variance.
    let variance: Vec<f32> = (0..n).map(|i| 1.84 * scene.reference[i].powi(2)).collect();
    let model = Model::Variational(VariationalModel::Hybrid);
    let frame = Frame::new(80, 64, &a).with_guides(scene.guides());
    let plain = denoise(&frame, &with(model)).expect("sound");
    let halves = denoise(&Frame { half: Some(&b), ..frame }, &with(model)).expect("sound");
    let layer = denoise(&Frame { variance: Some(&variance), ..frame }, &with(model)).expect("sound");
    let why = |d: &Denoised, step: &str| d.plan.step(step).expect("a line").why.clone();
    assert!(why(&plain, "strength").contains("default") && plain.strength == Some(4.0));
    assert!(why(&halves, "strength").contains("cross-validation"), "{}", halves.plan);
    assert!(why(&layer, "deviation").contains("known variance"), "{}", layer.plan);
    // One sample has no variance: renderers then write zeros, which say nothing.
    let zeros = vec![0.0; n];
    let none = denoise(&Frame { variance: Some(&zeros), ..frame }, &with(model)).expect("sound");
    assert!(why(&none, "noise").contains("all 0") && none.color == plain.color, "{}", none.plan);
    // The tails of these samples are heavier than their variance tells: detail lets a part of them through.
    let both =
        [(Frame { half: Some(&b), ..frame }, 0.065), (Frame { variance: Some(&variance), ..frame }, 0.095)];
    for (frame, most) in both {
        let known = denoise(&frame, &Settings::default()).expect("sound");
        let error = display_rmse(&known.color, &scene.reference);
        assert!(error < most, "{error}, at most {most}");
    }
}
