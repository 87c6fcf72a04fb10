//! Lights: what they emit, how a point on them is chosen, and with what density.
//!
//! One light is chosen per vertex: first a kind (sources without a surface, the environment, emitting surfaces), by
//! power but none below a floor, then a light of that kind by its alias table. All densities are per solid angle and
//! include the choice.

mod area;
mod environment;
mod patch;
mod picture;
mod source;

pub use environment::EnvironmentMap;
pub use picture::ThrownPicture;
pub use source::{Falloff, LightSource};

use crate::volume::MediumRef;
use area::Emitters;
pub(crate) use area::collect;
pub(crate) use patch::{Facing, Receiver};

use crate::PathtraceError;
use crate::world::{Interaction, World};
use environment::EnvironmentLight;
use photofit_sampling::AliasTable;
use photofit_scalar::Vec2f;
use photofit_scalar::Vec3f;
use source::PreparedSource;

/// Smallest probability of a kind of light that is there, before normalisation.
const KIND_FLOOR: f32 = 0.1;

/// Kinds of light, as indices of [`Lights::kinds`].
const SOURCES: usize = 0;
const ENVIRONMENT: usize = 1;
const AREA: usize = 2;

/// All lights of a world, in the render frame.
#[derive(Debug, Default)]
pub(crate) struct Lights {
    /// Probability of each kind.
    kinds: [f32; 3],
    /// The sources as they were given.
    given: Vec<LightSource>,
    sources: Vec<PreparedSource>,
    source_table: Option<AliasTable>,
    pub(crate) environment: Option<EnvironmentLight>,
    emitters: Emitters,
    emitter_table: Option<AliasTable>,
    /// There is one source or emitter, and nothing else.
    single: bool,
}

/// A direction towards a light.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LightSample {
    /// Unit vector towards the light.
    pub(crate) wi: Vec3f,
    /// Radiance that arrives if nothing is in the way; for sources without a surface the irradiance that a surface
    /// facing them receives.
    pub(crate) radiance: Vec3f,
    /// Density per solid angle, the choice of the light included; the probability of the choice alone for sources
    /// without a surface.
    pub(crate) pdf: f32,
    /// No other strategy finds this light.
    pub(crate) delta: bool,
    /// Where the light is.
    pub(crate) end: End,
    /// Which light it is.
    pub(crate) origin: LightOrigin,
}

/// Which light something comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightOrigin {
    /// A light without a surface, by its index.
    Source(u32),
    /// The environment.
    Environment,
    /// A point of a path in a medium that emits light.
    Medium {
        /// The medium.
        medium: MediumRef,
        /// A point of it in the render frame.
        point: Vec3f,
        /// Share of the estimate: one over the number of points.
        share: f32,
    },
    /// A surface that emits.
    Surface {
        /// Index of the instance.
        instance: u32,
        /// Index of the triangle.
        piece: u32,
        /// Both sets of texture coordinates, where the emission varies; else they are not told.
        uv: [Vec2f; 2],
    },
}

impl LightOrigin {
    #[inline(always)]
    pub(crate) fn surface(at: &Interaction) -> Self {
        Self::Surface { instance: at.instance, piece: at.piece, uv: at.uv }
    }
}

/// The far end of a shadow ray.
#[derive(Clone, Copy, Debug)]
pub(crate) enum End {
    /// Infinitely far away.
    Infinite,
    /// A point.
    Point(Vec3f),
    /// A point of a surface, already moved off it.
    Surface(Vec3f),
}

/// Random numbers of one light sample, each in `[0, 1)`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LightRandom {
    /// Chooses the light.
    pub(crate) choice: [f32; 2],
    /// Chooses the point on it.
    pub(crate) place: [f32; 2],
}

impl Lights {
    /// Prepares the lights of a world whose surfaces are known.
    pub(crate) fn new(
        world: &mut World,
        sources: &[LightSource],
        environment: Option<EnvironmentMap>,
    ) -> Result<Self, PathtraceError> {
        let mut out = Self { emitters: collect(world)?, ..Self::default() };
        out.set_sources(world, sources)?;
        out.environment = environment.map(EnvironmentLight::new).transpose()?;
        out.weigh(world.radius);
        Ok(out)
    }

