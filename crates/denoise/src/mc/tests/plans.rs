//! Every line of a plan is true for the model and the settings.

use super::*;
use crate::mc::{Guides, Sequence, Stage, VariationalModel};

/// A scene with a lamp without albedo, its halves, and the variance of their mean.
struct Case {
    scene: SyntheticFrame,
    halves: [Vec<f32>; 2],
    mean: Vec<f32>,
    variance: Vec<f32>,
    zeros: Vec<f32>,
}

fn case() -> Case {
    let mut scene = SyntheticFrame::new(96, 64, 0.0);
    let n = scene.shape.pixels();
    let (mut a, mut b) = (scene.noisy(2, 1), scene.noisy(2, 2));
    for i in (0..3 * n).filter(|i| (40..52).contains(&(i % n % 96)) && (20..30).contains(&(i % n / 96))) {
        scene.albedo[i] = 0.0;
        (a[i], b[i]) = (2.0 + a[i], 2.0 + b[i]);
    }
    let mean = a.iter().zip(&b).map(|(a, b)| 0.5 * (a + b)).collect();
    let variance = a.iter().zip(&b).map(|(a, b)| 0.25 * (a - b).powi(2)).collect();
    Case { zeros: vec![0.0; 3 * n], scene, halves: [a, b], mean, variance }
}

impl Case {
    /// Frames with all that may be known of the noise, with and without guides.
    fn frames(&self) -> Vec<(&'static str, Frame<'_>)> {
        let mut out = Vec::new();
        for (name, guides) in [("bare", Guides::default()), ("guided", self.scene.guides())] {
            let plain = Frame::new(96, 64, &self.mean).with_guides(guides);
            out.push((name, plain));
            out.push((name, Frame { variance: Some(&self.variance), ..plain }));
            out.push((name, Frame { variance: Some(&self.zeros), ..plain }));
            out.push((name, Frame { color: &self.halves[0], half: Some(&self.halves[1]), ..plain }));
        }
        out
    }
}

/// Stages that have a line of their name; the others are inputs, or choices within a stage.
const OWN_LINES: [Stage; 7] = [
    Stage::Noiseless,
    Stage::Demodulation,
    Stage::ZeroAlbedo,
    Stage::Detail,
    Stage::Antialiasing,
    Stage::Edges,
    Stage::Coherence,
];

#[test]
fn what_a_plan_says_of_a_stage_is_so() {
    let case = case();
    let run = |frame: &Frame<'_>, model, without: Option<Stage>| {
        let without = without.into_iter().collect();
        denoise(frame, &Settings { without, ..with(model) }).expect("a sound frame")
    };
    for (name, frame) in case.frames() {
        for model in MODELS {
            let all = run(&frame, model, None);
            for stage in OWN_LINES {
                let less = run(&frame, model, Some(stage));
                let place = format!("{name}, {model:?}, {stage}");
                assert!(!less.plan.runs(stage.name()), "{place}: {}", less.plan);
                let why = |d: &Denoised| d.plan.step(stage.name()).map(|s| s.why.clone());
                match all.plan.runs(stage.name()) {
                    // What is skipped anyhow is no matter of leaving it out, and leaving it out changes nothing.
                    false => assert!(all.color == less.color, "{place} is skipped, and changes something"),
                    true => assert_eq!(why(&less).as_deref(), Some("left out by the settings"), "{place}"),
                }
            }
            let left_out = all.plan.steps.iter().find(|s| s.why.contains("left out"));
            assert!(
                left_out.is_none(),
                "{name}, {model:?}: nothing is left out, and the line is {left_out:?}"
            );
            let automatic = model == Model::Auto;
            for stage in ["antialiasing", "edges"] {
                let why = &all.plan.step(stage).expect("a line").why;
                assert_eq!(why == "part of the automatic model", !automatic, "{model:?}, {stage}: {why}");
            }
        }
    }
    let guided = Frame::new(96, 64, &case.mean).with_guides(case.scene.guides());
    let cells = |without| {
        run(&guided, Model::Auto, Some(without)).plan.step("regression").expect("a line").why.clone()
    };
    assert!(cells(Stage::Bandwidth).ends_with("bandwidth left out"));
    assert!(cells(Stage::Highlights).ends_with("highlights left out"));
}

