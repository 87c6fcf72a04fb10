//! What a scene needs of the integrator, and the compiled variant that has just that.
//!
//! The integrator is one generic function over a set of [`Features`]; what a set leaves out is not compiled into it. A
//! few sets are compiled; [`RenderPlan::new`] picks the smallest that covers a world.

use crate::integrator::Kernel;
use crate::integrator::path::{trace_aovs, trace_picture};
use crate::world::World;
use std::fmt;

/// Instances, spheres and grids of distances: a ray walks two levels.
pub(crate) const TWO_LEVEL: u32 = 1;
/// Surfaces that let rays pass at random or by a mask, or that are not there.
pub(crate) const ALPHA: u32 = 1 << 1;
/// Materials that vary over a surface.
pub(crate) const TEXTURES: u32 = 1 << 2;
/// An environment.
pub(crate) const ENVIRONMENT: u32 = 1 << 3;
/// Lights without a surface.
pub(crate) const SOURCES: u32 = 1 << 4;
/// Surfaces that emit or are shown unlit.
pub(crate) const EMITTERS: u32 = 1 << 5;
/// Participating media.
pub(crate) const VOLUMES: u32 = 1 << 6;
/// Absorption inside of surfaces, or surfaces that are boundaries alone: absorption is followed across them.
pub(crate) const ABSORPTION: u32 = 1 << 7;
/// Everything.
pub(crate) const ALL: u32 = (1 << 8) - 1;
/// What paths have whose directions a sampler chooses, in worlds without media; in others they have everything. Sets are many,
/// and each of them would be compiled for each sampler.
pub(crate) const SAMPLED: u32 = ALL & !VOLUMES;

/// Names and what is left out, in the order of the bits.
const NAMES: [(&str, &str); 8] = [
    ("two-level traversal", "one hierarchy holds everything"),
    ("alpha tests", "every surface is opaque"),
    ("texture lookup", "no material varies over its surface"),
    ("environment light", "there is no environment"),
    ("light sources", "there is no point, spot or directional light and no projector"),
    ("light of surfaces", "no surface emits or is unlit"),
    ("media", "there are no volumes"),
    ("absorption, boundaries", "no surface encloses an absorbing solid or is a boundary alone"),
];

/// A set of features.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Features(pub(crate) u32);

impl Features {
    /// All features.
    pub const ALL: Self = Self(ALL);

    /// Every feature with its name.
    pub fn each() -> impl Iterator<Item = (&'static str, Self)> {
        NAMES.iter().enumerate().map(|(bit, (name, _))| (*name, Self(1 << bit)))
    }

    /// What a world needs.
    pub fn of(world: &World) -> Self {
        let placed = |f: &dyn Fn(&crate::world::Placed) -> bool| world.placed.iter().any(f);
        let material = |p: &crate::world::Placed| &world.materials[p.material as usize];
        let bits = [
            (TWO_LEVEL, !world.is_one_level()),
            (ALPHA, placed(&|p| p.alpha)),
            (TEXTURES, placed(&|p| p.varies)),
            (ENVIRONMENT, world.lights.environment.is_some()),
            (SOURCES, world.lights.has_sources()),
            (EMITTERS, placed(&|p| material(p).emits || material(p).unlit)),
            (VOLUMES, !world.media.is_empty()),
            (ABSORPTION, placed(&|p| material(p).absorbs())),
        ];
        Self(bits.iter().filter(|b| b.1).fold(0, |set, b| set | b.0))
    }

