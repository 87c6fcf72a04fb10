//! The smallest path tracer that is right: plain recursion, uniform directions, no light sampling, no weights. It is the
//! oracle of the tests and the baseline of the benchmarks, which alone run it.

use super::{PathOptions, PathSample};
use crate::random::PathRandom;
use crate::world::{World, WorldRay};
use photofit_sampling::{uniform_sphere, uniform_sphere_pdf};
use photofit_scalar::Vec3f;

/// Estimates the radiance along a ray: `L = Le + f(wo, wi) |cos| L(wi) / pdf`, with `wi` uniform on the sphere where the
/// BSDF is a function, and its own choice where it is a delta distribution.
///
/// Lights without a surface, media and absorption are not seen; surfaces are opaque.
pub(crate) fn trace(world: &World, ray: &WorldRay, random: &PathRandom, options: &PathOptions) -> PathSample {
    let radiance = radiance(world, ray, random, options.max_depth, 0);
    PathSample { radiance, direct: radiance, alpha: 1.0, ..PathSample::default() }
}

fn radiance(world: &World, ray: &WorldRay, random: &PathRandom, max_depth: u32, depth: u32) -> Vec3f {
    let Some(hit) = world.closest_where::<true>(ray, |_| true) else {
        return world.lights.environment_from(ray.direction, false).0;
    };
    let at = world.interaction::<true>(ray, &hit);
    let wo = -ray.direction;
    let mut found = None;
    let material = world.material_at::<true>(&at, wo, &mut found);
    if depth == max_depth {
        return material.emission;
    }
    let u = random.scatter(depth);
    let (wi, weight) = if material.is_delta() {
        match material.sample(material.to_local(wo), random.lobe(depth), u) {
            Some(s) => (material.to_render(s.wi).normalize_or_zero(), s.weight),
            None => return material.emission,
        }
    } else {
        let wi: Vec3f = uniform_sphere(u);
        let value = material.eval_pdf(material.to_local(wo), material.to_local(wi)).0;
        (wi, value * (1.0 / uniform_sphere_pdf::<f32>()))
    };
    if weight == Vec3f::zero() {
        return material.emission;
    }
    let next = at.leave(wi, f32::INFINITY);
    material.emission + weight.mul(radiance(world, &next, random, max_depth, depth + 1))
}
