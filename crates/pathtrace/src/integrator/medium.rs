//! What happens to a path, and to a shadow ray, in media.

use super::emission::Flown;
use super::path::{Departure, Path};
use super::sink::{MediaFlight, PathVertex, PictureSink, ShadowFlight, Sink};
use super::visibility::{Around, Passed};
use super::{PathOptions, exp};
use crate::light::Receiver;
use crate::plan;
use crate::random::PathRandom;
use crate::volume::{MediumRef, Segment, phase, sample_phase};
use crate::world::{World, WorldHit, WorldRay};
use photofit_sampling::{DirectionSampler, Rng};
use photofit_scalar::Vec3f;

/// What happened in a medium.
pub(super) enum Event {
    Passed,
    Scattered,
    Ended,
}

/// A collision on the way.
struct Collision {
    medium: MediumRef,
    t: f32,
    albedo: Vec3f,
    g: f32,
}

/// What became of a flight.
struct Flights {
    collision: Option<Collision>,
    /// How far it gets through media in boxes.
    in_boxes: f32,
    /// What the medium around the path leaves of the throughput.
    weight: Option<Vec3f>,
}

impl<const F: u32, S: Sink, D: DirectionSampler> Path<'_, F, S, D> {
    /// The first collision with a medium before the surface `hit`.
    #[inline(never)]
    pub(super) fn collide(&mut self, hit: Option<&WorldHit>, crossings: u32) -> Event {
        let end = hit.map_or(self.ray.t_max, |h| h.t);
        let before = self.throughput;
        let emits = self.world.media.emits_along(self.medium);
        let Flights { collision, in_boxes, weight } = self.collision(end, crossings, emits);
        if emits {
            let length = collision.as_ref().map_or(end, |c| c.t);
            self.emission_along(hit, &Flown { length, in_boxes, before }, crossings);
        }
        if let Some(weight) = weight {
            self.attenuate(weight);
        }
        if S::MEDIA {
            self.report_flight(hit, end, before, collision.as_ref());
        }
        let Some(at) = collision else {
            // Light that does not come through the medium is not followed.
            return if self.throughput == Vec3f::zero() { Event::Ended } else { Event::Passed };
        };
        if self.depth >= self.options.max_depth {
            return Event::Ended;
        }
        if F & plan::ABSORPTION != 0 {
            let sigma = self.absorption_before(hit);
            if S::SURFACES
                && let Some(solid) = self.solid_before(hit)
            {
                self.sink.absorbed(solid, at.t);
            }
            self.attenuate(absorbed(sigma, at.t));
        }
        self.attenuate(at.albedo);
        if self.throughput == Vec3f::zero() {
            return Event::Ended;
        }
        self.scatter_in_medium(self.ray.origin + self.ray.direction * at.t, at.g);
        Event::Scattered
    }

    /// Absorption per unit of length of the solid that the ray is in, on its way to `hit`.
    pub(super) fn absorption_before(&self, hit: Option<&WorldHit>) -> Vec3f {
        match hit {
            Some(h) => self.inside.on_the_way_to(self.world, h.instance, h.front),
            None => self.inside.absorption(self.world),
        }
    }

    fn report_flight(&mut self, hit: Option<&WorldHit>, end: f32, before: Vec3f, at: Option<&Collision>) {
        let absorption = if F & plan::ABSORPTION != 0 { self.absorption_before(hit) } else { Vec3f::zero() };
        self.sink.flight(&MediaFlight {
            origin: self.ray.origin,
            direction: self.ray.direction,
            length: at.map_or(end, |c| c.t),
            end,
            collided: at.map(|c| c.medium),
            bounded: self.medium,
            throughput: before,
            depth: self.depth,
            scatters: self.depth < self.options.max_depth,
            solids: self.inside,
            absorption,
        });
    }

    /// Next-event estimation and a new direction at a point of a medium with this phase function; the present ray
    /// arrives there.
    fn scatter_in_medium(&mut self, p: Vec3f, g: f32) {
        let d = self.ray.direction;
        let from = Receiver::point(p);
        if let Some(light) = self.light_for(&from) {
            let pdf = phase(g, d.dot(light.wi));
            let weight = self.light_weight(&light, || pdf);
            let arrives = self.throughput.mul(light.radiance) * (weight * pdf / light.pdf);
            if arrives != Vec3f::zero() {
                let around = Around { absorbers: self.inside, medium: self.medium };
                self.connect(&light, (p, None), around, (Vec3f::splat(pdf), weight, arrives));
            }
        }
        let wi = sample_phase(g, d, self.random.scatter(self.depth));
        let pdf = phase(g, d.dot(wi));
        self.sink.vertex(&PathVertex {
            position: p,
            normal: Vec3f::zero(),
            wo: -d,
            wi,
            pdf,
            delta: false,
            weight: Vec3f::splat(1.0),
            throughput: self.throughput,
            depth: self.depth,
            instance: u32::MAX,
        });
        self.last = Departure { from, pdf, only: false };
        self.ray = WorldRay { origin: p, direction: wi, t_max: f32::INFINITY };
        self.depth += 1;
    }

    /// The nearest of the collisions with all media. Where one of them emits light, flights end in what only absorbs, too
    /// ([`super::emission`]).
    fn collision(&mut self, end: f32, crossings: u32, emits: bool) -> Flights {
        let mut rng = self.random.tracking(0x1000 + 2 * (self.depth + crossings));
        let media = &self.world.media;
        let mut first: Option<(f32, Vec3f, usize)> = None;
        for (i, medium) in media.boxes.iter().enumerate() {
            let limit = first.map_or(end, |f| f.0);
            if let Some((t, q)) = medium.collide(self.ray.origin, self.ray.direction, limit, &mut rng) {
                first = Some((t, q, i));
            }
        }
        let length = first.map_or(end, |f| f.0);
        let mut weight = None;
        if let (Some(medium), Some(index)) = (media.bounded(self.medium), self.medium) {
            let along = Segment { origin: self.ray.origin, direction: self.ray.direction, length };
            if !emits && (medium.absorbs_only || self.depth >= self.options.max_depth) {
                // What collides here scatters no more.
                weight = Some(medium.transmittance(&along, &mut rng));
            } else {
                let mut numbers = None;
                if self.flown <= self.depth {
                    self.flown = self.depth + 1;
                    numbers = self.random.flight(self.depth);
                }
                let numbers = numbers.unwrap_or_else(|| [rng.next_f32(), rng.next_f32()]);
                let flight = medium.fly(&along, self.throughput, numbers, &mut rng);
                weight = Some(flight.weight);
                if let Some(t) = flight.collision {
                    let albedo = medium.albedo(along.origin + along.direction * t);
                    let medium_of_it = MediumRef::Bounded(index as usize);
                    let collision = Collision { medium: medium_of_it, t, albedo, g: medium.g };
                    return Flights { collision: Some(collision), in_boxes: length, weight };
                }
            }
        }
        let collision = first.map(|(t, q, i)| {
            let medium = &media.boxes[i];
            Collision { medium: MediumRef::Volume(i), t, albedo: medium.albedo(q), g: medium.g }
        });
        Flights { collision, in_boxes: length, weight }
    }

    /// Whether light may pass a surface without a scattering event.
    #[inline(always)]
    pub(super) fn may_cross(&self, instance: u32) -> bool {
        let world = self.world;
        world.materials[world.placed[instance as usize].material as usize].is_null || self.is_pane(instance)
    }

    /// Whether a surface is a pane that lets light straight through, without counting as a scattering event.
    #[inline(always)]
    pub(super) fn is_pane(&self, instance: u32) -> bool {
        let world = self.world;
        F & plan::VOLUMES != 0 && world.materials[world.placed[instance as usize].material as usize].pane
    }
}

