//! The path tracer: next-event estimation and BSDF sampling with multiple importance sampling (Veach 1997), Russian
//! roulette, stochastic opacity, media.

use super::absorbers::Absorbers;
use super::first::{camera_sees, first_hit, seen_through};
use super::medium::Event;
use super::sink::{AovSink, Contribution, Found, PathVertex, PictureSink, Sink, SurfaceVisit};
use super::visibility::closest;
use super::{PathOptions, PathSample, Strategy, brightest, exp};
use crate::light::{Facing, LightOrigin, Receiver};
use crate::plan;
use crate::random::PathRandom;
use crate::world::{Interaction, SurfaceMaterial, SurfaceScattering, World, WorldHit, WorldRay};
use photofit_sampling::{DirectionSampler, ScatteringSampler, Vertex, power_heuristic};
use photofit_scalar::Vec3f;

/// One over the throughput below which roulette ends paths: error times time is least around it.
const ROULETTE_SCALE: f32 = 2.0;
/// Scattering events from which on no path is sure to go on, and the largest probability then: light is not caught in
/// glass or between mirrors for ever.
const ROULETTE_DEEP: u32 = 16;
const ROULETTE_MAX: f32 = 0.95;
/// In worlds with media, where light takes more events to get anywhere: the first event after which roulette may end a
/// path, with the throughput itself as the probability to go on.
const ROULETTE_DEPTH_IN_MEDIA: u32 = 4;
/// Boundaries that are not there, passed in a row; a path that meets more is cut.
const MAX_CROSSINGS: u32 = 1024;
/// Tells the random number of a pane from that of its coverage.
const PANE: u64 = 1 << 63;

/// How the direction of the present ray was chosen.
#[derive(Clone, Copy)]
pub(super) struct Departure {
    /// The vertex it left.
    pub(super) from: Receiver,
    /// Its density, 1/sr.
    pub(super) pdf: f32,
    /// No other strategy finds it: the camera, or a delta lobe.
    pub(super) only: bool,
}

/// The state of a path between two vertices.
pub(super) struct Path<'a, const F: u32, S, D> {
    pub(super) world: &'a World,
    pub(super) random: PathRandom,
    pub(super) options: &'a PathOptions,
    /// Chooses the directions at surfaces.
    pub(super) sampler: &'a D,
    /// Receives what the path finds.
    pub(super) sink: S,
    pub(super) ray: WorldRay,
    pub(super) throughput: Vec3f,
    /// Square of the relative indices of refraction crossed, and densities of directions over those of scattering alone:
    /// what roulette must not see.
    pub(super) unseen: f32,
    pub(super) last: Departure,
    /// The absorbing solids that it is in.
    pub(super) inside: Absorbers,
    /// The bounded medium that it is in.
    pub(super) medium: Option<u32>,
    /// Vertices whose numbers for a flight are used up.
    pub(super) flown: u32,
    pub(super) depth: u32,
    /// The numbers of the next direction are stratified together with those of the last one.
    pub(super) together: bool,
}

/// The picture's part of a path; what `F` lacks is not compiled in.
pub(crate) fn trace_picture<const F: u32>(
    world: &World,
    ray: &WorldRay,
    random: &PathRandom,
    options: &PathOptions,
) -> PathSample {
    trace_with::<F, _>(world, ray, random, options, &ScatteringSampler, false)
}

/// As [`trace_picture`], with what auxiliary images need.
pub(crate) fn trace_aovs<const F: u32>(
    world: &World,
    ray: &WorldRay,
    random: &PathRandom,
    options: &PathOptions,
) -> PathSample {
    trace_with::<F, _>(world, ray, random, options, &ScatteringSampler, true)
}

/// A path with directions of `sampler`; with what auxiliary images need if `aovs`.
#[inline(always)]
pub(crate) fn trace_with<const F: u32, D: DirectionSampler>(
    world: &World,
    ray: &WorldRay,
    random: &PathRandom,
    options: &PathOptions,
    sampler: &D,
    aovs: bool,
) -> PathSample {
    if aovs {
        let (alpha, sink) = walk::<F, _, _>(world, ray, random, options, sampler, AovSink::default());
        let (picture, direct, first) = (sink.picture, sink.direct, sink.first);
        return PathSample {
            radiance: picture.radiance,
            direct,
            alpha,
            first,
            not_finite: picture.not_finite,
        };
    }
    let (alpha, sink) = walk::<F, _, _>(world, ray, random, options, sampler, PictureSink::default());
    PathSample { radiance: sink.radiance, alpha, not_finite: sink.not_finite, ..PathSample::default() }
}

