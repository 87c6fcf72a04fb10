//! Eight lobes side by side: what is asked at every vertex of a path is computed for all of them at once, in loops that
//! become vector instructions.

use super::vmf::{KAPPA, KAPPA_COSINE, Lobe, NORM_COSINE};
use photofit_scalar::{Vec3f, vec3};
use std::f32::consts::{LN_2, LOG2_E, TAU};

/// Lobes of a mixture.
pub(super) const LOBES: usize = 8;

type Each = [f32; LOBES];

/// A mixture of lobes, field by field; see [`Lobe`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mixture {
    /// Shares, which sum to 1.
    pub(super) weight: Each,
    mean: [Each; 3],
    kappa: Each,
    norm: Each,
}

#[inline(always)]
fn each(f: impl Fn(usize) -> f32) -> Each {
    std::array::from_fn(f)
}

/// `e^x` for `x` up to 80, with a relative error below 3e-7: no branch and no call.
#[inline(always)]
fn exp(x: f32) -> f32 {
    /// Its last binary digit counts ones.
    const SHIFT: f32 = 12_582_912.0;
    /// `LN_2` in two parts, the first of few digits.
    const LN_2_HIGH: f32 = 0.693_359_4;
    const LN_2_LOW: f32 = LN_2 - LN_2_HIGH - 1.904_654_3e-9;
    let x = x.max(-87.0);
    let shifted = x * LOG2_E + SHIFT;
    let n = shifted - SHIFT;
    let r = x - n * LN_2_HIGH - n * LN_2_LOW;
    let tail = 0.5 + r * (1.666_666_5e-1 + r * (4.166_579_6e-2 + r * (8.333_452e-3 + r * 1.398_2e-3)));
    let power = f32::from_bits((shifted.to_bits() << 23).wrapping_add(1.0_f32.to_bits()));
    (1.0 + r + r * r * tail) * power
}

impl Mixture {
    pub(super) fn new(lobes: [Lobe; LOBES]) -> Self {
        Self {
            weight: lobes.map(|l| l.weight),
            mean: [lobes.map(|l| l.mean.x), lobes.map(|l| l.mean.y), lobes.map(|l| l.mean.z)],
            kappa: lobes.map(|l| l.kappa),
            norm: lobes.map(|l| l.norm),
        }
    }

    #[inline]
    pub(super) fn lobe(&self, k: usize) -> Lobe {
        let mean = vec3(self.mean[0][k], self.mean[1][k], self.mean[2][k]);
        Lobe { weight: self.weight[k], mean, kappa: self.kappa[k], norm: self.norm[k] }
    }

    /// Density of a direction in each lobe times its weight.
    #[inline(always)]
    pub(super) fn parts(&self, wi: Vec3f) -> Each {
        each(|k| {
            let cosine = self.mean[0][k] * wi.x + self.mean[1][k] * wi.y + self.mean[2][k] * wi.z;
            self.weight[k] * self.norm[k] * exp(self.kappa[k] * (cosine - 1.0))
        })
    }

    /// Density of a direction, 1/sr.
    #[inline(always)]
    pub(super) fn density(&self, wi: Vec3f) -> f32 {
        sum(&self.parts(wi))
    }

    /// The mixture times the lobe of the cosine around `n`, normalised; itself where nothing is left.
    #[inline(always)]
    pub(super) fn with_cosine(&self, n: Vec3f) -> Self {
        let n = n * KAPPA_COSINE;
        let x = each(|k| self.mean[0][k] * self.kappa[k] + n.x);
        let y = each(|k| self.mean[1][k] * self.kappa[k] + n.y);
        let z = each(|k| self.mean[2][k] * self.kappa[k] + n.z);
        let length = each(|k| (x[k] * x[k] + y[k] * y[k] + z[k] * z[k]).sqrt());
        let kappa = each(|k| length[k].clamp(KAPPA[0], KAPPA[1] + KAPPA_COSINE));
        let norm = each(|k| kappa[k] / (TAU * (1.0 - exp(-2.0 * kappa[k]))));
        let left = each(|k| {
            self.weight[k] * self.norm[k] * NORM_COSINE / norm[k]
                * exp(kappa[k] - self.kappa[k] - KAPPA_COSINE)
        });
        let total = sum(&left);
        let usable = total > 0.0 && total.is_finite();
        if !usable {
            return *self;
        }
        let (share, one) = (1.0 / total, each(|k| 1.0 / length[k].max(1e-6)));
        Self {
            weight: each(|k| left[k] * share),
            mean: [each(|k| x[k] * one[k]), each(|k| y[k] * one[k]), each(|k| z[k] * one[k])],
            kappa,
            norm,
        }
    }

    /// A direction for `u` in `[0, 1)`; `None` if all weights are zero.
    #[inline]
    pub(super) fn sample(&self, [u, v]: [f32; 2]) -> Option<Vec3f> {
        let (mut rest, mut chosen) = (u, None);
        for (k, weight) in self.weight.iter().enumerate().filter(|(_, w)| **w > 0.0) {
            chosen = Some((k, (rest / weight).clamp(0.0, 1.0 - f32::EPSILON)));
            if rest < *weight {
                break;
            }
            rest -= weight;
        }
        let (k, rest) = chosen?;
        Some(self.lobe(k).sample([rest, v]))
    }
}

#[inline(always)]
fn sum(v: &Each) -> f32 {
    (v[0] + v[4]) + (v[1] + v[5]) + ((v[2] + v[6]) + (v[3] + v[7]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::{Rng, uniform_sphere};

    #[test]
    fn exponentials_are_as_near_as_stated() {
        let worst = (-8600..=8000).map(|i| {
            let x = i as f32 * 0.01;
            (f64::from(exp(x)) / f64::from(x).exp() - 1.0).abs()
        });
        let worst = worst.fold(0.0, f64::max);
        assert!(worst < 3e-7, "{worst:.1e}");
        assert!(exp(-1e30) < 2e-38 && exp(f32::NEG_INFINITY) < 2e-38 && exp(0.0) == 1.0);
    }

    #[test]
    fn mixtures_are_the_sums_of_their_lobes() {
        let mut rng = Rng::new(4, 1);
        for _ in 0..200 {
            let mut next = || rng.next_f32();
            let lobes: [Lobe; LOBES] = std::array::from_fn(|_| {
                let kappa = KAPPA[0] * (KAPPA[1] / KAPPA[0]).powf(next());
                Lobe::new(0.125, uniform_sphere([next(), next()]), kappa)
            });
            let n: Vec3f = uniform_sphere([next(), next()]);
            let (mixture, products) = (Mixture::new(lobes), lobes.map(|l| l.with_cosine(n)));
            let product = mixture.with_cosine(n);
            let total: f32 = products.iter().map(|l| l.weight).sum();
            for wi in [uniform_sphere([next(), next()]), lobes[3].mean, products[5].mean] {
                let plain: f32 = lobes.iter().map(|l| l.weight * l.pdf(wi)).sum();
                assert!((mixture.density(wi) - plain).abs() < 2e-5 * plain + 1e-12, "{plain}");
                let expected: f32 = products.iter().map(|l| l.weight / total * l.pdf(wi)).sum();
                let found = product.density(wi);
                assert!((found - expected).abs() < 1e-3 * expected + 1e-6, "{found} {expected}");
            }
            assert!((product.weight.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        }
    }
}
