//! The von Mises-Fisher distribution on the sphere.

use photofit_scalar::{Vec3f, vec3};
use std::f32::consts::TAU;

/// Bounds of the concentration.
pub(super) const KAPPA: [f32; 2] = [0.1, 2e4];
/// Concentration of the lobe that stands for the cosine: both have the same mean cosine, 2/3.
pub(super) const KAPPA_COSINE: f32 = 2.98;
/// `N(k)` of it.
pub(super) const NORM_COSINE: f32 = 0.475_508_5;

/// A lobe `w N(k) e^(k (m . d - 1))`, `N(k) = k / (2 pi (1 - e^(-2k)))`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lobe {
    /// Share of the mixture.
    pub(super) weight: f32,
    /// Unit mean direction.
    pub(super) mean: Vec3f,
    /// Concentration, within [`KAPPA`].
    pub(super) kappa: f32,
    /// `N(k)`: kept, since it costs as much as a density.
    pub(super) norm: f32,
}

/// `N(k)`; where `k` is large the other pole of the sphere has no part in it.
#[inline(always)]
fn norm(kappa: f32) -> f32 {
    if kappa > 9.0 { kappa / TAU } else { kappa / (TAU * -(-2.0 * kappa).exp_m1()) }
}

impl Lobe {
    /// A lobe around the unit vector `mean`.
    #[inline(always)]
    pub(super) fn new(weight: f32, mean: Vec3f, kappa: f32) -> Self {
        Self { weight, mean, kappa, norm: norm(kappa) }
    }

    /// Density of a direction, without the weight.
    #[cfg(test)]
    pub(super) fn pdf(&self, wi: Vec3f) -> f32 {
        let apart = self.mean - wi;
        self.norm * (self.kappa * -0.5 * apart.dot(apart)).exp()
    }

    /// A direction for `u` in `[0, 1)`.
    #[inline(always)]
    pub(super) fn sample(&self, u: [f32; 2]) -> Vec3f {
        let fall = (-2.0 * self.kappa).exp();
        // One minus the cosine, of which narrow lobes need all digits.
        let w = (-(1.0 - u[0] * (1.0 - fall)).max(f32::MIN_POSITIVE).ln() / self.kappa).clamp(0.0, 2.0);
        let (z, r) = (1.0 - w, (w * (2.0 - w)).sqrt());
        let (s, c) = (TAU * u[1]).sin_cos();
        let (x, y) = self.mean.orthonormal_pair();
        (x * (r * c) + y * (r * s) + self.mean * z).normalize_or_zero()
    }

    /// The lobe times that of the cosine around `n`: again a lobe, weighted by the integral; what a mixture does for all
    /// of its lobes.
    #[cfg(test)]
    pub(super) fn with_cosine(&self, n: Vec3f) -> Self {
        let sum = self.mean * self.kappa + n * KAPPA_COSINE;
        let length = sum.length();
        let kappa = length.clamp(KAPPA[0], KAPPA[1] + KAPPA_COSINE);
        let mean = if length > 1e-6 { sum * (1.0 / length) } else { n };
        let mut product = Self::new(self.weight, mean, kappa);
        product.weight *= self.norm * NORM_COSINE / product.norm * (kappa - self.kappa - KAPPA_COSINE).exp();
        product
    }

    /// The lobe whose samples have this mean vector (Banerjee et al. 2005).
    pub(super) fn of_mean(weight: f32, mean: Vec3f) -> Self {
        let r = mean.length().min(0.999_99);
        let kappa = (r * (3.0 - r * r) / (1.0 - r * r)).clamp(KAPPA[0], KAPPA[1]);
        let mean = if r > 1e-6 { mean.normalize_or_zero() } else { vec3(0.0, 0.0, 1.0) };
        Self::new(weight, mean, kappa)
    }
}

/// Length of the mean vector of the samples of a lobe of this concentration.
pub(super) fn mean_length(kappa: f32) -> f32 {
    1.0 / kappa.tanh() - 1.0 / kappa
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::{Rng, chi_square};

    #[test]
    fn samples_follow_the_density() {
        let mean = vec3(0.6, 0.0, 0.8);
        for kappa in [0.1, 1.0, 20.0, 500.0, KAPPA[1]] {
            let lobe = Lobe::new(1.0, mean, kappa);
            let (n, bins) = (100_000, 20);
            let mut rng = Rng::new(3, kappa.to_bits().into());
            // Bins of equal probability in the cosine, by the closed distribution.
            let mut counts = vec![0_u64; bins];
            for _ in 0..n {
                let apart = lobe.sample([rng.next_f32(), rng.next_f32()]) - mean;
                let apart = apart.to_array().into_iter().map(|v| f64::from(v).powi(2)).sum::<f64>();
                let k = f64::from(kappa);
                let rest = (1.0 - (-0.5 * k * apart).exp()) / (1.0 - (-2.0 * k).exp());
                counts[((rest * bins as f64) as usize).min(bins - 1)] += 1;
            }
            let z = chi_square::deviation(&counts, &vec![1.0 / bins as f64; bins]);
            assert!(z < chi_square::bound(5), "{kappa}: {z}");
            let fit = Lobe::of_mean(1.0, {
                let mut sum = Vec3f::zero();
                for _ in 0..n {
                    sum += lobe.sample([rng.next_f32(), rng.next_f32()]);
                }
                sum * (1.0 / n as f32)
            });
            assert!((mean_length(fit.kappa) - mean_length(lobe.kappa)).abs() < 0.02, "{kappa}");
            assert!((fit.kappa / kappa - 1.0).abs() < 0.1 || kappa < 0.2, "{kappa}: {}", fit.kappa);
        }
    }

    #[test]
    fn norms_are_those_of_the_formula() {
        for k in [0.1_f64, 1.0, 2.98, 8.9, 9.1, 300.0] {
            let exact = k / (std::f64::consts::TAU * -(-2.0 * k).exp_m1());
            assert!((f64::from(norm(k as f32)) / exact - 1.0).abs() < 1e-6, "{k}");
        }
        assert!((norm(KAPPA_COSINE) / NORM_COSINE - 1.0).abs() < 1e-6);
    }

    #[test]
    fn products_with_the_cosine_are_lobes() {
        let n = vec3(0.0, 0.0, 1.0);
        let cosine = Lobe::new(1.0, n, KAPPA_COSINE);
        for (mean, kappa) in [(vec3(0.6, 0.0, 0.8), 5.0), (vec3(0.8, 0.0, -0.6), 50.0)] {
            let lobe = Lobe::new(0.3, mean, kappa);
            let product = lobe.with_cosine(n);
            for wi in [vec3(0.0, 0.6, 0.8), vec3(1.0, 0.0, 0.0), mean] {
                let expected = lobe.weight * lobe.pdf(wi) * cosine.pdf(wi);
                let found = product.weight * product.pdf(wi);
                assert!((found / expected - 1.0).abs() < 1e-3, "{found} {expected}");
            }
        }
    }
}