/// Walks a path from a camera ray and reports to the sink; what `F` lacks is not compiled in. Returns 1 if the camera sees
/// something, else 0, and the sink.
#[inline(always)]
pub(crate) fn walk<const F: u32, S: Sink, D: DirectionSampler>(
    world: &World,
    ray: &WorldRay,
    random: &PathRandom,
    options: &PathOptions,
    sampler: &D,
    sink: S,
) -> (f32, S) {
    let mut path = Path::<F, S, D>::new(world, ray, random, options, sampler, sink);
    let alpha = path.go_on(0);
    if F & plan::ALPHA != 0
        && S::FIRST
        && let Some(first) = seen_through::<F>(world, ray, options)
    {
        path.sink.first(&first);
    }
    (alpha, path.sink)
}

impl<'a, const F: u32, S: Sink, D: DirectionSampler> Path<'a, F, S, D> {
    /// A path at its start.
    #[inline(always)]
    pub(super) fn new(
        world: &'a World,
        ray: &WorldRay,
        random: &PathRandom,
        options: &'a PathOptions,
        sampler: &'a D,
        sink: S,
    ) -> Self {
        Self {
            world,
            random: *random,
            options,
            sampler,
            sink,
            ray: *ray,
            throughput: Vec3f::splat(1.0),
            unseen: 1.0,
            last: Departure { from: Receiver::point(ray.origin), pdf: 0.0, only: true },
            inside: Absorbers::NONE,
            medium: if F & plan::VOLUMES != 0 { world.media.around_camera } else { None },
            flown: 0,
            depth: 0,
            together: false,
        }
    }

    /// Follows a path that has just scattered in a medium to its end.
    pub(super) fn follow(&mut self) {
        if self.roulette() {
            self.go_on(0);
        }
    }

    /// Walks to the end of the path, after `crossings` of surfaces that are not there. Returns 1 if the camera sees something,
    /// else 0.
    #[inline(always)]
    pub(super) fn go_on(&mut self, mut crossings: u32) -> f32 {
        let world = self.world;
        let mut alpha = 0.0;
        loop {
            let hit = closest::<F>(world, &self.ray, &self.random, 2 * (self.depth + crossings));
            if F & plan::VOLUMES != 0 {
                match self.collide(hit.as_ref(), crossings) {
                    Event::Scattered => {
                        if self.depth == 1 {
                            alpha = 1.0;
                        }
                        if self.roulette() {
                            continue;
                        }
                        break;
                    }
                    Event::Ended => {
                        alpha = 1.0;
                        break;
                    }
                    Event::Passed => {}
                }
            }
            let Some(hit) = hit else {
                if F & plan::ENVIRONMENT != 0 {
                    self.escape();
                }
                break;
            };
            let seen = self.depth > 0 || camera_sees::<F>(world, self.options, &hit);
            if !seen && crossings <= MAX_CROSSINGS {
                self.pass_unseen(&hit);
                crossings += 1;
                continue;
            }
            let wo = -self.ray.direction;
            let mut found = None;
            let (at, material) = if F & plan::TEXTURES != 0 {
                let at = world.interaction::<true>(&self.ray, &hit);
                (at, world.material_at::<true>(&at, wo, &mut found))
            } else {
                let at = world.interaction::<false>(&self.ray, &hit);
                (at, world.material_at::<false>(&at, wo, &mut found))
            };
            if F & plan::ABSORPTION != 0 {
                self.absorb(&at, hit.t);
            }
            if self.depth == 0
                && alpha == 0.0
                && !(F & plan::ABSORPTION != 0 && world.is_invisible(at.instance))
            {
                alpha = 1.0;
                if S::FIRST {
                    self.sink.first(&first_hit(&at, &material, wo));
                }
            }
            if S::SURFACES {
                self.sink.surface(&SurfaceVisit { interaction: &at, wo, material: &material });
            }
            if F & plan::EMITTERS != 0 && material.emission != Vec3f::zero() {
                self.emission(&at, &material);
            }
            let crossable = F & plan::ABSORPTION != 0 && self.may_cross(at.instance);
            if (self.depth >= self.options.max_depth && !crossable) || crossings > MAX_CROSSINGS {
                break;
            }
            if S::SPLITS && self.depth == 0 {
                let splits = self.sink.splits(&SurfaceVisit { interaction: &at, wo, material: &material });
                if splits > 1 {
                    self.split(&at, &material, crossings, splits);
                    break;
                }
            }
            match self.scatter(&at, &material, crossings) {
                Step::Scattered => {
                    self.depth += 1;
                    if (crossable && self.depth > self.options.max_depth) || !self.roulette() {
                        break;
                    }
                }
                Step::Crossed => crossings += 1,
                Step::Ended => break,
            }
        }
        alpha
    }
}

