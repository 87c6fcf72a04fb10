//! What a ray passes on its way: cut-outs, blended surfaces, boundaries that are not there, media.

use super::absorbers::Absorbers;
use super::medium::{absorbed, through_boundaries};
use super::sink::ShadowFlight;
use crate::light::{End, LightSample};
use crate::plan;
use crate::random::PathRandom;
use crate::volume::{MediumRef, Segment};
use crate::world::{Interaction, World, WorldHit, WorldRay};
use photofit_scalar::Vec3f;
use std::cell::RefCell;

/// Shortens a shadow ray by more than its rounding, so that it does not meet the light itself.
const SHORTENED: f32 = 1.0 - 1e-5;

/// Whether a surface stops a ray: chance decides for blended ones, always in the same way for one ray and one surface.
#[inline(always)]
fn stops<const ALPHA: bool>(world: &World, hit: &WorldHit, random: &PathRandom, ray: u32) -> bool {
    if !ALPHA || !world.placed[hit.instance as usize].alpha {
        return true;
    }
    let coverage = world.coverage(hit);
    coverage >= 1.0
        || (coverage > 0.0
            && random.surface(ray, u64::from(hit.instance) << 32 | u64::from(hit.piece)) < coverage)
}

/// The first surface along a ray.
#[inline(always)]
pub(super) fn closest<const F: u32>(
    world: &World,
    ray: &WorldRay,
    random: &PathRandom,
    index: u32,
) -> Option<WorldHit> {
    match (F & plan::TWO_LEVEL != 0, F & plan::ALPHA != 0) {
        (false, false) => closest_with::<false, false>(world, ray, random, index),
        (false, true) => closest_with::<false, true>(world, ray, random, index),
        (true, false) => closest_with::<true, false>(world, ray, random, index),
        (true, true) => closest_with::<true, true>(world, ray, random, index),
    }
}

#[inline(never)]
fn closest_with<const TWO_LEVEL: bool, const ALPHA: bool>(
    world: &World,
    ray: &WorldRay,
    random: &PathRandom,
    index: u32,
) -> Option<WorldHit> {
    world.closest_where::<TWO_LEVEL>(ray, |hit| stops::<ALPHA>(world, hit, random, index))
}

/// What surrounds the start of a shadow ray.
#[derive(Clone, Copy)]
pub(super) struct Around {
    /// The absorbing solids.
    pub(super) absorbers: Absorbers,
    /// The bounded medium.
    pub(super) medium: Option<u32>,
}

/// A part of a shadow ray.
#[derive(Clone, Copy)]
pub(super) enum Passed {
    /// In the absorbing solid of a material: its length.
    Solid(u32, f32),
    /// In a medium.
    Medium(ShadowFlight),
}

/// What a shadow ray meets.
struct Passage {
    blocked: bool,
    /// Boundaries of media, of absorbers that are not there otherwise, and panes on the way, in any order.
    crossed: Vec<WorldHit>,
}

#[inline(never)]
fn pass<const TWO_LEVEL: bool, const FILTER: bool, const MEDIA: bool>(
    world: &World,
    ray: &WorldRay,
    random: &PathRandom,
    index: u32,
) -> Passage {
    let crossed = RefCell::new(Vec::new());
    let blocked = world.occluded_where::<TWO_LEVEL>(ray, |hit| {
        if FILTER {
            let material = &world.materials[world.placed[hit.instance as usize].material as usize];
            let bounds = MEDIA && world.media.is_bounded() && (material.is_null || material.pane);
            if bounds || (material.is_null && material.solid) {
                crossed.borrow_mut().push(*hit);
            }
            if material.is_null || (MEDIA && material.pane) {
                return false;
            }
        }
        stops::<FILTER>(world, hit, random, index)
    });
    Passage { blocked, crossed: crossed.into_inner() }
}

/// Part of the light of a sample that arrives at `from`; `surface` is where the ray starts, if it is on a surface,
/// `around` is what surrounds the start; `passed` is told the parts in absorbing solids and in media.
#[inline(always)]
pub(super) fn transmittance<const F: u32>(
    world: &World,
    from: Vec3f,
    surface: Option<&Interaction>,
    light: &LightSample,
    around: Around,
    (random, index): (&PathRandom, u32),
    mut passed: impl FnMut(Passed),
) -> Vec3f {
    let origin = surface.map_or(from, |s| s.beside(light.wi));
    let ray = match light.end {
        End::Infinite => WorldRay { origin, direction: light.wi, t_max: f32::INFINITY },
        End::Point(p) | End::Surface(p) => {
            let v = p - origin;
            let distance = v.length();
            if distance == 0.0 {
                return Vec3f::splat(1.0);
            }
            WorldRay { origin, direction: v * (1.0 / distance), t_max: distance * SHORTENED }
        }
    };
    let filter = F & (plan::ALPHA | plan::ABSORPTION) != 0;
    let passage = match (F & plan::TWO_LEVEL != 0, filter, F & plan::VOLUMES != 0) {
        (_, _, true) => pass::<true, true, true>(world, &ray, random, index),
        (false, false, _) => pass::<false, false, false>(world, &ray, random, index),
        (false, true, _) => pass::<false, true, false>(world, &ray, random, index),
        (true, false, _) => pass::<true, false, false>(world, &ray, random, index),
        (true, true, _) => pass::<true, true, false>(world, &ray, random, index),
    };
    if passage.blocked {
        return Vec3f::zero();
    }
    let mut through = Vec3f::splat(1.0);
    if F & plan::VOLUMES != 0 {
        let mut rng = random.tracking(index);
        for (i, medium) in world.media.boxes.iter().enumerate() {
            let along = Segment { origin: ray.origin, direction: ray.direction, length: ray.t_max };
            passed(Passed::Medium(ShadowFlight { medium: MediumRef::Volume(i), along }));
            through *= medium.transmittance(ray.origin, ray.direction, ray.t_max, &mut rng);
            if through == Vec3f::zero() {
                return through;
            }
        }
        return through.mul(through_boundaries(world, &ray, passage.crossed, around, &mut rng, passed));
    }
    if F & plan::ABSORPTION != 0 {
        if passage.crossed.is_empty() {
            if let Some(solid) = around.absorbers.innermost_on(ray.t_max) {
                passed(Passed::Solid(solid, ray.t_max));
            }
            return absorbed(around.absorbers.absorption(world), ray.t_max);
        }
        let mut rng = random.tracking(index);
        return through_boundaries(world, &ray, passage.crossed, around, &mut rng, passed);
    }
    through
}
