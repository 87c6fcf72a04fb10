//! Pictures that look like those of other cameras.

use crate::FitError;
use crate::engine::traced::Traced;
use photofit_image::Image;
use photofit_pathtrace::View;

/// Width of the pictures that are compared.
const WIDTH: usize = 32;
/// Samples of their pixels.
const SAMPLES: u32 = 16;
/// Most pictures that are compared with each other.
const MOST: usize = 64;
/// By how much the mean correlation of two pictures with their cameras must grow when they change places.
const CLEARLY: f64 = 0.1;

/// Pairs of pictures that fit each other's camera clearly better than their own, by the correlation of their structure with
/// what the scene shows at the start; of more than 64 pictures the first ones.
///
/// # Errors
/// If the scene cannot be rendered.
pub(super) fn swapped(
    model: &Traced,
    views: &[View],
    pictures: &[Image],
) -> Result<Vec<(usize, usize)>, FitError> {
    let n = views.len().min(MOST);
    if n < 2 {
        return Ok(Vec::new());
    }
    let (w, h) = (model.options.width, model.options.height);
    let (tw, th) = (WIDTH.min(w), (WIDTH * h / w).clamp(1, h));
    let shown: Vec<Vec<f64>> = views[..n]
        .iter()
        .map(|v| Ok(structure(&model.sized(v, (tw, th), SAMPLES, 0)?, tw, th)))
        .collect::<Result<_, FitError>>()?;
    let given: Vec<Vec<f64>> = pictures[..n].iter().map(|p| structure(p, tw, th)).collect();
    let like = |picture: usize, view: usize| correlation(&given[picture], &shown[view]);
    let own: Vec<f64> = (0..n).map(|k| like(k, k)).collect();
    let pairs = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j)));
    Ok(pairs.filter(|&(i, j)| like(i, j) + like(j, i) > own[i] + own[j] + 2.0 * CLEARLY).collect())
}

/// Logarithms of the brightness of a picture reduced to `w` x `h`, without their mean.
fn structure(picture: &Image, w: usize, h: usize) -> Vec<f64> {
    let mut sum = vec![0.0; w * h];
    let mut count = vec![0.0; w * h];
    for y in 0..picture.height {
        for x in 0..picture.width {
            let at = y * h / picture.height * w + x * w / picture.width;
            let p = picture.pixel(x, y);
            sum[at] += f64::from(p[0].max(0.0) + p[1].max(0.0) + p[2].max(0.0));
            count[at] += 1.0;
        }
    }
    let mut out: Vec<f64> =
        sum.iter().zip(&count).map(|(s, n)| (s / f64::max(*n, 1.0) + 1e-3).ln()).collect();
    let mean = out.iter().sum::<f64>() / out.len() as f64;
    out.iter_mut().for_each(|v| *v -= mean);
    out
}

/// From -1 to 1; 0 where either is even.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let norm = (dot(a, a) * dot(b, b)).sqrt();
    if norm > 1e-12 { dot(a, b) / norm } else { 0.0 }
}
