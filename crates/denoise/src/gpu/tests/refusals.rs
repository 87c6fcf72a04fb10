//! What a device cannot do or refuses: the CPU does it, or it is an error; and what the plan tells of it.

use super::{bits, own_device};
use crate::DenoiseError;
use crate::mc::synthetic::SyntheticFrame;
use crate::mc::{Frame, Model, Settings, VariationalModel, denoise, denoise_on};
use photofit_gpu::{Caps, Gpu, GpuError, test_device};

const HYBRID: Model = Model::Variational(VariationalModel::Hybrid);

/// A device of which no more than some bytes are used.
fn within(binding: u64, memory: u64) -> Gpu {
    Gpu::within(&super::choice(), Caps { binding, memory, ..Caps::NONE }).expect("a device")
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn what_a_device_cannot_do_runs_on_the_cpu_and_is_told_unless_it_is_required() {
    let scene = SyntheticFrame::new(64, 48, 0.0);
    let noisy = scene.noisy(4, 3);
    let frame = Frame::new(64, 48, &noisy).with_guides(scene.guides());
    let small = within(1 << 14, u64::MAX);
    let lost = own_device();
    lost.destroy();
    let tgv = Model::Variational(VariationalModel::Tgv);
    for (gpu, model, told) in [
        (&small, HYBRID, "bytes"),
        (&lost, HYBRID, "lost"),
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
        let required = Settings { device_required: true, ..settings };
        let refused = denoise_on(gpu, &frame, &required).expect_err("it is required");
        assert!(refused.to_string().contains(told), "{refused}");
        let kind = matches!(refused, DenoiseError::NotOnDevice { .. } | DenoiseError::Device(_));
        assert!(kind && model.has_kernels() != told.contains("kernels"), "{refused:?}");
        assert!(denoise(&frame, &required).is_ok(), "without a device it asks for none");
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_device_that_refuses_is_asked_once() {
    let scene = SyntheticFrame::new(64, 48, 0.0);
    let (noisy, other) = (scene.noisy(4, 3), scene.noisy(4, 4));
    let frame = Frame { half: Some(&other), ..Frame::new(64, 48, &noisy).with_guides(scene.guides()) };
    let settings = Settings { model: HYBRID, ..Settings::default() };
    let ours = denoise(&frame, &settings).expect("a sound frame");
    let planes = 4 * scene.shape.len() as u64;
    // Room for the halves, not for the solver.
    let small = within(u64::MAX, 3 * planes);
    let before = small.traffic();
    let theirs = denoise_on(&small, &frame, &settings).expect("a sound frame");
    let line = theirs.plan.step("device").expect("a line");
    assert!(!line.runs && line.why.contains("out of device memory"), "{}", line.why);
    assert!(!line.why.contains("strength"), "{}", line.why);
    assert_eq!((ours.strength, bits(&ours.color)), (theirs.strength, bits(&theirs.color)), "as the CPU");
    let (after, held) = (small.traffic(), small.held());
    assert!(after.uploaded - before.uploaded <= 3 * planes && after.submissions == before.submissions);
    assert_eq!(held, 0, "nothing is left on the device");
    let required = Settings { device_required: true, ..settings };
    match denoise_on(&small, &frame, &required) {
        Err(DenoiseError::Device(GpuError::OutOfMemory { .. })) => {}
        other => panic!("it is required: {other:?}"),
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_strength_that_a_device_chose_before_it_refused_is_told() {
    let scene = SyntheticFrame::new(24, 16, 0.0);
    let (noisy, other) = (scene.noisy(4, 3), scene.noisy(4, 4));
    let frame = Frame { half: Some(&other), ..Frame::new(24, 16, &noisy) };
    let settings = Settings { model: HYBRID, iterations: 2, ..Settings::default() };
    let ours = denoise(&frame, &settings).expect("a sound frame");
    // The model takes more than the trials: between them is memory for the trials alone.
    let (mut least, mut most) = (0_u64, 1 << 20);
    let told = loop {
        assert!(most - least > 64, "no memory for the trials alone");
        let memory = least.midpoint(most);
        let theirs = denoise_on(&within(u64::MAX, memory), &frame, &settings).expect("a sound frame");
        let line = theirs.plan.step("device").expect("a line").clone();
        assert_eq!(ours.strength, theirs.strength, "{}", line.why);
        assert!(line.runs || bits(&ours.color) == bits(&theirs.color), "{}", line.why);
        match (line.runs, line.why.contains("it chose the strength")) {
            (true, _) => most = memory,
            (false, false) => least = memory,
            (false, true) => break line.why,
        }
    };
    assert!(told.contains("out of device memory") && told.contains("runs on the CPU"), "{told}");
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn the_plan_tells_what_a_device_did() {
    let scene = SyntheticFrame::new(64, 48, 0.0);
    let (noisy, other) = (scene.noisy(4, 3), scene.noisy(4, 4));
    let frame = Frame { half: Some(&other), ..Frame::new(64, 48, &noisy).with_guides(scene.guides()) };
    let samples = scene.shape.len() as u64;
    // By itself: the traffic is counted.
    let gpu = own_device();
    for (strength, submissions, readbacks, scores, told) in [
        (Some(4.0), 1, 1, 0, "one submission, one readback"),
        (
            None,
            11,
            2,
            10 * samples.div_ceil(64),
            "10 trials of the strength and the model in one solver: 11 submissions, 2 readbacks",
        ),
    ] {
        let settings = Settings { model: HYBRID, strength, ..Settings::default() };
        let before = gpu.traffic();
        let theirs = denoise_on(&gpu, &frame, &settings).expect("a sound frame");
        let after = gpu.traffic();
        let line = theirs.plan.step("device").expect("a line");
        assert!(line.runs && line.why.ends_with(told), "{}", line.why);
        // A readback is a submission, too.
        assert_eq!(after.submissions - before.submissions, submissions + readbacks, "{told}");
        assert_eq!(after.read - before.read, 4 * (samples + scores), "{told}");
        assert_eq!(gpu.held(), 0, "{told}");
    }
}
