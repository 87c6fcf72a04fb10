//! Light that media emit along a flight.
//!
//! A flight collides at `t` with the density `sigma_t T`: it gets as far as `t` with the probability `T`. So the integral of the
//! emission over what was flown, without any transmittance, has the expectation of `T` times the emission along the
//! whole way, at every density, 0 among them. It is taken at a random point of each of some equal parts. In a medium
//! that is the same everywhere, which may have no end, a distance is drawn by its transmittance instead, whatever its
//! own flight did. Light of a medium is found in no other way: no light sampling, weights of 1.

use super::medium::absorbed;
use super::path::Path;
use super::sink::{Contribution, Found, ShadowFlight, Sink};
use crate::light::LightOrigin;
use crate::plan;
use crate::volume::{EmittingPart, MediumRef, Segment};
use crate::world::WorldHit;
use photofit_sampling::DirectionSampler;
use photofit_scalar::Vec3f;

/// Points of a flight, one in each equal part.
const POINTS: u32 = 4;

/// How far a flight got.
#[derive(Clone, Copy)]
pub(super) struct Flown {
    /// Through all media.
    pub(super) length: f32,
    /// Through those with boxes of their own.
    pub(super) in_boxes: f32,
    /// The throughput that it began with.
    pub(super) before: Vec3f,
}

impl<const F: u32, S: Sink, D: DirectionSampler> Path<'_, F, S, D> {
    /// Reports the light of all media along the present flight on its way to `hit`.
    #[inline(never)]
    pub(super) fn emission_along(&mut self, hit: Option<&WorldHit>, flown: &Flown, crossings: u32) {
        let world = self.world;
        let media = &world.media;
        let flight = Segment { origin: self.ray.origin, direction: self.ray.direction, length: flown.length };
        let around = media.bounded(self.medium);
        let absorption = if F & plan::ABSORPTION != 0 { self.absorption_before(hit) } else { Vec3f::zero() };
        let solid = if S::SURFACES && F & plan::ABSORPTION != 0 { self.solid_before(hit) } else { None };
        let mut rng = self.random.tracking(0x2000 + 2 * (self.depth + crossings));
        for medium in media.along(self.medium) {
            let whole = Segment { length: flown.in_boxes, ..flight };
            let even = around.filter(|a| matches!(medium, MediumRef::Bounded(_)) && a.is_even());
            let Some(EmittingPart { emission, from, to }) =
                media.emitting_part(medium, if even.is_some() { &whole } else { &flight })
            else {
                continue;
            };
            for i in 0..POINTS {
                let u = (i as f32 + rng.next_f32()) / POINTS as f32;
                let drawn = match even {
                    Some(even) => even.distance([from, to], flown.before, u, &mut rng),
                    None => Some((from + u * (to - from), Vec3f::splat(to - from))),
                };
                let Some((t, weight)) = drawn else { continue };
                let point = flight.origin + flight.direction * t;
                let radiance = emission.at(point) * (1.0 / POINTS as f32);
                // The adjoint needs black light, too.
                if radiance == Vec3f::zero() && !S::MEDIA {
                    continue;
                }
                let mut local = weight.mul(absorbed(absorption, t));
                if let (Some(around), None) = (around, even) {
                    local = local.mul(around.share_at(t, flown.before));
                }
                // What is black stays so on a way without an end.
                let value = flown.before.mul(product(radiance, local));
                if !value.is_finite() {
                    self.sink.not_finite();
                    continue;
                }
                if let Some(solid) = solid {
                    self.sink.shadow_absorbed(solid, t);
                }
                if S::MEDIA {
                    let along = Segment { length: t, ..flight };
                    for medium in media.along(self.medium) {
                        self.sink.shadow_flight(&ShadowFlight { medium, along });
                    }
                }
                self.sink.contribution(&Contribution {
                    found: Found::Medium,
                    depth: self.depth,
                    throughput: flown.before,
                    scattering: Vec3f::splat(1.0),
                    radiance,
                    transmittance: local,
                    weight: 1.0,
                    pdf: self.last.pdf,
                    wi: flight.direction,
                    light: LightOrigin::Medium { medium, point, share: 1.0 / POINTS as f32 },
                    instance: u32::MAX,
                    value,
                });
            }
        }
    }

    /// The absorbing solid that the ray is in, on its way to `hit`.
    pub(super) fn solid_before(&self, hit: Option<&WorldHit>) -> Option<u32> {
        match hit {
            Some(h) => self.inside.solid_before(self.world, h.instance, h.front),
            None => self.inside.innermost(),
        }
    }
}

/// The product per channel, 0 where the first factor is.
fn product(a: Vec3f, b: Vec3f) -> Vec3f {
    let mut out = Vec3f::zero();
    for c in 0..3 {
        if a[c] != 0.0 {
            out[c] = a[c] * b[c];
        }
    }
    out
}
