//! The path tracer: next-event estimation and BSDF sampling with multiple importance sampling (Veach 1997), Russian
//! roulette, stochastic opacity, media.

use super::first::{first_hit, seen_through};
use super::medium::Event;
use super::visibility::{closest, transmittance};
use super::{PathOptions, PathSample, Strategy, brightest, exp};
use crate::light::{Facing, LightRandom, LightSample, Receiver};
use crate::plan;
use crate::random::PathRandom;
use crate::world::{Interaction, SurfaceMaterial, World, WorldHit, WorldRay};
use photofit_sampling::power_heuristic;
use photofit_scalar::Vec3f;

/// One over the throughput below which roulette ends paths: error times time is least around it.
const ROULETTE_SCALE: f32 = 2.0;
/// Scattering events from which on no path is sure to go on, and the largest probability then: light is not caught in
/// glass or between mirrors for ever.
const ROULETTE_DEEP: u32 = 16;
const ROULETTE_MAX: f32 = 0.95;
/// Boundaries that are not there, passed in a row; a path that meets more is cut.
const MAX_CROSSINGS: u32 = 1024;
/// Tells the random number of a pane from that of its coverage.
const PANE: u64 = 1 << 63;

/// How the last direction was chosen.
#[derive(Clone, Copy)]
pub(super) struct Last {
    /// The vertex it left.
    pub(super) from: Receiver,
    /// Its density, 1/sr.
    pub(super) pdf: f32,
    /// No other strategy finds it: the camera, or a delta lobe.
    pub(super) only: bool,
}

/// The state of a path between two vertices.
pub(super) struct Path<'a, const F: u32> {
    pub(super) world: &'a World,
    pub(super) random: &'a PathRandom,
    pub(super) options: &'a PathOptions,
    pub(super) ray: WorldRay,
    pub(super) radiance: Vec3f,
    pub(super) throughput: Vec3f,
    /// Square of the relative indices of refraction crossed: what roulette must not see.
    eta_squared: f32,
    pub(super) last: Last,
    /// Absorption of the surface that the path is in.
    pub(super) inside: Vec3f,
    /// The bounded medium that it is in.
    pub(super) medium: Option<u32>,
    /// Vertices whose numbers for a flight are used up.
    pub(super) flown: u32,
    pub(super) depth: u32,
    /// The numbers of the next direction are stratified together with those of the last one.
    together: bool,
}

