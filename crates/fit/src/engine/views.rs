//! Views: where the reference and the candidate are looked at from, under which light, at which moment of an animation, at which size.
//!
//! A set of views is a pure function of (set, index). Everything is in the normalised frame: the reference's bounding
//! sphere is centred at the origin with radius 1.

use crate::FitError;
use glam::Vec3;
use photofit_image::Image;
use photofit_pathtrace::View;
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
const STREAM_SIZE: u64 = 5 << 32;
const STREAM_BACKS: u64 = 6 << 32;
/// Fractional parts of the multiples of this number, sqrt(2), spread evenly whatever their count. The cameras of held-out views
/// turn by multiples of the golden angle: sizes must follow another number, or each size would have its direction.
const SPREAD: f64 = std::f64::consts::SQRT_2;

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

impl Lighting {
    /// Its name.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Mixed => "mixed",
            Self::Point => "point",
            Self::Environment(_) => "env",
        }
    }
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

/// A light of one view, in the normalised frame.
#[derive(Clone, Debug)]
pub enum ViewLight {
    /// Equal in all directions.
    Point {
        /// Where it is.
        position: Vec3f,
        /// Radiant intensity, W/sr per channel in the frame's units.
        intensity: Vec3f,
    },
    /// From afar.
    Directional {
        /// Unit vector towards the light.
        direction: Vec3f,
        /// Irradiance on a surface that faces it.
        irradiance: Vec3f,
    },
    /// The same radiance from everywhere.
    Ambient {
        /// The radiance.
        radiance: Vec3f,
    },
    /// An environment map.
    Environment {
        /// The map.
        map: Arc<Environment>,
        /// Turn about +y, radians.
        yaw: f32,
    },
}

/// The lights of one view.
#[derive(Clone, Debug, Default)]
pub struct ViewLights(pub Vec<ViewLight>);

impl ViewLights {
    /// As the shading crate takes them.
    pub fn lights(&self) -> Vec<Light<'_, f32>> {
        let light = |l| match l {
            &ViewLight::Point { position, intensity } => Light::Point { position, intensity },
            &ViewLight::Directional { direction, irradiance } => Light::Directional { direction, irradiance },
            &ViewLight::Ambient { radiance } => Light::Ambient { radiance },
            ViewLight::Environment { map, yaw } => {
                Light::Environment { map, rotation: Yaw::new(*yaw), scale: 1.0 }
            }
        };
        self.0.iter().map(light).collect()
    }
}

/// A moment of one of an asset's animations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moment {
    /// Index of the animation; `None`: as the asset stands.
    pub animation: Option<usize>,
    /// Time in the animation, seconds.
    pub time: f32,
}

/// A sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Centre.
    pub center: Vec3f,
    /// Radius.
    pub radius: f32,
}

impl Sphere {
    /// The bounds of everything in the normalised frame.
    pub const UNIT: Self = Self { center: Vec3f { x: 0.0, y: 0.0, z: 0.0 }, radius: 1.0 };
}

/// The camera of a view: one of two kinds, from which the other one follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ViewCamera {
    /// A pinhole, as both renderers draw it.
    Pinhole(Camera),
    /// A camera that the path tracer alone draws: a lens, parallel rays, a part of the picture.
    Traced(View),
}

impl From<Camera> for ViewCamera {
    fn from(camera: Camera) -> Self {
        Self::Pinhole(camera)
    }
}

impl ViewCamera {
    /// As the rasterizer draws it: of a camera that it cannot draw the pinhole at its eye, with its field of view.
    pub fn pinhole(&self) -> Camera {
        match self {
            Self::Pinhole(camera) => *camera,
            Self::Traced(view) => {
                let (eye, [_, up, back]) = (view.eye.as_vec3(), view.axes);
                let [w, h] = view.half;
                let (near, far) = (view.clip[0].max(1e-3), view.clip[1].min(1e6));
                Camera::look_at(eye, eye - back, up, 2.0 * h.atan(), w / h, near, far)
            }
        }
    }

    /// As the path tracer draws it.
    pub fn view(&self) -> View {
        match self {
            Self::Pinhole(camera) => View::pinhole(camera),
            Self::Traced(view) => *view,
        }
    }
}