    /// The same lights with other sources.
    fn set_sources(&mut self, world: &World, sources: &[LightSource]) -> Result<(), PathtraceError> {
        let prepared = sources.iter().enumerate().map(|(i, source)| source.prepare(i, world.origin));
        self.sources = prepared.collect::<Result<_, _>>()?;
        self.given = sources.to_vec();
        Ok(())
    }

    /// Replaces sources and environment; on an error everything is as it was.
    pub(crate) fn relight(
        &mut self,
        world: &World,
        sources: &[LightSource],
        environment: Option<EnvironmentMap>,
    ) -> Result<(), PathtraceError> {
        let environment = environment.map(EnvironmentLight::new).transpose()?;
        self.set_sources(world, sources)?;
        self.environment = environment;
        self.weigh(world.radius);
        Ok(())
    }

    /// Replaces the environment; on an error everything is as it was.
    pub(crate) fn replace_environment(
        &mut self,
        radius: f32,
        environment: Option<EnvironmentMap>,
    ) -> Result<(), PathtraceError> {
        self.environment = environment.map(EnvironmentLight::new).transpose()?;
        self.weigh(radius);
        Ok(())
    }

    /// Replaces sources; on an error everything is as it was.
    pub(crate) fn replace_sources(
        &mut self,
        world: &World,
        sources: &[LightSource],
    ) -> Result<(), PathtraceError> {
        self.set_sources(world, sources)?;
        self.weigh(world.radius);
        Ok(())
    }

    /// Takes up emitting surfaces that have changed.
    pub(crate) fn collect_again(&mut self, world: &mut World) -> Result<(), PathtraceError> {
        self.emitters = collect(world)?;
        self.weigh(world.radius);
        Ok(())
    }

    /// Takes up that the world has another size, or another origin.
    pub(crate) fn see_from(&mut self, world: &World) -> Result<(), PathtraceError> {
        let given = self.given.clone();
        self.replace_sources(world, &given)
    }

    /// Works out how probable each light is.
    fn weigh(&mut self, radius: f32) {
        let powers: Vec<f32> = self.sources.iter().map(|s| s.power(radius)).collect();
        let weights = &self.emitters.weights;
        let sum = |w: &[f32]| w.iter().map(|x| f64::from(*x)).sum::<f64>();
        let lit = self.environment.as_ref().filter(|e| e.is_sampled());
        let disk = std::f64::consts::PI * f64::from(radius) * f64::from(radius);
        let power = [sum(&powers), lit.map_or(0.0, |e| e.total() * disk), sum(weights)];
        self.single = lit.is_none()
            && match (self.sources.len(), weights.as_slice()) {
                (1, []) => true,
                (0, [weight]) => *weight > 0.0,
                _ => false,
            };
        self.kinds = kinds(power);
        self.source_table = AliasTable::new(&powers).ok();
        self.emitter_table = AliasTable::new(weights).ok();
    }

    /// Whether nothing gives light (surfaces that are shown unlit aside).
    pub(crate) fn is_dark(&self) -> bool {
        self.kinds.iter().all(|k| *k == 0.0)
            && self.environment.as_ref().is_none_or(EnvironmentLight::is_black)
    }

    /// Whether light sampling alone misses light of the environment.
    pub(crate) fn misses_environment(&self) -> bool {
        self.environment.as_ref().is_some_and(EnvironmentLight::is_compensated)
    }

    /// Number of lights without a surface.
    pub(crate) fn sources(&self) -> usize {
        self.sources.len()
    }

    /// Intensity of a light without a surface, or its irradiance.
    pub(crate) fn source_color(&self, index: usize) -> Vec3f {
        self.sources[index].color()
    }

    /// Whether a light without a surface throws a picture, which may leave more of one channel than of another.
    pub(crate) fn throws_picture(&self, index: usize) -> bool {
        self.sources[index].throws_picture()
    }

    /// The lights without a surface, as they were given.
    pub(crate) fn given(&self) -> &[LightSource] {
        &self.given
    }

    pub(crate) fn has_sources(&self) -> bool {
        !self.sources.is_empty()
    }

    /// Whether there is one light alone, so that none has to be chosen.
    #[inline(always)]
    pub(crate) fn is_single(&self) -> bool {
        self.single
    }

