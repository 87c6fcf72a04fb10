//! The stages from a noisy picture to a clean one.

use super::accumulate::{Accumulator, TemporalFrame, TemporalSettings};
use super::antialias::{correct_edges, soften};
use super::atrous::{atrous, spatial_variance};
use super::basis::Basis;
use super::black::{classes, regress_black};
use super::camera::Camera;
use super::frame::Frame;
use super::log_domain::variational;
use super::plan::now;
use super::prepare::{LastFrame, Prepared};
use super::regression::regress;
use super::restore::restore;
use super::variational::VariationalModel;
use super::window::blur_mean;
use super::{Plan, RUN, Stage, Stages, remodulate};
use crate::DenoiseError;
use crate::future::at_once;
use rayon::prelude::{
    IndexedParallelIterator, IntoParallelRefMutIterator, ParallelIterator, ParallelSliceMut,
};
use std::borrow::Cow;

#[cfg(feature = "gpu")]
pub(super) use photofit_gpu::Gpu;
/// Without the feature there is no device.
#[cfg(not(feature = "gpu"))]
pub(super) type Gpu = std::convert::Infallible;

/// What the plan says of a stage that the settings leave out, and of one that the other models do not have.
pub(super) const LEFT_OUT: &str = "left out by the settings";
pub(super) const NO_ALBEDO: &str = "no albedo is in use";
pub(super) const NO_SAMPLED: &str = "neither an albedo nor a normal is in use";
pub(super) const PART_OF_AUTO: &str = "part of the automatic model";
/// And of black pixels where there are none.
pub(super) const NO_BLACK: &str = "no pixels without diffuse reflectance, or no others";

/// What removes the noise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Model {
    /// Regression on the features, its widths chosen by estimated error.
    #[default]
    Auto,
    /// A convex model on the logarithm of the irradiance.
    Variational(VariationalModel),
    /// Edge-stopping wavelets guided by the variance, the baseline.
    Atrous,
}

impl Model {
    /// Whether a device has kernels for it: the models with total variation, `rof`, `tvl1` and `hybrid`.
    pub fn has_kernels(self) -> bool {
        match self {
            Self::Variational(model) => model != VariationalModel::Tgv,
            Self::Auto | Self::Atrous => false,
        }
    }
}

/// Choices that have good defaults.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The model.
    pub model: Model,
    /// Clamp rare huge samples.
    pub fireflies: bool,
    /// Scale the result of a convex model to the local mean of the noisy picture, for the mean of logarithms is too
    /// dark: more light, a little more residual noise.
    pub restore_mean: bool,
    /// `c` of [`super::adaptive_weight`]; chosen automatically when not given.
    pub strength: Option<f32>,
    /// Steps of a convex model.
    pub iterations: usize,
    /// Inputs and stages that are left out, to see what they bring.
    pub without: Stages,
    /// When history is kept.
    pub temporal: TemporalSettings,
    /// Whether it is an error if a device cannot do its part of the model, which otherwise runs on the CPU.
    pub device_required: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            model: Model::Auto,
            fireflies: true,
            restore_mean: true,
            strength: None,
            iterations: 20,
            without: Stages::default(),
            temporal: TemporalSettings::default(),
            device_required: false,
        }
    }
}

#[cfg(feature = "gpu")]
impl Settings {
    /// Whether a device has kernels for the model, if it is required.
    fn check_kernels(&self) -> Result<(), DenoiseError> {
        if self.device_required && !self.model.has_kernels() {
            return Err(DenoiseError::NotOnDevice { what: "this model".into() });
        }
        Ok(())
    }
}

/// A clean picture.
#[derive(Clone, Debug)]
pub struct Denoised {
    /// Radiance, 3 planes, not negative; holes are filled.
    pub color: Vec<f32>,
    /// Pixels with NaN or infinity in the input.
    pub holes: usize,
    /// Pixels that were clamped.
    pub fireflies: usize,
    /// `c` of a convex model.
    pub strength: Option<f32>,
    /// What ran, what was skipped, and the times.
    pub plan: Plan,
}

