//! Masks that keep their coverage: alpha is scaled so that as large a share of the texels passes the cutoff as the asset
//! covers (Castaño 2010). Without it, parts that are thinner than a texel vanish.

use crate::candidate::Candidate;
use photofit_geometry::atlas::mesh_coverage;
use photofit_raster::{Maps, channel};
use photofit_scene::AlphaMode;

/// Most that alpha is scaled by: what covers less than this part of the cutoff in a texel is no outline.
const MOST: f32 = 8.0;

/// Scales the alpha of the masked texels of freshly baked maps, class by class. Only texels that were baked (`valid`) or
/// found cut out (`cut`) count.
pub(super) fn keep(candidate: &Candidate, valid: &[bool], cut: &[bool], maps: &mut Maps) {
    for (class, material) in candidate.classes.iter().enumerate() {
        let AlphaMode::Mask { cutoff } = material.alpha else { continue };
        let triangles = candidate.triangles.iter().zip(&candidate.class);
        let triangles: Vec<[u32; 3]> =
            triangles.filter(|(_, c)| **c as usize == class).map(|(t, _)| *t).collect();
        if triangles.is_empty() {
            continue;
        }
        let drawn = mesh_coverage(&candidate.uvs, &triangles, maps.width, maps.height, true).mask();
        let known = |i: &usize| drawn[*i] && (valid[*i] || cut[*i]);
        let alphas: Vec<f32> =
            (0..drawn.len()).filter(known).map(|i| maps.texels[i][channel::ALPHA]).collect();
        let scale = scale_for(alphas, cutoff);
        let texels = maps.texels.iter_mut().zip(&drawn).filter(|(_, drawn)| **drawn);
        texels.for_each(|(t, _)| t[channel::ALPHA] = (t[channel::ALPHA] * scale).min(1.0));
    }
}

/// The factor by which as large a share of `alphas` reaches `cutoff` as their mean, as closely as their values in 8 bits
/// allow: where all are nearly alike, all or none pass, whichever is nearer.
fn scale_for(alphas: Vec<f32>, cutoff: f32) -> f32 {
    let mean = alphas.iter().map(|a| f64::from(*a)).sum::<f64>();
    let wanted = mean.round() as usize;
    let passing = |a: f32| alphas.iter().filter(|x| **x >= a).count();
    if wanted == 0 || wanted >= alphas.len() || cutoff <= 0.0 {
        return 1.0;
    }
    // Half a step of 8 bits off any value, so that rounding changes nothing.
    let thresholds = (0..255).map(|k| (k as f32 + 0.5) / 255.0).filter(|t| *t * MOST >= cutoff);
    let off = |a: f32| passing(a).abs_diff(wanted);
    let best = thresholds.min_by_key(|t| off(*t)).filter(|t| off(*t) < off(cutoff));
    best.map_or(1.0, |t| cutoff / t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::Rng;

    fn covered(alphas: &[f32], scale: f32, cutoff: f32) -> usize {
        alphas.iter().filter(|a| **a * scale >= cutoff).count()
    }

    #[test]
    fn as_many_texels_pass_as_are_covered() {
        let mut rng = Rng::new(1, 0);
        // Thin parts: no texel is half covered.
        let thin: Vec<f32> = (0..1000).map(|_| rng.uniform(0.0, 0.45)).collect();
        // Thick parts with small holes.
        let thick: Vec<f32> = thin.iter().map(|a| 1.0 - a).collect();
        for (alphas, cutoff) in [(&thin, 0.5), (&thick, 0.5), (&thin, 0.3)] {
            let mean: f32 = alphas.iter().sum();
            let scale = scale_for(alphas.clone(), cutoff);
            let after = covered(alphas, scale, cutoff);
            assert!((after as f32 - mean).abs() <= 5.0, "{after} of {mean} with {scale}");
        }
        assert_eq!(covered(&thin, 1.0, 0.5), 0, "they vanish as they are");
        assert_eq!(covered(&thick, 1.0, 0.5), 1000, "they have no holes as they are");
    }

    #[test]
    fn masks_without_a_better_choice_stay() {
        for alphas in [vec![], vec![1.0; 9], vec![0.0; 9], vec![0.25; 9]] {
            assert!((scale_for(alphas, 0.5) - 1.0).abs() < 1e-6);
        }
    }
}