    /// Where the table of emitting triangles lies: another place where it was made anew.
    #[cfg(test)]
    pub(crate) fn table(&self) -> *const u32 {
        self.emitters.of_piece.as_ptr()
    }

    /// Powers of the emitting surfaces.
    #[cfg(test)]
    pub(crate) fn weights(&self) -> &[f32] {
        &self.emitters.weights
    }

    /// Bytes of the tables.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.emitters.list.as_slice())
            + size_of_val(self.emitters.weights.as_slice())
            + size_of_val(self.emitters.of_piece.as_slice())
            + self.emitter_table.as_ref().map_or(0, |t| 12 * t.len())
            + self.environment.as_ref().map_or(0, EnvironmentLight::bytes)
    }

    /// A direction from a receiver towards a light; `None` where the chosen light does not shine there.
    #[inline(never)]
    pub(crate) fn sample(&self, world: &World, from: &Receiver, u: LightRandom) -> Option<LightSample> {
        if let (true, [emitter]) = (self.single, self.emitters.list.as_slice()) {
            return emitter.sample(world, from, u.place);
        }
        let (kind, first) = self.kind(u.choice[0]);
        let choice = [first, u.choice[1]];
        let of_kind = self.kinds[kind];
        let mut sample = match kind {
            SOURCES => {
                let chosen = self.source_table.as_ref()?.sample(choice);
                let mut sample = self.sources[chosen.index].sample(from.p)?;
                sample.pdf *= chosen.pmf;
                sample.origin = LightOrigin::Source(chosen.index as u32);
                sample
            }
            ENVIRONMENT => self.environment.as_ref()?.sample(choice, u.place)?,
            _ => {
                let chosen = self.emitter_table.as_ref()?.sample(choice);
                let mut sample = self.emitters.list[chosen.index].sample(world, from, u.place)?;
                sample.pdf *= chosen.pmf;
                sample
            }
        };
        sample.pdf *= of_kind;
        (sample.pdf > 0.0 && sample.pdf.is_finite()).then_some(sample)
    }

    /// The kind for a random number, and the number stretched to `[0, 1)` again.
    #[inline(always)]
    fn kind(&self, u: f32) -> (usize, f32) {
        const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;
        let mut from = 0.0;
        let mut last = (AREA, 0.0);
        for (kind, &p) in self.kinds.iter().enumerate().filter(|(_, p)| **p > 0.0) {
            last = (kind, ((u - from) / p).clamp(0.0, BELOW_ONE));
            if u < from + p {
                return last;
            }
            from += p;
        }
        last
    }

    /// Density with which [`Self::sample`] finds the point `at` of a surface for a receiver.
    #[inline(never)]
    pub(crate) fn surface_pdf(&self, world: &World, from: &Receiver, at: &Interaction) -> f32 {
        let base = world.placed[at.instance as usize].emitter;
        let Some(table) = self.emitter_table.as_ref().filter(|_| base != crate::world::Placed::DARK) else {
            return 0.0;
        };
        let index = self.emitters.of_piece[(base + at.piece) as usize] as usize;
        self.kinds[AREA] * table.pmf(index) * self.emitters.list[index].pdf(world, from, at)
    }

    /// Radiance of the environment from a direction and, if it is `wanted`, the density with which [`Self::sample`] finds
    /// that direction (else 0).
    #[inline(never)]
    pub(crate) fn environment_from(&self, wi: Vec3f, wanted: bool) -> (Vec3f, f32) {
        let Some(e) = &self.environment else { return (Vec3f::zero(), 0.0) };
        let (radiance, pdf) = e.radiance_and_pdf(wi, wanted);
        (radiance, self.kinds[ENVIRONMENT] * pdf)
    }
}

/// Probabilities of the kinds from their powers.
fn kinds(power: [f64; 3]) -> [f32; 3] {
    let total: f64 = power.iter().sum();
    if !(total > 0.0 && total.is_finite()) {
        return [0.0; 3];
    }
    let floored = power.map(|p| if p > 0.0 { ((p / total) as f32).max(KIND_FLOOR) } else { 0.0 });
    let sum: f32 = floored.iter().sum();
    floored.map(|p| p / sum)
}

/// Relative luminance of a radiance.
pub(crate) fn luminance(c: Vec3f) -> f32 {
    photofit_image::luminance(c.to_array())
}
