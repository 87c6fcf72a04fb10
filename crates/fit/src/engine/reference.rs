//! References: what answers (camera, lights, moment, size) with a picture.
//!
//! To the fit the renderer of the reference is a black box: it gives pictures, no gradients. Path traced pictures hold
//! what a rasterizer leaves out (shadows, light between surfaces); the candidate takes up in its maps what of it does not
//! depend on the light. What the candidate cannot express at all (coats, sheen, glass) is left out of the pictures that
//! it is compared with, and comes back with the export.

use super::animated::{Animated, WorldPose};
use super::asset::Normalised;
use super::classes::drawn;
use super::frame::FitFrame;
use super::not_finite::NotFinite;
use super::views::{Moment, Setup, Sphere};
use crate::FitError;
use crate::scene_render::SceneRenderer;
use glam::{DAffine3, Quat};
use photofit_image::{Image, downsample};
use photofit_pathtrace::{
    EnvironmentMap, LightSource, Parts, PathOptions, RenderOptions, Renderer, World, WorldOptions,
};
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::{FlatScene, Scene, SurfaceLibrary};
use photofit_shading::{Energy, Light};
use std::borrow::Cow;
use std::sync::{Mutex, PoisonError};

/// What rough surfaces do with the light that single scattering loses, on all sides of a fit: reference, candidate and
/// judge. glTF's own reference loses it.
pub const ENERGY: Energy = Energy::Single;
/// Samples per axis of a rasterized pixel, where nothing else is asked for.
pub(crate) const SUPERSAMPLE: usize = 4;
/// Most samples per axis that the rasterizer takes at once.
const MOST_AT_ONCE: usize = 8;
/// Samples of a path traced pixel, where nothing else is asked for.
pub const SAMPLES: u32 = 64;
/// Rows of the maps that path tracing takes from a prefiltered environment.
const ROWS: usize = 128;

/// What the pictures of a reference are, for plans, judgements and reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReferenceKind {
    /// How they are made, in words: what follows `pictures of the asset are`.
    pub name: &'static str,
    /// Whether they hold shadows and light between surfaces, which go into the maps of what is fitted to them.
    pub indirect_light: bool,
    /// Whether they show the backs of single-sided surfaces in views that ask for them ([`Setup::backs`]).
    pub draws_backs: bool,
    /// Samples of a pixel, where they are path traced.
    pub spp: Option<u32>,
}

impl ReferenceKind {
    /// As the candidate's: direct light without shadows.
    pub const RASTERIZED: Self =
        Self { name: "rasterized", indirect_light: false, draws_backs: true, spp: None };
    /// Finished pictures; what light they hold is not known.
    pub const GIVEN: Self = Self { name: "given", indirect_light: false, draws_backs: false, spp: None };

    /// With all light, by so many samples of a pixel.
    pub fn path_traced(spp: u32) -> Self {
        Self { name: "path traced", indirect_light: true, draws_backs: false, spp: Some(spp) }
    }
}

/// Samples per axis that pictures of `size` pixels a side need of a reference: the smaller they are, the more of its
/// detail falls into one pixel.
pub fn samples_for(size: usize) -> usize {
    match size {
        0..=64 => 16,
        65..=160 => 8,
        _ => SUPERSAMPLE,
    }
}

/// A picture of a reference.
#[derive(Clone, Debug)]
pub struct ReferencePicture {
    /// Linear RGBA, premultiplied.
    pub image: Image,
    /// Noise: standard deviation of a pixel relative to its value, root mean square over the picture; 0 for clean ones.
    pub noise: Option<f64>,
    /// Two pictures with noise of their own, whose mean it is, where it was made so.
    pub halves: Option<Box<[Image; 2]>>,
}

impl ReferencePicture {
    /// A picture without noise.
    pub fn clean(image: Image) -> Self {
        Self { image, noise: Some(0.0), halves: None }
    }
}

/// What a fit is compared with, in the normalised frame.
pub trait Reference: Sync {
    /// What its pictures are.
    fn kind(&self) -> ReferenceKind;

    /// The picture of a view.
    ///
    /// # Errors
    /// If it cannot be made.
    fn picture(&self, setup: &Setup) -> Result<ReferencePicture, FitError>;

