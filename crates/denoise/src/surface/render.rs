//! The one-pixel point renderer: every point falls on one pixel, the nearest wins.

use super::{Cloud, Pinhole};
use photofit_scalar::{Vec3f, vec3};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Points that one task projects.
const CHUNK: usize = 1 << 14;
/// No point.
const NONE: u64 = u64::MAX;
/// Least cosine-like product `|n . r|` at which the plane of a point is trusted to move its depth.
const STEEP: f32 = 0.1;
/// Largest relative change of depth from a point to the centre of its pixel.
const CENTERED: f32 = 0.05;

/// What each pixel saw: struct of arrays, one entry per pixel, row by row.
#[derive(Clone, Debug)]
pub struct Samples {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Index of the point, `u32::MAX` where no point fell.
    pub index: Vec<u32>,
    /// Depth along the optical axis at the centre of the pixel, 0 where no point fell.
    pub z: Vec<f32>,
    /// Unit normal in camera axes (right, down, forward) that faces the camera; zero where unknown.
    pub normal: Vec<Vec3f>,
    /// Distance to the neighbours on the surface, in the units of the points.
    pub spacing: Vec<f32>,
    /// Points in front of the camera and inside of the picture, hidden ones included.
    pub in_view: usize,
}

impl Samples {
    /// A picture in which no point fell.
    pub fn empty(width: usize, height: usize) -> Self {
        let n = width * height;
        Self {
            width,
            height,
            index: vec![u32::MAX; n],
            z: vec![0.0; n],
            normal: vec![Vec3f::zero(); n],
            spacing: vec![0.0; n],
            in_view: 0,
        }
    }

    /// Whether a point fell on the pixel.
    #[inline]
    pub fn is_valid(&self, pixel: usize) -> bool {
        self.index[pixel] != u32::MAX
    }

    /// Number of pixels with a point.
    pub fn count(&self) -> usize {
        self.index.iter().filter(|i| **i != u32::MAX).count()
    }

    /// Forgets what a pixel saw.
    pub fn remove(&mut self, pixel: usize) {
        self.index[pixel] = u32::MAX;
        self.z[pixel] = 0.0;
        self.normal[pixel] = Vec3f::zero();
        self.spacing[pixel] = 0.0;
    }

    /// Median distance between neighbouring samples on the screen, pixels; 1 without samples.
    ///
    /// The spacing of each sample on its surface, divided by what a pixel covers at its depth.
    pub fn spacing_px(&self, camera: &Pinhole) -> f32 {
        let f = (camera.fx * camera.fy).sqrt() as f32;
        let mut all: Vec<f32> =
            self.z.iter().zip(&self.spacing).filter(|(z, _)| **z > 0.0).map(|(z, s)| f * s / z).collect();
        if all.is_empty() {
            return 1.0;
        }
        let mid = all.len() / 2;
        *all.select_nth_unstable_by(mid, f32::total_cmp).1
    }
}

/// Renders a cloud. Depth is moved along the plane of the point to the centre of its pixel.
///
/// Deterministic: of the points of one pixel the nearest wins, of equally near ones the first.
pub fn render_points(cloud: &Cloud, camera: &Pinhole) -> Samples {
    let (keys, in_view) = nearest_points(cloud, camera);
    let mut samples = Samples { in_view, ..Samples::empty(camera.width, camera.height) };
    let w = camera.width;
    let rows = samples
        .index
        .par_chunks_mut(w)
        .zip(samples.z.par_chunks_mut(w))
        .zip(samples.normal.par_chunks_mut(w))
        .zip(samples.spacing.par_chunks_mut(w))
        .zip(keys.par_chunks(w))
        .enumerate();
    rows.for_each(|(y, ((((index, z), normal), spacing), keys))| {
        let ray_y = camera.ray_y(y as f64);
        for x in 0..w {
            let key = keys[x].load(Ordering::Relaxed);
            if key == NONE {
                continue;
            }
            let point = key as u32;
            let at = point as usize;
            let p = cloud.positions()[at].cast::<f64>().to_array();
            let p = camera.to_camera(p);
            let p = vec3(p[0] as f32, p[1] as f32, p[2] as f32);
            let n = facing(camera.direction_to_camera(cloud.normals()[at]), p);
            index[x] = point;
            normal[x] = n;
            spacing[x] = cloud.spacing()[at];
            z[x] = centered(p, n, camera.ray_x(x as f64), ray_y);
        }
    });
    samples
}