/// What is asked of a reference: camera, lights, moment, and size of the picture.
#[derive(Clone, Debug)]
pub struct Setup {
    /// The camera.
    pub camera: ViewCamera,
    /// The lights.
    pub lights: ViewLights,
    /// The moment of its animation.
    pub moment: Moment,
    /// Columns of the picture.
    pub width: usize,
    /// Rows of the picture.
    pub height: usize,
    /// The finished picture that shows this view, where views come with pictures.
    pub picture: Option<usize>,
    /// Backs of single-sided surfaces are drawn, too, as renderers do that know no sides. The rasterizer alone does so.
    pub backs: bool,
}

impl Setup {
    /// The finished picture that shows this view, of `count`.
    ///
    /// # Errors
    /// A view that does not name one of them.
    pub fn given_picture(&self, count: usize) -> Result<usize, FitError> {
        self.picture.filter(|p| *p < count).ok_or_else(|| {
            let is = self.picture.map_or("none".to_owned(), |p| p.to_string());
            let rule = format!("of the view is {is}; it must be the number of one of {count} pictures");
            FitError::Setting { field: "picture", rule }
        })
    }

    /// The same view in a picture that is smaller by `factor` along both axes, at least one pixel.
    #[must_use]
    pub fn shrunk(&self, factor: usize) -> Self {
        let size = |n: usize| (n / factor).max(1);
        Self { width: size(self.width), height: size(self.height), ..self.clone() }
    }
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

/// Views of a fit: pure functions of their arguments.
pub trait Views: Sync {
    /// View number `index` of a set of which `count` views are wanted, spread over all there are. Numbers of
    /// [`Set::Train`] have no end. Those of the other sets from `count` on may be further views, `count` of them spread alike.
    fn setup(&self, set: Set, index: u64, count: u64) -> Setup;
}

/// Views of an animated asset: those of others, two at a time of each moment in turn.
#[derive(Clone, Debug)]
pub struct OverMoments<V> {
    /// From where, and under which light.
    pub views: V,
    /// At which moments; without any the views keep theirs.
    pub moments: Vec<Moment>,
}

impl<V: Views> Views for OverMoments<V> {
    fn setup(&self, set: Set, index: u64, count: u64) -> Setup {
        let mut setup = self.views.setup(set, index, count);
        if !self.moments.is_empty() {
            setup.moment = self.moments[(index / 2) as usize % self.moments.len()];
        }
        setup
    }
}

/// Views all around a sphere, drawn by a seed.
#[derive(Clone, Debug)]
pub struct Orbit {
    /// Seed of all draws.
    pub seed: u64,
    /// Where the light comes from.
    pub lighting: Lighting,
    /// Width and height of the pictures, pixels.
    pub size: usize,
    /// Those of the smallest pictures of [`Set::Train`] and [`Set::HeldOut`]: logarithms of sizes are spread evenly from there to
    /// [`Self::size`], which all pictures have without.
    pub smallest: Option<usize>,
    /// What is looked at.
    pub bounds: Sphere,
    /// Nearest and farthest camera of [`Set::Train`], in distances at which the sphere just fills the picture.
    pub distance: [f32; 2],
    /// Distance of the other cameras, likewise.
    pub judged_distance: f32,
    /// The moment of its animation.
    pub moment: Moment,
    /// Share of the views of [`Set::Train`] that show the backs of single-sided surfaces.
    pub backs: f32,
}

impl Orbit {
    /// Views in which the unit sphere fills a picture of `size` x `size` pixels, give or take a third.
    pub fn new(seed: u64, lighting: &Lighting, size: usize) -> Self {
        Self {
            seed,
            lighting: lighting.clone(),
            size,
            smallest: None,
            bounds: Sphere::UNIT,
            distance: [0.72, 1.1],
            judged_distance: 1.01,
            moment: Moment::default(),
            backs: 0.0,
        }
    }
}

impl Orbit {
    /// Width and height of a picture.
    fn size_of(&self, set: Set, index: u64) -> usize {
        let Some(smallest) = self.smallest.filter(|s| *s < self.size && set != Set::Report) else {
            return self.size;
        };
        let share = match set {
            Set::Train => f64::from(Rng::new(self.seed, STREAM_SIZE + index).next_f32()),
            Set::HeldOut | Set::Report => (SPREAD * index as f64).fract(),
        };
        let (least, most) = (smallest as f64, self.size as f64);
        ((most * (least / most).powf(share)).round() as usize).clamp(smallest, self.size)
    }
}

impl Views for Orbit {
    fn setup(&self, set: Set, index: u64, count: u64) -> Setup {
        let stream = match set {
            Set::Train => STREAM_TRAIN,
            Set::HeldOut => STREAM_HELD_OUT,
            Set::Report => STREAM_REPORT,
        };
        let mut rng = Rng::new(self.seed, stream + index);
        let Sphere { center, radius } = self.bounds;
        let target = Vec3::from_array(center.to_array());
        let framing = radius / HALF_TANGENT.atan().sin();
        let [nearest, farthest] = self.distance;
        let (direction, distance) = match set {
            Set::Train => (sphere(&mut rng), framing * rng.uniform(nearest, farthest)),
            Set::HeldOut | Set::Report => (
                fibonacci(index, count, if set == Set::Report { 0.7 } else { 2.1 }),
                framing * self.judged_distance,
            ),
        };
        let eye = target + direction * distance;
        let mut camera = Camera::look_at(
            eye,
            target,
            if set == Set::Train { sphere(&mut rng) } else { Vec3::Y },
            2.0 * HALF_TANGENT.atan(),
            1.0,
            0.01 * distance,
            distance + 1.5 * radius,
        );
        if set == Set::Train {
            let shift = radius * glam::vec3(rng.uniform(-0.12, 0.12), rng.uniform(-0.12, 0.12), 0.0);
            camera.view = glam::Mat4::from_translation(shift) * camera.view;
            camera.eye = camera.view.inverse().transform_point3(Vec3::ZERO);
        }
        let lights = lights(&mut rng, &self.bounds, direction, &self.lighting, index);
        let (width, height) = [self.size_of(set, index); 2].into();
        let backs = set == Set::Train && Rng::new(self.seed, STREAM_BACKS + index).next_f32() < self.backs;
        Setup { camera: camera.into(), lights, moment: self.moment, width, height, picture: None, backs }
    }
}

fn lights(
    rng: &mut Rng,
    around: &Sphere,
    towards_camera: Vec3,
    lighting: &Lighting,
    index: u64,
) -> ViewLights {
    match lighting {
        Lighting::Mixed if index.is_multiple_of(2) => {
            lights(rng, around, towards_camera, &Lighting::Environment(studio()), index)
        }
        Lighting::Mixed | Lighting::Point => {
            // Cosine-weighted about the camera's direction.
            let (s, t) = towards_camera.any_orthonormal_pair();
            let (u, a) = (rng.uniform(0.0, 1.0), rng.uniform(0.0, std::f32::consts::TAU));
            let r = u.sqrt();
            let d = s * (r * a.cos()) + t * (r * a.sin()) + towards_camera * (1.0 - u).max(0.0).sqrt();
            let distance = 3.0 * around.radius;
            let irradiance = rng.uniform(2.0, 3.2);
            let p = d * distance;
            let intensity = Vec3f::splat(irradiance * distance * distance);
            ViewLights(vec![
                ViewLight::Point { position: around.center + vec3(p.x, p.y, p.z), intensity },
                ViewLight::Ambient { radiance: Vec3f::splat(rng.uniform(0.1, 0.35)) },
            ])
        }
        Lighting::Environment(map) => {
            let yaw = rng.uniform(0.0, std::f32::consts::TAU);
            ViewLights(vec![ViewLight::Environment { map: map.clone(), yaw }])
        }
    }
}

fn sphere(rng: &mut Rng) -> Vec3 {
    let d: Vec3f = uniform_sphere([rng.next_f32(), rng.next_f32()]);
    Vec3::new(d.x, d.y, d.z)
}

/// `count` cameras in a spiral around a sphere, which they see whole, from above to below.
pub fn views_around(center: Vec3, radius: f32, count: usize) -> Vec<View> {
    const FOV: f32 = 0.7;
    let view = |k: usize| {
        let y = 1.0 - 2.0 * (k as f32 + 0.5) / count as f32;
        let (turn, r) = (2.4 * k as f32, (1.0 - y * y).sqrt());
        let distance = radius / (0.5 * FOV).sin();
        let eye = center + distance * Vec3::new(r * turn.cos(), y, r * turn.sin());
        View::pinhole(&Camera::look_at(eye, center, Vec3::Y, FOV, 1.0, 1e-3 * distance, 4.0 * distance))
    };
    (0..count).map(view).collect()
}

fn fibonacci(index: u64, count: u64, turn: f32) -> Vec3 {
    let y = 1.0 - 2.0 * ((index % count.max(1)) as f32 + 0.5) / count.max(1) as f32;
    let a = index as f32 * (std::f32::consts::PI * (3.0 - 5.0f32.sqrt())) + turn;
    let r = (1.0 - y * y).max(0.0).sqrt();
    Vec3::new(r * a.cos(), y, r * a.sin())
}

/// How a candidate is sampled in the pictures of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sampling {
    /// Samples per axis of a pixel.
    pub per_axis: usize,
    /// Each triangle is shaded once in a pixel, with the texture footprint of the pixel; else each sample is.
    pub shade_per_pixel: bool,
}