    /// Whether every feature of `other` is in this set.
    pub fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

/// The sets that are compiled.
const SETS: [u32; 12] = {
    const STANDARD: u32 = TEXTURES | ENVIRONMENT | SOURCES | EMITTERS;
    [
        EMITTERS,
        ENVIRONMENT,
        SOURCES,
        EMITTERS | TWO_LEVEL,
        TEXTURES | ENVIRONMENT,
        TEXTURES | ENVIRONMENT | ALPHA,
        STANDARD,
        STANDARD | ALPHA,
        STANDARD | TWO_LEVEL,
        STANDARD | ALPHA | TWO_LEVEL,
        SAMPLED,
        ALL,
    ]
};

/// Each set with its integrators: of the picture alone, and with what auxiliary images need.
const KERNELS: [(u32, [Kernel; 2]); 12] = [
    (SETS[0], [trace_picture::<{ SETS[0] }>, trace_aovs::<{ SETS[0] }>]),
    (SETS[1], [trace_picture::<{ SETS[1] }>, trace_aovs::<{ SETS[1] }>]),
    (SETS[2], [trace_picture::<{ SETS[2] }>, trace_aovs::<{ SETS[2] }>]),
    (SETS[3], [trace_picture::<{ SETS[3] }>, trace_aovs::<{ SETS[3] }>]),
    (SETS[4], [trace_picture::<{ SETS[4] }>, trace_aovs::<{ SETS[4] }>]),
    (SETS[5], [trace_picture::<{ SETS[5] }>, trace_aovs::<{ SETS[5] }>]),
    (SETS[6], [trace_picture::<{ SETS[6] }>, trace_aovs::<{ SETS[6] }>]),
    (SETS[7], [trace_picture::<{ SETS[7] }>, trace_aovs::<{ SETS[7] }>]),
    (SETS[8], [trace_picture::<{ SETS[8] }>, trace_aovs::<{ SETS[8] }>]),
    (SETS[9], [trace_picture::<{ SETS[9] }>, trace_aovs::<{ SETS[9] }>]),
    (SETS[10], [trace_picture::<{ SETS[10] }>, trace_aovs::<{ SETS[10] }>]),
    (SETS[11], [trace_picture::<{ SETS[11] }>, trace_aovs::<{ SETS[11] }>]),
];

/// Which integrator runs for a world, and why.
#[derive(Clone, Copy)]
pub struct RenderPlan {
    /// What the world needs.
    pub needs: Features,
    /// What the chosen integrator has.
    pub has: Features,
    /// For the picture alone, and with what auxiliary images need.
    pub(crate) kernels: [Kernel; 2],
}

impl RenderPlan {
    /// The smallest compiled integrator that has all that `world` needs.
    pub fn new(world: &World) -> Self {
        Self::with_at_least(world, Features::default())
    }

    /// Of paths in `world` whose directions a sampler chooses ([`crate::Renderer::pass_with`], [`crate::Renderer::pass_side_by_side`], [`crate::Renderer::walk`]).
    pub fn sampled(world: &World) -> Self {
        Self::with_at_least(world, Features(SAMPLED))
    }

    /// As [`Self::new`], with further features that nothing needs: to measure what they cost.
    pub fn with_at_least(world: &World, further: Features) -> Self {
        let needs = Features::of(world);
        let wanted = Features(needs.0 | further.0);
        let (has, kernels) = KERNELS
            .into_iter()
            .filter(|(set, _)| Features(*set).contains(wanted))
            .min_by_key(|(set, _)| set.count_ones())
            .unwrap_or((ALL, [trace_picture::<ALL>, trace_aovs::<ALL>]));
        Self { needs, has: Features(has), kernels }
    }
}

impl fmt::Debug for RenderPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RenderPlan")
            .field("needs", &self.needs)
            .field("has", &self.has)
            .finish_non_exhaustive()
    }
}

/// One line per feature: runs, is skipped and why, or is compiled in without being needed.
impl fmt::Display for RenderPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (bit, (name, absent)) in NAMES.iter().enumerate() {
            let bit = 1 << bit;
            let (word, why) = match (self.needs.0 & bit != 0, self.has.0 & bit != 0) {
                (true, _) => ("runs", ""),
                (false, true) => ("idle", *absent),
                (false, false) => ("skipped", *absent),
            };
            let why = if why.is_empty() { String::new() } else { format!(": {why}") };
            writeln!(f, "  {name:<22} {word}{why}")?;
        }
        Ok(())
    }
}
