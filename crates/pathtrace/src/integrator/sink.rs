//! What a path reports: a sink receives every contribution of light and every vertex, in the order of the path.
//!
//! The walk of a path (`path`) is written once over a sink. Sinks of this crate: the picture, the auxiliary images of
//! the first surface, and vertices with estimates of the radiance that arrives there, to train direction samplers with.

use super::FirstHit;
use super::absorbers::Absorbers;
use crate::light::LightOrigin;
use crate::volume::{MediumRef, Segment};
use crate::world::{Interaction, SurfaceMaterial};
use photofit_scalar::Vec3f;

/// How the light of a contribution was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Found {
    /// A light was chosen and connected to a vertex (next-event estimation).
    NextEvent,
    /// The path met a surface that emits.
    Emission,
    /// The path left the world.
    Environment,
    /// A medium on the way of the path emitted it; a part of a flight, at most up to its collision.
    Medium,
}

/// Light that a path adds to the radiance of its camera ray.
///
/// With `local = scattering * radiance * transmittance * weight / density`, where `density` is [`Self::pdf`] for
/// [`Found::NextEvent`] and 1 otherwise, [`Self::value`] is `throughput * local` up to rounding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contribution {
    /// How it was found.
    pub found: Found,
    /// Scattering events between the light and the camera: 0 for light that the camera sees directly.
    pub depth: u32,
    /// Throughput of the path at the vertex that adds the light: what scattering, media and roulette left so far.
    pub throughput: Vec3f,
    /// `f |cos theta_i|` of the surface, or the phase function, towards the light for [`Found::NextEvent`]; else 1.
    pub scattering: Vec3f,
    /// Radiance of the light; the irradiance on a facing surface for lights without a surface.
    pub radiance: Vec3f,
    /// What media and absorbing surfaces on the shadow ray of [`Found::NextEvent`] let through; for [`Found::Medium`] what absorbing
    /// solids do, times the length of the way or the transmittance over the density of the point; else 1 (what lies before the vertex is in the throughput).
    pub transmittance: Vec3f,
    /// Weight of multiple importance sampling.
    pub weight: f32,
    /// Density with which the direction was chosen, 1/sr: of the light for [`Found::NextEvent`], else of the last
    /// scattering event (0 at the camera).
    pub pdf: f32,
    /// Unit vector from the last vertex towards the light.
    pub wi: Vec3f,
    /// Which light it is.
    pub light: LightOrigin,
    /// Index of the instance that scatters the light of [`Found::NextEvent`]; `u32::MAX` in media, and else.
    pub instance: u32,
    /// What is added to the radiance of the camera ray.
    pub value: Vec3f,
}

/// A scattering event: a path arrived against `wo` and goes on along `wi`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathVertex {
    /// The point, in the render frame ([`crate::World::to_world`]).
    pub position: Vec3f,
    /// Unit shading normal; zero in media.
    pub normal: Vec3f,
    /// Unit vector towards the viewer.
    pub wo: Vec3f,
    /// Unit vector along which the path goes on.
    pub wi: Vec3f,
    /// Density of `wi`, 1/sr; 1 for delta lobes.
    pub pdf: f32,
    /// The direction comes from a delta lobe.
    pub delta: bool,
    /// Factor of the throughput: `f |cos theta_i| / pdf`.
    pub weight: Vec3f,
    /// Throughput before the event.
    pub throughput: Vec3f,
    /// Scattering events before this one.
    pub depth: u32,
    /// Index of the instance; `u32::MAX` in media.
    pub instance: u32,
}

/// A surface that a path has reached, before it finds or scatters light there.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceVisit<'a> {
    /// The point.
    pub interaction: &'a Interaction,
    /// Unit vector towards the viewer.
    pub wo: Vec3f,
    /// What the surface does there.
    pub(crate) material: &'a SurfaceMaterial<'a>,
}

/// A part of a path in the render frame, up to a collision with a medium or to the next surface.
#[derive(Clone, Copy, Debug)]
pub struct MediaFlight {
    /// Where it starts.
    pub(crate) origin: Vec3f,
    /// Unit vector.
    pub(crate) direction: Vec3f,
    /// Distance that was flown.
    pub(crate) length: f32,
    /// Distance at which it would have ended without collisions.
    pub(crate) end: f32,
    /// The medium that it collided with.
    pub(crate) collided: Option<MediumRef>,
    /// The bounded medium that it is in.
    pub(crate) bounded: Option<u32>,
    /// Throughput of the path before it.
    pub(crate) throughput: Vec3f,
    /// Scattering events before it.
    pub(crate) depth: u32,
    /// What collides may scatter: the path has events left.
    pub(crate) scatters: bool,
    /// The absorbing solids around it, and the absorption of the innermost.
    pub(crate) solids: Absorbers,
    pub(crate) absorption: Vec3f,
}

