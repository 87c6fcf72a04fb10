//! From a rendered picture to what the models filter: holes, irradiance, exposure, fireflies, noise.

use super::black::{black_pixels, classes};
use super::exact::{ExactPixel, exact_pixels};
use super::feature_filter::{share_of_noise, share_of_variance, smooth_features};
use super::firefly::{OTHERS, REGRESSION, tame_fireflies};
use super::frame::{Features, Frame};
use super::noise::half_variance;
use super::pipeline::{LEFT_OUT, NO_ALBEDO, NO_BLACK, NO_SAMPLED, PART_OF_AUTO};
use super::pooled::Pooled;
use super::{Model, Plan, RUN, Settings, Stage, demodulate, divisor};
use crate::{DenoiseError, Shape};
use rayon::prelude::{
    IndexedParallelIterator, IntoParallelIterator, IntoParallelRefIterator, IntoParallelRefMutIterator,
    ParallelIterator, ParallelSliceMut,
};

/// Mean irradiance that every picture is scaled to: logarithms and thresholds then mean the same for all.
const EXPOSURE: f32 = 0.35;

/// A picture ready to be filtered.
#[derive(Clone, Debug)]
pub(crate) struct Prepared<'a> {
    pub(crate) shape: Shape,
    pub(crate) features: Features<'a>,
    /// Divisor of each sample, if there is an albedo.
    pub(crate) divisor: Option<Vec<f32>>,
    /// The share of noise in the features, where a pixel has one sample.
    pub(crate) jagged: Option<Pooled<1>>,
    /// Factor from radiance to the units of `irradiance`.
    pub(crate) key: f32,
    /// 3 planes; 0 at holes.
    pub(crate) irradiance: Vec<f32>,
    /// The last frame alone, if `irradiance` has a history.
    pub(crate) last: Option<LastFrame>,
    /// The two halves, if they are given.
    pub(crate) halves: Option<[Vec<f32>; 2]>,
    /// Variance of the irradiance, mean over the channels, if it is known.
    pub(crate) variance: Option<Vec<f32>>,
    /// Relative number of samples of each pixel; 0 at holes.
    pub(crate) weight: Vec<f32>,
    /// The weight of the regression; with a history at most the number of its frames.
    pub(crate) trust: Vec<f32>,
    /// Pixels with weight whose albedo is at the floor, where there are others too.
    pub(crate) black: Vec<usize>,
    /// Pixels without noise, in radiance; their weight is 0.
    pub(crate) exact: Vec<ExactPixel>,
    pub(crate) holes: usize,
    pub(crate) fireflies: usize,
}

/// Why the noise is not told by a layer that was given.
const VARIANCE_LEFT_OUT: &str = "the variance layer is left out by the settings";

/// What the last frame of a sequence holds without its history: samples of its own pixels, which hang together with no others.
#[derive(Clone, Debug)]
pub(crate) struct LastFrame {
    /// 3 planes; 0 at holes.
    pub(crate) irradiance: Vec<f32>,
    /// 0 at holes.
    pub(crate) weight: Vec<f32>,
    /// Of the irradiance, mean over the channels, if a variance layer tells it.
    pub(crate) variance: Option<Vec<f32>>,
}

