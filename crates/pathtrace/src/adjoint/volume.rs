//! Replay in media: derivatives with respect to extinction, albedo and emission (Vicini, Speierer and Jakob 2021; differential ratio
//! tracking after Nimier-David, Müller, Keller and Jakob 2022).
//!
//! With the rest `R` of a path's light, known at each flight, and the derivative of the loss in front of everything:
//!
//! - *Transmittance*, of flights and shadow rays: `-R` times the integral of `d sigma_t` over what was flown. It holds at
//!   any density.
//! - *Scattering* towards the path, `T d(sigma_t a) L_s` at every distance of a flight. Collisions sample it by
//!   `T sigma_t`, with `R d sigma_t / sigma_t`: none where there is nothing yet. Distances drawn by `T` alone sample it
//!   anywhere, with light gathered for them by a path of their own, for one flight per path, chosen by what there is to
//!   tell. Both are weighted by what adds up to 1 at each point (in the form of the power heuristic, Veach and Guibas
//!   1995; `c` stands for the density of distances, and is not it):
//!   `sigma_t^2 / (sigma_t^2 + c^2)` and the rest, with `c` one over the length of the flight's way in the medium. So no
//!   estimate is divided by a density that may be 0, and thin media, in which paths seldom collide, are told by
//!   distances. Where these count less than about a collision, roulette leaves them out.
//! - *Albedo*: collisions count `sigma_t^2 / (sigma_t^2 + c^2) a^2 / (a^2 + b^2)`, distances the rest; `b` is 0 but where
//!   albedos are small.
//! - *Emission* at the points where the path looks it up; what dims it there is told as that of a shadow ray.

use super::layout::NONE;
use super::replay::{Replay, offset};
use crate::integrator::medium::{absorbed, gathered};
use crate::integrator::{MediaFlight, PathOptions, ShadowFlight, brightest};
use crate::random::PathRandom;
use crate::volume::{Derivatives, MediumRef, Segment};
use photofit_sampling::{DirectionSampler, Rng};
use photofit_scalar::Vec3f;

/// What the replay of a path keeps for media.
#[derive(Debug, Default)]
pub(super) struct MediaReplay {
    rng: Option<Rng>,
    /// What the light of the path counts for the loss, each channel by its size.
    whole: f32,
    /// Parts of the present shadow ray in media that have parameters.
    pub(super) shadow: Vec<ShadowFlight>,
    /// Sum of the weights of the flights so far, and the one that was chosen.
    total: f32,
    chosen: Option<Chosen>,
}

/// A flight at which light is gathered anew.
#[derive(Debug)]
struct Chosen {
    flight: MediaFlight,
    medium: MediumRef,
    weight: f32,
    /// See [`Derivatives::reach`].
    reach: f32,
}

impl MediaReplay {
    /// Begins a path.
    #[inline]
    pub(super) fn begin(&mut self, random: &PathRandom, loss: Vec3f, total: &[f64; 3]) {
        self.rng = Some(random.derivatives());
        self.whole = (0..3).map(|c| (loss[c] * total[c] as f32).abs()).sum();
        (self.total, self.chosen) = (0.0, None);
        self.shadow.clear();
    }
}

