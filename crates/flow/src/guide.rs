//! What a guide is: a learned density of directions, asked at a vertex; and its mixture with the scattering function.

use crate::FlowError;
use photofit_sampling::{DirectionSample, DirectionSampler, Scattering, Vertex};
use photofit_scalar::Vec3f;

/// Where a direction is wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Query {
    /// The point.
    pub position: Vec3f,
    /// Unit shading normal.
    pub normal: Vec3f,
    /// Unit vector towards the viewer.
    pub wo: Vec3f,
    /// Roughness as glTF means it (the width of GGX is its square), in `[0, 1]`; 1 where it is not known.
    pub roughness: f32,
}

/// What a guide learns from: a direction that was taken at a vertex and what came of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Record {
    /// The vertex.
    pub query: Query,
    /// Unit vector along which the path went on.
    pub wi: Vec3f,
    /// Density with which it was chosen, 1/sr, of everything that could choose it.
    pub pdf: f32,
    /// Estimate of the integrand `f L |cos theta_i|` along it, one number for all channels, at least 0.
    pub value: f32,
    /// Estimate of the radiance `L` that arrives along it, at least 0.
    pub incident: f32,
}

impl Record {
    /// Whether something can be learned from it: finite, and some light.
    pub fn is_useful(&self) -> bool {
        let q = &self.query;
        let finite =
            q.position.is_finite() && q.normal.is_finite() && q.wo.is_finite() && self.wi.is_finite();
        let positive = |v: f32| v > 0.0 && v.is_finite();
        finite && positive(self.pdf) && positive(self.value / self.pdf) && self.incident.is_finite()
    }
}

/// Bounds of the share of a guide in a mixture with the scattering function. The rest keeps every weight bounded: with a
/// half of it, no direction weighs more than twice what the scattering function alone gives it, where the guide is wrong;
/// with more for the guide, few such directions make most of the variance.
pub const SHARE: [f32; 2] = [0.02, 0.5];

/// A learned density of directions.
///
/// All answers are functions of what was learned and of the arguments alone, bitwise the same for any number of threads.
pub trait Guide {
    /// What answers at one vertex share.
    type Local;

    /// Prepares answers at a vertex.
    fn local(&self, at: &Query) -> Self::Local;

    /// Probability with which the guide rather than the scattering function should choose the direction, within
    /// [`SHARE`].
    fn share(&self, local: &Self::Local) -> f32;

    /// A direction for `u` in `[0, 1)` and its density, 1/sr; `None` where `u` belongs to no direction (the density then
    /// integrates to less than 1).
    fn sample(&self, local: &Self::Local, u: [f32; 2]) -> Option<(Vec3f, f32)>;

    /// Density of [`Self::sample`] at `wi`, 1/sr.
    fn pdf(&self, local: &Self::Local, wi: Vec3f) -> f32;

    /// [`Self::sample`] of each, to the same bits; as many `answers` as are asked for.
    fn sample_all(&self, asked: &[(&Self::Local, [f32; 2])], answers: &mut [Option<(Vec3f, f32)>]) {
        for ((local, u), answer) in asked.iter().zip(answers) {
            *answer = self.sample(local, *u);
        }
    }

    /// [`Self::pdf`] of each, to the same bits; as many `answers` as are asked for.
    fn pdf_all(&self, asked: &[(&Self::Local, Vec3f)], answers: &mut [f32]) {
        for ((local, wi), answer) in asked.iter().zip(answers) {
            *answer = self.pdf(local, *wi);
        }
    }
}

/// A guide that learns.
pub trait Learn: Guide + Sync {
    /// Learns from records, which were made with the directions of the present state; what later answers come from is
    /// replaced at the end.
    ///
    /// The first call takes the densities of its records as those of the scattering function alone, later ones as those of
    /// its mixture with the guide ([`Guided`]).
    ///
    /// # Errors
    /// [`crate::FlowError::Diverged`] where a gradient or what was learned is not finite; what answers is as before.
    fn learn(&mut self, records: &[Record]) -> Result<(), FlowError>;
}

/// The mixture of the scattering function and a guide, each with the share that the guide wants at the vertex: one density
/// for both, so that an integrator weights its samples once (balance heuristic).
///
/// Delta lobes belong to the scattering function; surfaces with nothing else are left to it.
#[derive(Clone, Copy, Debug)]
pub struct Guided<'a, G>(pub &'a G);

fn query<S>(at: &Vertex<'_, S>) -> Query {
    Query { position: at.position, normal: at.normal, wo: at.wo, roughness: 1.0 }
}

impl<G: Guide> DirectionSampler for Guided<'_, G> {
    /// None where there are delta lobes alone.
    type Local = Option<G::Local>;

    const COSTLY: bool = true;

    #[inline]
    fn local<S: Scattering>(&self, at: &Vertex<'_, S>) -> Self::Local {
        (!at.scattering.is_delta()).then(|| self.0.local(&query(at)))
    }

    #[inline]
    fn sample<S: Scattering>(
        &self,
        at: &Vertex<'_, S>,
        local: &Self::Local,
        lobe: f32,
        u: [f32; 2],
    ) -> Option<DirectionSample> {
        let Some(local) = local else { return at.scattering.sample(lobe, u) };
        let share = self.0.share(local);
        let (mut sample, guide) = if lobe < share {
            let (wi, guide) = self.0.sample(local, u)?;
            let transmitted = wi.dot(at.normal) * at.wo.dot(at.normal) < 0.0;
            let weight = Vec3f::zero();
            // Roulette has to know the factor of radiance at refraction, whoever chose the direction.
            let eta = if transmitted { at.scattering.eta(wi) } else { 1.0 };
            let sample =
                DirectionSample { wi, weight, pdf: 0.0, delta: false, transmitted, eta, preference: 1.0 };
            (sample, guide)
        } else {
            let mut sample = at.scattering.sample(((lobe - share) / (1.0 - share)).min(BELOW_ONE), u)?;
            if sample.delta {
                sample.weight *= 1.0 / (1.0 - share);
                return Some(sample);
            }
            (sample, self.0.pdf(local, sample.wi))
        };
        let (value, own) = at.scattering.eval_pdf(sample.wi);
        let pdf = own * (1.0 - share) + guide * share;
        let usable = pdf > 0.0 && pdf.is_finite();
        if !usable {
            return None;
        }
        (sample.weight, sample.pdf) = (value * (1.0 / pdf), pdf);
        sample.preference = DirectionSample::preferred(pdf, own);
        Some(sample)
    }

    #[inline]
    fn pdf<S: Scattering>(&self, _: &Vertex<'_, S>, local: &Self::Local, wi: Vec3f, own: f32) -> f32 {
        let Some(local) = local else { return own };
        let share = self.0.share(local);
        own * (1.0 - share) + self.0.pdf(local, wi) * share
    }

    #[inline]
    fn has_lobes<S: Scattering>(&self, _: &Vertex<'_, S>) -> bool {
        true
    }
}

/// The largest number below 1.
const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

#[cfg(test)]
mod tests;
