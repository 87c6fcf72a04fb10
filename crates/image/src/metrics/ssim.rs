//! Structural similarity (Wang, Bovik, Sheikh and Simoncelli 2004).

use super::{ErrorMap, assert_same_shape, mean, plane};
use crate::Image;
use crate::convolve::{Edge, Plane};
use rayon::prelude::*;

const SIGMA: f64 = 1.5;
const RADIUS: usize = 5;
const C1: f32 = 0.01 * 0.01;
const C2: f32 = 0.03 * 0.03;

/// SSIM of display images with a Gaussian window of sigma 1.5 (11 x 11, mirrored edges), population covariance and
/// data range 1, averaged over the channels.
///
/// The map covers all pixels; `mean` leaves out the 5 pixels at each edge, whose windows reach over it, where the image
/// is larger than that. Both are what scikit-image's `structural_similarity` returns for `gaussian_weights=True,
/// sigma=1.5, use_sample_covariance=False, data_range=1`.
///
/// # Panics
/// If the shapes differ or the images have no channels.
pub fn ssim(reference: &Image, test: &Image) -> ErrorMap {
    assert_same_shape(reference, test);
    let (width, height, channels) = (reference.width, reference.height, reference.channels);
    assert!(channels > 0, "at least one channel");
    let taps = window();
    let mut map = Image::new(width, height, 1);
    for c in 0..channels {
        let similarity = channel_similarity(&plane(reference, c), &plane(test, c), &taps);
        for (m, s) in map.data.iter_mut().zip(similarity) {
            *m += s / channels as f32;
        }
    }
    let inner = if width > 2 * RADIUS && height > 2 * RADIUS {
        &map.crop(RADIUS, RADIUS, width - 2 * RADIUS, height - 2 * RADIUS)
    } else {
        &map
    };
    ErrorMap { mean: mean(inner.data.iter().copied()), map }
}

fn window() -> [f32; 2 * RADIUS + 1] {
    let gauss: [f64; 2 * RADIUS + 1] = std::array::from_fn(|i| {
        let x = (i as f64 - RADIUS as f64) / SIGMA;
        (-0.5 * x * x).exp()
    });
    let sum: f64 = gauss.iter().sum();
    gauss.map(|g| (g / sum) as f32)
}

fn channel_similarity(a: &Plane, b: &Plane, taps: &[f32]) -> Vec<f32> {
    let blur = |p: &Plane| p.separable(taps, taps, Edge::Mirror).data;
    let product = |p: &Plane, q: &Plane| {
        let data = p.data.iter().zip(&q.data).map(|(x, y)| x * y).collect();
        blur(&Plane { width: p.width, height: p.height, data })
    };
    // Variances do not change when the middle of the range moves to 0, and lose less to cancellation.
    let (a, b) = (&centred(a), &centred(b));
    let (ma, mb) = (blur(a), blur(b));
    let (aa, bb, ab) = (product(a, a), product(b, b), product(a, b));
    let similarity = |i: usize| {
        let (ma, mb) = (ma[i], mb[i]);
        let (va, vb, cov) = (aa[i] - ma * ma, bb[i] - mb * mb, ab[i] - ma * mb);
        let (ma, mb) = (ma + 0.5, mb + 0.5);
        ((2.0 * ma * mb + C1) * (2.0 * cov + C2)) / ((ma * ma + mb * mb + C1) * (va + vb + C2))
    };
    (0..ma.len()).into_par_iter().with_min_len(1 << 12).map(similarity).collect()
}

fn centred(p: &Plane) -> Plane {
    Plane { width: p.width, height: p.height, data: p.data.iter().map(|v| v - 0.5).collect() }
}
