//! Light that media send out along a flight.
//!
//! A flight collides at `t` with the density `sigma_t T`: it gets as far as `t` with the probability `T`. So the integral of the
//! emission over what was flown, without any transmittance, has the expectation of `T` times the emission along the
//! whole way, at every density, 0 among them. It is taken at a random point of each of some equal parts. Light of
//! a medium is found in no other way: no light sampling, weights of 1.

use super::medium::absorbed;
use super::path::Path;
use super::sink::{Contribution, Found, ShadowFlight, Sink};
use crate::light::LightOrigin;
use crate::plan;
use crate::volume::{Glow, Segment};
use crate::world::WorldHit;
use photofit_sampling::DirectionSampler;
use photofit_scalar::Vec3f;

/// Points of a flight, one in each equal part.
const POINTS: u32 = 4;

impl<const F: u32, S: Sink, D: DirectionSampler> Path<'_, F, S, D> {
    /// Reports the light of all media along the present flight, which got as far as `flown` on its way to `hit`; `before` is
    /// the throughput that it began with.
    #[inline(never)]
    pub(super) fn glow(&mut self, hit: Option<&WorldHit>, flown: f32, before: Vec3f, crossings: u32) {
        let world = self.world;
        let media = &world.media;
        let flight = Segment { origin: self.ray.origin, direction: self.ray.direction, length: flown };
        let around = media.bounded(self.medium);
        let (absorption, solid) = if F & plan::ABSORPTION != 0 {
            (self.absorption_before(hit), self.solid_before(hit))
        } else {
            (Vec3f::zero(), None)
        };
        let mut rng = self.random.tracking(0x2000 + 2 * (self.depth + crossings));
        for medium in media.along(self.medium) {
            let Some(Glow { emission, from, to }) = media.glow(medium, &flight) else { continue };
            if !to.is_finite() {
                self.sink.not_finite();
                continue;
            }
            let step = (to - from) / POINTS as f32;
            for i in 0..POINTS {
                let t = from + (i as f32 + rng.next_f32()) * step;
                let point = flight.origin + flight.direction * t;
                let radiance = emission.at(point) * step;
                // The adjoint needs black light, too.
                if radiance == Vec3f::zero() && !S::MEDIA {
                    continue;
                }
                let mut transmittance = absorbed(absorption, t);
                if let Some(around) = around {
                    transmittance = transmittance.mul(around.share_at(t, before));
                }
                let value = before.mul(radiance).mul(transmittance);
                if !value.is_finite() {
                    self.sink.not_finite();
                    continue;
                }
                if S::SURFACES
                    && let Some(solid) = solid
                {
                    self.sink.shadow_absorbed(solid, t);
                }
                if S::MEDIA {
                    let along = Segment { length: t, ..flight };
                    media
                        .along(self.medium)
                        .for_each(|medium| self.sink.shadow_flight(&ShadowFlight { medium, along }));
                }
                self.sink.contribution(&Contribution {
                    found: Found::Medium,
                    depth: self.depth,
                    throughput: before,
                    scattering: Vec3f::splat(1.0),
                    radiance,
                    transmittance,
                    weight: 1.0,
                    pdf: self.last.pdf,
                    wi: flight.direction,
                    light: LightOrigin::Medium { medium, point, length: step },
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
