//! Tests across stages, on the synthetic scene.
mod automatic;
mod exact;
mod lamps;
mod plans;
mod relations;
mod stress;
mod temporal;
mod variational;

use super::synthetic::SyntheticFrame;
use super::{Denoised, Frame, Model, Settings, VariationalModel, denoise};

const MODELS: [Model; 6] = [
    Model::Auto,
    Model::Variational(VariationalModel::Rof),
    Model::Variational(VariationalModel::TvL1),
    Model::Variational(VariationalModel::Hybrid),
    Model::Variational(VariationalModel::Tgv),
    Model::Atrous,
];

/// Root mean square of the difference after the display curve `min(x,1)^(1/2.2)`.
fn display_rmse(a: &[f32], b: &[f32]) -> f64 {
    let shown = |v: f32| f64::from(v.clamp(0.0, 1.0)).powf(1.0 / 2.2);
    let sum: f64 = a.iter().zip(b).map(|(a, b)| (shown(*a) - shown(*b)).powi(2)).sum();
    (sum / a.len() as f64).sqrt()
}

fn with(model: Model) -> Settings {
    Settings { model, ..Settings::default() }
}

fn run(scene: &SyntheticFrame, noisy: &[f32], guided: bool, model: Model) -> Denoised {
    let mut frame = Frame::new(scene.shape.width, scene.shape.height, noisy);
    if guided {
        frame = frame.with_guides(scene.guides());
    }
    denoise(&frame, &with(model)).expect("a sound frame")
}