/// Nearest point of each pixel as depth bits and index, and the number of points in view.
fn nearest_points(cloud: &Cloud, camera: &Pinhole) -> (Vec<AtomicU64>, usize) {
    let pixels = camera.pixels();
    let mut keys = Vec::with_capacity(pixels);
    keys.resize_with(pixels, || AtomicU64::new(NONE));
    let (w, h) = (camera.width as f64, camera.height as f64);
    let in_view = cloud
        .positions()
        .par_chunks(CHUNK)
        .enumerate()
        .map(|(chunk, positions)| {
            let mut count = 0;
            for (i, p) in positions.iter().enumerate() {
                let [x, y, z] = camera.to_camera(p.cast::<f64>().to_array());
                let depth = z as f32;
                // Written so that NaN fails.
                if !(depth >= f32::MIN_POSITIVE && depth.is_finite()) {
                    continue;
                }
                let (u, v) = (x / z * camera.fx + camera.cx, y / z * camera.fy + camera.cy);
                if !(u >= 0.0 && v >= 0.0 && u < w && v < h) {
                    continue;
                }
                count += 1;
                let pixel = v as usize * camera.width + u as usize;
                // Positive floats are ordered as their bits.
                let key = u64::from(depth.to_bits()) << 32 | (chunk * CHUNK + i) as u64;
                if key < keys[pixel].load(Ordering::Relaxed) {
                    keys[pixel].fetch_min(key, Ordering::Relaxed);
                }
            }
            count
        })
        .sum();
    (keys, in_view)
}

/// The sign of a normal that faces the camera from `p`.
fn facing(n: Vec3f, p: Vec3f) -> Vec3f {
    if n.dot(p) > 0.0 { -n } else { n }
}

/// Depth where the ray `(x, y, 1)` meets the plane of the point `p` with normal `n`; the point's own depth where the
/// plane is seen at a grazing angle or leads far away.
#[inline]
fn centered(p: Vec3f, n: Vec3f, x: f32, y: f32) -> f32 {
    let across = n.x * x + n.y * y + n.z;
    let z = n.dot(p) / across;
    let near = (z - p.z).abs() <= CENTERED * p.z;
    if across.abs() >= STEEP && near { z } else { p.z }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::Rng;

    fn camera(side: usize) -> Pinhole {
        Pinhole::look_at([0.0; 3], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], 1.0, side, side)
    }

    #[test]
    fn the_nearest_point_wins_and_the_first_of_equals() {
        let p = |z: f32| vec3(0.01, 0.01, z);
        let positions = vec![p(-3.0), p(-2.0), p(-2.0), p(-5.0), p(2.0), vec3(100.0, 0.0, -1.0)];
        let samples = render_points(&Cloud::new(positions, vec![], vec![]).unwrap(), &camera(1));
        assert_eq!((samples.index[0], samples.in_view, samples.count()), (1, 4, 1));
    }

    #[test]
    fn depth_is_that_of_the_plane_at_the_centre_of_the_pixel() {
        let n = vec3(0.5_f32, -0.3, 0.8).normalize_or_zero();
        let mut rng = Rng::new(1, 0);
        // Points of the plane n . (p + 4 z) = 0.
        let points: Vec<Vec3f> = (0..5000)
            .map(|_| {
                let (x, y) = (rng.uniform(-3.0, 3.0), rng.uniform(-3.0, 3.0));
                vec3(x, y, -4.0 - (n.x * x + n.y * y) / n.z)
            })
            .collect();
        let c = camera(48);
        for normals in [vec![n; points.len()], vec![]] {
            let cloud = Cloud::new(points.clone(), normals, vec![]).unwrap();
            let s = render_points(&cloud, &c);
            assert!(s.count() > 1000);
            for i in (0..s.z.len()).filter(|i| s.is_valid(*i)) {
                let (x, y) = (c.ray_x((i % 48) as f64), c.ray_y((i / 48) as f64));
                // In the world the ray is (x, -y, -1).
                let exact = 4.0 * n.z / -(n.x * x - n.y * y - n.z);
                assert!((s.z[i] / exact - 1.0).abs() < 2e-3, "{} against {exact}", s.z[i]);
                assert!(s.normal[i].x * x + s.normal[i].y * y + s.normal[i].z < 0.0, "faces the camera");
            }
        }
    }

    #[test]
    fn offsets_of_a_million_cost_nothing() {
        let mut rng = Rng::new(2, 0);
        let mut number = || (rng.uniform(-2.0, 2.0) * 16.0).round() / 16.0;
        let near: Vec<Vec3f> = (0..400).map(|_| vec3(number(), number(), number() - 5.0)).collect();
        let far = near.iter().map(|p| *p + Vec3f::splat(1e6)).collect();
        let up = [0.0, 1.0, 0.0];
        let a = Pinhole::look_at([0.0; 3], [0.0, 0.0, -1.0], up, 1.0, 40, 40);
        let b = Pinhole { eye: [1e6; 3], ..a };
        let a = render_points(&Cloud::new(near, vec![], vec![]).unwrap(), &a);
        let b = render_points(&Cloud::new(far, vec![], vec![]).unwrap(), &b);
        assert_eq!((a.index, a.z), (b.index, b.z));
    }

    #[test]
    fn the_spacing_on_the_screen() {
        let grid =
            (0..10_000).map(|i| vec3((i % 100) as f32 - 49.5, (i / 100) as f32 - 49.5, -200.0)).collect();
        let c = camera(256);
        let samples = render_points(&Cloud::new(grid, vec![], vec![]).unwrap(), &c);
        let expected = (c.fx / 200.0) as f32;
        assert!((samples.spacing_px(&c) / expected - 1.0).abs() < 0.1);
    }
}