/// Denoises one picture.
///
/// ```
/// use photofit_denoise::mc::{Frame, Settings, denoise};
/// let noisy: Vec<f32> = (0..3 * 32 * 32).map(|i| if i % 7 < 3 { 0.0 } else { 1.0 }).collect();
/// let clean = denoise(&Frame::new(32, 32, &noisy), &Settings::default())?;
/// assert!(clean.color.iter().all(|v| (v - 4.0 / 7.0).abs() < 0.25));
/// # Ok::<(), photofit_denoise::DenoiseError>(())
/// ```
///
/// # Errors
/// If a plane has a wrong length, or a setting is out of range.
pub fn denoise(frame: &Frame<'_>, settings: &Settings) -> Result<Denoised, DenoiseError> {
    at_once(denoise_at(None, frame, settings))
}

/// [`denoise`] with what a device has kernels for on that device: the solver, the exponential and the local means of the models
/// with total variation (`rof`, `tvl1`, `hybrid`), with halves also the trials of the strength. What it has none for, or no room,
/// runs on the CPU, and the line `device` of the plan tells it; with [`Settings::device_required`] it is an error. In a browser,
/// [`fetch_denoised`] does it.
///
/// # Errors
/// As [`denoise`]; [`DenoiseError::NotOnDevice`] and what the device says where it is required.
#[cfg(all(feature = "gpu", not(target_arch = "wasm32")))]
pub fn denoise_on(gpu: &Gpu, frame: &Frame<'_>, settings: &Settings) -> Result<Denoised, DenoiseError> {
    at_once(fetch_denoised(gpu, frame, settings))
}

/// [`denoise_on`] as a future, which blocks the thread for the device outside of browsers only.
///
/// # Errors
/// As [`denoise_on`].
#[cfg(feature = "gpu")]
pub async fn fetch_denoised(
    gpu: &Gpu,
    frame: &Frame<'_>,
    settings: &Settings,
) -> Result<Denoised, DenoiseError> {
    settings.check_kernels()?;
    denoise_at(Some(gpu), frame, settings).await
}

async fn denoise_at(
    gpu: Option<&Gpu>,
    frame: &Frame<'_>,
    settings: &Settings,
) -> Result<Denoised, DenoiseError> {
    let mut plan = Plan::default();
    let prepared = Prepared::of(frame, settings, None, &mut plan)?;
    plan.skip("history", "a single frame");
    filter(gpu, prepared, settings, plan).await
}

/// A sequence of frames of a static scene under a moving camera.
#[derive(Clone, Debug)]
pub struct Sequence {
    settings: Settings,
    accumulator: Option<Accumulator>,
    last: Option<(Prepared<'static>, Plan)>,
    frames: usize,
    reset: usize,
}

impl Sequence {
    /// Without history.
    pub fn new(settings: Settings) -> Self {
        Self { settings, accumulator: None, last: None, frames: 0, reset: 0 }
    }

    /// Adds a frame. Positions are computed from the depth (distance from the camera) if they are not given.
    ///
    /// # Errors
    /// If a plane has a wrong length, the size changes, or there are neither positions nor depths.
    pub fn push(&mut self, frame: &Frame<'_>, camera: Camera) -> Result<(), DenoiseError> {
        let mut plan = Plan::default();
        let key = self.last.as_ref().map(|(p, _)| p.key);
        let prepared = Prepared::of(frame, &self.settings, key, &mut plan)?;
        let shape = prepared.shape;
        if let Some((last, _)) = &self.last
            && last.shape != shape
        {
            return Err(DenoiseError::Length {
                what: "the colour of a later frame",
                found: shape.len(),
                expected: last.shape.len(),
                shape: last.shape,
            });
        }
        let position = match (&prepared.features.position, &prepared.features.depth) {
            (Some(p), _) => Some(p.clone()),
            (None, Some(depth)) => camera.positions(depth, shape.width).map(Cow::Owned),
            (None, None) => None,
        };
        let Some(position) = position else { return Err(DenoiseError::Unplaced) };
        let normal = prepared.features.normal.clone();
        let normal = normal.unwrap_or_else(|| facing(&position, shape.width).into());
        let settings = self.settings.temporal;
        let history =
            self.accumulator.get_or_insert_with(|| Accumulator::new(shape.width, shape.height, settings));
        let reset = plan.stage("history", || {
            let reset = history.add(&TemporalFrame {
                irradiance: &prepared.irradiance,
                weight: &prepared.trust,
                normal: &normal,
                position: &position,
                camera,
            });
            (reset, format!("frame {} of the sequence", self.frames + 1))
        })?;
        drop((position, normal));
        self.last = Some((prepared.into_owned(), plan));
        (self.frames, self.reset) = (self.frames + 1, reset);
        Ok(())
    }

