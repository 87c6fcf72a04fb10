//! The regressors of a picture: its features, each with mean 0 and deviation 1.

use super::frame::Features;
use crate::Shape;
use rayon::prelude::{IntoParallelIterator, ParallelIterator};

/// Most regressors beside the constant.
pub(crate) const MAX_REGRESSORS: usize = 6;

/// Standardised regressors, one plane each; the constant is implied.
#[derive(Clone, Debug)]
pub(crate) struct Basis {
    pub(crate) planes: Vec<Vec<f32>>,
    pub(crate) names: String,
}

impl Basis {
    /// Normal and position where they are given; without a position the pixel coordinates, and the depth if there is
    /// one. Constant regressors are dropped.
    pub(crate) fn of(features: &Features<'_>, shape: Shape) -> Self {
        let n = shape.pixels();
        let mut names = Vec::new();
        let mut planes: Vec<&[f32]> = Vec::new();
        let axes: Vec<f32>;
        let mut add = |name, data| {
            names.push(name);
            planes.extend(<[f32]>::chunks(data, n));
        };
        if let Some(normal) = &features.normal {
            add("normal", normal);
        }
        match (&features.position, &features.depth) {
            (Some(position), _) => add("position", position),
            (None, depth) => {
                let axis = |f: &dyn Fn(usize) -> usize| (0..n).map(|i| f(i) as f32).collect::<Vec<_>>();
                axes = [axis(&|i| i % shape.width), axis(&|i| i / shape.width)].concat();
                add("pixel", &axes);
                if let Some(depth) = depth {
                    add("depth", depth);
                }
            }
        }
        let planes: Vec<Vec<f32>> = planes.into_par_iter().filter_map(standardised).collect();
        Self { planes, names: names.join(", ") }
    }
}

/// The plane with mean 0 and deviation 1; `None` if it is constant.
fn standardised(plane: &[f32]) -> Option<Vec<f32>> {
    let n = plane.len() as f64;
    // Sums of short runs in single precision, with the first value taken off, so that no offset costs digits.
    let origin = plane.first().copied()?;
    let sum = |f: &dyn Fn(&[f32]) -> f32| plane.chunks(RUN).map(|run| f64::from(f(run))).sum::<f64>();
    let shift = (sum(&|run| lanes(run, |v| v - origin)) / n) as f32;
    let mean = origin + shift;
    let deviation = (sum(&|run| lanes(run, |v| (v - mean) * (v - mean))) / n).sqrt() as f32;
    if deviation.is_nan() || deviation <= 1e-6 * mean.abs() || deviation == 0.0 {
        return None;
    }
    let scale = 1.0 / deviation;
    Some(plane.iter().map(|v| (v - mean) * scale).collect())
}

/// Values that are summed in single precision.
const RUN: usize = 512;

/// Sum of `f` in eight lanes.
#[inline]
fn lanes(run: &[f32], f: impl Fn(f32) -> f32) -> f32 {
    let mut sum = [0.0_f32; 8];
    let chunks = run.chunks_exact(8);
    let rest = chunks.remainder().iter().map(|v| f(*v)).sum::<f32>();
    for chunk in chunks {
        for (s, v) in sum.iter_mut().zip(chunk) {
            *s += f(*v);
        }
    }
    sum.iter().sum::<f32>() + rest
}
