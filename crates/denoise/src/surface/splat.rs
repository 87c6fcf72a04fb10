//! Splat depth and the removal of points that lie behind it.

use super::{Pinhole, Samples};
use crate::wide::run_widest;
use photofit_scalar::Vec3f;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering};

/// Range of the depth of a splat over that of its point.
const DEPTH_RANGE: (f32, f32) = (0.7, 1.3);
/// What falling on pixels moves a point, pixels.
const ROUNDING: f32 = 0.6;
/// Largest reach of a splat, pixels.
const MOST_REACH: f32 = 128.0;

/// How far a point reaches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SplatRadius {
    /// A disc on the screen, pixels.
    Pixels(f32),
    /// A disc on the surface, in distances to the neighbours of the point, plus 0.6 pixels for what falling on pixels
    /// moves: seen edge-on it is narrow, which keeps silhouettes tight.
    Spacing(f32),
}

impl SplatRadius {
    /// The reach on the screen in pixels, and the squared reach on the surface, of a point at depth `z`.
    pub(super) fn reach(self, spacing: f32, z: f32, camera: &Pinhole) -> (f32, f32) {
        let f = (camera.fx.max(camera.fy)) as f32;
        match self {
            Self::Pixels(r) => (r.min(MOST_REACH), f32::INFINITY),
            Self::Spacing(k) => {
                let r = k * spacing + ROUNDING * z / f;
                // Perspective and tilt widen the disc by at most the depth range.
                ((1.4 * r * f / z).min(MOST_REACH), r * r)
            }
        }
    }
}

/// Depth of the nearest splat at each pixel, infinity where none reaches.
///
/// A splat is a disc on the plane of its point: depth `(n . P) / (n . r)` along the ray `r`, accepted within
/// 0.7 to 1.3 of the point's own. Atomic minima on integers: the same bits for any number of threads.
pub fn splat_depth(samples: &Samples, camera: &Pinhole, radius: SplatRadius) -> Vec<f32> {
    let infinity = f32::INFINITY.to_bits();
    let mut depth = Vec::with_capacity(samples.z.len());
    depth.resize_with(samples.z.len(), || AtomicU32::new(infinity));
    (0..samples.height).into_par_iter().for_each(|y| {
        run_widest(
            #[inline(always)]
            || {
                for x in (0..samples.width).filter(|x| samples.is_valid(y * samples.width + x)) {
                    draw(samples, camera, radius, x, y, &depth);
                }
            },
        );
    });
    depth.into_iter().map(|d| f32::from_bits(d.into_inner())).collect()
}

#[inline(always)]
fn draw(samples: &Samples, camera: &Pinhole, radius: SplatRadius, x: usize, y: usize, depth: &[AtomicU32]) {
    let (w, h) = (samples.width, samples.height);
    let i = y * w + x;
    let z = samples.z[i];
    let (px, py) = (camera.ray_x(x as f64), camera.ray_y(y as f64));
    let mut n = samples.normal[i];
    if n == Vec3f::zero() {
        n.z = -1.0;
    }
    let plane = (n.x * px + n.y * py + n.z) * z;
    let (reach, disc) = radius.reach(samples.spacing[i], z, camera);
    let near = |at: usize, end: usize| {
        let lo = (at as f32 - reach).ceil().max(0.0) as usize;
        (lo, (at as f32 + reach).floor().min((end - 1) as f32) as usize)
    };
    let ((x0, x1), (y0, y1)) = (near(x, w), near(y, h));
    let (step_x, step_y) = camera.ray_steps();
    let mut line = [0; 2 * MOST_REACH as usize + 2];
    for v in y0..=y1 {
        let dy = v as f32 - y as f32;
        let half = (reach * reach - dy * dy).max(0.0).sqrt();
        let ry = py + dy * step_y;
        let (row, base) = (v * w, n.y * ry + n.z);
        let from = x0.max((x as f32 - half).ceil().max(0.0) as usize);
        let to = (x1 + 1).min((x as f32 + half) as usize + 1);
        let line = &mut line[..to.saturating_sub(from)];
        let first = from as f32 - x as f32;
        for (k, out) in line.iter_mut().enumerate() {
            let rx = px + (first + k as f32) * step_x;
            let d = plane / (n.x * rx + base);
            let (ex, ey, ez) = (rx * d - px * z, ry * d - py * z, d - z);
            let inside = ex * ex + ey * ey + ez * ez <= disc;
            let accepted = inside & (d >= DEPTH_RANGE.0 * z) & (d <= DEPTH_RANGE.1 * z);
            *out = if accepted { d.to_bits() } else { u32::MAX };
        }
        // Most lose against what is there already, and reading costs less than an exchange.
        for (there, bits) in depth[row + from..].iter().zip(line.iter()) {
            if *bits < there.load(Ordering::Relaxed) {
                there.fetch_min(*bits, Ordering::Relaxed);
            }
        }
    }
    // Rounding must not lose the pixel of the point itself.
    depth[i].fetch_min(z.to_bits(), Ordering::Relaxed);
}

