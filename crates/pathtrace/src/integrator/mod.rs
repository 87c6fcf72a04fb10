//! Estimators of the radiance that arrives along a ray.

mod absorbers;
mod emission;
mod first;
pub(crate) mod medium;
mod next_event;
pub(crate) mod path;
mod sink;
mod split;
pub(crate) mod uniform;
mod visibility;

pub use sink::{
    AovSink, Contribution, Found, MediaFlight, PathVertex, PictureSink, ShadowFlight, Sink, SurfaceVisit,
    TrainingSink, TrainingVertex,
};

use crate::random::PathRandom;
use crate::world::{World, WorldRay};
use photofit_scalar::{Vec3f, vec3};

/// Which directions a path looks for light in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Strategy {
    /// Next-event estimation and BSDF sampling, weighted by the power heuristic.
    #[default]
    Mis,
    /// Next-event estimation alone; delta lobes are followed.
    Light,
    /// BSDF sampling alone; lights without a surface are sampled.
    Bsdf,
}

/// What bounds a path, and how it looks for light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PathOptions {
    /// Most scattering events of a path: 0 shows emission alone, 1 direct light.
    pub max_depth: u32,
    /// Scattering events after which Russian roulette may end a path whose throughput is below a half.
    pub roulette_depth: u32,
    /// Where light is looked for.
    pub strategy: Strategy,
    /// The camera sees the environment; else its background is transparent.
    pub show_environment: bool,
    /// The camera sees surfaces that emit; else what lies behind them.
    pub show_emitters: bool,
}

impl Default for PathOptions {
    /// 16 events, roulette from the first on, all strategies, everything shown.
    fn default() -> Self {
        Self {
            max_depth: 16,
            roulette_depth: 1,
            strategy: Strategy::Mis,
            show_environment: true,
            show_emitters: true,
        }
    }
}

/// What is found along a camera ray.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct PathSample {
    /// Radiance.
    pub(crate) radiance: Vec3f,
    /// Part of it that was scattered at most once.
    pub(crate) direct: Vec3f,
    /// 1 where the camera sees something.
    pub(crate) alpha: f32,
    /// The first surface, if it was asked for.
    pub(crate) first: FirstHit,
    /// Contributions that were left out because they were not finite.
    pub(crate) not_finite: u32,
}

/// The first surface that a camera ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstHit {
    /// Its point, in the render frame; not finite where there is none.
    pub p: Vec3f,
    /// Unit geometric normal on the viewer's side.
    pub ng: Vec3f,
    /// Unit shading normal on the viewer's side.
    pub ns: Vec3f,
    /// Part of uniform light that it reflects.
    pub albedo: Vec3f,
    /// Index of the instance, or `u32::MAX`.
    pub instance: u32,
}

impl Default for FirstHit {
    fn default() -> Self {
        Self {
            p: Vec3f::splat(f32::INFINITY),
            ng: Vec3f::zero(),
            ns: Vec3f::zero(),
            albedo: Vec3f::zero(),
            instance: u32::MAX,
        }
    }
}

/// One path.
pub(crate) type Kernel = fn(&World, &WorldRay, &PathRandom, &PathOptions) -> PathSample;

/// `exp` per channel.
#[inline(always)]
pub(crate) fn exp(v: Vec3f) -> Vec3f {
    vec3(v.x.exp(), v.y.exp(), v.z.exp())
}

/// Largest channel.
#[inline(always)]
pub(crate) fn brightest(v: Vec3f) -> f32 {
    v.x.max(v.y).max(v.z)
}