impl Sampling {
    /// Every sample is shaded. With one sample the candidate's texture filter would be fitted to that of the reference,
    /// and the result be too sharp in any renderer that takes more.
    pub const SUPERSAMPLED: Self = Self { per_axis: 2, shade_per_pixel: false };
    /// As graphics hardware draws: visibility by several samples, shading once per pixel and triangle.
    pub const ENGINE: Self = Self { per_axis: 4, shade_per_pixel: true };
}

/// Largest radiance of the noise behind the asset in the pictures of a fit.
pub(crate) const BACKGROUND_MAX: f32 = 0.8;

/// A view with its reference picture.
#[derive(Clone, Debug)]
pub struct Shot {
    /// The camera.
    pub camera: ViewCamera,
    /// The finished picture that the view belongs to, where views come with pictures.
    pub picture: Option<usize>,
    /// Number of the draw: what is random about the picture follows from it.
    pub number: u64,
    /// The lights.
    pub lights: ViewLights,
    /// The moment of its animation: a model that moves is drawn as it is then.
    pub moment: Moment,
    /// Columns of the picture.
    pub width: usize,
    /// Rows of the picture.
    pub height: usize,
    /// How the candidate is sampled.
    pub sampling: Sampling,
    /// Whether backs of single-sided surfaces are drawn, too ([`Setup::backs`]).
    pub backs: bool,
    /// The picture of the reference, linear premultiplied RGBA, `[H*W*4]`; other shots may show it, too.
    pub shown: Arc<Image>,
    /// Draws the background: three numbers per pixel, each up to .8.
    pub noise: Rng,
}