/// An estimate of the light that a phase function gathers at distance `t` along a flight, as it goes back along the
/// flight: of paths that begin with a scattering event there, with random numbers of their own.
pub(crate) fn gathered<const F: u32, D: DirectionSampler>(
    world: &World,
    (flight, t, g): (&MediaFlight, f32, f32),
    random: &PathRandom,
    options: &PathOptions,
    sampler: &D,
) -> Vec3f {
    let ray = WorldRay { origin: flight.origin, direction: flight.direction, t_max: flight.end };
    let mut path =
        Path::<F, PictureSink, D>::new(world, &ray, random, options, sampler, PictureSink::default());
    (path.inside, path.medium, path.depth) = (flight.solids, flight.bounded, flight.depth);
    path.scatter_in_medium(ray.origin + ray.direction * t, g);
    path.follow();
    path.sink.radiance
}

/// Transmittance of bounded media, absorbing solids and panes along a shadow ray that starts in `around` and crosses
/// `surfaces` (in any order); `passed` is told the parts in absorbing solids and in media.
pub(super) fn through_boundaries(
    world: &World,
    ray: &WorldRay,
    mut surfaces: Vec<WorldHit>,
    mut around: Around,
    rng: &mut Rng,
    mut passed: impl FnMut(Passed),
) -> Vec3f {
    surfaces
        .sort_unstable_by(|a, b| a.t.total_cmp(&b.t).then((a.instance, a.piece).cmp(&(b.instance, b.piece))));
    surfaces.dedup();
    let media = &world.media;
    let mut through = Vec3f::splat(1.0);
    let mut from = 0.0;
    for hit in &surfaces {
        let sigma = around.absorbers.on_the_way_to(world, hit.instance, hit.front);
        if let Some(solid) = around.absorbers.solid_before(world, hit.instance, hit.front) {
            passed(Passed::Solid(solid, hit.t - from));
        }
        through = through.mul(absorbed(sigma, hit.t - from));
        through = through.mul(scattered(world, ray, around.medium, [from, hit.t], rng, &mut passed));
        if through == Vec3f::zero() {
            return through;
        }
        from = hit.t;
        through = through.mul(world.straight_through(ray, hit));
        around.absorbers.cross(world, hit.instance, hit.front);
        around.medium = media.beside(hit.instance, !hit.front, around.medium);
    }
    if let Some(solid) = around.absorbers.innermost_on(ray.t_max - from) {
        passed(Passed::Solid(solid, ray.t_max - from));
    }
    through = through.mul(absorbed(around.absorbers.absorption(world), ray.t_max - from));
    through.mul(scattered(world, ray, around.medium, [from, ray.t_max], rng, &mut passed))
}

/// What of light passes a length of an absorber; all of it without absorption, and on a way without end: what it leaves to the environment
/// is no closed solid.
#[inline(always)]
pub(crate) fn absorbed(sigma: Vec3f, length: f32) -> Vec3f {
    if sigma == Vec3f::zero() || length <= 0.0 || length == f32::INFINITY {
        return Vec3f::splat(1.0);
    }
    exp(sigma.map(|s| if s > 0.0 { -s * length } else { 0.0 }))
}

/// What of light passes a bounded medium between two distances.
fn scattered(
    world: &World,
    ray: &WorldRay,
    medium: Option<u32>,
    [from, to]: [f32; 2],
    rng: &mut Rng,
    passed: &mut impl FnMut(Passed),
) -> Vec3f {
    match (world.media.bounded(medium), medium) {
        (Some(medium), Some(index)) if to > from => {
            let origin = ray.origin + ray.direction * from;
            let along = Segment { origin, direction: ray.direction, length: to - from };
            passed(Passed::Medium(ShadowFlight { medium: MediumRef::Bounded(index as usize), along }));
            medium.transmittance(&along, rng)
        }
        _ => Vec3f::splat(1.0),
    }
}
