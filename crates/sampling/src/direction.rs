//! How the next direction of a path is chosen: the scattering function alone, a density of its own, or a mixture.
//!
//! [`Scattering`] is what an integrator knows of a surface for one direction of view; a [`DirectionSampler`] chooses
//! directions at such a [`Vertex`] and gives the density with which it does. [`ScatteringSampler`] follows the
//! scattering function, [`UniformSphere`] knows nothing, [`Mixture`] joins two samplers with the one density that both
//! have together, so that an integrator weights its samples once (balance heuristic).
//!
//! ```
//! use photofit_sampling::{DirectionSampler, Mixture, ScatteringSampler, UniformSphere};
//! // Three of four directions from the scattering function, one of four from anywhere.
//! let sampler = Mixture { first: ScatteringSampler, second: UniformSphere, share: 0.25 };
//! # let _ = sampler;
//! ```

use crate::{uniform_sphere, uniform_sphere_pdf};
use photofit_scalar::Vec3f;

/// A direction that was chosen at a vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DirectionSample {
    /// Unit vector away from the surface.
    pub wi: Vec3f,
    /// `f |cos theta_i| / pdf`; for a delta lobe its reflectance or transmittance over the probability of choosing it.
    pub weight: Vec3f,
    /// Density per solid angle, 1/sr, of the whole sampler; 1 for a delta lobe.
    pub pdf: f32,
    /// The direction comes from a delta lobe: no density finds it.
    pub delta: bool,
    /// The direction lies on the other side of the shading plane than the viewer.
    pub transmitted: bool,
    /// Index of refraction on the side of `wi` over that on the side of the viewer; 1 for reflection and thin surfaces.
    pub eta: f32,
    /// [`Self::pdf`] over the density of the scattering function alone: 1 for its own samples and for delta lobes. Roulette
    /// must not see it: a direction that a guide prefers has a small weight because much light is expected from it.
    pub preference: f32,
}

impl DirectionSample {
    /// [`Self::preference`] of a sample of density `pdf` where the scattering function has `own`.
    #[inline]
    pub fn preferred(pdf: f32, own: f32) -> f32 {
        if own > 0.0 { (pdf / own).min(PREFERENCE_MAX) } else { 1.0 }
    }
}

/// Largest [`DirectionSample::preference`]; more makes no difference to roulette and could overflow along a path.
const PREFERENCE_MAX: f32 = 1e4;

/// How a surface scatters at a point towards one viewer, with directions in the frame of the [`Vertex`].
pub trait Scattering {
    /// A direction with the scattering function's own density for `lobe` and `u` in `[0, 1)`; `None` where the path
    /// ends.
    fn sample(&self, lobe: f32, u: [f32; 2]) -> Option<DirectionSample>;

    /// `f |cos theta_i|` without delta lobes, and the density with which [`Self::sample`] makes `wi`.
    fn eval_pdf(&self, wi: Vec3f) -> (Vec3f, f32);

    /// Whether all lobes are delta lobes.
    fn is_delta(&self) -> bool;

    /// Whether [`Self::sample`] reads `lobe`.
    fn has_lobes(&self) -> bool;
}

/// A point at which a direction is chosen.
#[derive(Clone, Copy, Debug)]
pub struct Vertex<'a, S> {
    /// The point.
    pub position: Vec3f,
    /// Unit shading normal.
    pub normal: Vec3f,
    /// Unit vector towards the viewer.
    pub wo: Vec3f,
    /// How the surface scatters towards `wo`.
    pub scattering: &'a S,
}

/// Chooses directions at the vertices of a path.
pub trait DirectionSampler {
    /// What the answers at one vertex share.
    type Local;