/// Estimates the radiance along a camera ray; what `F` lacks is not compiled in.
pub(crate) fn trace_path<const F: u32>(
    world: &World,
    ray: &WorldRay,
    random: &PathRandom,
    options: &PathOptions,
    first_wanted: bool,
) -> PathSample {
    let mut path = Path::<F> {
        world,
        random,
        options,
        ray: *ray,
        radiance: Vec3f::zero(),
        throughput: Vec3f::splat(1.0),
        eta_squared: 1.0,
        last: Last { from: Receiver::point(ray.origin), pdf: 0.0, only: true },
        inside: Vec3f::zero(),
        medium: if F & plan::VOLUMES != 0 { world.media.around_camera } else { None },
        flown: 0,
        depth: 0,
        together: false,
    };
    let mut out = PathSample::default();
    let mut crossings = 0;
    loop {
        let hit = closest::<F>(world, &path.ray, random, 2 * (path.depth + crossings));
        if F & plan::VOLUMES != 0 {
            let end = hit.map_or(path.ray.t_max, |h| h.t);
            match path.collide(end, crossings) {
                Event::Scattered => {
                    if path.depth == 1 {
                        out.alpha = 1.0;
                        out.direct = path.radiance;
                    }
                    if path.roulette() {
                        continue;
                    }
                    break;
                }
                Event::Ended => {
                    out.alpha = 1.0;
                    break;
                }
                Event::Passed => {}
            }
        }
        let Some(hit) = hit else {
            if F & plan::ENVIRONMENT != 0 {
                path.escape();
            }
            if path.depth <= 1 {
                out.direct = path.radiance;
            }
            break;
        };
        if F & plan::EMITTERS != 0
            && path.depth == 0
            && !options.show_emitters
            && world.emits(hit.instance)
            && crossings <= MAX_CROSSINGS
        {
            path.pass_unseen(&hit);
            crossings += 1;
            continue;
        }
        let wo = -path.ray.direction;
        let mut found = None;
        let (at, material) = if F & plan::TEXTURES != 0 {
            let at = world.interaction::<true>(&path.ray, &hit);
            (at, world.material_at::<true>(&at, wo, &mut found))
        } else {
            let at = world.interaction::<false>(&path.ray, &hit);
            (at, world.material_at::<false>(&at, wo, &mut found))
        };
        if F & plan::ABSORPTION != 0 {
            path.absorb(&at, hit.t);
        }
        if path.depth == 0
            && out.alpha == 0.0
            && !(F & plan::ABSORPTION != 0 && world.is_invisible(at.instance))
        {
            out.alpha = 1.0;
            if first_wanted {
                out.first = first_hit(&at, &material, wo);
            }
        }
        if F & plan::EMITTERS != 0 && material.emission != Vec3f::zero() {
            path.emission(&at, &material);
        }
        if path.depth <= 1 {
            out.direct = path.radiance;
        }
        let crossable = F & plan::ABSORPTION != 0 && path.may_cross(at.instance);
        if (path.depth >= options.max_depth && !crossable) || crossings > MAX_CROSSINGS {
            break;
        }
        match path.scatter(&at, &material, crossings) {
            Step::Scattered => {
                path.depth += 1;
                if (crossable && path.depth > options.max_depth) || !path.roulette() {
                    break;
                }
            }
            Step::Crossed => crossings += 1,
            Step::Ended => break,
        }
    }
    if F & plan::ALPHA != 0
        && first_wanted
        && let Some(first) = seen_through::<F>(world, ray, options)
    {
        out.first = first;
    }
    out.radiance = path.radiance;
    out
}

/// What happened at a surface.
enum Step {
    Scattered,
    /// The surface is not there.
    Crossed,
    Ended,
}

