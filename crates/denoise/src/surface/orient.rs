//! The sign of normals that are seen edge-on, from the surface around them.

use super::{Pinhole, Samples};
use photofit_scalar::Vec3f;
use rayon::prelude::*;

/// Cosine to the ray below which a normal may face the camera by mistake.
const GRAZING: f32 = 0.35;
/// Largest relative difference of depth within a surface.
const SURFACE: f32 = 0.03;

/// Turns grazing normals to the side of the normals around them on the same surface.
///
/// Normals of points have no sign, and the one that faces the camera is taken. Near outlines, where the plane is seen
/// edge-on, a small error of the normal makes that the wrong one, and the surface would seem to turn the other way.
/// Normals that are turned end up facing slightly away from the camera. `spacing` is the distance between samples in
/// pixels.
pub(super) fn orient(samples: &mut Samples, camera: &Pinhole, spacing: f32) {
    let (w, h) = (samples.width, samples.height);
    let r = (2.0 * spacing).ceil().clamp(2.0, 10.0) as usize;
    let cosine: Vec<f32> = (0..w * h)
        .into_par_iter()
        .map(|i| {
            let ray = camera.ray(i);
            -samples.normal[i].dot(ray) / ray.length()
        })
        .collect();
    let around = |i: usize| {
        let (x, y) = (i % w, i / w);
        let mut sum = Vec3f::zero();
        for v in y.saturating_sub(r)..(y + r + 1).min(h) {
            for j in v * w + x.saturating_sub(r)..v * w + (x + r + 1).min(w) {
                if cosine[j] >= GRAZING && (samples.z[j] - samples.z[i]).abs() <= SURFACE * samples.z[i] {
                    sum += samples.normal[j] * cosine[j];
                }
            }
        }
        sum
    };
    let turned: Vec<usize> = (0..w * h)
        .into_par_iter()
        .filter(|&i| samples.normal[i] != Vec3f::zero() && cosine[i] < GRAZING)
        .filter(|&i| samples.normal[i].dot(around(i)) < 0.0)
        .collect();
    for i in turned {
        samples.normal[i] = -samples.normal[i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::synthetic::{SIDE, camera};
    use photofit_scalar::vec3;

    #[test]
    fn normals_at_an_outline_follow_their_surface() {
        // The upper half of a cylinder around the axis of x, each sample with its true normal but for noise.
        let camera = camera();
        let n = SIDE * SIDE;
        let mut samples = Samples::empty(SIDE, SIDE);
        let mut wrong = Vec::new();
        for i in 0..n {
            let ray = camera.ray(i);
            let y = ray.y;
            // |t (y, 1) - (0, 3)| = 0.4
            let root = 9.0 - (y * y + 1.0) * (9.0 - 0.16);
            if root <= 0.0 {
                continue;
            }
            let t = (3.0 - root.sqrt()) / (y * y + 1.0);
            let truth = vec3(0.0, t * y, t - 3.0) * (1.0 / 0.4);
            let facing = truth.dot(ray) / ray.length();
            samples.index[i] = i as u32;
            samples.z[i] = t;
            samples.normal[i] = truth;
            if facing > -0.3 && i % 3 == 0 {
                samples.normal[i] = -truth;
                wrong.push(i);
            }
        }
        let before = samples.normal.clone();
        orient(&mut samples, &camera, 4.0);
        assert!(wrong.len() > 20, "{}", wrong.len());
        let turned: Vec<usize> = (0..n).filter(|i| samples.normal[*i] != before[*i]).collect();
        println!("{} of {} wrong signs mended", turned.len(), wrong.len());
        assert!(turned.iter().all(|i| wrong.contains(i)), "right signs stay");
        // Right at the outline the samples that could tell are too far away in depth.
        assert!(2 * turned.len() >= wrong.len(), "{} of {}", turned.len(), wrong.len());
    }
}