    /// Frames so far.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Denoises the view of the last frame; `None` before the first.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn denoise(&self) -> Option<Result<Denoised, DenoiseError>> {
        at_once(self.denoise_at(None))
    }

    /// [`Self::denoise`] on a device, as [`denoise_on`]. In a browser, [`Self::fetch_denoised`] does it.
    ///
    /// # Errors
    /// If a setting is out of range, and what the device says where it is required.
    #[cfg(all(feature = "gpu", not(target_arch = "wasm32")))]
    pub fn denoise_on(&self, gpu: &Gpu) -> Option<Result<Denoised, DenoiseError>> {
        at_once(self.fetch_denoised(gpu))
    }

    /// [`Self::denoise_on`] as a future, as [`fetch_denoised`].
    ///
    /// # Errors
    /// As [`Self::denoise_on`].
    #[cfg(feature = "gpu")]
    pub async fn fetch_denoised(&self, gpu: &Gpu) -> Option<Result<Denoised, DenoiseError>> {
        if let Err(e) = self.settings.check_kernels() {
            return Some(Err(e));
        }
        self.denoise_at(Some(gpu)).await
    }

    async fn denoise_at(&self, gpu: Option<&Gpu>) -> Option<Result<Denoised, DenoiseError>> {
        let (last, plan) = self.last.as_ref()?;
        let history = self.accumulator.as_ref()?;
        let (mut prepared, mut plan) = (last.copy(), plan.clone());
        let known = history.variance();
        let averaged = known.iter().any(Option::is_some);
        if self.frames > 1 && !averaged {
            plan.skip("mean", "no pixel was seen before: the last frame stands alone");
        }
        if averaged {
            // A history tells more of the noise than two halves, which tell too little of each pixel.
            if prepared.halves.take().is_some() {
                prepared.variance = None;
            }
            let irradiance = std::mem::replace(&mut prepared.irradiance, history.mean());
            let weight = std::mem::replace(&mut prepared.weight, history.effective());
            prepared.last = Some(LastFrame { irradiance, weight, variance: prepared.variance.take() });
            prepared.trust =
                prepared.weight.iter().zip(history.counts()).map(|(w, count)| w.min(count)).collect();
            let mean = prepared.weight.iter().sum::<f32>() / prepared.weight.len() as f32;
            plan.run("mean", format!("{mean:.2} effective samples per pixel, {} pixels new", self.reset));
            let of_last = prepared.last.as_ref().and_then(|last| last.variance.as_deref());
            prepared.variance =
                Some(accumulated_variance(&known, &prepared.weight, prepared.shape.width, of_last));
            let layer = if of_last.is_some() { "; of the last frame from its layer" } else { "" };
            plan.restate("noise", format!("from the history{layer}"));
        }
        Some(filter(gpu, prepared, &self.settings, plan).await)
    }
}

