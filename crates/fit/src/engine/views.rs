//! Cameras and lights of a fit: where the reference and the candidate are looked at from.
//!
//! Everything is in the normalised frame: the reference's bounding sphere is centred at the origin with radius 1.

use glam::Vec3;
use photofit_image::Image;
use photofit_sampling::{Rng, uniform_sphere};
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::Camera;
use photofit_shading::{Environment, Light, Yaw};
use std::sync::{Arc, OnceLock};

/// Tangent of half the field of view of the training cameras.
pub const HALF_TANGENT: f32 = 0.4;
/// Random streams: one per purpose, so that adding views never changes the others.
const STREAM_TRAIN: u64 = 1 << 32;
const STREAM_HELD_OUT: u64 = 2 << 32;
const STREAM_REPORT: u64 = 3 << 32;
const STREAM_BACKGROUND: u64 = 4 << 32;

/// Where the light of a fit comes from.
#[derive(Clone, Debug, Default)]
pub enum Lighting {
    /// Every other view as [`Lighting::Point`], the others under the environment [`studio`]: an asset fitted under one
    /// kind of light alone looks worse under the other.
    #[default]
    Mixed,
    /// A point light around the camera and a weak constant environment.
    Point,
    /// An environment map, turned at random, scaled so that a white diffuse sphere averages 0.7.
    Environment(Arc<Environment>),
}

/// The environment of [`Lighting::Mixed`]: a sky, a ground and three soft lights, scaled so that a white diffuse sphere
/// averages 0.7.
///
/// # Panics
/// Never: its radiance is finite.
pub fn studio() -> Arc<Environment> {
    static STUDIO: OnceLock<Arc<Environment>> = OnceLock::new();
    /// Direction, sharpness and radiance of each light.
    const LIGHTS: [([f32; 3], f32, [f32; 3]); 3] = [
        ([0.6, 0.5, 0.62], 40.0, [14.0, 12.6, 11.0]),
        ([-0.75, 0.25, 0.6], 15.0, [2.2, 2.5, 3.0]),
        ([0.1, 0.75, -0.65], 80.0, [10.0, 10.0, 11.0]),
    ];
    let (width, height) = (128, 64);
    let texel = |i: usize| {
        let theta = ((i / width) as f32 + 0.5) / height as f32 * std::f32::consts::PI;
        let phi = ((i % width) as f32 + 0.5) / width as f32 * std::f32::consts::TAU;
        let d = vec3(theta.sin() * phi.sin(), theta.cos(), theta.sin() * phi.cos());
        let sky = 1.0 / (1.0 + (-8.0 * d.y).exp());
        let mut rgb =
            vec3(0.16, 0.14, 0.12) * (1.0 - sky) + vec3(0.35, 0.42, 0.55) * (sky * (1.0 - 0.4 * d.y));
        for (towards, sharpness, radiance) in LIGHTS {
            let cosine = d.dot(Vec3f::from_array(towards).normalize_or_zero());
            rgb += Vec3f::from_array(radiance) * ((cosine - 1.0) * sharpness).exp();
        }
        rgb.to_array()
    };
    let make = || {
        let rgb: Vec<f32> = (0..width * height).flat_map(texel).collect();
        let map = Environment::from_equirectangular(width, height, &rgb);
        Arc::new(map.expect("finite radiance").normalised(0.7))
    };
    STUDIO.get_or_init(make).clone()
}

/// The lights of one shot.
#[derive(Clone, Debug)]
pub struct ShotLights {
    point: Option<(Vec3f, Vec3f)>,
    ambient: Vec3f,
    environment: Option<(Arc<Environment>, f32)>,
}

impl ShotLights {
    /// As the shading crate takes them.
    pub fn lights(&self) -> Vec<Light<'_, f32>> {
        let mut out = Vec::with_capacity(2);
        if let Some((position, intensity)) = self.point {
            out.push(Light::Point { position, intensity });
        }
        if self.ambient != Vec3f::zero() {
            out.push(Light::Ambient { radiance: self.ambient });
        }
        if let Some((map, yaw)) = &self.environment {
            out.push(Light::Environment { map, rotation: Yaw::new(*yaw), scale: 1.0 });
        }
        out
    }
}

/// A camera with its lights.
#[derive(Clone, Debug)]
pub struct Setup {
    /// The camera.
    pub camera: Camera,
    /// The lights.
    pub lights: ShotLights,
}

/// Which set of views.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Set {
    /// Seen while fitting.
    Train,
    /// For the early stop.
    HeldOut,
    /// For the report: evenly spread, never seen by the fit.
    Report,
}