    /// Prepares answers at a vertex.
    fn local<S: Scattering>(&self, at: &Vertex<'_, S>) -> Self::Local;

    /// A direction for `lobe` and `u` in `[0, 1)`; `None` where the path ends. `local` is that of the vertex.
    fn sample<S: Scattering>(
        &self,
        at: &Vertex<'_, S>,
        local: &Self::Local,
        lobe: f32,
        u: [f32; 2],
    ) -> Option<DirectionSample>;

    /// `f |cos theta_i|` of the surface without delta lobes, and the density with which [`Self::sample`] makes `wi`.
    fn eval_pdf<S: Scattering>(&self, at: &Vertex<'_, S>, local: &Self::Local, wi: Vec3f) -> (Vec3f, f32);

    /// Whether [`Self::sample`] reads `lobe`.
    fn has_lobes<S: Scattering>(&self, at: &Vertex<'_, S>) -> bool;
}

/// The scattering function's own sampling.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScatteringSampler;

impl DirectionSampler for ScatteringSampler {
    type Local = ();

    #[inline(always)]
    fn local<S: Scattering>(&self, _: &Vertex<'_, S>) {}

    #[inline(always)]
    fn sample<S: Scattering>(
        &self,
        at: &Vertex<'_, S>,
        _: &Self::Local,
        lobe: f32,
        u: [f32; 2],
    ) -> Option<DirectionSample> {
        at.scattering.sample(lobe, u)
    }

    #[inline(always)]
    fn eval_pdf<S: Scattering>(&self, at: &Vertex<'_, S>, _: &Self::Local, wi: Vec3f) -> (Vec3f, f32) {
        at.scattering.eval_pdf(wi)
    }

    #[inline(always)]
    fn has_lobes<S: Scattering>(&self, at: &Vertex<'_, S>) -> bool {
        at.scattering.has_lobes()
    }
}

/// All directions alike; delta lobes are never found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UniformSphere;

impl DirectionSampler for UniformSphere {
    type Local = ();

    #[inline(always)]
    fn local<S: Scattering>(&self, _: &Vertex<'_, S>) {}

    #[inline]
    fn sample<S: Scattering>(
        &self,
        at: &Vertex<'_, S>,
        _: &Self::Local,
        _: f32,
        u: [f32; 2],
    ) -> Option<DirectionSample> {
        let wi: Vec3f = uniform_sphere(u);
        let (value, own) = at.scattering.eval_pdf(wi);
        let pdf = uniform_sphere_pdf();
        let transmitted = wi.dot(at.normal) * at.wo.dot(at.normal) < 0.0;
        let preference = DirectionSample::preferred(pdf, own);
        let weight = value * (1.0 / pdf);
        Some(DirectionSample { wi, weight, pdf, delta: false, transmitted, eta: 1.0, preference })
    }

    #[inline]
    fn eval_pdf<S: Scattering>(&self, at: &Vertex<'_, S>, _: &Self::Local, wi: Vec3f) -> (Vec3f, f32) {
        (at.scattering.eval_pdf(wi).0, uniform_sphere_pdf())
    }

    #[inline]
    fn has_lobes<S: Scattering>(&self, _: &Vertex<'_, S>) -> bool {
        false
    }
}

/// One of two samplers by chance: the density of a direction is that of both by their shares, whichever chose it.
///
/// Surfaces with nothing but delta lobes are left to the first one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mixture<A, B> {
    /// Knows the delta lobes.
    pub first: A,
    /// Chosen with probability [`Self::share`].
    pub second: B,
    /// In `[0, 1)`.
    pub share: f32,
}

impl<A: DirectionSampler, B: DirectionSampler> DirectionSampler for Mixture<A, B> {
    type Local = (A::Local, B::Local);

    #[inline]
    fn local<S: Scattering>(&self, at: &Vertex<'_, S>) -> Self::Local {
        (self.first.local(at), self.second.local(at))
    }

    #[inline]
    fn sample<S: Scattering>(
        &self,
        at: &Vertex<'_, S>,
        local: &Self::Local,
        lobe: f32,
        u: [f32; 2],
    ) -> Option<DirectionSample> {
        if at.scattering.is_delta() {
            return self.first.sample(at, &local.0, lobe, u);
        }
        let mut sample = if lobe < self.share {
            self.second.sample(at, &local.1, lobe / self.share, u)
        } else {
            self.first.sample(at, &local.0, (lobe - self.share) / (1.0 - self.share), u)
        }?;
        if sample.delta {
            sample.weight *= 1.0 / (1.0 - self.share);
            return Some(sample);
        }
        let (value, pdf) = self.eval_pdf(at, local, sample.wi);
        let usable = pdf > 0.0 && pdf.is_finite();
        if !usable {
            return None;
        }
        (sample.weight, sample.pdf) = (value * (1.0 / pdf), pdf);
        sample.preference = DirectionSample::preferred(pdf, at.scattering.eval_pdf(sample.wi).1);
        Some(sample)
    }

    #[inline]
    fn eval_pdf<S: Scattering>(&self, at: &Vertex<'_, S>, local: &Self::Local, wi: Vec3f) -> (Vec3f, f32) {
        let (value, first) = self.first.eval_pdf(at, &local.0, wi);
        if at.scattering.is_delta() {
            return (value, first);
        }
        let second = self.second.eval_pdf(at, &local.1, wi).1;
        (value, first * (1.0 - self.share) + second * self.share)
    }

    #[inline]
    fn has_lobes<S: Scattering>(&self, _: &Vertex<'_, S>) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::chi_square;
    use crate::{Rng, cosine_hemisphere, cosine_hemisphere_pdf};
    use photofit_scalar::vec3;

    /// Lambert's surface with +z as its normal, and a mirror of probability `mirror` on it.
    struct Plastic {
        albedo: f32,
        mirror: f32,
    }

    const WO: Vec3f = Vec3f { x: 0.6, y: 0.0, z: 0.8 };

    impl Scattering for Plastic {
        fn sample(&self, lobe: f32, u: [f32; 2]) -> Option<DirectionSample> {
            let delta = lobe < self.mirror;
            let wi = if delta { vec3(-WO.x, -WO.y, WO.z) } else { cosine_hemisphere(u) };
            let weight = Vec3f::splat(if delta { 1.0 } else { self.albedo });
            let pdf = if delta { 1.0 } else { (1.0 - self.mirror) * cosine_hemisphere_pdf(wi.z) };
            Some(DirectionSample { wi, weight, pdf, delta, transmitted: false, eta: 1.0, preference: 1.0 })
        }

        fn eval_pdf(&self, wi: Vec3f) -> (Vec3f, f32) {
            let pdf = (1.0 - self.mirror) * cosine_hemisphere_pdf(wi.z);
            (Vec3f::splat(self.albedo * pdf), pdf)
        }

        fn is_delta(&self) -> bool {
            self.mirror >= 1.0
        }

        fn has_lobes(&self) -> bool {
            self.mirror > 0.0
        }
    }

    fn at(scattering: &Plastic) -> Vertex<'_, Plastic> {
        Vertex { position: Vec3f::zero(), normal: vec3(0.0, 0.0, 1.0), wo: WO, scattering }
    }

    fn random(i: u64) -> (f32, [f32; 2]) {
        let mut rng = Rng::new(5, i);
        (rng.next_f32(), [rng.next_f32(), rng.next_f32()])
    }

    #[test]
    fn mixtures_have_the_density_that_they_state() {
        const N: u64 = 200_000;
        const CELLS: [usize; 2] = [12, 8];
        for share in [0.0, 0.3, 0.9] {
            let mixture = Mixture { first: ScatteringSampler, second: UniformSphere, share };
            let surface = Plastic { albedo: 0.7, mirror: 0.0 };
            let cell = |wi: Vec3f| {
                let turn = 0.5 + wi.y.atan2(wi.x) / std::f32::consts::TAU;
                let row = ((0.5 - 0.5 * wi.z) * CELLS[0] as f32) as usize;
                let column = (turn * CELLS[1] as f32) as usize;
                row.min(CELLS[0] - 1) * CELLS[1] + column.min(CELLS[1] - 1)
            };
            let mut counts = vec![0_u64; CELLS[0] * CELLS[1]];
            for i in 0..N {
                let (lobe, u) = random(i);
                let sample = mixture.sample(&at(&surface), &((), ()), lobe, u).unwrap();
                let (value, pdf) = mixture.eval_pdf(&at(&surface), &((), ()), sample.wi);
                assert!((sample.pdf - pdf).abs() <= 1e-6 * pdf, "one density for both ways");
                assert!((sample.weight.x * pdf - value.x).abs() <= 1e-5 * value.x.max(1e-3));
                counts[cell(sample.wi)] += 1;
            }
            // The integral over a ring between heights a and b: half the difference, and of the cosine lobe b^2 - a^2.
            let expected: Vec<f64> = (0..counts.len())
                .map(|i| {
                    let height = |row: usize| 1.0 - 2.0 * row as f64 / CELLS[0] as f64;
                    let (top, bottom) = (height(i / CELLS[1]), height(i / CELLS[1] + 1));
                    let lambert = top.max(0.0).powi(2) - bottom.max(0.0).powi(2);
                    let share = f64::from(share);
                    (share * 0.5 * (top - bottom) + (1.0 - share) * lambert) / CELLS[1] as f64
                })
                .collect();
            chi_square(&format!("share {share}"), &counts, &expected);
        }
    }

    #[test]
    fn mixtures_keep_the_energy_of_delta_lobes() {
        const N: u64 = 100_000;
        for (albedo, mirror, share) in [(0.5, 0.4, 0.3), (0.5, 0.0, 0.5), (0.2, 1.0, 0.5)] {
            let surface = Plastic { albedo, mirror };
            let mixture = Mixture { first: ScatteringSampler, second: UniformSphere, share };
            let (mut sum, mut squares) = (0.0, 0.0);
            for i in 0..N {
                let (lobe, u) = random(i);
                let weight =
                    mixture.sample(&at(&surface), &((), ()), lobe, u).map_or(0.0, |s| f64::from(s.weight.x));
                (sum, squares) = (sum + weight, squares + weight * weight);
            }
            let n = N as f64;
            let mean = sum / n;
            let error = ((squares / n - mean * mean).max(0.0) / n).sqrt();
            let expected = f64::from(mirror + (1.0 - mirror) * albedo);
            assert!((mean - expected).abs() < 4.0 * error + 1e-6, "{mean} +- {error}, expected {expected}");
        }
    }
}
