//! What a fit of a surface runs: the samples of its maps that are fitted, and the passes that draw it ("skip what a scene
//! doesn't need"). The rows in which every task tells what it runs stand beside it.

pub(crate) mod rows;

pub use rows::{Item, PlanRows, Runs};

use super::reference::{ENERGY, ReferenceKind};
use super::surface::{coarse_rates, rates_of};
use crate::candidate::{Candidate, SurfaceClass};
use photofit_raster::deferred::{Masks, Passes};
use photofit_raster::{CHANNELS, channel};
use rows::Work;

/// A sample that varies less than this over the baked maps is constant: one step of 8 bits.
const CONSTANT: f32 = 1.0 / 255.0;

/// What is asked of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitRequest {
    /// Steps that are made at most.
    pub steps: u64,
    /// Whether its shape may move in them.
    pub moves: bool,
    /// What the pictures are that it is fitted to.
    pub reference: ReferenceKind,
}

/// Which samples of a surface's maps are fitted, and which passes draw it: what the maps of the start say.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfacePlan {
    /// The passes of the renderer.
    pub passes: Passes,
    /// Whether each sample of a texel is fitted; one that is the same everywhere in the baked maps is not.
    pub fitted: [bool; CHANNELS],
    /// Whether the outlines of masks are fitted, so that masks fade in the steps.
    pub fades: bool,
    /// Whether each sample varies over the baked maps and stays as it is.
    held: [bool; CHANNELS],
    /// Whether coarse mip levels have texels of their own.
    free_mips: bool,
}

/// Whether a sample varies over the base level of maps.
fn varies(candidate: &Candidate, c: usize) -> bool {
    let base = &candidate.maps.levels[0].texels;
    let (lo, hi) = base.iter().fold((f32::MAX, f32::MIN), |(lo, hi), t| (lo.min(t[c]), hi.max(t[c])));
    hi - lo > CONSTANT
}

/// Whether each sample varies and is not fitted, where these are.
pub(super) fn held(candidate: &Candidate, fitted: [bool; CHANNELS]) -> [bool; CHANNELS] {
    std::array::from_fn(|c| c <= channel::OCCLUSION && !fitted[c] && varies(candidate, c))
}

impl SurfacePlan {
    /// The plan of a candidate with baked maps.
    pub fn new(candidate: &Candidate, asked: FitRequest) -> Self {
        let base = &candidate.maps.levels[0].texels;
        let any = |c: usize, f: &dyn Fn(f32) -> bool| base.iter().any(|t| f(t[c]));
        let used = |is: fn(&SurfaceClass) -> bool| {
            candidate.class.iter().any(|c| is(&candidate.classes[*c as usize]))
        };
        let varies = |c: usize| varies(candidate, c);
        let metallic = any(channel::METALLIC, &|x| x > 0.02);
        let mut fitted = [false; CHANNELS];
        // Shadows and light between surfaces go into the base colour.
        fitted[..3].fill(asked.reference.indirect_light || (0..3).any(varies));
        fitted[channel::ALPHA] = used(SurfaceClass::has_alpha);
        fitted[channel::ROUGHNESS] = varies(channel::ROUGHNESS);
        fitted[channel::METALLIC] = metallic && varies(channel::METALLIC);
        let bent = (0..2).any(|k| any(channel::NORMAL + k, &|x| x.abs() > CONSTANT));
        // On a shape that moves, flat maps do not stay flat.
        let moves = asked.steps > 0 && asked.moves;
        fitted[channel::NORMAL..channel::NORMAL + 3].fill(bent || moves);
        let emissive = (0..3).any(|k| any(channel::EMISSIVE + k, &|x| x > 1e-4));
        fitted[channel::EMISSIVE..channel::EMISSIVE + 3].fill(emissive);
        let plan = Self::of_samples(candidate, fitted, moves);
        let passes = Passes { map_gradients: asked.steps > 0 && fitted.contains(&true), ..plan.passes };
        Self { passes, fades: used(SurfaceClass::is_masked), ..plan }
    }

    /// The plan of a candidate of whose maps these samples are fitted, and drawn where they need a pass of their own, and whose
    /// shape moves or not. No mask fades.
    pub fn of_samples(candidate: &Candidate, fitted: [bool; CHANNELS], moves: bool) -> Self {
        let passes = Passes {
            masks: Masks::Cut,
            alpha_gradients: fitted[channel::ALPHA],
            normal_map: fitted[channel::NORMAL],
            emissive: fitted[channel::EMISSIVE],
            // Blended silhouettes are there for the gradients of positions.
            antialias: moves,
            max_layers: if candidate.is_transparent() { Passes::default().max_layers } else { 1 },
            position_gradients: moves,
            map_gradients: fitted.contains(&true),
            energy: ENERGY,
        };
        let held = held(candidate, fitted);
        Self { passes, fitted, fades: false, held, free_mips: candidate.fitted_levels() > 1 }
    }

    /// What a fit of so many steps does with the surface.
    pub(crate) fn work(&self, steps: u64) -> Work {
        let rates = rates_of(self.fitted);
        let coarse = self.free_mips.then(|| coarse_rates(rates));
        let Self { passes, held, .. } = *self;
        Work { passes, rates, coarse, held, moves: passes.position_gradients, steps: steps > 0 }
    }
}

#[cfg(test)]
pub(crate) mod tests;