/// View number `index` of a set; a pure function of its arguments.
pub fn setup(set: Set, index: u64, count: u64, seed: u64, lighting: &Lighting) -> Setup {
    let stream = match set {
        Set::Train => STREAM_TRAIN,
        Set::HeldOut => STREAM_HELD_OUT,
        Set::Report => STREAM_REPORT,
    };
    let mut rng = Rng::new(seed, stream + index);
    let framing = 1.0 / HALF_TANGENT.atan().sin();
    let (direction, distance) = match set {
        Set::Train => (sphere(&mut rng), framing * rng.uniform(0.72, 1.1)),
        Set::HeldOut | Set::Report => {
            (fibonacci(index, count, if set == Set::Report { 0.7 } else { 2.1 }), framing * 1.01)
        }
    };
    let eye = direction * distance;
    let mut camera = Camera::look_at(
        eye,
        Vec3::ZERO,
        if set == Set::Train { sphere(&mut rng) } else { Vec3::Y },
        2.0 * HALF_TANGENT.atan(),
        1.0,
        0.01 * distance,
        distance + 1.5,
    );
    if set == Set::Train {
        let shift = glam::vec3(rng.uniform(-0.12, 0.12), rng.uniform(-0.12, 0.12), 0.0);
        camera.view = glam::Mat4::from_translation(shift) * camera.view;
        camera.eye = camera.view.inverse().transform_point3(Vec3::ZERO);
    }
    Setup { camera, lights: lights(&mut rng, direction, lighting, index) }
}

fn lights(rng: &mut Rng, towards_camera: Vec3, lighting: &Lighting, index: u64) -> ShotLights {
    match lighting {
        Lighting::Mixed if index.is_multiple_of(2) => {
            lights(rng, towards_camera, &Lighting::Environment(studio()), index)
        }
        Lighting::Mixed | Lighting::Point => {
            // Cosine-weighted about the camera's direction.
            let (s, t) = towards_camera.any_orthonormal_pair();
            let (u, a) = (rng.uniform(0.0, 1.0), rng.uniform(0.0, std::f32::consts::TAU));
            let r = u.sqrt();
            let d = s * (r * a.cos()) + t * (r * a.sin()) + towards_camera * (1.0 - u).max(0.0).sqrt();
            let distance = 3.0;
            let irradiance = rng.uniform(2.0, 3.2);
            let p = d * distance;
            ShotLights {
                point: Some((vec3(p.x, p.y, p.z), Vec3f::splat(irradiance * distance * distance))),
                ambient: Vec3f::splat(rng.uniform(0.1, 0.35)),
                environment: None,
            }
        }
        Lighting::Environment(map) => ShotLights {
            point: None,
            ambient: Vec3f::zero(),
            environment: Some((map.clone(), rng.uniform(0.0, std::f32::consts::TAU))),
        },
    }
}

fn sphere(rng: &mut Rng) -> Vec3 {
    let d: Vec3f = uniform_sphere([rng.next_f32(), rng.next_f32()]);
    Vec3::new(d.x, d.y, d.z)
}

fn fibonacci(index: u64, count: u64, turn: f32) -> Vec3 {
    let y = 1.0 - 2.0 * (index as f32 + 0.5) / count.max(1) as f32;
    let a = index as f32 * (std::f32::consts::PI * (3.0 - 5.0f32.sqrt())) + turn;
    let r = (1.0 - y * y).max(0.0).sqrt();
    Vec3::new(r * a.cos(), y, r * a.sin())
}

/// A view with its reference picture.
#[derive(Clone, Debug)]
pub struct Shot {
    /// The camera.
    pub camera: Camera,
    /// The lights.
    pub lights: ShotLights,
    /// Columns of the picture.
    pub width: usize,
    /// Rows of the picture.
    pub height: usize,
    /// Samples per axis that the candidate takes of a pixel.
    pub samples: usize,
    /// Radiance behind the asset, the same for both images, one per pixel.
    pub background: Vec<[f32; 3]>,
    /// The reference over the background; the fourth sample is its coverage.
    pub reference: Vec<[f32; 4]>,
}

impl Shot {
    /// Puts a reference picture (linear, premultiplied RGBA) over noise, which supervises coverage.
    ///
    /// # Panics
    /// If the picture does not have four channels.
    pub fn new(setup: &Setup, picture: &Image, samples: usize, seed: u64, index: u64) -> Self {
        assert_eq!(picture.channels, 4, "a premultiplied RGBA picture");
        let mut rng = Rng::new(seed, STREAM_BACKGROUND + index);
        let background: Vec<[f32; 3]> = (0..picture.pixels())
            .map(|_| [rng.uniform(0.0, 0.8), rng.uniform(0.0, 0.8), rng.uniform(0.0, 0.8)])
            .collect();
        let reference = picture
            .data
            .chunks_exact(4)
            .zip(&background)
            .map(|(p, b)| {
                let t = 1.0 - p[3];
                [p[0] + t * b[0], p[1] + t * b[1], p[2] + t * b[2], p[3]]
            })
            .collect();
        Self {
            camera: setup.camera,
            lights: setup.lights.clone(),
            width: picture.width,
            height: picture.height,
            samples,
            background,
            reference,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_are_a_function_of_seed_and_index() {
        let at = |set, i, seed| setup(set, i, 8, seed, &Lighting::Point).camera;
        assert_eq!(at(Set::Train, 3, 1), at(Set::Train, 3, 1));
        assert_ne!(at(Set::Train, 3, 1), at(Set::Train, 4, 1));
        assert_ne!(at(Set::Train, 3, 1), at(Set::Train, 3, 2));
        assert_ne!(at(Set::HeldOut, 3, 1).eye, at(Set::Report, 3, 1).eye);
    }

    #[test]
    fn the_unit_sphere_fits_report_views() {
        for i in 0..8 {
            let c = setup(Set::Report, i, 8, 0, &Lighting::Point).camera;
            let d = c.eye.length();
            assert!((1.0 / d).asin() <= HALF_TANGENT.atan(), "view {i}");
        }
    }
}