/// Removes the samples that lie behind the splats by more than the share `tolerance` of their depth, and returns
/// their number. The thesis' choice is 3%.
///
/// # Panics
/// If there is not one splat depth per pixel.
pub fn prune(samples: &mut Samples, splats: &[f32], tolerance: f32) -> usize {
    assert_eq!(splats.len(), samples.z.len(), "one splat depth per pixel");
    let mut removed = 0;
    for i in 0..splats.len() {
        if samples.z[i] > splats[i] * (1.0 + tolerance) {
            samples.remove(i);
            removed += 1;
        }
    }
    removed
}

#[cfg(test)]
mod tests {
    use super::super::synthetic::sphere_over_background;
    use super::super::tests::uniform;
    use super::*;
    use photofit_scalar::vec3;

    /// Recall, precision and the share of good samples that are lost.
    fn figures(radius: SplatRadius, front: f32, back: f32) -> (f64, f64, f64) {
        let scene = sphere_over_background();
        let (samples, hidden) = scene.sample(front, back, uniform(1));
        let splats = splat_depth(&samples, &scene.camera, radius);
        let mut kept = samples.clone();
        let removed = prune(&mut kept, &splats, 0.03);
        let (mut right, mut wrong, mut occluded) = (0, 0, 0);
        for i in (0..hidden.len()).filter(|i| samples.is_valid(*i)) {
            occluded += usize::from(hidden[i]);
            right += usize::from(hidden[i] && !kept.is_valid(i));
            wrong += usize::from(!hidden[i] && !kept.is_valid(i));
        }
        assert_eq!(removed, right + wrong);
        let visible_back = (0..hidden.len()).filter(|i| samples.is_valid(*i) && !scene.front[*i]).count();
        let recall = right as f64 / occluded as f64;
        (recall, right as f64 / removed as f64, wrong as f64 / visible_back as f64)
    }

    #[test]
    fn hidden_samples_are_found() {
        let (recall, precision, lost) = figures(SplatRadius::Pixels(3.0), 0.11, 0.10);
        println!("3 pixels: recall {recall:.3}, precision {precision:.3}, false removal {lost:.3}");
        assert!(recall >= 0.95 && precision >= 0.88 && lost <= 0.10);
        // A disc of one pixel finds few of them.
        assert!(figures(SplatRadius::Pixels(1.0), 0.12, 0.10).0 < 0.6);
        for (front, back) in [(0.12, 0.1), (0.03, 0.2), (0.4, 0.3)] {
            let (recall, precision, lost) = figures(SplatRadius::Spacing(1.0), front, back);
            println!("{front} {back}: recall {recall:.3}, precision {precision:.3}, false removal {lost:.3}");
            assert!(recall >= 0.95 && lost <= 0.15, "coverage {front}, {back}");
        }
    }

    #[test]
    fn nothing_is_lost_on_a_tilted_plane() {
        let camera = super::super::synthetic::camera();
        let n = vec3(0.8_f32, 0.3, -0.5).normalize_or_zero();
        let count = camera.pixels();
        let z: Vec<f32> = (0..count)
            .map(|i| {
                let (x, y) =
                    (camera.ray_x((i % camera.width) as f64), camera.ray_y((i / camera.width) as f64));
                3.0 * n.z / (n.x * x + n.y * y + n.z)
            })
            .collect();
        let mut samples = Samples {
            width: camera.width,
            height: camera.height,
            index: (0..count as u32).map(|i| if z[i as usize] > 0.0 { i } else { u32::MAX }).collect(),
            spacing: z.iter().map(|z| (4.0 * z / camera.fx as f32).max(0.0)).collect(),
            z: z.iter().map(|z| z.max(0.0)).collect(),
            normal: vec![n; count],
            in_view: count,
        };
        for radius in [SplatRadius::Pixels(3.0), SplatRadius::Spacing(1.5)] {
            let splats = splat_depth(&samples, &camera, radius);
            assert_eq!(prune(&mut samples, &splats, 0.001), 0, "{radius:?}");
        }
    }

    #[test]
    fn splats_cover_what_they_should() {
        let camera = super::super::synthetic::camera();
        let count = camera.pixels();
        let at = 60 * camera.width + 64;
        let mut samples = Samples {
            width: camera.width,
            height: camera.height,
            index: vec![u32::MAX; count],
            z: vec![0.0; count],
            normal: vec![vec3(0.0, 0.0, -1.0); count],
            spacing: vec![0.0; count],
            in_view: 1,
        };
        samples.index[at] = 0;
        samples.z[at] = 2.0;
        let covered = |s: &Samples, r| splat_depth(s, &camera, r).iter().filter(|d| d.is_finite()).count();
        assert_eq!(covered(&samples, SplatRadius::Pixels(3.0)), 29);
        assert_eq!(covered(&samples, SplatRadius::Spacing(1.0)), 1, "no spacing is one pixel");
        samples.spacing[at] = 6.0 * 2.0 / camera.fx as f32;
        let area = covered(&samples, SplatRadius::Spacing(1.0)) as f32;
        assert!((area / (6.6 * 6.6 * std::f32::consts::PI) - 1.0).abs() < 0.1, "{area}");
        // Seen under 60 degrees the disc is half as wide.
        samples.normal[at] = vec3(0.866, 0.0, -0.5);
        let tilted = covered(&samples, SplatRadius::Spacing(1.0)) as f32;
        assert!((tilted / area - 0.5).abs() < 0.1, "{tilted}");
    }
}
