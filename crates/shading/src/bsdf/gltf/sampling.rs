//! Sampling of the layered BSDF, and what integrators ask of it.

use super::layers::{
    BROAD, BROAD_TRANSMITTED, COAT, GltfBsdf, MICROFACETS, Prepared, SHEEN, SHEEN_LOBE, SMOOTH, SMOOTH_COAT,
    SMOOTH_REFRACTION, TRANSMISSION, VOLUME,
};
use super::sheen;
use crate::bsdf::ggx::Ggx;
use crate::bsdf::refraction::{Facets, reflect, refract};
use crate::bsdf::{BsdfSample, Scatter, mirror_z, reflect_z, weighted};
use crate::energy::Energy;
use photofit_sampling::{cosine_hemisphere, uniform_hemisphere};
use photofit_scalar::{Real, Vec3, vec3};

/// What a lobe gives, in the frame of `Prepared::wo`.
enum Drawn<T> {
    /// A direction, and whether it passes to the other side; its density is that of all lobes together.
    Direction(Vec3<T>, bool),
    /// The same for a delta lobe, its value, and the part of the lobe's probability that leads there.
    Delta(Vec3<T>, bool, Vec3<T>, T),
}

impl<T: Real> GltfBsdf<T> {
    /// Draws from a lobe; `rest` is what choosing the lobe left of its random number.
    fn draw(&self, p: &Prepared<T>, lobe: usize, rest: T, u: [T; 2]) -> Option<Drawn<T>> {
        Some(match lobe {
            MICROFACETS if self.uses(SMOOTH) => self.draw_smooth(p, rest)?,
            MICROFACETS => self.draw_microfacet(p, rest, u)?,
            BROAD => Drawn::Direction(cosine_hemisphere(u), false),
            BROAD_TRANSMITTED => Drawn::Direction(mirror_z(cosine_hemisphere(u)), true),
            SHEEN_LOBE => Drawn::Direction(uniform_hemisphere(u), false),
            _ => self.draw_coat(p, u)?,
        })
    }

    fn draw_smooth(&self, p: &Prepared<T>, rest: T) -> Option<Drawn<T>> {
        let share = self.reflected_share(p, p.wo.z);
        if rest < share {
            let wi = reflect_z(p.wo);
            let value = self.fresnel(p.inside, p.eta, p.wo.z) * self.below_layers(p, wi);
            return Some(Drawn::Delta(wi, false, value, share));
        }
        let passed = self.passed(p.inside, p.eta, p.wo.z);
        let wi = if self.uses(VOLUME) { refract(p.wo, up(), p.eta)? } else { -p.wo };
        let value = self.transmitted.mul(passed) * (self.scale(p.eta) * self.below_layers(p, wi));
        Some(Drawn::Delta(wi, true, value, T::one() - share))
    }

    fn draw_microfacet(&self, p: &Prepared<T>, rest: T, u: [T; 2]) -> Option<Drawn<T>> {
        let m = self.base.sample(p.wo, u);
        let share = self.reflected_share(p, p.wo.dot(m));
        if rest < share {
            return Some(Drawn::Direction(reflect(p.wo, m), false));
        }
        if !self.uses(VOLUME) {
            return Some(Drawn::Direction(mirror_z(reflect(p.wo, m)), true));
        }
        if !self.uses(SMOOTH_REFRACTION) {
            return Some(Drawn::Direction(refract(p.wo, m, p.eta)?, true));
        }
        // Only the refracted lobe is a delta lobe: it gets what the rough reflection leaves.
        let albedo = self.albedos(self.dielectric_f0, self.dielectric_f90);
        let passed = albedo.single(self.albedo_at(&albedo, p.wo)).map(|e| (T::one() - e).relu());
        let wi = refract(p.wo, up(), p.eta)?;
        let value = self.transmitted.mul(passed) * (self.scale(p.eta) * self.below_layers(p, wi));
        Some(Drawn::Delta(wi, true, value, T::one() - share))
    }

