//! A small scene with known depth, and samples of it, for tests and benchmarks.

use super::{Pinhole, Samples};
use photofit_scalar::{Vec3f, vec3};

/// Side of the picture, pixels.
pub const SIDE: usize = 128;

/// A picture with its truth, `SIDE * SIDE` pixels, row by row.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Looks along the depth.
    pub camera: Pinhole,
    /// Depth along the axis of the camera.
    pub z: Vec<f32>,
    /// Whether the foreground covers the pixel.
    pub front: Vec<bool>,
    /// Unit normals in camera axes.
    pub normal: Vec<Vec3f>,
    /// Depth of the background behind everything.
    back: Vec<f32>,
    back_normal: Vec3f,
}

/// The camera of the scene: from the origin along -z.
pub fn camera() -> Pinhole {
    Pinhole::look_at([0.0; 3], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], 0.9, SIDE, SIDE)
}

/// A sphere that covers 45% of the picture before a tilted plane that is 2.7 times as far.
pub fn sphere_over_background() -> Scene {
    let camera = camera();
    // The silhouette of a sphere of radius r around (0, 0, d) has tan(angle) = r / sqrt(d^2 - r^2).
    let tangent = (0.45 / std::f64::consts::PI).sqrt() * SIDE as f64 / camera.fx;
    let sine = tangent / (1.0 + tangent * tangent).sqrt();
    let (d, r) = (2.0_f32, 2.0 * sine as f32);
    let back_normal = vec3(0.1_f32, -0.15, -1.0).normalize_or_zero();
    let plane = back_normal.z * 5.4;
    let n = SIDE * SIDE;
    let mut scene = Scene {
        camera,
        z: vec![0.0; n],
        back: vec![0.0; n],
        front: vec![false; n],
        normal: vec![back_normal; n],
        back_normal,
    };
    for i in 0..n {
        let ray = scene.camera.ray(i);
        scene.back[i] = plane / back_normal.dot(ray);
        scene.z[i] = scene.back[i];
        // |t ray - (0, 0, d)|^2 = r^2
        let (a, b, c) = (ray.length_squared(), d, d * d - r * r);
        let root = b * b - a * c;
        if root > 0.0 {
            let t = (b - root.sqrt()) / a;
            scene.z[i] = t;
            scene.front[i] = true;
            scene.normal[i] = (ray * t - vec3(0.0, 0.0, d)) * (1.0 / r);
        }
    }
    scene
}

impl Scene {
    /// Samples a share of the pixels of each surface by independent numbers in `[0, 1)`; where a front sample is
    /// missing the background shows through. Returns the samples and which of them lie behind the front.
    pub fn sample(&self, front: f32, back: f32, mut uniform: impl FnMut() -> f32) -> (Samples, Vec<bool>) {
        let n = self.z.len();
        let mut samples = Samples::empty(SIDE, SIDE);
        let mut hidden = vec![false; n];
        for i in 0..n {
            let (seen, behind) = (uniform() < front, uniform() < back);
            let (z, normal, share) = match (self.front[i], seen, behind) {
                (true, true, _) => (self.z[i], self.normal[i], front),
                (true, false, true) => (self.back[i], self.back_normal, back),
                (false, _, true) => (self.z[i], self.back_normal, back),
                _ => continue,
            };
            hidden[i] = self.front[i] && !seen;
            samples.index[i] = i as u32;
            samples.z[i] = z;
            samples.normal[i] = normal;
            // Tilted surfaces have fewer samples for their area.
            let ray = self.camera.ray(i);
            let cosine = (-normal.dot(ray) / ray.length()).max(0.05);
            samples.spacing[i] = z / self.camera.fx as f32 / (share * cosine).sqrt();
        }
        samples.in_view = samples.count();
        (samples, hidden)
    }

    /// Relative rms error of depth, given as ln z, over the pixels that are `of` it.
    pub fn error(&self, u: &[f32], of: impl Fn(usize) -> bool) -> f64 {
        let (mut sum, mut count) = (0.0, 0);
        for i in (0..u.len()).filter(|i| of(*i)) {
            let relative = f64::from(u[i]).exp() / f64::from(self.z[i]) - 1.0;
            sum += relative * relative;
            count += 1;
        }
        (sum / f64::from(count)).sqrt()
    }

    /// The error where the front covers, and where it does not.
    pub fn errors(&self, u: &[f32]) -> (f64, f64) {
        (self.error(u, |i| self.front[i]), self.error(u, |i| !self.front[i]))
    }
}

/// ln z of samples, and which pixels have one.
pub fn ln_depth(samples: &Samples) -> (Vec<f32>, Vec<bool>) {
    let valid: Vec<bool> = (0..samples.z.len()).map(|i| samples.is_valid(i)).collect();
    let u = samples.z.iter().map(|z| if *z > 0.0 { z.ln() } else { 0.0 }).collect();
    (u, valid)
}