/// A part of a shadow ray in a medium, in the render frame.
#[derive(Clone, Copy, Debug)]
pub struct ShadowFlight {
    pub(crate) medium: MediumRef,
    pub(crate) along: Segment,
}

/// Receives what a path finds. All calls are resolved at compile time: what a sink leaves empty costs nothing.
pub trait Sink {
    /// Whether [`Self::first`] is called.
    const FIRST: bool = false;

    /// The surface that the camera sees; not called where there is none. Where it sees through blended surfaces, a second
    /// call at the end of the path replaces the first: with the surface of which most is seen.
    #[inline(always)]
    fn first(&mut self, _surface: &FirstHit) {}

    /// Whether [`Self::surface`], [`Self::absorbed`] and [`Self::shadow_absorbed`] are called, and light of a chosen
    /// direction is reported though none of it is scattered.
    const SURFACES: bool = false;

    /// The path has reached a surface: the emission, the light chosen at it and the scattering that are reported next,
    /// up to the next call, belong to it (those in media aside).
    #[inline(always)]
    fn surface(&mut self, _visit: &SurfaceVisit<'_>) {}

    /// Whether [`Self::splits`] is called.
    const SPLITS: bool = false;

    /// Into how many the path is split at the first surface that may scatter it, at least 1 (path splitting); each carries an equal
    /// share of the light.
    #[inline(always)]
    fn splits(&self, _first: &SurfaceVisit<'_>) -> u32 {
        1
    }

    /// One of several splits begins at the first surface, whose emission and next-event estimation are reported already; what
    /// follows, up to the next call or the end, belongs to it.
    #[inline(always)]
    fn split(&mut self) {}

    /// A length of the way, in the render frame, lay in the absorbing solid of a material; [`Self::attenuate`] with its
    /// factor follows.
    #[inline(always)]
    fn absorbed(&mut self, _material: u32, _length: f32) {}

    /// A length of the shadow ray of the next [`Found::NextEvent`], or of the way to the next [`Found::Medium`], in the render frame, lies in the absorbing solid of
    /// a material.
    #[inline(always)]
    fn shadow_absorbed(&mut self, _material: u32, _length: f32) {}

    /// Whether [`Self::flight`] and [`Self::shadow_flight`] are called.
    const MEDIA: bool = false;

    /// The path has flown through media, whose own light is told already: to a collision, whose contributions and vertex follow, to a surface, or out of
    /// the world. It is reported before what solids absorbed on the way.
    #[inline(always)]
    fn flight(&mut self, _flight: &MediaFlight) {}

    /// A part of the shadow ray of the next [`Found::NextEvent`], or of the way to the next [`Found::Medium`], lies in a medium; the latter
    /// may reach beyond it.
    #[inline(always)]
    fn shadow_flight(&mut self, _flight: &ShadowFlight) {}

    /// A scattering event.
    #[inline(always)]
    fn vertex(&mut self, _vertex: &PathVertex) {}

    /// The throughput is multiplied with a factor that belongs to no vertex: absorption, a flight through a medium,
    /// survival of roulette, a surface that is passed straight through.
    #[inline(always)]
    fn attenuate(&mut self, _factor: Vec3f) {}

    /// Light. Lights that something keeps from the vertex are reported with none arriving, or not at all
    /// ([`photofit_sampling::DirectionSampler::COSTLY`]).
    fn contribution(&mut self, light: &Contribution);

    /// A contribution or a throughput was not finite; it is left out.
    #[inline(always)]
    fn not_finite(&mut self) {}
}

/// Sums up the radiance of one path.
#[derive(Clone, Copy, Debug, Default)]
pub struct PictureSink {
    /// The radiance.
    pub radiance: Vec3f,
    /// Contributions that were left out because they were not finite.
    pub not_finite: u32,
}

impl Sink for PictureSink {
    #[inline(always)]
    fn contribution(&mut self, light: &Contribution) {
        self.radiance += light.value;
    }

    #[inline(always)]
    fn not_finite(&mut self) {
        self.not_finite += 1;
    }
}

/// The picture with what auxiliary images show: the first surface, and light that was scattered at most once.
#[derive(Clone, Copy, Debug, Default)]
pub struct AovSink {
    /// The radiance.
    pub picture: PictureSink,
    /// The part of it that was scattered at most once.
    pub direct: Vec3f,
    /// The first surface.
    pub first: FirstHit,
}

impl Sink for AovSink {
    const FIRST: bool = true;

    #[inline(always)]
    fn first(&mut self, surface: &FirstHit) {
        self.first = *surface;
    }

