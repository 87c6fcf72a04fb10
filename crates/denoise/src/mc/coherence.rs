//! Where the guides are smooth: the coherence map that lets edges of normal, albedo, depth and position pass.

use super::frame::Features;
use crate::Shape;
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};

/// `s_A` of the auxiliary weight.
pub const SHARPNESS: f32 = 2.0;

/// Curvature of a guide of any number of planes, between 0 and 1 per pixel: `C = |H guide|` (Frobenius norm over all
/// planes, second differences that reach outside the picture left out), divided by its 99.5th percentile and cut at 1.
/// All 0 for guides without curvature.
///
/// # Panics
/// If `guide` is not a whole number of planes.
pub fn curvature(guide: &[f32], width: usize, height: usize) -> Vec<f32> {
    let n = height * width;
    assert!(n > 0 && guide.len().is_multiple_of(n), "whole planes of {width} x {height}");
    let mut out = vec![0.0; n];
    out.par_chunks_mut(width).enumerate().with_min_len(8).for_each(|(i, out)| {
        for u in guide.chunks(n) {
            let at = |i: usize| &u[i * width..][..width];
            let own = at(i);
            for j in 1..width.saturating_sub(1) {
                out[j] += (own[j + 1] - 2.0 * own[j] + own[j - 1]).powi(2);
            }
            if i + 1 < height {
                let below = at(i + 1);
                for j in 0..width - 1 {
                    out[j] += 2.0 * (below[j + 1] - below[j] - own[j + 1] + own[j]).powi(2);
                }
                if i > 0 {
                    let above = at(i - 1);
                    for j in 0..width {
                        out[j] += (below[j] - 2.0 * own[j] + above[j]).powi(2);
                    }
                }
            }
        }
        out.iter_mut().for_each(|c| *c = c.sqrt());
    });
    let scale = percentile(&out, 0.995);
    out.iter_mut().for_each(|c| *c = if scale > 0.0 { (*c / scale).min(1.0) } else { 0.0 });
    out
}

/// The value below which a share `q` of the values lies.
pub(crate) fn percentile(values: &[f32], q: f64) -> f32 {
    let mut sorted = values.to_vec();
    let k = ((sorted.len() - 1) as f64 * q).round() as usize;
    *sorted.select_nth_unstable_by(k, f32::total_cmp).1
}

/// `W_aux = exp(-s_A max C)` over the guides, one value per pixel; 1 everywhere without guides.
pub(crate) fn auxiliary_weight(features: &Features<'_>, shape: Shape, sharpness: f32) -> Vec<f32> {
    let mut most = vec![0.0_f32; shape.pixels()];
    for guide in
        [&features.normal, &features.albedo, &features.depth, &features.position].into_iter().flatten()
    {
        for (m, c) in most.iter_mut().zip(curvature(guide, shape.width, shape.height)) {
            *m = m.max(c);
        }
    }
    most.iter_mut().for_each(|c| *c = (-sharpness * *c).exp());
    most
}

/// The weight of the first published version, kept for comparison: `W = max(W_aux, 1 - exp(-s_E sigma))`, strong
/// where the guides are smooth or the noise is high.
///
/// # Panics
/// If the lengths differ.
pub fn blended_weight(auxiliary: &[f32], sigma: &[f32], sharpness: f32) -> Vec<f32> {
    assert_eq!(auxiliary.len(), sigma.len(), "one value per pixel");
    auxiliary.iter().zip(sigma).map(|(w, s)| w.max(1.0 - (-sharpness * s).exp())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_have_no_curvature_and_edges_have_all_of_it() {
        let (width, height) = (31, 24);
        let ramp: Vec<f32> = (0..height * width).map(|i| (i % width + 2 * (i / width)) as f32).collect();
        assert!(curvature(&ramp, width, height).iter().all(|c| *c == 0.0), "natural boundaries");
        let step: Vec<f32> = (0..height * width).map(|i| if i % width < 15 { 0.0 } else { 1.0 }).collect();
        let c = curvature(&step, width, height);
        for (i, c) in c.iter().enumerate() {
            let near = [14, 15].contains(&(i % width));
            assert_eq!(*c > 0.5, near, "pixel {i}: {c}");
        }
        assert_eq!(curvature(&[1.0], 1, 1), [0.0]);
        assert_eq!(curvature(&[1.0, 5.0], 2, 1), [0.0; 2]);
    }
}