impl<'a> Prepared<'a> {
    /// With `key` of an earlier frame of the same sequence, if there is one.
    pub(crate) fn of(
        frame: &Frame<'a>,
        settings: &Settings,
        key: Option<f32>,
        plan: &mut Plan,
    ) -> Result<Self, DenoiseError> {
        frame.check()?;
        let without = settings.without;
        let shape = frame.shape;
        let mut features = Features::of(&frame.guides, without, shape.pixels(), plan);
        let variance = frame.variance.filter(|_| !without.has(Stage::Variance));
        let no_layer = match (frame.variance, variance) {
            (Some(_), None) => VARIANCE_LEFT_OUT,
            _ => "no variance layer",
        };
        let frame = &Frame { variance, ..*frame };
        let (mut sides, mut weight, holes) = plan.stage("holes", || {
            let (sides, weight, holes) = holes(frame);
            let why = format!("{holes} pixels with NaN or infinity");
            ((sides, weight, holes), why)
        });
        let exact = match without.has(Stage::Noiseless) {
            true => {
                plan.skip("noiseless", LEFT_OUT);
                Vec::new()
            }
            false => exact(frame, &features, &mut weight, plan),
        };
        let jagged = smoothed(frame, &mut features, (settings, no_layer), plan);
        let demodulated = features.albedo.as_ref().filter(|_| !without.has(Stage::Demodulation));
        let divisor = match demodulated {
            Some(albedo) => Some(plan.stage("demodulation", || {
                let d = divisor(albedo);
                sides.iter_mut().for_each(|side| demodulate(side, &d));
                (d, "colour / max(albedo, 0.01)")
            })),
            None => {
                let why = if features.albedo.is_some() { LEFT_OUT } else { NO_ALBEDO };
                plan.skip("demodulation", why);
                None
            }
        };
        let apart = features.albedo.as_ref().filter(|_| !without.has(Stage::ZeroAlbedo));
        let black = apart.map_or(Vec::new(), |a| black_pixels(a, &weight));
        // The automatic model has a stage of its own for them.
        match (settings.model, without.has(Stage::ZeroAlbedo), black.len()) {
            (Model::Auto, ..) => {}
            (_, true, _) => plan.skip("zero-albedo", LEFT_OUT),
            (_, _, 0) if features.albedo.is_none() => plan.skip("zero-albedo", NO_ALBEDO),
            (_, _, 0) => plan.skip("zero-albedo", NO_BLACK),
            (_, _, n) => {
                plan.run(
                    "zero-albedo",
                    format!("{n} pixels without diffuse reflectance: means by themselves"),
                );
            }
        }
        let own_class = if black.is_empty() { Vec::new() } else { classes(&weight, &black).into() };
        // All pixels where there is only one class.
        let others = own_class.first().unwrap_or(&weight);
        let key = plan.stage("exposure", || {
            let key = key.unwrap_or_else(|| key_of(&sides[0], others));
            for side in &mut sides {
                side.par_iter_mut().with_min_len(RUN).for_each(|v| *v = (*v * key).max(0.0));
            }
            (key, format!("what is filtered times {key:.4e}"))
        });
        let layer = frame.variance.filter(|v| frame.half.is_none() && v.iter().any(|v| *v > 0.0));
        let layer = layer.map(|v| scaled(v, divisor.as_deref(), key));
        let over = if settings.model == Model::Auto { REGRESSION } else { OTHERS };
        let fireflies = match settings.fireflies {
            true => plan.stage("fireflies", || {
                let (mut spread, mut cut) = (0, 0);
                let variance = layer.as_deref().filter(|_| settings.model == Model::Auto);
                for w in std::iter::once(others).chain(own_class.get(1)) {
                    for side in &mut sides {
                        let found = tame_fireflies(side, w, variance, shape.width, over);
                        (spread, cut) = (spread + found.spread, cut + found.cut);
                    }
                }
                let why = format!(
                    "{spread} pixels of one sample spread, {cut} cut at {over} times the mean around"
                );
                (spread + cut, why)
            }),
            false => {
                plan.skip("fireflies", "switched off");
                0
            }
        };
        let variance = plan.stage("noise", || match (&sides[..], frame.variance) {
            ([a, b], _) if a == b => (None, "the halves are equal: not known".to_owned()),
            ([a, b], _) => (Some(half_variance(a, b)), "from the two halves".to_owned()),
            (_, Some(_)) if layer.is_some() => (layer, "from the variance layer".to_owned()),
            (_, Some(_)) => (None, "the variance layer is all 0: not known".to_owned()),
            _ => (None, format!("not known: no halves; {no_layer}")),
        });
        let (irradiance, halves) = match (sides.pop(), sides.pop()) {
            (Some(b), Some(a)) => {
                let mean = a.iter().zip(&b).map(|(a, b)| 0.5 * (a + b)).collect();
                (mean, Some([a, b]))
            }
            (last, _) => (last.unwrap_or_default(), None),
        };
        Ok(Self {
            trust: weight.clone(),
            last: None,
            shape,
            features,
            divisor,
            jagged,
            key,
            irradiance,
            halves,
            variance,
            weight,
            black,
            exact,
            holes,
            fireflies,
        })
    }

    /// With own copies of the features.
    pub(crate) fn into_owned(self) -> Prepared<'static> {
        Prepared { features: self.features.into_owned(), ..self }
    }

    /// A copy of all but the features.
    pub(crate) fn copy(&self) -> Prepared<'_> {
        let shell = Self { features: Features::default(), ..self.clone() };
        Prepared { features: self.features.borrowed(), ..shell }
    }

    /// Mean over the channels.
    pub(crate) fn level(&self) -> Vec<f32> {
        let n = self.shape.pixels();
        let u = &self.irradiance;
        (0..n).map(|i| (u[i] + u[n + i] + u[2 * n + i]) * (1.0 / 3.0)).collect()
    }
}

/// Whether the noise of a frame is known.
fn is_known(frame: &Frame<'_>) -> bool {
    match (frame.half, frame.variance) {
        (Some(half), _) => half != frame.color,
        (None, Some(v)) => v.iter().any(|v| *v > 0.0),
        (None, None) => false,
    }
}