    /// `None` where a facet of the coat reflects below the coat's own horizon: its masking takes that light.
    fn draw_coat(&self, p: &Prepared<T>, u: [T; 2]) -> Option<Drawn<T>> {
        let n = p.coat_normal;
        if self.uses(SMOOTH_COAT) {
            let value = self.coat.weight * Self::coat_fresnel(n.dot(p.wo));
            return Some(Drawn::Delta(reflect(p.wo, n), false, Vec3::splat(value), T::one()));
        }
        let (s, t) = n.orthonormal_pair();
        let wo = vec3(s.dot(p.wo), t.dot(p.wo), n.dot(p.wo));
        let wi = reflect(wo, Ggx::isotropic(self.coat.alpha).sample(wo, u));
        (wi.z > T::zero()).then(|| Drawn::Direction(s * wi.x + t * wi.y + n * wi.z, false))
    }
}

/// The normal.
#[inline(always)]
fn up<T: Real>() -> Vec3<T> {
    vec3(T::zero(), T::zero(), T::one())
}

impl<T: Real> Scatter<T> for GltfBsdf<T> {
    #[inline]
    fn eval_pdf(&self, wo: Vec3<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        match self.prepare(wo) {
            None => (Vec3::zero(), T::zero()),
            Some(p) => self.evaluate(&p, self.turn(if p.mirrored { mirror_z(wi) } else { wi })),
        }
    }

    #[inline]
    fn sample(&self, wo: Vec3<T>, lobe: T, u: [T; 2]) -> Option<BsdfSample<T>> {
        let p = self.prepare(wo)?;
        let (chosen, rest) = choose(&p.probability, lobe);
        let drawn = self.draw(&p, chosen, rest, u)?;
        let (Drawn::Direction(wi, passes) | Drawn::Delta(wi, passes, ..)) = drawn;
        // Microfacets may reflect below the surface, or refract above it: masking takes that light.
        let right_side = if passes { wi.z < T::zero() } else { wi.z > T::zero() };
        if !right_side {
            return None;
        }
        let eta = if passes { p.eta } else { T::one() };
        let sample = match drawn {
            Drawn::Delta(wi, _, value, share) => {
                let weight = value / (p.probability[chosen] * share);
                BsdfSample { wi, weight, pdf: T::one(), delta: true, eta }
            }
            Drawn::Direction(wi, _) => weighted(wi, self.evaluate(&p, wi), eta)?,
        };
        let wi = self.turn_back(sample.wi);
        Some(BsdfSample { wi: if p.mirrored { mirror_z(wi) } else { wi }, ..sample })
    }

    #[inline]
    fn is_delta(&self) -> bool {
        let coat = !self.uses(COAT) || self.uses(SMOOTH_COAT);
        self.uses(SMOOTH) && self.diffuse == Vec3::zero() && !self.uses(SHEEN) && coat
    }

    #[inline]
    fn transmits(&self) -> bool {
        self.uses(TRANSMISSION)
    }

    #[inline]
    fn eta(&self, wo: Vec3<T>) -> T {
        self.eta_from(wo.z < T::zero())
    }

    fn albedo(&self, wo: Vec3<T>) -> Vec3<T> {
        let Some(p) = self.prepare(wo) else { return Vec3::zero() };
        let albedo = self.albedos(self.f0, self.f90);
        let e = albedo.single(self.albedo_at(&albedo, p.wo));
        let below = self.diffuse + self.transmitted;
        let base = match self.energy {
            Energy::Single => self.diffuse + e + self.transmitted.mul(e.map(|e| (T::one() - e).relu())),
            Energy::Compensated => e + below.mul(e.map(|e| (T::one() - e).relu())),
        };
        let cover = Vec3::splat(p.coat)
            + self.sheen_color * (sheen::albedo(p.wo.z, self.sheen_roughness) * (T::one() - p.coat));
        base * ((T::one() - p.coat) * (T::one() - p.sheen)) + cover
    }
}

/// The lobe that a number in `[0, 1)` chooses, one of positive probability, and the number spread over `[0, 1)` again.
#[inline(always)]
fn choose<T: Real>(probability: &[T; 5], lobe: T) -> (usize, T) {
    let mut rest = lobe;
    let mut last = (MICROFACETS, T::zero());
    for (i, &p) in probability.iter().enumerate() {
        if p > T::zero() {
            last = (i, (rest / p).clamp_to(T::zero(), T::one() - T::epsilon()));
            if rest < p {
                break;
            }
            rest -= p;
        }
    }
    last
}