/// Variance of the accumulated means of so many `effective` frames: that which is `known`, as a mean over the pixels around, for few
/// frames tell little of one pixel. Pixels of a single frame have the variance of the last frame where it is given, else that of what is
/// around, else the mean over the picture.
fn accumulated_variance(
    known: &[Option<f32>],
    effective: &[f32],
    width: usize,
    of_last: Option<&[f32]>,
) -> Vec<f32> {
    // Per sample, so that pixels with short histories can borrow it.
    let sample: Vec<f32> = known.iter().zip(effective).map(|(v, n)| v.unwrap_or(0.0) * n).collect();
    let weight: Vec<f32> = known.iter().map(|v| if v.is_some() { 1.0 } else { 0.0 }).collect();
    let blurred = blur_mean(&sample, &weight, width, 2.0);
    let (sum, count) = sample.iter().zip(&weight).fold((0.0, 0.0), |(s, c), (v, w)| (s + v, c + w));
    let anywhere: f32 = if count > 0.0 { sum / count } else { 0.0 };
    let near = blur_mean(&weight, &vec![1.0; weight.len()], width, 2.0);
    let of = |i: usize| match (of_last, effective[i] > 0.0) {
        (_, false) => 0.0,
        (Some(last), true) if known[i].is_none() => last[i],
        _ if near[i] > 1e-6 => blurred[i] / effective[i],
        _ => anywhere / effective[i],
    };
    (0..effective.len()).map(of).collect()
}

