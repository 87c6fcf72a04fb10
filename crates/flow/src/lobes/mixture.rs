//! Eight lobes side by side: what is asked at every vertex of a path is computed for all of them at once, in loops that
//! become vector instructions.

use super::vmf::{KAPPA, KAPPA_COSINE, Lobe, NORM_COSINE};
use crate::elementary::exp;
use photofit_scalar::wide::{Kernel, Width, run_up_to};
use photofit_scalar::{Vec3f, vec3};
use std::f32::consts::TAU;

/// Lobes of a mixture.
pub(super) const LOBES: usize = 8;

pub(super) type Each = [f32; LOBES];

/// Length of the vector `kappa m` of a product of lobes below which it has no direction in single precision.
const LENGTH_MIN: f32 = 1e-6;

/// A mixture of lobes, field by field; see [`Lobe`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mixture {
    /// Shares, which sum to 1.
    pub(super) weight: Each,
    mean: [Each; 3],
    pub(super) kappa: Each,
    norm: Each,
}

/// Eight numbers at once.
pub(super) const WIDTH: Width = Width::Avx2;

/// [`Mixture::density`], for one width.
struct Density<'a>(&'a Mixture, Vec3f);

impl Kernel for Density<'_> {
    type Output = f32;

    #[inline(always)]
    fn run(self) -> f32 {
        sum(&self.0.parts(self.1))
    }
}

#[inline(always)]
pub(super) fn each(f: impl Fn(usize) -> f32) -> Each {
    let mut out = [0.0; LOBES];
    // Not `from_fn`, which is a call where vectors are wide.
    for (k, v) in out.iter_mut().enumerate() {
        *v = f(k);
    }
    out
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
        Lobe { weight: self.weight[k], mean: self.mean(k), kappa: self.kappa[k], norm: self.norm[k] }
    }

    #[inline]
    pub(super) fn mean(&self, k: usize) -> Vec3f {
        vec3(self.mean[0][k], self.mean[1][k], self.mean[2][k])
    }

    /// The lobes as they are at `offset`, and the distances of their places over those from here: each looks at a place of
    /// this inverse distance (less than 1 over the length of the offset) and spreads as the place is nearer.
    #[inline(always)]
    pub(super) fn moved(&self, inverse: &Each, offset: Vec3f) -> (Self, Each) {
        let x = each(|k| self.mean[0][k] - inverse[k] * offset.x);
        let y = each(|k| self.mean[1][k] - inverse[k] * offset.y);
        let z = each(|k| self.mean[2][k] - inverse[k] * offset.z);
        let squared = each(|k| x[k] * x[k] + y[k] * y[k] + z[k] * z[k]);
        let distance = each(|k| squared[k].sqrt());
        let one = each(|k| 1.0 / distance[k]);
        let kappa = each(|k| (self.kappa[k] * squared[k]).clamp(KAPPA[0], KAPPA[1]));
        let norm = norms(&kappa);
        let mean = [x, y, z].map(|v| each(|k| v[k] * one[k]));
        (Self { weight: self.weight, mean, kappa, norm }, distance)
    }

    /// Density of a direction in each lobe times its weight.
    ///
    /// `1 - m . d` is taken as `|m - d|^2 / 2`: near a narrow lobe the dot product has no digits left, and how far vectors
    /// of single precision are from unit length would change the density by percents.
    #[inline(always)]
    pub(super) fn parts(&self, wi: Vec3f) -> Each {
        each(|k| {
            let (x, y, z) = (self.mean[0][k] - wi.x, self.mean[1][k] - wi.y, self.mean[2][k] - wi.z);
            self.weight[k] * self.norm[k] * exp(self.kappa[k] * -0.5 * (x * x + y * y + z * z))
        })
    }

    /// Density of a direction, 1/sr.
    #[inline]
    pub(super) fn density(&self, wi: Vec3f) -> f32 {
        run_up_to(WIDTH, Density(self, wi))
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
        let norm = norms(&kappa);
        let left = each(|k| {
            self.weight[k] * self.norm[k] * NORM_COSINE / norm[k]
                * exp(kappa[k] - self.kappa[k] - KAPPA_COSINE)
        });
        let total = sum(&left);
        let usable = total > 0.0 && total.is_finite();
        if !usable {
            return *self;
        }
        let (share, one) = (1.0 / total, each(|k| 1.0 / length[k].max(LENGTH_MIN)));
        // What the cosine cancels has no direction: any will do, if it has unit length.
        let lost = each(|k| if length[k] > LENGTH_MIN { 0.0 } else { 1.0 / KAPPA_COSINE });
        let unit = |v: &Each, n: f32| each(|k| if lost[k] > 0.0 { n * lost[k] } else { v[k] * one[k] });
        Self {
            weight: each(|k| left[k] * share),
            mean: [unit(&x, n.x), unit(&y, n.y), unit(&z, n.z)],
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

/// `N(k)` of each lobe.
#[inline(always)]
fn norms(kappa: &Each) -> Each {
    each(|k| kappa[k] / (TAU * (1.0 - exp(-2.0 * kappa[k]))))
}

#[inline(always)]
fn sum(v: &Each) -> f32 {
    (v[0] + v[4]) + (v[1] + v[5]) + ((v[2] + v[6]) + (v[3] + v[7]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::{Rng, uniform_sphere};

    /// Eight times the same lobe.
    fn alike(lobe: Lobe) -> Mixture {
        Mixture::new([Lobe { weight: 1.0 / LOBES as f32, ..lobe }; LOBES])
    }

    #[test]
    fn narrow_lobes_integrate_to_one_in_single_precision() {
        let mut rng = Rng::new(6, 2);
        for _ in 0..50 {
            let mean: Vec3f = uniform_sphere([rng.next_f32(), rng.next_f32()]);
            let mixture = alike(Lobe::new(1.0, mean, KAPPA[1]));
            let (x, y) = mean.orthonormal_pair();
            // Uniform in the azimuth and in 1 - cos up to 12 / kappa, where e^-12 is left.
            let (rings, around, most) = (400, 20, 12.0 / f64::from(KAPPA[1]));
            let mut sum = 0.0;
            for i in 0..rings * around {
                let w = most * (f64::from(i / around) + 0.5) / f64::from(rings);
                let (s, c) = (f64::from(i % around) / f64::from(around) * std::f64::consts::TAU).sin_cos();
                let r = (w * (2.0 - w)).sqrt();
                let wi = x * (r * c) as f32 + y * (r * s) as f32 + mean * (1.0 - w) as f32;
                let density = mixture.density(wi);
                // Directions of a path are unit vectors to a few digits.
                let longer = mixture.density(wi * (1.0 + 1e-6));
                assert!((longer / density - 1.0).abs() < 1e-3, "{longer} {density}");
                sum += f64::from(density) * most * std::f64::consts::TAU / f64::from(rings * around);
            }
            assert!((sum - 1.0).abs() < 3e-4, "{mean:?}: {sum}");
        }
    }

    #[test]
    fn lobes_that_the_cosine_cancels_keep_unit_means() {
        let n = vec3(0.0, 0.0, 1.0);
        let product = alike(Lobe::new(1.0, -n, KAPPA_COSINE)).with_cosine(n);
        let mut rng = Rng::new(7, 3);
        for k in 0..LOBES {
            assert!((product.lobe(k).mean.length() - 1.0).abs() < 1e-5, "{:?}", product.lobe(k));
        }
        let wi = product.sample([rng.next_f32(), rng.next_f32()]).unwrap();
        assert!((wi.length() - 1.0).abs() < 1e-5 && product.density(wi) > 0.05, "{wi:?}");
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