/// Smooths the noise out of the features where a variance layer tells it from textures; where a layer of zeros says that a pixel has
/// one sample, returns the share of noise per pixel.
fn smoothed(
    frame: &Frame<'_>,
    features: &mut Features<'_>,
    (settings, no_layer): (&Settings, &str),
    plan: &mut Plan,
) -> Option<Pooled<1>> {
    let shape = frame.shape;
    let layer = frame.variance.filter(|_| frame.half.is_none());
    let skipped = match settings {
        Settings { model: Model::Variational(_) | Model::Atrous, .. } => Some(PART_OF_AUTO),
        _ if settings.without.has(Stage::Antialiasing) => Some(LEFT_OUT),
        // Halves tell the noise of the colour alone.
        _ if frame.half.is_some() => {
            Some("halves in place of a variance layer, which would tell noise from textures")
        }
        _ if layer.is_none() => Some(no_layer),
        _ if features.albedo.is_none() && features.normal.is_none() => Some(NO_SAMPLED),
        _ => None,
    };
    let (None, Some(layer)) = (skipped, layer) else {
        plan.skip("antialiasing", skipped.unwrap_or_default());
        return None;
    };
    plan.stage("antialiasing", || {
        let Some(mut jagged) = share_of_noise(features, shape) else {
            return (None, "no noise in the features".to_owned());
        };
        if is_known(frame) {
            let noise = share_of_variance(frame.color, layer, shape.width);
            jagged.sums.iter_mut().zip(noise.sums).for_each(|(s, n)| *s *= n);
            let share = 100.0 * smooth_features(features, shape, &jagged);
            return (None, format!("noise of the features, {share:.1}% of the picture"));
        }
        let share = jagged.sums.iter().sum::<f32>() / jagged.blocks() as f32;
        (Some(jagged), format!("edges of the features, {:.1}% of the picture", 100.0 * share))
    })
}

/// Finds the pixels without noise and takes their weight, so that they do not reach their neighbours.
fn exact(frame: &Frame<'_>, features: &Features<'_>, weight: &mut [f32], plan: &mut Plan) -> Vec<ExactPixel> {
    if !is_known(frame) {
        plan.skip("noiseless", "the noise is not known");
        return Vec::new();
    }
    plan.stage("noiseless", || {
        let exact = exact_pixels(frame, features, weight);
        exact.iter().for_each(|(i, _)| weight[*i] = 0.0);
        let why = format!("{} pixels without noise stay as they are", exact.len());
        (exact, why)
    })
}

/// The one or two halves with zeros at pixels where any of them is not finite.
fn holes(frame: &Frame<'_>) -> (Vec<Vec<f32>>, Vec<f32>, usize) {
    let n = frame.shape.pixels();
    let copy = |planes: &[f32]| planes.par_iter().with_min_len(RUN).copied().collect();
    let mut sides: Vec<Vec<f32>> = std::iter::once(frame.color).chain(frame.half).map(copy).collect();
    // Larger values would overflow when they are squared.
    let sound = |v: f32| v.abs() < 1e15;
    let known = |i: usize| frame.variance.is_none_or(|v| (0..3).all(|c| v[c * n + i].is_finite()));
    let mut weight = vec![1.0_f32; n];
    let count = weight.par_chunks_mut(RUN).enumerate().map(|(k, run)| {
        let from = k * RUN;
        for plane in sides.iter().flat_map(|side| side.chunks(n)) {
            for (w, v) in run.iter_mut().zip(&plane[from..]) {
                *w = if sound(*v) { *w } else { 0.0 };
            }
        }
        if frame.variance.is_some() {
            run.iter_mut().enumerate().filter(|(i, _)| !known(from + i)).for_each(|(_, w)| *w = 0.0);
        }
        run.iter().filter(|w| **w == 0.0).count()
    });
    let count = count.sum::<usize>();
    if count > 0 {
        for i in (0..n).filter(|i| weight[*i] == 0.0) {
            sides.iter_mut().for_each(|s| (0..3).for_each(|c| s[c * n + i] = 0.0));
        }
    }
    (sides, weight, count)
}

/// Factor to the common exposure: the mean without the brightest hundredth, from at most 2^16 pixels. 1 for black.
fn key_of(irradiance: &[f32], weight: &[f32]) -> f32 {
    let n = weight.len();
    let step = n.div_ceil(1 << 16).max(1);
    // A step that shares no factor with usual widths visits all columns.
    let step = if step > 1 { step | 1 } else { 1 };
    let mut levels: Vec<f32> = (0..n)
        .step_by(step)
        .filter(|i| weight[*i] > 0.0)
        .map(|i| (irradiance[i] + irradiance[n + i] + irradiance[2 * n + i]) * (1.0 / 3.0))
        .collect();
    levels.sort_unstable_by(f32::total_cmp);
    let kept = levels.len() - levels.len() / 100;
    let mean = levels[..kept].iter().map(|v| f64::from(*v)).sum::<f64>() / kept.max(1) as f64;
    let key = (f64::from(EXPOSURE) / mean) as f32;
    if key.is_finite() && key > 0.0 { key } else { 1.0 }
}

/// A variance layer in the units of the irradiance, mean over the channels.
fn scaled(variance: &[f32], divisor: Option<&[f32]>, key: f32) -> Vec<f32> {
    let n = variance.len() / 3;
    let of = |i: usize| {
        let v = if variance[i].is_finite() { variance[i].max(0.0) } else { 0.0 };
        v * (key / divisor.map_or(1.0, |d| d[i])).powi(2)
    };
    let mean = |i: usize| (of(i) + of(n + i) + of(2 * n + i)) * (1.0 / 3.0);
    (0..n).into_par_iter().with_min_len(RUN).map(mean).collect()
}