/// Normals from differences of positions, for histories without a normal guide.
fn facing(position: &[f32], width: usize) -> Vec<f32> {
    let n = position.len() / 3;
    let height = n / width;
    let at = |i: usize| -> [f32; 3] { std::array::from_fn(|c| position[c * n + i]) };
    let minus = |a: [f32; 3], b: [f32; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let mut out = vec![0.0; 3 * n];
    for i in (0..n).filter(|i| at(*i) != [0.0; 3]) {
        let (x, y) = (i % width, i / width);
        let (x0, y0) = (
            if x + 1 < width { i } else { i - x.min(1) },
            if y + 1 < height { i } else { i - width * y.min(1) },
        );
        let (a, b) = (minus(at((x0 + 1).min(n - 1)), at(x0)), minus(at((y0 + width).min(n - 1)), at(y0)));
        let m = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
        let length = (m[0] * m[0] + m[1] * m[1] + m[2] * m[2]).sqrt();
        if length > 0.0 {
            (0..3).for_each(|c| out[c * n + i] = m[c] / length);
        }
    }
    out
}

/// Runs the model and returns to radiance.
async fn filter(
    gpu: Option<&Gpu>,
    mut prepared: Prepared<'_>,
    settings: &Settings,
    mut plan: Plan,
) -> Result<Denoised, DenoiseError> {
    let has_kernels = settings.model.has_kernels();
    if gpu.is_some() && !has_kernels {
        plan.skip("device", "there are no kernels for this model: it runs on the CPU");
    }
    let mut strength = None;
    let mut estimate = match settings.model {
        Model::Auto => regression(&prepared, settings.without, &mut plan),
        Model::Variational(model) => {
            let gpu = gpu.filter(|_| has_kernels);
            let (u, c) = variational(gpu, model, &mut prepared, settings, &mut plan).await?;
            strength = Some(c);
            u
        }
        Model::Atrous => plan.stage("atrous", || {
            let variance = match &prepared.variance {
                Some(v) => v.clone(),
                None => spatial_variance(prepared.shape, &prepared.irradiance, &prepared.weight),
            };
            let p = &prepared;
            (atrous(p.shape, &p.features, &p.irradiance, &variance, &p.weight), "5 levels of 5 x 5 taps")
        }),
    };
    // Only samples of the pixel itself show how its edge is covered: those of a history were divided by other albedos.
    let (mut noisy, weight, variance) = match prepared.last {
        Some(LastFrame { irradiance, weight, variance }) => (irradiance, weight, variance),
        None => (prepared.irradiance, prepared.weight, prepared.variance),
    };
    if let Some(d) = &prepared.divisor {
        plan.stage("remodulation", || {
            remodulate(&mut estimate, d);
            remodulate(&mut noisy, d);
            ((), "times the same divisor")
        });
    }
    let variance = variance.map(|mut v| {
        if let Some(d) = &prepared.divisor {
            let n = v.len();
            v.par_iter_mut()
                .with_min_len(RUN)
                .enumerate()
                .for_each(|(i, v)| *v *= (d[i].powi(2) + d[n + i].powi(2) + d[2 * n + i].powi(2)) / 3.0);
        }
        v
    });
    let sampled = [&prepared.features.albedo, &prepared.features.normal];
    match settings.model {
        Model::Auto if settings.without.has(Stage::Edges) => plan.skip("edges", LEFT_OUT),
        Model::Auto if sampled.iter().any(|f| f.is_some()) => {
            let began = now();
            let s = correct_edges(prepared.shape, &mut estimate, &noisy, &weight, variance.as_deref());
            let list = |v: &[f32]| v.iter().map(|v| format!("{v:.2}")).collect::<Vec<_>>().join(" ");
            let (blur, own) = (list(&s.blur), list(&s.noisy));
            let percent = 100.0 * s.edges;
            match s.blur.iter().chain(&s.noisy).all(|share| *share == 0.0) {
                true => {
                    plan.skip("edges", format!("{percent:.1}% of the pixels: nothing gained by a correction"))
                }
                false => plan.timed(
                    "edges",
                    format!("{percent:.1}% of the pixels; blur {blur}, own samples {own} by strength"),
                    began,
                ),
            }
        }
        Model::Auto => plan.skip("edges", NO_SAMPLED),
        _ => plan.skip("edges", PART_OF_AUTO),
    }
    if let (Model::Auto, Some(share)) = (settings.model, &prepared.jagged) {
        soften(prepared.shape, &mut estimate, share);
    }
    let scale = 1.0 / prepared.key;
    estimate.par_iter_mut().with_min_len(RUN).for_each(|v| *v = (*v * scale).max(0.0));
    estimate.par_chunks_mut(prepared.shape.pixels()).enumerate().for_each(|(c, plane)| {
        prepared.exact.iter().for_each(|(i, color)| plane[*i] = color[c]);
    });
    let (holes, fireflies) = (prepared.holes, prepared.fireflies);
    Ok(Denoised { color: estimate, holes, fireflies, strength, plan })
}

fn regression(p: &Prepared<'_>, without: Stages, plan: &mut Plan) -> Vec<f32> {
    let basis = plan.stage("regressors", || {
        let basis = Basis::of(&p.features, p.shape);
        let names = basis.names.clone();
        (basis, names)
    });
    let split = (!p.black.is_empty()).then(|| classes(&p.trust, &p.black));
    let mut estimate = plan.stage("regression", || {
        let trust = split.as_ref().map_or(&p.trust, |[others, _]| others);
        let r = regress(p.shape, &basis, &p.irradiance, trust, p.variance.as_deref(), without, true);
        let shares = r.shares.map(|s| format!("{:.0}%", 100.0 * s)).join(" ");
        let mut why =
            format!("bandwidths of 3, 5, 8, 16 pixels in {shares} of {} cells; {} flat", r.cells, r.flat);
        for stage in [Stage::Bandwidth, Stage::Highlights].into_iter().filter(|stage| without.has(*stage)) {
            why += &format!("; {stage} left out");
        }
        (r.estimate, why)
    });
    match &split {
        None if without.has(Stage::ZeroAlbedo) => plan.skip("zero-albedo", LEFT_OUT),
        None if p.features.albedo.is_none() => plan.skip("zero-albedo", NO_ALBEDO),
        None => plan.skip("zero-albedo", NO_BLACK),
        Some([_, own]) => plan.stage("zero-albedo", || {
            regress_black(p, &basis, own, without, &mut estimate);
            ((), format!("{} pixels without diffuse reflectance by themselves", p.black.len()))
        }),
    }
    match without.has(Stage::Detail) {
        true => plan.skip("detail", LEFT_OUT),
        false => plan.stage("detail", || ((), restore(p, split.as_ref(), &mut estimate))),
    }
    estimate
}
