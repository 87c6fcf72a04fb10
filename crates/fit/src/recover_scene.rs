//! Recovering materials, textures and lights of a scene from a picture of it, through the path tracer. Assembled from the
//! parts of the engine; the third task beside [`crate::simplify`] and [`crate::recover`].

use crate::engine::checkpoint::Digest;
use crate::engine::cpu::Cpu;
use crate::engine::reference::{Picture, Reference};
use crate::engine::steering::Steering;
use crate::engine::traced::Traced;
use crate::engine::trainer::{HeldOut, HistoryPoint, Job, Keeping, Phase, train};
use crate::engine::views::{Pose, Sampling, Set, Setup, Sphere, ViewLights, Views};
use crate::{FitError, Progress, bake};
use glam::Vec3;
use photofit_image::Image;
use photofit_raster::loss::Loss;
use photofit_scene::Camera;

/// Options of [`recover_scene`].
#[derive(Clone, Debug)]
pub struct RecoverSceneOptions {
    /// Steps of the fit.
    pub steps: u64,
    /// Peak rate of the optimizer, relative to the mean of the start where values have no upper bound of 1.
    pub rate: f64,
    /// Seed of the order of views; that of pictures and gradients is [`Traced::options`]'.
    pub seed: u64,
    /// Checkpoints and limits.
    pub keeping: Keeping,
}

impl Default for RecoverSceneOptions {
    fn default() -> Self {
        Self { steps: 200, rate: 0.05, seed: 0, keeping: Keeping::default() }
    }
}

/// What was recovered.
#[derive(Debug)]
pub struct RecoveredScene {
    /// The world with the values of the best look.
    pub model: Traced,
    /// The course of the fit.
    pub history: Vec<HistoryPoint>,
    /// Steps made.
    pub steps: u64,
    /// Ended by the user or the time limit.
    pub stopped: bool,
}

/// Pictures of a scene, one per view of the model.
struct Pictures<'a>(&'a [Image]);

impl Reference for Pictures<'_> {
    fn picture(&self, setup: &Setup) -> Result<Picture, FitError> {
        // The model's pictures are noisy: the loss must be one that noise does not bias.
        Ok(Picture { image: self.0[setup.picture.unwrap_or(0)].clone(), noise: 1.0 })
    }

    fn bounds(&self, _: Pose) -> Sphere {
        Sphere::UNIT
    }

    fn surface(&self, _: Pose) -> Option<&bake::Reference<'_>> {
        None
    }
}

impl Views for Pictures<'_> {
    fn setup(&self, _: Set, index: u64, _: u64) -> Setup {
        let at = (index % self.0.len() as u64) as usize;
        Setup {
            // The model knows its cameras by the number of the picture.
            camera: Camera::look_at(Vec3::Z, Vec3::ZERO, Vec3::Y, 1.0, 1.0, 0.1, 10.0),
            lights: ViewLights::default(),
            pose: Pose::default(),
            width: self.0[at].width,
            height: self.0[at].height,
            picture: Some(at),
        }
    }
}

/// Fits the parameters of `model` to the light of `pictures` (linear; their alpha is not looked at), one for each of its
/// views.
///
/// # Errors
/// See [`FitError`]: pictures of another size or number than the model's, values that are not finite.
pub fn recover_scene(
    model: Traced,
    pictures: &[Image],
    options: &RecoverSceneOptions,
    progress: &dyn Progress,
) -> Result<RecoveredScene, FitError> {
    let (w, h) = (model.options.width, model.options.height);
    let wrong = |rule: String| Err(FitError::Setting { field: "pictures", rule });
    if pictures.len() != model.views.len() || pictures.is_empty() {
        return wrong(format!("are {}; they must be {}, one per view", pictures.len(), model.views.len()));
    }
    for p in pictures {
        if (p.width, p.height, p.channels) != (w, h, 4) {
            let found = format!("{} x {} with {} channels", p.width, p.height, p.channels);
            return wrong(format!("are {found}; they must be {w} x {h} with 4"));
        }
        if let Some(i) = p.data.iter().position(|v| !v.is_finite()) {
            let at = (i / 4 % w, i / 4 / w);
            return wrong(format!("have the value {} at pixel {at:?}; it must be finite", p.data[i]));
        }
    }
    // Alpha counts for nothing: a sky that is seen is light like any other, and nothing is put behind it.
    let opaque = |p: &Image| Image::from_fn(w, h, 4, |x, y, c| if c < 3 { p.pixel(x, y)[c] } else { 1.0 });
    let pictures: Vec<Image> = pictures.iter().map(opaque).collect();
    let source = Pictures(&pictures);
    let count = pictures.len() as u64;
    let held_out = HeldOut::new(&source, &source, Sampling::SUPERSAMPLED, count, options.seed)?;
    let (spp, gradient_spp) = (model.options.spp, model.gradient_spp);
    let names: Vec<&str> = model.parameters.iter().map(|p| p.name.as_str()).collect();
    let mut seen = Digest::new();
    pictures.iter().for_each(|p| seen.add(&p.data));
    let (seed, depth) = (model.options.seed, model.options.path.max_depth);
    let steered = Steering::default()
        .option("rate", options.rate)
        .option("spp", spp)
        .option("gradient_spp", gradient_spp)
        .option("smoothing", format!("{:?}", model.smoothing).to_lowercase())
        .option("parameter", names.join(", "))
        .option("seed", seed)
        .option("max_depth", depth)
        .option("look_spp", model.look_spp)
        .digest("picture", format!("{:016x}", seen.value()));
    let job = Job {
        reference: &source,
        views: &source,
        held_out: &held_out,
        sampling: Sampling::SUPERSAMPLED,
        loss: Loss::Mse,
        seed: options.seed,
        batch: pictures.len(),
        fresh: pictures.len().div_ceil(2),
        steps: options.steps,
        keeping: &options.keeping,
        options: steered,
    };
    let rate = |k: usize| (model.parameters[k].name.clone().into(), options.rate * scale(&model, k));
    let rates = (0..model.parameters.len()).map(rate).collect();
    let phase = Phase { name: "parameters", first: 0, steps: options.steps, shrink: 1, rates, renewal: None };
    let trained = train(Cpu::new(model)?, &job, |_| vec![phase], progress)?;
    Ok(RecoveredScene {
        model: trained.model,
        history: trained.history,
        steps: trained.steps,
        stopped: trained.stopped || progress.is_cancelled(),
    })
}

/// What the rate of a parameter is relative to.
fn scale(model: &Traced, parameter: usize) -> f64 {
    if model.parameters[parameter].range[1] <= 1.0 {
        return 1.0;
    }
    let values = model.of(parameter);
    let mean = values.iter().map(|v| f64::from(v.abs())).sum::<f64>() / values.len().max(1) as f64;
    if mean > 0.0 { mean } else { 1.0 }
}

#[cfg(test)]
mod tests;
