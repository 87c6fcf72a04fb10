//! Fits of scenes that are stopped go on to the same bits.

use super::parameters::{around, hall_model};
use super::*;
use crate::Progress;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Says stop at the n-th question.
struct Stop(AtomicUsize, usize);

impl Progress for Stop {
    fn report(&self, _: &'static str, _: u64, _: u64, _: &str) {}

    fn is_cancelled(&self) -> bool {
        self.0.fetch_add(1, Ordering::Relaxed) >= self.1
    }
}

const STEPS: u64 = 56;

fn small() -> Traced {
    let mut model = hall_model();
    (model.options.spp, model.gradient_spp, model.evaluation_spp) = (1, 1, 2);
    model.smoothing = Smoothing::Bilateral;
    for (k, start) in [0.4, 0.5, 0.6, 1.5, 0.5].into_iter().enumerate() {
        model.replace(k, &vec![start; model.of(k).len()]).expect("valid");
    }
    model
}

fn targets(spp: u32) -> Vec<Image> {
    around(2).iter().map(|v| hall_model().picture(v, spp, 99).expect("rendered")).collect()
}

fn fit(targets: &[Image], folder: Option<&Path>, progress: &dyn Progress) -> RecoveredScene {
    let checkpointing = Checkpointing { checkpoint: folder.map(Into::into), resume: true, time_limit: None };
    let options = RecoverSceneOptions { steps: STEPS, rate: 0.08, seed: 3, checkpointing };
    recover_scene(small(), &around(2), targets, &options, progress).expect("fits")
}

/// Step, bits of the loss and of the quality of an evaluation.
type Evaluation = (u64, u64, u64);

/// Values and pictures of what was found, and the evaluations, without times.
fn result(r: &RecoveredScene) -> (Vec<u32>, Vec<u32>, Vec<Evaluation>) {
    let values = (0..r.model.parameters.len()).flat_map(|k| r.model.of(k)).map(|v| v.to_bits()).collect();
    let picture = r.model.picture(&around(2)[1], 4, 5).expect("rendered");
    let evaluations = r.history.iter().map(|h| (h.step, h.loss.to_bits(), h.quality.to_bits())).collect();
    (values, picture.data.iter().map(|v| v.to_bits()).collect(), evaluations)
}

#[test]
fn a_scene_stopped_anywhere_is_recovered_to_the_same_bits() {
    let targets = targets(64);
    let whole = result(&fit(&targets, None, &Silent));
    for stops in [vec![0], vec![1], vec![13], vec![25], vec![26], vec![55], vec![7, 12, 25]] {
        let dir = tempfile::tempdir().expect("a folder");
        for at in &stops {
            let r = fit(&targets, Some(dir.path()), &Stop(AtomicUsize::new(0), *at));
            assert!(r.stopped, "stopped after {at} more steps");
        }
        let end = fit(&targets, Some(dir.path()), &Silent);
        assert_eq!(end.steps, STEPS);
        assert!(result(&end) == whole, "stopped after {stops:?}");
    }
}

#[test]
fn filters_that_narrow_go_on_to_the_same_bits() {
    let start = |smoothing| {
        let mut m = model(smoothing);
        (m.options.spp, m.gradient_spp, m.evaluation_spp) = (1, 1, 2);
        [0.5, 0.5, 3.0].into_iter().enumerate().for_each(|(k, v)| {
            m.replace(k, &vec![v; m.of(k).len()]).expect("valid");
        });
        assert!(m.is_smoothed(1), "the wall has a filter");
        m
    };
    let target = [model(Smoothing::None).picture(&view(), 16, 99).expect("rendered")];
    for smoothing in [Smoothing::Bilateral, Smoothing::Narrowing] {
        let fit = |folder: Option<&Path>, progress: &dyn Progress| {
            let checkpointing =
                Checkpointing { checkpoint: folder.map(Into::into), resume: true, time_limit: None };
            let options = RecoverSceneOptions { steps: STEPS, rate: 0.08, seed: 3, checkpointing };
            let r = recover_scene(start(smoothing), &[view()], &target, &options, progress).expect("fits");
            let values: Vec<u32> = (0..3).flat_map(|k| r.model.of(k)).map(|v| v.to_bits()).collect();
            (r.stopped, values)
        };
        let (_, whole) = fit(None, &Silent);
        // Before, at and after the step that loses the level, half of them.
        for at in [3, 26, 28, 29, 40] {
            let dir = tempfile::tempdir().expect("a folder");
            assert!(fit(Some(dir.path()), &Stop(AtomicUsize::new(0), at)).0, "stopped after {at}");
            assert!(fit(Some(dir.path()), &Silent).1 == whole, "{smoothing:?}, stopped after {at}");
        }
    }
}

#[test]
fn a_checkpoint_of_another_scene_is_refused() {
    let targets = targets(16);
    let dir = tempfile::tempdir().expect("a folder");
    fit(&targets, Some(dir.path()), &Stop(AtomicUsize::new(0), 2));
    let refused = |model: Traced, views: &[View]| {
        let checkpointing =
            Checkpointing { checkpoint: Some(dir.path().into()), resume: true, time_limit: None };
        let options = RecoverSceneOptions { steps: STEPS, rate: 0.08, seed: 3, checkpointing };
        recover_scene(model, views, &targets, &options, &Silent).unwrap_err().to_string()
    };
    // A camera that moved, and a value that is not fitted.
    let mut moved = around(2);
    moved[1].eye.x += 0.1;
    let text = refused(small(), &moved);
    assert!(text.contains("fit.ckpt") && text.contains("another"), "{text}");
    let mut other = small();
    let metallic = Parameter::Material { materials: vec![1], value: MaterialValue::Metallic };
    other.world_mut().set_parameter(&metallic, &[0.2]).expect("valid");
    let text = refused(other, &around(2));
    assert!(text.contains("fit.ckpt") && text.contains("another"), "{text}");
}
