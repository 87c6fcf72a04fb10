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
    pub(crate) fn of(features: &Features, shape: Shape) -> Self {
        let n = shape.pixels();
        let mut names = Vec::new();
        let mut planes: Vec<Vec<f32>> = Vec::new();
        let mut add = |name, data: &[f32]| {
            names.push(name);
            planes.extend(data.chunks(n).map(<[f32]>::to_vec));
        };
        if let Some(normal) = &features.normal {
            add("normal", normal);
        }
        match (&features.position, &features.depth) {
            (Some(position), _) => add("position", position),
            (None, depth) => {
                let axis = |f: &dyn Fn(usize) -> usize| (0..n).map(|i| f(i) as f32).collect::<Vec<_>>();
                add("pixel", &[axis(&|i| i % shape.cols), axis(&|i| i / shape.cols)].concat());
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
fn standardised(mut plane: Vec<f32>) -> Option<Vec<f32>> {
    let n = plane.len() as f64;
    let mean = plane.iter().map(|v| f64::from(*v)).sum::<f64>() / n;
    let square = plane.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / n;
    let deviation = square.sqrt();
    if deviation.is_nan() || deviation <= 1e-7 * mean.abs() || deviation == 0.0 {
        return None;
    }
    for v in &mut plane {
        *v = ((f64::from(*v) - mean) / deviation) as f32;
    }
    Some(plane)
}
