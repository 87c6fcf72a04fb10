//! A small analytic scene with known radiance and heavy-tailed noise, for tests, benchmarks and examples.

use super::camera::Camera;
use super::frame::Guides;
use crate::Shape;
use rayon::prelude::{IntoParallelIterator, ParallelIterator};

/// One view of a checked floor, a striped wall and a sphere under a soft light with a shadow.
#[derive(Clone, Debug)]
pub struct SyntheticFrame {
    /// Rows, columns, 3 channels.
    pub shape: Shape,
    /// Radiance, averaged over 3 x 3 points of each pixel.
    pub reference: Vec<f32>,
    /// Reflectance at the pixel's centre.
    pub albedo: Vec<f32>,
    /// Normal at the pixel's centre.
    pub normal: Vec<f32>,
    /// Distance from the camera.
    pub depth: Vec<f32>,
    /// Position.
    pub position: Vec<f32>,
    /// Projection.
    pub camera: Camera,
}

type V3 = [f64; 3];

fn dot(a: V3, b: V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

const CENTER: V3 = [0.35, -0.35, -3.2];
const RADIUS: f64 = 0.65;
const LIGHT: V3 = [-1.2, 2.2, -1.5];

struct Hit {
    t: f64,
    position: V3,
    normal: V3,
    albedo: V3,
}

/// Distance to the sphere along a unit direction.
fn sphere(o: V3, d: V3) -> Option<f64> {
    let m: V3 = std::array::from_fn(|k| o[k] - CENTER[k]);
    let (b, c) = (dot(m, d), dot(m, m) - RADIUS * RADIUS);
    let root = b * b - c;
    let t = -b - root.max(0.0).sqrt();
    (root > 0.0 && t > 1e-6).then_some(t)
}

fn trace(o: V3, d: V3) -> Hit {
    let at = |t: f64| -> V3 { std::array::from_fn(|k| o[k] + t * d[k]) };
    if let Some(t) = sphere(o, d) {
        let p = at(t);
        let normal = std::array::from_fn(|k| (p[k] - CENTER[k]) / RADIUS);
        return Hit { t, position: p, normal, albedo: [0.8, 0.5, 0.2] };
    }
    let floor = if d[1] < -1e-9 { (-1.0 - o[1]) / d[1] } else { f64::INFINITY };
    let wall = (-5.0 - o[2]) / d[2].min(-1e-9);
    if floor < wall {
        let p = at(floor);
        let odd = (p[0] * 2.0).floor() + (p[2] * 2.0).floor();
        let albedo = if odd.rem_euclid(2.0) == 0.0 { [0.75; 3] } else { [0.12, 0.2, 0.35] };
        return Hit { t: floor, position: p, normal: [0.0, 1.0, 0.0], albedo };
    }
    let p = at(wall);
    let albedo = if (p[0] * 3.0).rem_euclid(1.0) < 0.12 { [0.05; 3] } else { [0.6, 0.55, 0.5] };
    Hit { t: wall, position: p, normal: [0.0, 0.0, 1.0], albedo }
}

/// Smooth direct light with a penumbra, and a weak ambient term.
fn radiance(hit: &Hit) -> V3 {
    let l: V3 = std::array::from_fn(|k| LIGHT[k] - hit.position[k]);
    let distance = dot(l, l).sqrt();
    let l = l.map(|v| v / distance);
    let m: V3 = std::array::from_fn(|k| CENTER[k] - hit.position[k]);
    let along = dot(m, l);
    let miss = (dot(m, m) - along * along).max(0.0).sqrt() / RADIUS;
    let shadow = if along > 0.0 { ((miss - 0.8) / 0.4).clamp(0.0, 1.0) } else { 1.0 };
    let direct = 6.0 * dot(hit.normal, l).max(0.0) * shadow / (distance * distance);
    std::array::from_fn(|k| hit.albedo[k] * (direct + 0.15 + 0.1 * hit.normal[1]))
}

impl SyntheticFrame {
    /// The view of `width x height` pixels from a camera moved by `shift` to the right.
    ///
    /// # Panics
    /// If there are no pixels.
    pub fn new(width: usize, height: usize, shift: f64) -> Self {
        assert!(height > 0 && width > 0, "pixels");
        let n = height * width;
        let focal = 1.1 * width.max(height) as f64;
        let origin = [shift, 0.1, 0.0];
        let (cx, cy) = (0.5 * width as f64, 0.5 * height as f64);
        let ray = |x: f64, y: f64| {
            let d = [(x - cx) / focal, (cy - y) / focal, -1.0];
            let k = 1.0 / dot(d, d).sqrt();
            trace(origin, d.map(|v| v * k))
        };
        let pixels: Vec<(Hit, V3)> = (0..n)
            .into_par_iter()
            .map(|i| {
                let (x, y) = ((i % width) as f64, (i / width) as f64);
                let mut sum = [0.0; 3];
                for s in 0..9 {
                    let (sx, sy) = (f64::from(s % 3), f64::from(s / 3));
                    let light = radiance(&ray(x + (sx + 0.5) / 3.0, y + (sy + 0.5) / 3.0));
                    (0..3).for_each(|k| sum[k] += light[k] / 9.0);
                }
                (ray(x + 0.5, y + 0.5), sum)
            })
            .collect();
        let planes = |f: &dyn Fn(&(Hit, V3)) -> V3| -> Vec<f32> {
            (0..3).flat_map(|k| pixels.iter().map(move |p| f(p)[k] as f32)).collect()
        };
        // Camera coordinates: x right, y up, looking down -z.
        let world_to_pixel = [
            [focal, 0.0, -cx, -focal * origin[0]],
            [0.0, -focal, -cy, focal * origin[1]],
            [0.0, 0.0, -1.0, 0.0],
        ];
        Self {
            shape: Shape::new(width, height, 3),
            reference: planes(&|p| p.1),
            albedo: planes(&|p| p.0.albedo),
            normal: planes(&|p| p.0.normal),
            position: planes(&|p| p.0.position),
            depth: pixels.iter().map(|p| p.0.t as f32).collect(),
            camera: Camera { world_to_pixel },
        }
    }

    /// All guides.
    pub fn guides(&self) -> Guides<'_> {
        Guides {
            albedo: Some(&self.albedo),
            normal: Some(&self.normal),
            depth: Some(&self.depth),
            position: Some(&self.position),
        }
    }

    /// The mean of `samples` samples per pixel: the reference times noise of mean 1 that is 0 for four in ten samples,
    /// exponential for the others, and 40 times as bright for one in a thousand; slightly coloured.
    pub fn noisy(&self, samples: u32, seed: u64) -> Vec<f32> {
        let n = self.shape.pixels();
        let mut out = vec![0.0; 3 * n];
        for i in 0..n {
            for s in 0..samples {
                let mut counter = (i as u64) << 20 | u64::from(s) << 4;
                let mut next = || {
                    counter += 1;
                    uniform(seed, counter)
                };
                let (kind, value) = (next(), -(1.0 - next()).ln());
                let factor = if kind < 0.001 {
                    40.0
                } else if kind < 0.401 {
                    0.0
                } else {
                    value * 0.96 / 0.599
                };
                let factor = factor / f64::from(samples);
                for c in 0..3 {
                    let tint = 0.9 + 0.2 * next();
                    out[c * n + i] += (f64::from(self.reference[c * n + i]) * factor * tint) as f32;
                }
            }
        }
        out
    }
}

/// A number in [0, 1) that depends on seed and counter alone.
fn uniform(seed: u64, counter: u64) -> f64 {
    // The mixing function of splitmix64.
    let mut z =
        seed.wrapping_mul(0xd134_2543_de82_ef95).wrapping_add(counter.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_mean_one_and_points_project_to_their_pixels() {
        let f = SyntheticFrame::new(64, 48, 0.1);
        let (noisy, n) = (f.noisy(64, 3), 48 * 64);
        let sum = |v: &[f32]| v.iter().map(|v| f64::from(*v)).sum::<f64>();
        assert!((sum(&noisy) / sum(&f.reference) - 1.0).abs() < 0.02);
        for i in (0..n).step_by(97) {
            let p = [f.position[i], f.position[n + i], f.position[2 * n + i]];
            let [x, y] = f.camera.project(p).expect("in front");
            assert!((x - (i % 64) as f64 - 0.5).abs() < 1e-3 && (y - (i / 64) as f64 - 0.5).abs() < 1e-3);
        }
        let found = f.camera.positions(&f.depth, 64).expect("invertible");
        assert!(found.iter().zip(&f.position).all(|(a, b)| (a - b).abs() < 1e-3));
    }
}