#[test]
fn several_stages_are_left_out_at_once() {
    let case = case();
    let frame = Frame::new(96, 64, &case.mean).with_guides(case.scene.guides());
    let run = |frame: &Frame<'_>, stages: &[Stage]| {
        let without = stages.iter().copied().collect();
        denoise(frame, &Settings { without, ..Settings::default() }).expect("a sound frame")
    };
    let stages = [Stage::Normal, Stage::Bandwidth, Stage::Highlights, Stage::Detail];
    let less = run(&frame, &stages);
    let regression = &less.plan.step("regression").expect("a line").why;
    assert!(regression.ends_with("; bandwidth left out; highlights left out"), "{regression}");
    assert!(!less.plan.runs("normal") && !less.plan.runs("detail"), "{}", less.plan);
    // As where the input is not there.
    let guides = Guides { normal: None, ..frame.guides };
    assert!(less.color == run(&frame.with_guides(guides), &stages[1..]).color);
    assert!(less.color != run(&frame, &stages[..3]).color, "detail makes a difference");
}

#[test]
fn a_sequence_says_where_its_noise_is_from() {
    let case = case();
    let frame = Frame::new(96, 64, &case.halves[0]).with_guides(case.scene.guides());
    let mut history = Sequence::new(Settings::default());
    for frames in 1..=2 {
        let half = Frame { half: Some(&case.halves[1]), ..frame };
        history.push(&half, case.scene.camera).expect("sound");
        let plan = history.denoise().expect("frames").expect("sound").plan;
        let why = &plan.step("noise").expect("a line").why;
        assert_eq!(why, if frames == 1 { "from the two halves" } else { "from the history" });
    }
}

/// An input that is given and left out is told apart from one that is not given, and what rests on it says so, too.
#[test]
fn inputs_that_are_left_out_were_given() {
    let case = case();
    let n = case.scene.shape.pixels();
    let position: Vec<f32> = (0..3 * n).map(|i| (i % 96) as f32).collect();
    let guides = Guides { position: Some(&position), ..case.scene.guides() };
    let frame =
        Frame { variance: Some(&case.variance), ..Frame::new(96, 64, &case.mean).with_guides(guides) };
    let bare = Frame::new(96, 64, &case.mean);
    let why = |frame: &Frame<'_>, stage: Stage, step: &str| {
        let plan = denoise(frame, &Settings { without: stage.into(), ..with(Model::Auto) }).unwrap().plan;
        plan.step(step).map(|s| (s.runs, s.why.clone()))
    };
    for (stage, steps) in [
        (Stage::Albedo, &["albedo"][..]),
        (Stage::Normal, &["normal"]),
        (Stage::Position, &["position", "depth"]),
    ] {
        for step in steps {
            let given = if *step == "depth" { guides.depth.is_some() } else { true };
            let expected = if given { "left out by the settings" } else { "not given" };
            assert_eq!(why(&frame, stage, step), Some((false, expected.into())), "{stage}, {step}");
            assert_eq!(why(&bare, stage, step), Some((false, "not given".into())), "{stage}, {step}");
        }
    }
    for step in ["noise", "antialiasing"] {
        let told = |frame| why(frame, Stage::Variance, step).map_or_else(String::new, |s| s.1);
        assert!(
            told(&frame).ends_with("the variance layer is left out by the settings"),
            "{step}: {}",
            told(&frame)
        );
        assert!(told(&bare).ends_with("no variance layer"), "{step}: {}", told(&bare));
    }
}

/// A model is the same without stages that it does not have, and another one without some of those that it has.
#[test]
fn a_model_has_the_stages_that_change_it() {
    let case = case();
    let guided = Frame::new(96, 64, &case.mean).with_guides(case.scene.guides());
    let known = Frame { variance: Some(&case.variance), ..guided };
    for model in MODELS {
        let all = [&guided, &known].map(|f| denoise(f, &with(model)).unwrap().color);
        for stage in Stage::ALL.into_iter().filter(|s| !s.is_of(model)) {
            for (frame, all) in [&guided, &known].into_iter().zip(&all) {
                let less = denoise(frame, &Settings { without: stage.into(), ..with(model) }).unwrap();
                assert!(less.color == *all, "{model:?} has {stage}");
            }
        }
    }
    let hybrid = Model::Variational(VariationalModel::Hybrid);
    let auto = [Stage::Bandwidth, Stage::Detail, Stage::Edges].map(|stage| (Model::Auto, stage));
    for (model, stage) in auto.into_iter().chain([(hybrid, Stage::Coherence)]) {
        let less = denoise(&known, &Settings { without: stage.into(), ..with(model) }).unwrap();
        assert!(less.color != denoise(&known, &with(model)).unwrap().color, "{stage}");
    }
}