/// What happened at a surface.
pub(super) enum Step {
    Scattered,
    /// The surface is not there.
    Crossed,
    Ended,
}

impl<const F: u32, S: Sink, D: DirectionSampler> Path<'_, F, S, D> {
    /// Light of the environment along a ray that meets nothing.
    #[inline(always)]
    fn escape(&mut self) {
        if self.depth == 0 && !self.options.show_environment {
            return;
        }
        let d = self.ray.direction;
        let weighted = !self.last.only && self.options.strategy == Strategy::Mis;
        let (radiance, pdf) = self.world.lights.environment_from(d, weighted);
        let weight = self.weight(|_| pdf);
        self.found(Found::Environment, LightOrigin::Environment, radiance, weight);
    }

    /// Light that the surface itself emits.
    #[inline(always)]
    fn emission(&mut self, at: &Interaction, material: &SurfaceMaterial<'_>) {
        let (world, from) = (self.world, &self.last.from);
        let weight = self.weight(|lights| lights.surface_pdf(world, from, at));
        self.found(Found::Emission, LightOrigin::surface(at), material.emission, weight);
    }

    /// Reports light that the path met.
    #[inline(always)]
    fn found(&mut self, found: Found, light: LightOrigin, radiance: Vec3f, weight: f32) {
        let one = Vec3f::splat(1.0);
        let value = self.throughput.mul(radiance) * weight;
        if !value.is_finite() {
            self.sink.not_finite();
            return;
        }
        self.sink.contribution(&Contribution {
            found,
            depth: self.depth,
            throughput: self.throughput,
            scattering: one,
            radiance,
            transmittance: one,
            weight,
            pdf: self.last.pdf,
            wi: self.ray.direction,
            light,
            instance: u32::MAX,
            value,
        });
    }

    /// Multiplies the throughput with what belongs to no vertex.
    #[inline(always)]
    pub(super) fn attenuate(&mut self, factor: Vec3f) {
        self.throughput = self.throughput.mul(factor);
        self.sink.attenuate(factor);
    }

    /// Weight of light found by scattering, against next-event estimation of density `pdf`.
    #[inline(always)]
    fn weight(&self, pdf: impl FnOnce(&crate::light::Lights) -> f32) -> f32 {
        match self.options.strategy {
            _ if self.last.only => 1.0,
            Strategy::Bsdf => 1.0,
            Strategy::Light => 0.0,
            Strategy::Mis => power_heuristic(1.0, self.last.pdf, 1.0, pdf(&self.world.lights)),
        }
    }

    /// Goes on behind a surface that the camera does not see.
    #[cold]
    fn pass_unseen(&mut self, hit: &WorldHit) {
        let at = self.world.interaction::<false>(&self.ray, hit);
        if F & plan::ABSORPTION != 0 {
            self.absorb(&at, hit.t);
            self.enter(&at);
        }
        if F & plan::VOLUMES != 0 {
            self.medium = self.world.media.beside(at.instance, !at.front, self.medium);
        }
        self.ray = at.leave(self.ray.direction, self.ray.t_max - hit.t);
    }

    /// Takes up what absorbs on the other side of a surface.
    #[inline(always)]
    fn enter(&mut self, at: &Interaction) {
        self.inside.cross(self.world, at.instance, at.front);
    }

    /// Absorption on the way to a surface.
    #[inline(always)]
    fn absorb(&mut self, at: &Interaction, t: f32) {
        let sigma = self.inside.on_the_way_to(self.world, at.instance, at.front);
        if S::SURFACES
            && let Some(material) = self.inside.solid_before(self.world, at.instance, at.front)
        {
            self.sink.absorbed(material, t);
        }
        if sigma != Vec3f::zero() {
            self.attenuate(exp(sigma * -t));
        }
    }

    /// Whether the path goes on; its weight makes up for those that do not.
    #[inline(always)]
    pub(super) fn roulette(&mut self) -> bool {
        let media = F & plan::VOLUMES != 0 && !self.world.media.is_empty();
        let (least, scale) = if media { (ROULETTE_DEPTH_IN_MEDIA, 1.0) } else { (0, ROULETTE_SCALE) };
        if self.depth < self.options.roulette_depth.max(least) {
            return self.throughput != Vec3f::zero();
        }
        let sure = if media || self.depth >= ROULETTE_DEEP { ROULETTE_MAX } else { 1.0 };
        let q = (scale * brightest(self.throughput) * self.unseen).min(sure);
        if q >= 1.0 {
            return true;
        }
        let survives = self.random.survival(self.depth - 1) < q;
        if survives {
            self.throughput *= 1.0 / q;
            self.sink.attenuate(Vec3f::splat(1.0 / q));
        }
        survives
    }

    /// Next-event estimation and a new direction at a surface, after `crossings` that were not there.
    #[inline(always)]
    fn scatter(&mut self, at: &Interaction, material: &SurfaceMaterial<'_>, crossings: u32) -> Step {
        self.with_light(at, material, |path, vertex, local, from| {
            path.choose(at, material, (vertex, local, from), crossings)
        })
    }

    /// Next-event estimation at a surface, then what `go_on` does there.
    #[inline(always)]
    pub(super) fn with_light<T>(
        &mut self,
        at: &Interaction,
        material: &SurfaceMaterial<'_>,
        go_on: impl FnOnce(&mut Self, &Vertex<'_, SurfaceScattering<'_>>, &D::Local, Receiver) -> T,
    ) -> T {
        let wo = -self.ray.direction;
        let facing = if material.transmits() { Facing::Both(material.n) } else { Facing::Front(material.n) };
        let from = Receiver { p: at.p, facing };
        let scattering = SurfaceScattering::new(material, wo);
        let vertex = Vertex { position: at.p, normal: material.n, wo, scattering: &scattering };
        let local = self.sampler.local(&vertex);
        if !material.is_delta() {
            self.light_at_surface(at, &vertex, &local, &from);
        }
        go_on(self, &vertex, &local, from)
    }

    /// A new direction at a surface.
    #[inline(always)]
    pub(super) fn choose(
        &mut self,
        at: &Interaction,
        material: &SurfaceMaterial<'_>,
        (vertex, local, from): (&Vertex<'_, SurfaceScattering<'_>>, &D::Local, Receiver),
        crossings: u32,
    ) -> Step {
        let wo = vertex.wo;
        let has_lobes = self.sampler.has_lobes(vertex);
        let lobe = if self.is_pane(at.instance) {
            // The numbers of this event are still needed behind the pane.
            self.random.surface(2 * (self.depth + crossings), PANE | u64::from(at.instance))
        } else if has_lobes {
            self.random.lobe(self.depth)
        } else {
            0.0
        };
        let u = if self.depth == 1 && self.together {
            self.random.second_scatter()
        } else {
            self.random.scatter(self.depth)
        };
        self.together = self.depth == 0 && !has_lobes;
        let Some(sample) = self.sampler.sample(vertex, local, lobe, u) else { return Step::Ended };
        let (wi, crosses) = (sample.wi, sample.transmitted);
        if sample.weight == Vec3f::zero() {
            return Step::Ended;
        }
        // A direction that the shading normal puts on another side than the geometry does leaks light.
        if (wi.dot(at.ng) * wo.dot(at.ng) < 0.0) != crosses || wi == Vec3f::zero() {
            return Step::Ended;
        }
        if F & plan::VOLUMES != 0 {
            self.medium = self.world.media.beside(at.instance, at.front != crosses, self.medium);
        }
        if F & plan::ABSORPTION != 0 && crosses {
            let world = self.world;
            self.enter(at);
            if world.materials[world.placed[at.instance as usize].material as usize].is_null {
                self.ray = at.leave(wi, f32::INFINITY);
                return Step::Crossed;
            }
        }
        if crosses && self.is_pane(at.instance) {
            self.attenuate(sample.weight);
            self.ray = at.leave(self.ray.direction, f32::INFINITY);
            return Step::Crossed;
        }
        self.sink.vertex(&PathVertex {
            position: at.p,
            normal: material.n,
            wo,
            wi,
            pdf: sample.pdf,
            delta: sample.delta,
            weight: sample.weight,
            throughput: self.throughput,
            depth: self.depth,
            instance: at.instance,
        });
        self.throughput = self.throughput.mul(sample.weight);
        self.unseen *= sample.eta * sample.eta * sample.preference;
        self.last = Departure { from, pdf: sample.pdf, only: sample.delta };
        self.ray = at.leave(wi, f32::INFINITY);
        if self.throughput.is_finite() {
            Step::Scattered
        } else {
            self.sink.not_finite();
            Step::Ended
        }
    }
}
