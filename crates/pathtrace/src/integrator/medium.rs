//! What happens to a path, and to a shadow ray, in media.

use super::path::{Last, Path};
use super::visibility::transmittance;
use crate::light::Receiver;
use crate::plan;
use crate::volume::{Segment, phase, sample_phase};
use crate::world::{World, WorldHit, WorldRay};
use photofit_sampling::Rng;
use photofit_scalar::Vec3f;

/// What happened in a medium.
pub(super) enum Event {
    Passed,
    Scattered,
    Ended,
}

/// A collision on the way.
struct Collision {
    t: f32,
    albedo: Vec3f,
    g: f32,
}

impl<const F: u32> Path<'_, F> {
    /// The first collision with a medium before the distance `end`.
    #[inline(never)]
    pub(super) fn collide(&mut self, end: f32, crossings: u32) -> Event {
        let Some(at) = self.collision(end, crossings) else {
            // Light that does not come through the medium is not followed.
            return if self.throughput == Vec3f::zero() { Event::Ended } else { Event::Passed };
        };
        if self.depth >= self.options.max_depth {
            return Event::Ended;
        }
        self.throughput = self.throughput.mul(at.albedo);
        if self.throughput == Vec3f::zero() {
            return Event::Ended;
        }
        let (p, d) = (self.ray.origin + self.ray.direction * at.t, self.ray.direction);
        let from = Receiver::point(p);
        if let Some(light) = self.light_for(&from) {
            let pdf = phase(at.g, d.dot(light.wi));
            let weight = self.light_weight(&light, pdf) * pdf / light.pdf;
            let arrives = self.throughput.mul(light.radiance) * weight;
            if arrives != Vec3f::zero() && arrives.is_finite() {
                let index = 2 * self.depth + 1;
                let around = (self.inside, self.medium);
                let through = transmittance::<F>(self.world, p, None, &light, around, self.random, index);
                self.radiance += arrives.mul(through);
            }
        }
        let wi = sample_phase(at.g, d, self.random.scatter(self.depth));
        self.last = Last { from, pdf: phase(at.g, d.dot(wi)), only: false };
        self.ray = WorldRay { origin: p, direction: wi, t_max: f32::INFINITY };
        self.depth += 1;
        Event::Scattered
    }

    /// The nearest of the collisions with all media; the throughput takes up what the medium around the path lets
    /// through.
    fn collision(&mut self, end: f32, crossings: u32) -> Option<Collision> {
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
        if let Some(filling) = media.filling(self.medium) {
            let along = Segment { origin: self.ray.origin, direction: self.ray.direction, length };
            if self.depth >= self.options.max_depth {
                // What collides here scatters no more.
                self.throughput = self.throughput.mul(filling.transmittance(&along, &mut rng));
            } else {
                let mut numbers = None;
                if self.flown <= self.depth {
                    self.flown = self.depth + 1;
                    numbers = self.random.flight(self.depth);
                }
                let numbers = numbers.unwrap_or_else(|| [rng.next_f32(), rng.next_f32()]);
                let flight = filling.fly(&along, self.throughput, numbers, &mut rng);
                self.throughput = self.throughput.mul(flight.weight);
                if let Some(t) = flight.collision {
                    let albedo = filling.albedo(along.origin + along.direction * t);
                    return Some(Collision { t, albedo, g: filling.g });
                }
            }
        }
        let (t, q, i) = first?;
        Some(Collision { t, albedo: media.boxes[i].albedo(q), g: media.boxes[i].g })
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

/// Transmittance of the media and panes along a shadow ray that starts in `medium` and crosses `surfaces` (in any order).
pub(super) fn through_bounded(
    world: &World,
    ray: &WorldRay,
    mut surfaces: Vec<WorldHit>,
    mut medium: Option<u32>,
    rng: &mut Rng,
) -> Vec3f {
    surfaces
        .sort_unstable_by(|a, b| a.t.total_cmp(&b.t).then((a.instance, a.piece).cmp(&(b.instance, b.piece))));
    surfaces.dedup();
    let mut through = Vec3f::splat(1.0);
    let mut from = 0.0;
    let media = &world.media;
    let mut pass = |medium: Option<u32>, from: f32, to: f32, through: Vec3f| match media.filling(medium) {
        Some(filling) if to > from => {
            let origin = ray.origin + ray.direction * from;
            let along = Segment { origin, direction: ray.direction, length: to - from };
            through.mul(filling.transmittance(&along, rng))
        }
        _ => through,
    };
    for hit in &surfaces {
        through = pass(medium, from, hit.t, through);
        if through == Vec3f::zero() {
            return through;
        }
        from = hit.t;
        through = through.mul(world.straight_through(ray, hit));
        medium = media.beside(hit.instance, !hit.front, medium);
    }
    pass(medium, from, ray.t_max, through)
}
