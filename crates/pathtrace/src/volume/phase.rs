//! The phase function of Henyey and Greenstein (1941); isotropic for `g = 0`.

use photofit_scalar::{Vec3f, vec3};
use std::f32::consts::{PI, TAU};

/// Below this anisotropy the function is isotropic within rounding.
const ISOTROPIC: f32 = 1e-3;

/// Density per solid angle of scattering from a ray along `direction` into `wi`: `cosine = direction . wi`, positive `g`
/// scatters forward.
#[inline]
pub(crate) fn phase(g: f32, cosine: f32) -> f32 {
    let d = 1.0 + g * g - 2.0 * g * cosine;
    (1.0 - g * g) / (4.0 * PI * d * d.max(1e-12).sqrt()).max(1e-30)
}

/// A direction with exactly that density.
#[inline]
pub(crate) fn sample_phase(g: f32, direction: Vec3f, u: [f32; 2]) -> Vec3f {
    let cosine = if g.abs() < ISOTROPIC {
        1.0 - 2.0 * u[0]
    } else {
        let q = (1.0 - g * g) / (1.0 + g - 2.0 * g * u[0]);
        ((1.0 + g * g - q * q) / (2.0 * g)).clamp(-1.0, 1.0)
    };
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let (sin_phi, cos_phi) = (TAU * u[1]).sin_cos();
    let (s, t) = direction.orthonormal_pair();
    let local = vec3(sine * cos_phi, sine * sin_phi, cosine);
    (s * local.x + t * local.y + direction * local.z).normalize_or_zero()
}