    /// As [`Self::picture`]; `None` where that takes long and `stop`, which is asked meanwhile, says true.
    ///
    /// # Errors
    /// As [`Self::picture`].
    fn picture_unless(
        &self,
        setup: &Setup,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<ReferencePicture>, FitError> {
        let _ = stop;
        self.picture(setup).map(Some)
    }

    /// A sphere around what the pictures show at a moment.
    fn bounds(&self, moment: Moment) -> Sphere;

    /// Where its pictures are drawn and why there, for the plan; `None` where nothing is chosen.
    fn where_drawn(&self) -> Option<String> {
        None
    }

    /// What it holds on a device and may give back for a while.
    #[cfg(feature = "gpu")]
    fn device_memory(&self) -> Option<super::gpu::DeviceMemory> {
        None
    }

    /// Has the CPU draw all pictures from now on, for a reason.
    fn leave_device(&self, why: &str) {
        let _ = why;
    }
}

/// An asset drawn by the rasterizer: direct light without shadows.
#[derive(Clone, Copy, Debug)]
pub struct Rasterized<'a> {
    flat: &'a FlatScene,
    library: &'a SurfaceLibrary,
    animated: Option<&'a Animated<'a>>,
    samples: Samples,
}

/// Samples per axis of a pixel.
#[derive(Clone, Copy, Debug)]
enum Samples {
    All(usize),
    /// As many as a picture of its size needs ([`samples_for`]), over this.
    BySize(usize),
}

impl<'a> Rasterized<'a> {
    /// Pictures of a flattened scene in the normalised frame.
    pub fn new(flat: &'a FlatScene, library: &'a SurfaceLibrary) -> Self {
        Self { flat, library, animated: None, samples: Samples::All(SUPERSAMPLE) }
    }

    /// The same at the moments of an animated asset's animations, too.
    #[must_use]
    pub fn animated(self, animated: &'a Animated<'a>) -> Self {
        Self { animated: Some(animated), ..self }
    }

    /// The same with `samples` samples per axis of a pixel: 1, 2, 4, 8 or 16. With one it is what an engine shows.
    #[must_use]
    pub fn sampled(self, samples: usize) -> Self {
        Self { samples: Samples::All(samples), ..self }
    }

    /// The same with as many samples per axis as a picture of its size needs ([`samples_for`]), `fewer` times less.
    #[must_use]
    pub fn sampled_by_size(self, fewer: usize) -> Self {
        Self { samples: Samples::BySize(fewer), ..self }
    }

    /// Samples per axis of a pixel of a picture.
    pub(crate) fn samples_of(&self, setup: &Setup) -> usize {
        match self.samples {
            Samples::All(samples) => samples,
            Samples::BySize(fewer) => (samples_for(setup.width.max(setup.height)) / fewer.max(1)).max(1),
        }
    }

    /// What is drawn, as it stands.
    #[cfg(feature = "gpu")]
    pub(crate) fn asset(&self) -> (&'a FlatScene, &'a SurfaceLibrary) {
        (self.flat, self.library)
    }
}

impl Reference for Rasterized<'_> {
    fn kind(&self) -> ReferenceKind {
        ReferenceKind::RASTERIZED
    }

    fn picture(&self, setup: &Setup) -> Result<ReferencePicture, FitError> {
        let posed = moving(self.animated, setup.moment)?.map(|a| a.flat(setup.moment)).transpose()?;
        let renderer = SceneRenderer::new(posed.as_deref().unwrap_or(self.flat), self.library);
        let renderer = if setup.backs { renderer.with_backs() } else { renderer };
        let lights = setup.lights.lights();
        // Many samples are those of several smaller pixels.
        let samples = self.samples_of(setup);
        let parts = (samples / MOST_AT_ONCE).max(1);
        let (w, h) = (setup.width * parts, setup.height * parts);
        let image = renderer.render(&setup.camera.pinhole(), &lights, w, h, samples / parts);
        Ok(ReferencePicture::clean(if parts > 1 { downsample(&image, parts) } else { image }))
    }

    fn bounds(&self, moment: Moment) -> Sphere {
        self.animated.filter(|_| moment.animation.is_some()).map_or(Sphere::UNIT, |a| a.bounds(moment))
    }
}

/// Who knows the asset at a moment; `None` where it stands still.
fn moving<'a>(
    animated: Option<&'a Animated<'a>>,
    moment: Moment,
) -> Result<Option<&'a Animated<'a>>, FitError> {
    match (animated, moment.animation) {
        (_, None) => Ok(None),
        (Some(animated), Some(_)) => Ok(Some(animated)),
        (None, Some(a)) => {
            let rule = format!("names animation {a}; the reference stands still");
            Err(FitError::Setting { field: "moment", rule })
        }
    }
}

/// What of an asset's materials path traced pictures hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MaterialFeatures {
    /// What a candidate can express: the core of glTF; surfaces that transmit light are blended.
    Core,
    /// Everything that the file means.
    All,
}

/// No moment.
const UNKNOWN: Moment = Moment { animation: Some(usize::MAX), time: 0.0 };

/// An asset drawn by the path tracer, with all light.
#[derive(Debug)]
pub struct PathTraced<'a> {
    /// Behind a lock, since each picture has lights of its own, and a moment.
    world: Mutex<(World, Moment)>,
    animated: Option<&'a Animated<'a>>,
    not_finite: NotFinite,
    seed: u64,
    spp: u32,
    /// Which of several in whose pictures no noise is the same, where they are made in halves.
    apart: Option<u64>,
}