/// What a candidate is drawn over and compared with. Both are put together where they are used: a device makes its own.
#[derive(Clone, Debug)]
pub struct Composite {
    /// Radiance behind the asset, the same for both images, `[H*W]`.
    pub background: Vec<[f32; 3]>,
    /// The reference over the background, `[H*W]`; the fourth number is its coverage.
    pub reference: Vec<[f32; 4]>,
}

impl Shot {
    /// A reference picture (linear, premultiplied RGBA) before noise, which supervises coverage.
    ///
    /// # Panics
    /// If the picture does not have four channels.
    pub fn new(
        setup: &Setup,
        picture: impl Into<Arc<Image>>,
        sampling: Sampling,
        seed: u64,
        index: u64,
    ) -> Self {
        let shown = picture.into();
        assert_eq!(shown.channels, 4, "a premultiplied RGBA picture");
        Self {
            camera: setup.camera,
            picture: setup.picture,
            number: index,
            lights: setup.lights.clone(),
            moment: setup.moment,
            width: shown.width,
            height: shown.height,
            sampling,
            backs: setup.backs,
            shown,
            noise: Rng::new(seed, STREAM_BACKGROUND + index),
        }
    }

    /// Radiance behind the asset, `[H*W]`.
    pub fn background(&self) -> Vec<[f32; 3]> {
        let mut rng = self.noise.clone();
        let pixel = |_| std::array::from_fn(|_| rng.uniform(0.0, BACKGROUND_MAX));
        (0..self.shown.pixels()).map(pixel).collect()
    }

    /// Background and reference.
    pub fn over_noise(&self) -> Composite {
        let background = self.background();
        let over = |(p, b): (&[f32], &[f32; 3])| {
            let t = 1.0 - p[3];
            [p[0] + t * b[0], p[1] + t * b[1], p[2] + t * b[2], p[3]]
        };
        let reference = self.shown.data.chunks_exact(4).zip(&background).map(over).collect();
        Composite { background, reference }
    }
}

#[cfg(test)]
mod tests;