    #[inline(always)]
    fn contribution(&mut self, light: &Contribution) {
        self.picture.contribution(light);
        if light.depth <= 1 {
            self.direct += light.value;
        }
    }

    #[inline(always)]
    fn not_finite(&mut self) {
        self.picture.not_finite();
    }
}

/// A scattering event with an estimate of the radiance that arrives along its direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainingVertex {
    /// The event.
    pub event: PathVertex,
    /// Unbiased estimate of the radiance that arrives at the vertex from `wi`.
    pub radiance: Vec3f,
    /// Product of the factors between the event and the end of the path so far.
    since: Vec3f,
}

/// Keeps the vertices of paths, each with an estimate of the radiance that arrives from the direction taken.
///
/// Light that the path meets right after a vertex counts in full there, whatever its weight in the picture (the vertex
/// sees it by this direction alone), unless the sink is [`Self::weighted`]. Call [`Self::begin`] before each path.
#[derive(Clone, Debug, Default)]
pub struct TrainingSink {
    /// The vertices of all paths, in order.
    pub vertices: Vec<TrainingVertex>,
    /// See [`Self::weighted`].
    weighted: bool,
    /// Where those of the present path begin.
    start: usize,
}

impl TrainingSink {
    /// A sink in which light met right after a vertex counts with its weight in the picture: the part that next-event
    /// estimation leaves to directions. [`TrainingVertex::radiance`] is then an estimate of that part.
    pub fn weighted() -> Self {
        Self { weighted: true, ..Self::default() }
    }

    /// Begins a new path: the vertices so far are complete.
    pub fn begin(&mut self) {
        self.start = self.vertices.len();
    }

    #[inline]
    fn scale(&mut self, factor: Vec3f) {
        self.vertices[self.start..].iter_mut().for_each(|v| v.since = v.since.mul(factor));
    }
}

impl Sink for TrainingSink {
    fn vertex(&mut self, vertex: &PathVertex) {
        self.scale(vertex.weight);
        let (radiance, since) = (Vec3f::zero(), Vec3f::splat(1.0));
        self.vertices.push(TrainingVertex { event: *vertex, radiance, since });
    }

    fn attenuate(&mut self, factor: Vec3f) {
        self.scale(factor);
    }

    fn contribution(&mut self, light: &Contribution) {
        let density = if light.found == Found::NextEvent { light.pdf } else { 1.0 };
        let arrives = light.scattering.mul(light.radiance).mul(light.transmittance) * (1.0 / density);
        // All vertices for light of a surface or the environment but the last see it by both strategies.
        let (last, before) = match self.vertices[self.start..].split_last_mut() {
            Some((last, before)) => (last, before),
            None => return,
        };
        for v in before {
            v.radiance += v.since.mul(arrives) * light.weight;
        }
        let full = light.found != Found::NextEvent && !self.weighted;
        let weight = if full { 1.0 } else { light.weight };
        last.radiance += last.since.mul(arrives) * weight;
    }
}

impl<S: Sink> Sink for &mut S {
    const FIRST: bool = S::FIRST;
    const SPLITS: bool = S::SPLITS;

    #[inline(always)]
    fn splits(&self, first: &SurfaceVisit<'_>) -> u32 {
        (**self).splits(first)
    }

    #[inline(always)]
    fn split(&mut self) {
        (**self).split();
    }

    const SURFACES: bool = S::SURFACES;
    const MEDIA: bool = S::MEDIA;

    #[inline(always)]
    fn flight(&mut self, flight: &MediaFlight) {
        (**self).flight(flight);
    }

    #[inline(always)]
    fn shadow_flight(&mut self, flight: &ShadowFlight) {
        (**self).shadow_flight(flight);
    }

    #[inline(always)]
    fn surface(&mut self, visit: &SurfaceVisit<'_>) {
        (**self).surface(visit);
    }

    #[inline(always)]
    fn absorbed(&mut self, material: u32, length: f32) {
        (**self).absorbed(material, length);
    }

    #[inline(always)]
    fn shadow_absorbed(&mut self, material: u32, length: f32) {
        (**self).shadow_absorbed(material, length);
    }

    #[inline(always)]
    fn first(&mut self, surface: &FirstHit) {
        (**self).first(surface);
    }

    #[inline(always)]
    fn vertex(&mut self, vertex: &PathVertex) {
        (**self).vertex(vertex);
    }

    #[inline(always)]
    fn attenuate(&mut self, factor: Vec3f) {
        (**self).attenuate(factor);
    }

    #[inline(always)]
    fn contribution(&mut self, light: &Contribution) {
        (**self).contribution(light);
    }

    #[inline(always)]
    fn not_finite(&mut self) {
        (**self).not_finite();
    }
}
