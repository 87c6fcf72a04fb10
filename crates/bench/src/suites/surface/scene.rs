//! A sphere before a tilted wall with known depth, and samples of it.

use photofit_denoise::surface::{Pinhole, Samples};
use photofit_sampling::Rng;
use photofit_scalar::{Vec3f, vec3};

/// Side of the picture, pixels.
pub(super) const SIDE: usize = 128;
/// Share of the picture that the sphere covers.
const COVER: f64 = 0.45;

/// Pixels around the outline that count as edge.
const EDGE: isize = 3;

/// What a pixel belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// The sphere.
    Front,
    /// The wall.
    Back,
    /// Either, near the outline.
    Edge,
}

/// A picture with its truth, pixel by pixel.
pub(super) struct Scene {
    pub(super) camera: Pinhole,
    /// Depth.
    pub(super) z: Vec<f32>,
    /// Whether the sphere covers the pixel.
    pub(super) front: Vec<bool>,
    /// What it belongs to.
    part: Vec<Part>,
    /// Unit normals in camera axes.
    pub(super) normal: Vec<Vec3f>,
    /// Depth of the wall, also where the sphere hides it.
    wall: Vec<f32>,
    wall_normal: Vec3f,
}

/// A square picture from the origin along -z; `fov` in radians.
pub(super) fn camera(side: usize, fov: f64) -> Pinhole {
    Pinhole::look_at([0.0; 3], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], fov, side, side)
}

impl Scene {
    /// The wall is 2.7 times as far as the centre of the sphere.
    pub(super) fn sphere_before_wall() -> Self {
        let camera = camera(SIDE, 0.9);
        // The silhouette of a sphere of radius r around (0, 0, d) has tan(angle) = r / sqrt(d^2 - r^2).
        let tangent = (COVER / std::f64::consts::PI).sqrt() * SIDE as f64 / camera.fx;
        let (d, r) = (2.0_f32, (2.0 * tangent / (1.0 + tangent * tangent).sqrt()) as f32);
        let wall_normal = vec3(0.1_f32, -0.15, -1.0).normalize_or_zero();
        let n = SIDE * SIDE;
        let mut scene = Self {
            camera,
            z: vec![0.0; n],
            front: vec![false; n],
            part: Vec::new(),
            normal: vec![wall_normal; n],
            wall: vec![0.0; n],
            wall_normal,
        };
        for i in 0..n {
            let ray = scene.ray(i);
            scene.wall[i] = wall_normal.z * 5.4 / wall_normal.dot(ray);
            scene.z[i] = scene.wall[i];
            // |t ray - (0, 0, d)|^2 = r^2
            let (a, c) = (ray.length_squared(), d * d - r * r);
            let root = d * d - a * c;
            if root > 0.0 {
                let t = (d - root.sqrt()) / a;
                scene.z[i] = t;
                scene.front[i] = true;
                scene.normal[i] = (ray * t - vec3(0.0, 0.0, d)) * (1.0 / r);
            }
        }
        scene.parts();
        scene
    }

    /// The ray of a pixel, of depth 1.
    pub(super) fn ray(&self, i: usize) -> Vec3f {
        let (x, y, c) = ((i % SIDE) as f64 + 0.5, (i / SIDE) as f64 + 0.5, &self.camera);
        vec3(((x - c.cx) / c.fx) as f32, ((y - c.cy) / c.fy) as f32, 1.0)
    }

    /// Samples on these shares of the pixels of the sphere and of the wall; where a sample of the sphere is missing
    /// the wall shows through. Returns which samples the sphere should hide.
    pub(super) fn sample(&self, (front, back): (f32, f32), seed: u64) -> (Samples, Vec<bool>) {
        let n = self.z.len();
        let mut rng = Rng::new(seed, 0);
        let mut samples = Samples {
            width: SIDE,
            height: SIDE,
            index: vec![u32::MAX; n],
            z: vec![0.0; n],
            normal: vec![Vec3f::zero(); n],
            spacing: vec![0.0; n],
            in_view: 0,
        };
        let mut hidden = vec![false; n];
        for i in 0..n {
            let (seen, behind) = (rng.next_f32() < front, rng.next_f32() < back);
            let (z, normal, share) = match (self.front[i], seen, behind) {
                (true, true, _) => (self.z[i], self.normal[i], front),
                (_, _, true) => (self.wall[i], self.wall_normal, back),
                _ => continue,
            };
            hidden[i] = self.front[i] && !seen;
            samples.index[i] = i as u32;
            samples.z[i] = z;
            samples.normal[i] = normal;
            // Tilted surfaces have fewer samples for their area.
            let ray = self.ray(i);
            let cosine = (-normal.dot(ray) / ray.length()).max(0.05);
            samples.spacing[i] = z / self.camera.fx as f32 / (share * cosine).sqrt();
        }
        samples.in_view = samples.count();
        (samples, hidden)
    }

    /// Relative rms error of depth, given as ln z, over the pixels that are `of` it: their part, and whether they show
    /// the sphere.
    pub(super) fn error(&self, ln_z: &[f32], of: impl Fn(Part, bool) -> bool) -> f64 {
        let (mut sum, mut count) = (0.0, 0);
        for i in (0..ln_z.len()).filter(|i| of(self.part[*i], self.front[*i])) {
            sum += (f64::from(ln_z[i]).exp() / f64::from(self.z[i]) - 1.0).powi(2);
            count += 1;
        }
        (sum / f64::from(count)).sqrt()
    }

    /// Finds the pixels near the outline.
    fn parts(&mut self) {
        let n = SIDE as isize;
        let near = |i: usize| {
            let (x, y) = ((i % SIDE) as isize, (i / SIDE) as isize);
            let window = (-EDGE..=EDGE).flat_map(|v| (-EDGE..=EDGE).map(move |u| (x + u, y + v)));
            let mut inside = window.filter(|(u, v)| (0..n).contains(u) && (0..n).contains(v));
            inside.any(|(u, v)| self.front[(v * n + u) as usize] != self.front[i])
        };
        let part = |i: usize| match (near(i), self.front[i]) {
            (true, _) => Part::Edge,
            (false, true) => Part::Front,
            (false, false) => Part::Back,
        };
        self.part = (0..SIDE * SIDE).map(part).collect();
    }
}

/// ln z of samples, and which pixels have one.
pub(super) fn ln_depth(samples: &Samples) -> (Vec<f32>, Vec<bool>) {
    let ln = |z: &f32| if *z > 0.0 { z.ln() } else { 0.0 };
    (samples.z.iter().map(ln).collect(), (0..samples.z.len()).map(|i| samples.is_valid(i)).collect())
}
