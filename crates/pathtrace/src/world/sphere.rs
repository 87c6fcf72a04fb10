//! The sphere: exact intersection and its texture coordinates.

use glam::DVec3;
use photofit_scalar::{Vec2f, Vec3f, vec2, vec3};

/// Distances at which a ray meets the unit sphere around the origin, the nearer first; in lengths of `d`.
///
/// The discriminant is taken from the point of the ray closest to the centre, which keeps its digits for far origins
/// (Haines et al. 2019, "Precision Improvements for Ray/Sphere Intersection", Ray Tracing Gems 7).
#[inline]
pub(crate) fn intersect(o: DVec3, d: DVec3) -> Option<[f64; 2]> {
    let a = d.length_squared();
    let b = -o.dot(d);
    let closest = o + d * (b / a);
    let discriminant = a * (1.0 - closest.length_squared());
    // Written so that NaN fails.
    if !(discriminant >= 0.0 && a > 0.0) {
        return None;
    }
    let c = o.length_squared() - 1.0;
    let q = b + discriminant.sqrt().copysign(b);
    if q == 0.0 {
        return Some([0.0, 0.0]);
    }
    let (s, t) = (c / q, q / a);
    Some([s.min(t), s.max(t)])
}

/// Texture coordinates of a point of the unit sphere: `u` the angle around z from x over 2 pi, `v` the angle from +z
/// over pi.
#[inline]
pub(crate) fn uv(q: Vec3f) -> Vec2f {
    let phi = q.y.atan2(q.x);
    let turn = std::f32::consts::TAU;
    let u = if phi < 0.0 { phi + turn } else { phi } / turn;
    vec2(u, q.z.clamp(-1.0, 1.0).acos() / std::f32::consts::PI)
}

/// The tangent along `u`, not normalised; any across the normal at the poles.
#[inline]
pub(crate) fn tangent(q: Vec3f) -> Vec3f {
    if q.x * q.x + q.y * q.y > 1e-12 { vec3(-q.y, q.x, 0.0) } else { vec3(0.0, 1.0, 0.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_far_inside_and_missing() {
        let x = DVec3::X;
        assert_eq!(intersect(-3.0 * x, x), Some([2.0, 4.0]));
        assert_eq!(intersect(-3.0 * x, 2.0 * x), Some([1.0, 2.0]));
        assert_eq!(intersect(DVec3::ZERO, x), Some([-1.0, 1.0]));
        assert_eq!(intersect(3.0 * x, x), Some([-4.0, -2.0]));
        assert_eq!(intersect(DVec3::new(-3.0, 1.1, 0.0), x), None);
        assert_eq!(intersect(-3.0 * x, DVec3::ZERO), None);
        let [near, _] = intersect(DVec3::new(-1e9, 0.5, 0.0), x).unwrap();
        assert!((near - (1e9 - 0.75_f64.sqrt())).abs() < 1e-6, "{near}");
    }

    #[test]
    fn coordinates_turn_around_z() {
        assert_eq!(uv(vec3(0.0, 0.0, 1.0)).y, 0.0);
        assert_eq!(uv(vec3(1.0, 0.0, 0.0)), vec2(0.0, 0.5));
        assert_eq!(uv(vec3(0.0, 1.0, 0.0)).x, 0.25);
        assert_eq!(uv(vec3(0.0, -1.0, 0.0)).x, 0.75);
        for q in [vec3(0.6, 0.0, 0.8), vec3(0.0, 0.0, -1.0)] {
            assert!(tangent(q).length() > 0.1 && tangent(q).dot(q) == 0.0);
        }
    }
}
