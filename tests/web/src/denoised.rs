//! Denoised pictures: on the CPU by the default model, by a convex one on either.

use crate::Twin;
use photofit_denoise::DenoiseError;
use photofit_denoise::mc::synthetic::SyntheticFrame;
use photofit_denoise::mc::{Frame, Model, Settings, VariationalModel, denoise, fetch_denoised};
use photofit_gpu::{Gpu, GpuError};

/// Logarithms after 20 steps, made exponentials, over the largest radiance.
const DENOISED: f64 = 2e-5;

pub(crate) async fn twins(gpu: &Gpu) -> Result<Vec<Twin>, GpuError> {
    let scene = SyntheticFrame::new(48, 32, 0.0);
    let (noisy, other) = (scene.noisy(4, 3), scene.noisy(4, 4));
    let frame = Frame::new(48, 32, &noisy).with_guides(scene.guides());
    let failed = |e: DenoiseError| match e {
        DenoiseError::Device(e) => e,
        e => GpuError::Device(e.to_string()),
    };
    // Every stage asks for the time, which a browser does not tell to a program without its glue.
    let automatic = denoise(&frame, &Settings::default()).map_err(failed)?;
    let timed = automatic.plan.steps.iter().any(|s| s.seconds.is_some());
    if timed == cfg!(target_arch = "wasm32") {
        return Err(GpuError::Device(format!("times of stages: {timed}")));
    }
    let settings = Settings {
        model: Model::Variational(VariationalModel::Hybrid),
        device_required: true,
        ..Settings::default()
    };
    let mut out = Vec::new();
    for (what, frame) in
        [("denoised picture", frame), ("the same of halves", Frame { half: Some(&other), ..frame })]
    {
        let ours = denoise(&frame, &settings).map_err(failed)?;
        let theirs = fetch_denoised(gpu, &frame, &settings).await.map_err(failed)?;
        out.push(Twin::new(what, &ours.color, &theirs.color, DENOISED));
    }
    Ok(out)
}
