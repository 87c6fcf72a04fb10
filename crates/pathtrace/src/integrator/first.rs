//! What a camera ray meets first, for the auxiliary images.

use super::{FirstHit, PathOptions};
use crate::plan;
use crate::world::{Interaction, SurfaceMaterial, World, WorldHit, WorldRay};
use photofit_scalar::Vec3f;

/// Blended surfaces that are looked through.
const LAYERS: usize = 16;
/// What is left to see, below which nothing more is looked for.
const REST: f32 = 1e-2;

pub(super) fn first_hit(at: &Interaction, material: &SurfaceMaterial<'_>, wo: Vec3f) -> FirstHit {
    let turned = |n: Vec3f| if at.front { n } else { -n };
    let shading = if material.n.dot(wo) < 0.0 { -material.n } else { material.n };
    FirstHit {
        p: at.p,
        ng: turned(at.ng),
        ns: shading,
        albedo: material.albedo(material.to_local(wo)),
        instance: at.instance,
    }
}

/// What a ray meets that sees through blended surfaces: the surface (or the background) of which most is seen, with the
/// mean albedo of all. `None` where nothing is blended.
///
/// The path itself stops at one of them by chance. Auxiliary images of that would be noisy, and be no guide for a
/// denoiser.
#[inline(never)]
pub(super) fn seen_through<const F: u32>(
    world: &World,
    ray: &WorldRay,
    options: &PathOptions,
) -> Option<FirstHit> {
    let wo = -ray.direction;
    let (mut beyond, mut rest, mut albedo) = (f32::NEG_INFINITY, 1.0_f32, Vec3f::zero());
    let (mut most, mut best) = (0.0, FirstHit::default());
    for layer in 0..LAYERS {
        let Some(hit) = next_surface::<F>(world, ray, options, beyond) else {
            if layer == 0 {
                return None;
            }
            if rest > most {
                best = FirstHit::default();
            }
            break;
        };
        let coverage = world.coverage(&hit);
        if layer == 0 && coverage >= 1.0 {
            return None;
        }
        let at = world.interaction::<true>(ray, &hit);
        let mut found = None;
        let first = first_hit(&at, &world.material_at::<true>(&at, wo, &mut found), wo);
        let share = rest * coverage;
        albedo += first.albedo * share;
        if share > most {
            (most, best) = (share, first);
        }
        rest *= 1.0 - coverage;
        if rest < REST {
            break;
        }
        beyond = hit.t;
    }
    Some(FirstHit { albedo, ..best })
}

/// Whether the camera sees the surface at a hit: neither the back of a single-sided one nor a light that is not shown.
#[inline(always)]
pub(super) fn camera_sees<const F: u32>(world: &World, options: &PathOptions, hit: &WorldHit) -> bool {
    let hidden = F & plan::EMITTERS != 0 && !options.show_emitters && world.emits(hit.instance);
    !hidden && !world.culls(hit)
}

/// The first surface behind a distance of which anything is seen.
fn next_surface<const F: u32>(
    world: &World,
    ray: &WorldRay,
    options: &PathOptions,
    beyond: f32,
) -> Option<WorldHit> {
    let seen = |hit: &WorldHit| {
        hit.t > beyond
            && camera_sees::<F>(world, options, hit)
            && !(F & plan::ABSORPTION != 0 && world.is_invisible(hit.instance))
            && world.coverage(hit) > 0.0
    };
    match F & plan::TWO_LEVEL != 0 {
        true => world.closest_where::<true>(ray, seen),
        false => world.closest_where::<false>(ray, seen),
    }
}