impl Replay<'_> {
    /// Adjoint of a flight: of transmittance, and of the scattering at its end.
    pub(super) fn flown(&mut self, flight: &MediaFlight) {
        let rest = Vec3f::from_array(self.rest.map(|r| r as f32));
        let g = self.loss.mul(rest);
        for medium in self.world.media.along(flight.bounded) {
            let cells = self.layout.medium(medium);
            if g != Vec3f::zero() {
                let along = segment(flight, flight.length);
                self.transmitted(medium, &along, g);
            }
            let by_density = cells.extinction != NONE && cells.scatters;
            if flight.scatters && (by_density || cells.albedo != NONE) {
                self.consider(flight, medium);
            }
        }
        if let Some(medium) = flight.collided.filter(|_| g != Vec3f::zero()) {
            self.collided(flight, medium, g);
        }
    }

    /// Adjoint of the transmittance of the shadow ray that was reported last, for the gradient `g` of its logarithm.
    pub(super) fn shadowed(&mut self, g: Vec3f) {
        while let Some(flight) = self.media.shadow.pop() {
            if g != Vec3f::zero() {
                self.transmitted(flight.medium, &flight.along, g);
            }
        }
    }

    fn transmitted(&mut self, medium: MediumRef, along: &Segment, g: Vec3f) {
        let cell = self.layout.medium(medium).extinction;
        let (Some(rng), true) = (&mut self.media.rng, cell != NONE) else { return };
        let carried = g.map(f32::abs).sum() / self.media.whole;
        let out = &mut *self.out;
        let add = |voxel, g| out.add(offset(cell, voxel), g);
        Derivatives::of(self.world, medium).transmittance_vjp(along, g, carried, rng, add);
    }

    /// Adjoint of a collision, for the gradient `g` of the logarithm of what is scattered.
    fn collided(&mut self, flight: &MediaFlight, medium: MediumRef, g: Vec3f) {
        let cells = self.layout.medium(medium);
        let derivatives = Derivatives::of(self.world, medium);
        let p = flight.origin + flight.direction * flight.length;
        let out = &mut *self.out;
        // Flights without an end gather no light: collisions tell all of it.
        let reach = derivatives.reach(&segment(flight, flight.end));
        let [c, b] = reach.map_or([0.0; 2], |reach| [1.0 / reach, cells.dark_albedo]);
        let point = derivatives.at(p);
        let sigma = point.extinction();
        if cells.extinction != NONE {
            let g = over(g, sigma, c);
            point.extinction_vjp(g, |voxel, g| out.add(offset(cells.extinction, voxel), g));
        }
        if cells.albedo != NONE {
            let g = over(g.mul(shares(sigma, c)), point.albedo(), b);
            point.albedo_vjp(g, |voxel, g| out.add(offset(cells.albedo, voxel), g));
        }
    }

    /// Chooses among the flights of a path, by length, throughput and how much of it collisions leave to tell, one at which
    /// light is gathered anew.
    fn consider(&mut self, flight: &MediaFlight, medium: MediumRef) {
        let whole = segment(flight, flight.end);
        let derivatives = Derivatives::of(self.world, medium);
        let Some(reach) = derivatives.reach(&whole) else { return };
        let cells = self.layout.medium(medium);
        let Some(rng) = &mut self.media.rng else { return };
        let Some(untold) = &cells.untold else { return };
        let mut untold = untold.at(reach, flight.throughput);
        if cells.albedo != NONE && cells.dark_albedo > 0.0 {
            // However thick the medium is, collisions tell little of albedos near 0.
            untold = untold.max(0.5 * flight.throughput.sum());
        }
        let weight = reach * untold;
        let total = self.media.total + weight;
        if !(weight > 0.0 && total.is_finite()) {
            return;
        }
        self.media.total = total;
        if rng.next_f32() * total < weight {
            self.media.chosen = Some(Chosen { flight: *flight, medium, weight, reach });
        }
    }

    /// Adjoint of the scattering at a distance along the flight that was chosen, with light gathered for it.
    pub(super) fn scattered_anew<const F: u32, D: DirectionSampler>(
        &mut self,
        random: &PathRandom,
        options: &PathOptions,
        sampler: &D,
    ) {
        let Some(Chosen { flight, medium, weight, reach }) = self.media.chosen.take() else { return };
        let Some(rng) = &mut self.media.rng else { return };
        let derivatives = Derivatives::of(self.world, medium);
        let Some(sample) = derivatives.sample(&segment(&flight, flight.end), flight.throughput, rng) else {
            return;
        };
        let (t, p) = (sample.t, flight.origin + flight.direction * sample.t);
        let mut g = self.loss.mul(flight.throughput).mul(sample.weight) * (self.media.total / weight);
        g = g.mul(absorbed(flight.absorption, t));
        for other in self.world.media.along(flight.bounded).filter(|m| *m != medium) {
            let along = segment(&flight, t);
            g = g.mul(Derivatives::of(self.world, other).transmittance(&along, rng));
        }
        if g == Vec3f::zero() {
            return;
        }
        let cells = self.layout.medium(medium);
        let point = derivatives.at(p);
        let (sigma, albedo) = (point.extinction(), point.albedo());
        // What collisions leave to tell of the extinction and of the albedo; nothing of what is not asked for, nor of what
        // scatters nothing.
        let told = shares(sigma, 1.0 / reach);
        let rest = |cell, told, other: Vec3f| {
            let scatters = |c: usize| cell != NONE && other[c] > 0.0;
            let mut rest = Vec3f::splat(1.0) - told;
            (0..3).filter(|c| !scatters(*c)).for_each(|c| rest[c] = 0.0);
            rest
        };
        let of_extinction = rest(cells.extinction, told, albedo);
        let of_albedo = rest(cells.albedo, told.mul(shares(albedo, cells.dark_albedo)), sigma);
        // About 1 for a collision.
        let survives = brightest(of_extinction.max(of_albedo)) * (self.media.total / weight);
        if survives < 1.0 {
            if rng.next_f32() >= survives {
                return;
            }
            g *= 1.0 / survives;
        }
        let at = (&flight, t, derivatives.g());
        let light = gathered::<F, D>(self.world, at, &random.branch(), options, sampler);
        let g = g.mul(light);
        let out = &mut *self.out;
        if cells.extinction != NONE {
            let g = g.mul(albedo).mul(of_extinction);
            point.extinction_vjp(g, |voxel, g| out.add(offset(cells.extinction, voxel), g));
        }
        if cells.albedo != NONE {
            let g = g.mul(sigma).mul(of_albedo);
            point.albedo_vjp(g, |voxel, g| out.add(offset(cells.albedo, voxel), g));
        }
    }
}

/// The first part of a flight.
fn segment(flight: &MediaFlight, length: f32) -> Segment {
    Segment { origin: flight.origin, direction: flight.direction, length }
}

/// `value^2 / (value^2 + reference^2)`: what collisions tell; 0 where both are 0.
#[inline]
fn share(value: f32, reference: f32) -> f32 {
    if value > 0.0 { 1.0 / (1.0 + (reference / value).powi(2)) } else { 0.0 }
}

/// [`share`] per channel.
#[inline]
fn shares(value: Vec3f, reference: f32) -> Vec3f {
    value.map(|v| share(v, reference))
}

/// `g` times the [`share`] over the value, per channel; 0 where the value is 0.
#[inline]
fn over(g: Vec3f, value: Vec3f, reference: f32) -> Vec3f {
    let mut out = Vec3f::zero();
    for c in 0..3 {
        if value[c] > 0.0 {
            out[c] = g[c] * share(value[c], reference) / value[c];
        }
    }
    out
}
