//! Tests of the crate: gradients, energy, reciprocity, precision.

mod bench;
mod gradients;
mod lighting;
mod renderers;
mod scattering;

use crate::Surface;
use photofit_gradcheck::Uniform;
use photofit_scalar::{Vec3, vec3};

/// A random vector with components in `[-1, 1)`.
pub(crate) fn vector(random: &mut Uniform) -> Vec3<f64> {
    vec3(random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(-1.0, 1.0))
}

/// A random unit vector.
pub(crate) fn unit(random: &mut Uniform) -> Vec3<f64> {
    loop {
        let v = vector(random);
        let l = v.length();
        if l > 0.1 && l < 1.0 {
            return v * (1.0 / l);
        }
    }
}

/// A random unit vector at the cosine `c` from `n`.
pub(crate) fn at_cosine(random: &mut Uniform, n: Vec3<f64>, c: f64) -> Vec3<f64> {
    let (s, t) = n.orthonormal_pair();
    let phi = random.range(0.0, std::f64::consts::TAU);
    n * c + (s * phi.cos() + t * phi.sin()) * (1.0 - c * c).sqrt()
}

/// A random material of the given roughness.
pub(crate) fn material(random: &mut Uniform, roughness: f64) -> Surface<f64> {
    Surface {
        base_color: vec3(random.range(0.05, 1.0), random.range(0.05, 1.0), random.range(0.05, 1.0)),
        roughness,
        metallic: random.range(0.0, 1.0),
        gamma: random.range(0.0, 0.9),
    }
}

/// A material as six numbers, and back.
pub(crate) fn flatten(s: &Surface<f64>) -> Vec<f64> {
    vec![s.base_color.x, s.base_color.y, s.base_color.z, s.roughness, s.metallic, s.gamma]
}

/// Inverse of [`flatten`].
pub(crate) fn unflatten(x: &[f64]) -> Surface<f64> {
    Surface { base_color: vec3(x[0], x[1], x[2]), roughness: x[3], metallic: x[4], gamma: x[5] }
}

/// Three numbers of a slice as a vector.
pub(crate) fn at(x: &[f64], i: usize) -> Vec3<f64> {
    vec3(x[i], x[i + 1], x[i + 2])
}

/// Concatenates vectors behind a list of numbers.
pub(crate) fn join(mut head: Vec<f64>, vectors: &[Vec3<f64>]) -> Vec<f64> {
    for v in vectors {
        head.extend(v.to_array());
    }
    head
}
