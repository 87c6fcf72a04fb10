//! How the next direction of a path is chosen: the scattering function alone, a density of its own, or a mixture.
//!
//! [`Scattering`] is what an integrator knows of a surface for one direction of view; a [`DirectionSampler`] chooses
//! directions at such a [`Vertex`] and gives the density with which it does. [`ScatteringSampler`] follows the
//! scattering function; guides that learn are mixed with it in `photofit-flow`.

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

    /// [`DirectionSample::eta`] of a direction that something else chose.
    fn eta(&self, wi: Vec3f) -> f32;

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

/// Chooses directions at the surfaces that a path meets. Directions in media are those of the phase function, whatever the
/// sampler.
pub trait DirectionSampler {
    /// What the answers at one vertex share.
    type Local;

    /// Whether [`Self::pdf`] costs more than to see whether something is in the way: it may then be asked only for lights that
    /// arrive, or for none.
    const COSTLY: bool;

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

    /// The density with which [`Self::sample`] makes `wi`, where the scattering function alone has the density `own`.
    fn pdf<S: Scattering>(&self, at: &Vertex<'_, S>, local: &Self::Local, wi: Vec3f, own: f32) -> f32;

    /// Whether [`Self::sample`] reads `lobe`.
    fn has_lobes<S: Scattering>(&self, at: &Vertex<'_, S>) -> bool;
}

/// Paths that can be walked with directions of any sampler.
pub trait Paths {
    /// Walks one of them to its end.
    fn walk<D: DirectionSampler>(&self, path: usize, sampler: &D);
}

/// Walks many paths side by side, so that what they ask of a sampler can be answered together. A path
/// must ask only at the vertex that it prepared last, so that paths which sinks split must not be walked so.
pub trait SideBySide {
    /// Walks the paths from 0 to `count - 1`, each of them once and on this thread. They begin in order, but take turns.
    fn walk_all<P: Paths>(&self, count: usize, paths: &P);
}

/// The scattering function's own sampling.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScatteringSampler;

impl DirectionSampler for ScatteringSampler {
    type Local = ();

    const COSTLY: bool = false;

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
    fn pdf<S: Scattering>(&self, _: &Vertex<'_, S>, _: &Self::Local, _: Vec3f, own: f32) -> f32 {
        own
    }

    #[inline(always)]
    fn has_lobes<S: Scattering>(&self, at: &Vertex<'_, S>) -> bool {
        at.scattering.has_lobes()
    }
}