impl<const F: u32> Path<'_, F> {
    /// Light of the environment along a ray that meets nothing.
    #[inline(always)]
    fn escape(&mut self) {
        if self.depth == 0 && !self.options.show_environment {
            return;
        }
        let d = self.ray.direction;
        let radiance = self.world.lights.environment_radiance(d);
        let weight = self.weight(|lights| lights.environment_pdf(d));
        self.radiance += self.throughput.mul(radiance) * weight;
    }

    /// Light that the surface itself emits.
    #[inline(always)]
    fn emission(&mut self, at: &Interaction, material: &SurfaceMaterial<'_>) {
        let (world, from) = (self.world, &self.last.from);
        let weight = self.weight(|lights| lights.surface_pdf(world, from, at));
        self.radiance += self.throughput.mul(material.emission) * weight;
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
        let compiled = &self.world.materials[self.world.placed[at.instance as usize].material as usize];
        self.inside = if at.front { compiled.absorption } else { Vec3f::zero() };
    }

    /// Absorption on the way to a surface.
    #[inline(always)]
    fn absorb(&mut self, at: &Interaction, t: f32) {
        let material = &self.world.materials[self.world.placed[at.instance as usize].material as usize];
        // A path that begins inside learns of it at the way out.
        let unknown = !at.front && self.inside == Vec3f::zero();
        let sigma = if unknown { material.absorption } else { self.inside };
        if sigma != Vec3f::zero() {
            self.throughput = self.throughput.mul(exp(sigma * -t));
        }
    }

    /// Whether the path goes on; its weight makes up for those that do not.
    #[inline(always)]
    fn roulette(&mut self) -> bool {
        if self.depth < self.options.roulette_depth {
            return self.throughput != Vec3f::zero();
        }
        let sure = if self.depth < ROULETTE_DEEP { 1.0 } else { ROULETTE_MAX };
        let q = (ROULETTE_SCALE * brightest(self.throughput) * self.eta_squared).min(sure);
        if q >= 1.0 {
            return true;
        }
        let survives = self.random.survival(self.depth - 1) < q;
        if survives {
            self.throughput *= 1.0 / q;
        }
        survives
    }

    /// Next-event estimation and a new direction at a surface, after `crossings` that were not there.
    #[inline(always)]
    fn scatter(&mut self, at: &Interaction, material: &SurfaceMaterial<'_>, crossings: u32) -> Step {
        let wo = -self.ray.direction;
        let local = material.to_local(wo);
        let facing = if material.transmits() { Facing::Both(material.n) } else { Facing::Front(material.n) };
        let from = Receiver { p: at.p, facing };
        if !material.is_delta() {
            self.light_at_surface(at, material, &from, wo, local);
        }
        let has_lobes = material.has_lobes();
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
        let Some(sample) = material.sample(local, lobe, u) else { return Step::Ended };
        let wi = material.to_render(sample.wi).normalize_or_zero();
        let crosses = sample.wi.z * local.z < 0.0;
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
        self.throughput = self.throughput.mul(sample.weight);
        if crosses && self.is_pane(at.instance) {
            self.ray = at.leave(self.ray.direction, f32::INFINITY);
            return Step::Crossed;
        }
        self.eta_squared *= sample.eta * sample.eta;
        self.last = Last { from, pdf: sample.pdf, only: sample.delta };
        self.ray = at.leave(wi, f32::INFINITY);
        if self.throughput.is_finite() { Step::Scattered } else { Step::Ended }
    }

    /// A light for this vertex.
    #[inline(always)]
    pub(super) fn light_for(&self, from: &Receiver) -> Option<LightSample> {
        if F & (plan::ENVIRONMENT | plan::SOURCES | plan::EMITTERS) == 0 {
            return None;
        }
        let lights = &self.world.lights;
        let choice = if lights.is_single() { [0.0; 2] } else { self.random.light_choice(self.depth) };
        let place = self.random.light(self.depth);
        let sample = lights.sample(self.world, from, LightRandom { choice, place })?;
        (sample.delta || self.options.strategy != Strategy::Bsdf).then_some(sample)
    }

    /// Weight of a light sample against scattering of density `pdf`.
    #[inline(always)]
    pub(super) fn light_weight(&self, light: &LightSample, pdf: f32) -> f32 {
        if light.delta || self.options.strategy == Strategy::Light {
            1.0
        } else {
            power_heuristic(1.0, light.pdf, 1.0, pdf)
        }
    }

    #[inline(always)]
    fn light_at_surface(
        &mut self,
        at: &Interaction,
        material: &SurfaceMaterial<'_>,
        from: &Receiver,
        wo: Vec3f,
        local: Vec3f,
    ) {
        let Some(light) = self.light_for(from) else { return };
        let wi = material.to_local(light.wi);
        if (light.wi.dot(at.ng) * wo.dot(at.ng) < 0.0) != (wi.z * local.z < 0.0) {
            return;
        }
        let (value, pdf) = material.eval_pdf(local, wi);
        let weight = self.light_weight(&light, pdf) / light.pdf;
        let arrives = self.throughput.mul(value).mul(light.radiance) * weight;
        if arrives == Vec3f::zero() || !arrives.is_finite() {
            return;
        }
        let index = 2 * self.depth + 1;
        let crosses = light.wi.dot(at.ng) * wo.dot(at.ng) < 0.0;
        let inside = if crosses { Vec3f::zero() } else { self.inside };
        let mut medium = self.medium;
        if F & plan::VOLUMES != 0 {
            medium = self.world.media.beside(at.instance, at.front != crosses, medium);
        }
        let around = (inside, medium);
        let through = transmittance::<F>(self.world, at.p, Some(at), &light, around, self.random, index);
        self.radiance += arrives.mul(through);
    }
}
