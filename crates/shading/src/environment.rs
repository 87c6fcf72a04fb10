//! Light from all around: prefiltered for diffuse and specular reflection.
//!
//! Diffuse: the cosine-weighted mean radiance per normal (irradiance over pi). Specular: radiance filtered by the GGX
//! lobe, one image per roughness, in the approximation that viewer, normal and lobe axis coincide (split-sum, Karis
//! 2013), read trilinearly. Both are octahedral images whose derivatives are those of the interpolation.
//!
//! The diffuse part is a table of 64x64 normals, not spherical harmonics: of second order, these leave 6 % of a small
//! light's peak as ringing on either side, while the table errs by half a percent of the peak at most.
//!
//! Under a sky with a small sun, the specular levels agree with integration within 3 % (up to roughness 0.4) and
//! 0.6 % (above), relative rms; reflection in the split-sum approximation errs by 2..10 % of the exact integral.

use crate::octahedral::Octahedral;
use photofit_scalar::{Real, Vec3, vec3};

/// Roughness levels of the specular chain: level k is roughness `k / (LEVELS - 1)`.
pub(crate) const LEVELS: usize = 9;

/// Why an environment cannot be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EnvironmentError {
    /// No pixels.
    #[error("environment image is empty ({width}x{height})")]
    Empty {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// The slice does not hold three numbers per pixel.
    #[error("environment image of {width}x{height} needs 3 numbers per pixel, got {length}")]
    Length {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Numbers in the slice.
        length: usize,
    },
}

/// A prefiltered environment map.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment<T = f32> {
    pub(crate) diffuse: Octahedral<T>,
    pub(crate) specular: Vec<Octahedral<T>>,
}

impl<T: Real> Environment<T> {
    /// Irradiance over pi for the normal `n`: what a white Lambertian surface reflects.
    #[inline(always)]
    pub fn diffuse(&self, n: Vec3<T>) -> Vec3<T> {
        self.diffuse.lookup(n)
    }

    /// Value of [`Self::diffuse`] and gradient with respect to `n`; `seed` maps the value to its gradient.
    #[inline(always)]
    pub fn diffuse_vjp(&self, n: Vec3<T>, seed: impl FnOnce(Vec3<T>) -> Vec3<T>) -> (Vec3<T>, Vec3<T>) {
        self.diffuse.lookup_vjp(n, seed)
    }

    /// Radiance around `d` (any length), filtered for a perceptual roughness in 0..1.
    #[inline(always)]
    pub fn specular(&self, d: Vec3<T>, roughness: T) -> Vec3<T> {
        let (i, f, _) = level(roughness);
        let (low, high) = (self.specular[i].lookup(d), self.specular[i + 1].lookup(d));
        low + (high - low) * f
    }

    /// Value of [`Self::specular`] and its gradient with respect to `d` and the roughness for the gradient `g`.
    #[inline(always)]
    pub fn specular_vjp(&self, d: Vec3<T>, roughness: T, g: Vec3<T>) -> (Vec3<T>, Vec3<T>, T) {
        let (i, f, slope) = level(roughness);
        let (low, d_low) = self.specular[i].lookup_vjp(d, |_| g * (T::one() - f));
        let (high, d_high) = self.specular[i + 1].lookup_vjp(d, |_| g * f);
        (low + (high - low) * f, d_low + d_high, g.dot(high - low) * slope)
    }

    /// Mean radiance over all directions: the average of a white diffuse sphere over its normals.
    pub fn mean_radiance(&self) -> Vec3<f64> {
        let (mut sum, mut weight, n) = (Vec3::zero(), 0.0, self.diffuse.size());
        for k in 0..n * n {
            let w = self.diffuse.texel_direction(k % n, k / n).1;
            sum += self.diffuse.texel(k % n, k / n).cast() * w;
            weight += w;
        }
        sum * (1.0 / weight)
    }

    /// Scaled so that the luminance (Rec.709) of [`Self::mean_radiance`] is `target`; a black environment stays black.
    #[must_use]
    pub fn normalised(mut self, target: T) -> Self {
        let luminance = self.mean_radiance().dot(vec3(0.2126, 0.7152, 0.0722));
        if luminance > 0.0 {
            let factor = target / T::of(luminance);
            self.diffuse.scale(factor);
            self.specular.iter_mut().for_each(|s| s.scale(factor));
        }
        self
    }

    /// Converts the numbers to another scalar.
    pub fn cast<U: Real>(&self) -> Environment<U> {
        Environment {
            diffuse: self.diffuse.cast(),
            specular: self.specular.iter().map(Octahedral::cast).collect(),
        }
    }
}

/// Level, fraction towards the next level, and levels per roughness (0 where clamped).
#[inline(always)]
fn level<T: Real>(roughness: T) -> (usize, T, T) {
    let (zero, one) = (T::zero(), T::one());
    let slope = T::of((LEVELS - 1) as f64);
    let r = roughness.clamp_to(zero, one);
    let x = r * slope;
    let i = (x.f64() as usize).min(LEVELS - 2);
    (i, x - T::of(i as f64), if r == roughness { slope } else { zero })
}