/// Samples of a pixel that two halves need.
pub(crate) const FEWEST_IN_HALVES: u32 = 2;
/// Tells the seeds of halves from others.
const HALVES: u64 = 0x5851_f42d_4c95_7f2d;

impl<'a> PathTraced<'a> {
    /// Pictures of a scene given in the frame of the asset `n`; lights of its own are left out.
    ///
    /// # Errors
    /// If the path tracer refuses the scene.
    pub fn new(
        scene: &Scene,
        n: &Normalised,
        features: MaterialFeatures,
        seed: u64,
    ) -> Result<Self, FitError> {
        let shown = features.of(scene);
        Ok(Self {
            world: Mutex::new((world(&shown, n.frame(), ENERGY)?, Moment::default())),
            animated: None,
            not_finite: n.not_finite.clone(),
            seed,
            spp: SAMPLES,
            apart: None,
        })
    }

    /// Pictures of a scene whose geometry lies in the frame of the asset `n` already; its materials are those of the asset.
    ///
    /// # Errors
    /// If the path tracer refuses the scene.
    pub fn in_frame(
        scene: &Scene,
        n: &Normalised,
        features: MaterialFeatures,
        seed: u64,
    ) -> Result<Self, FitError> {
        let shown = features.of(scene);
        let (identity, start) = (DAffine3::IDENTITY, Moment::default());
        let world = Mutex::new((placed_world(&shown, identity, n.frame().radius, ENERGY)?, start));
        let not_finite = n.not_finite.clone();
        Ok(Self { world, animated: None, not_finite, seed, spp: SAMPLES, apart: None })
    }

    /// The same at the moments of an animated asset's animations, too.
    #[must_use]
    pub fn animated(mut self, animated: &'a Animated<'a>) -> Self {
        let (world, shown) = self.world.get_mut().unwrap_or_else(PoisonError::into_inner);
        // What moves is to cost no more than its own hierarchy, in all pictures alike.
        world.keep_apart();
        *shown = UNKNOWN;
        Self { animated: Some(animated), ..self }
    }

    /// The same with `spp` samples of a pixel.
    #[must_use]
    pub fn sampled(self, spp: u32) -> Self {
        Self { spp, ..self }
    }

    /// The same as two pictures of half of the samples and their mean ([`ReferencePicture::halves`]), of two samples at
    /// least. Their noise is that of no picture of another number, so that none is near another by its noise.
    #[must_use]
    pub fn in_halves(self, number: u64) -> Self {
        Self { spp: self.spp.max(FEWEST_IN_HALVES), apart: Some(number), ..self }
    }

    /// A picture of the world as it stands, and its noise; `None` where it was stopped.
    fn rendered(
        &self,
        world: &World,
        setup: &Setup,
        (seed, spp): (u64, u32),
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<(Image, f64)>, FitError> {
        let options = RenderOptions {
            width: setup.width,
            height: setup.height,
            spp,
            seed,
            path: PathOptions { show_environment: false, ..PathOptions::default() },
            ..RenderOptions::default()
        };
        let mut renderer = Renderer::new(world, &setup.camera.view(), options)?;
        loop {
            let progress = renderer.pass(stop);
            if progress.done {
                self.not_finite.add(progress.not_finite);
                return Ok(Some((renderer.picture(), progress.noise)));
            }
            if stop() {
                return Ok(None);
            }
        }
    }
}

impl Reference for PathTraced<'_> {
    fn kind(&self) -> ReferenceKind {
        ReferenceKind::path_traced(self.spp)
    }

    fn picture(&self, setup: &Setup) -> Result<ReferencePicture, FitError> {
        Ok(self.picture_unless(setup, &|| false)?.expect("nothing stops it"))
    }

    fn picture_unless(
        &self,
        setup: &Setup,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<ReferencePicture>, FitError> {
        let lights = setup.lights.lights();
        let animated = moving(self.animated, setup.moment)?.or(self.animated);
        let mut world = self.world.lock().unwrap_or_else(PoisonError::into_inner);
        let (world, shown) = &mut *world;
        if let Some(animated) = animated.filter(|_| *shown != setup.moment) {
            let WorldPose { shapes, instances } = animated.parts(setup.moment)?;
            // Of a pose that is refused nothing is known.
            *shown = UNKNOWN;
            world.set_pose(shapes, &instances)?;
            *shown = setup.moment;
        }
        let (sources, environment) = path_lights(&lights);
        world.relight(&sources, environment)?;
        let Some(number) = self.apart else {
            let made = self.rendered(world, setup, (self.seed, self.spp), stop)?;
            return Ok(made.map(|(image, noise)| ReferencePicture {
                image,
                noise: Some(noise),
                halves: None,
            }));
        };
        // Views have noise of their own, so that a mean over them has less.
        let view = setup.camera.view().eye.to_array().map(f64::to_bits);
        let view = view.into_iter().fold(HALVES, |seed, x| photofit_sampling::hash(seed, self.seed, x));
        let half = |k: u64| {
            let seed = photofit_sampling::hash(view, number, k);
            let spp = if k == 0 { self.spp.div_ceil(2) } else { self.spp / 2 };
            self.rendered(world, setup, (seed, spp), stop)
        };
        let Some((first, noise)) = half(0)? else { return Ok(None) };
        let Some((second, other)) = half(1)? else { return Ok(None) };
        let mut image = first.clone();
        image.data.iter_mut().zip(&second.data).for_each(|(a, b)| *a = 0.5 * (*a + b));
        // Of the mean of two.
        let noise = Some(0.5 * noise.hypot(other));
        Ok(Some(ReferencePicture { image, noise, halves: Some(Box::new([first, second])) }))
    }

    fn bounds(&self, moment: Moment) -> Sphere {
        self.animated.filter(|_| moment.animation.is_some()).map_or(Sphere::UNIT, |a| a.bounds(moment))
    }
}

impl MaterialFeatures {
    /// A scene with these features of its materials.
    pub(crate) fn of(self, scene: &Scene) -> Cow<'_, Scene> {
        match self {
            Self::All => Cow::Borrowed(scene),
            Self::Core => {
                let mut scene = drawn(scene).into_owned();
                scene.materials.iter_mut().for_each(|m| m.extensions = None);
                Cow::Owned(scene)
            }
        }
    }
}

/// A scene in the frame of a fit; its own lights are left out, as by the rasterizer.
pub(crate) fn world(scene: &Scene, frame: FitFrame, energy: Energy) -> Result<World, FitError> {
    placed_world(scene, frame.transform(), frame.radius, energy)
}

/// A scene that `to_frame` puts into the frame of a fit, whose unit of length is `radius` of the units of its materials.
fn placed_world(scene: &Scene, to_frame: DAffine3, radius: f32, energy: Energy) -> Result<World, FitError> {
    let mut parts = Parts::from_scene(scene);
    parts.lights.clear();
    for instance in &mut parts.instances {
        instance.transform = to_frame * instance.transform;
    }
    parts.scale_densities(radius);
    // A world is never without light; every picture brings its own.
    parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(1.0)));
    let options = WorldOptions { energy, ..WorldOptions::default() };
    Ok(World::with_options(parts, options)?)
}

/// The lights of a picture as the path tracer takes them, which knows one environment: light from all around is added up.
pub(crate) fn path_lights(lights: &[Light<'_, f32>]) -> (Vec<LightSource>, Option<EnvironmentMap>) {
    let sources = lights.iter().filter_map(LightSource::of).collect();
    let (mut even, mut maps) = (None, Vec::new());
    for light in lights {
        match light {
            Light::Ambient { radiance } => even = Some(even.unwrap_or_else(Vec3f::zero) + *radiance),
            Light::Environment { map, rotation, scale } => maps.push((map, rotation, *scale)),
            _ => {}
        }
    }
    let environment = match (even, &maps[..]) {
        (None, []) => None,
        (Some(radiance), []) => Some(EnvironmentMap::constant(radiance)),
        (None, [(map, rotation, scale)]) => {
            let x = rotation.apply(vec3(1.0, 0.0, 0.0));
            let turn = Quat::from_rotation_y((-x.z).atan2(x.x));
            let mut out = EnvironmentMap::new(equirectangular(|d| map.specular(d, 0.0)));
            (out.scale, out.rotation) = (*scale, turn);
            Some(out)
        }
        (even, maps) => Some(EnvironmentMap::new(equirectangular(|d| {
            maps.iter().fold(even.unwrap_or_else(Vec3f::zero), |sum, (map, rotation, scale)| {
                sum + map.specular(rotation.invert(d), 0.0) * *scale
            })
        }))),
    };
    (sources, environment)
}

/// Radiance from all directions, laid out as [`EnvironmentMap`] says.
fn equirectangular(radiance: impl Fn(Vec3f) -> Vec3f) -> Image {
    let (width, height) = (2 * ROWS, ROWS);
    let texel = |i: usize| {
        let theta = ((i / width) as f32 + 0.5) / height as f32 * std::f32::consts::PI;
        let phi = (((i % width) as f32 + 0.5) / width as f32 - 0.5) * std::f32::consts::TAU;
        let d = vec3(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin());
        radiance(d).map(|x| x.max(0.0)).to_array()
    };
    let data: Vec<[f32; 3]> = (0..width * height).map(texel).collect();
    Image::from_data(width, height, 3, data.into_flattened())
}

#[cfg(test)]
mod agreement;
#[cfg(test)]
mod tests;
