//! Normal numbers from the counter-based generator: pure functions of seed, stream and position.

use photofit_sampling::Rng;
use std::f64::consts::TAU;

/// One random number of 64 bits.
pub(crate) const fn hash(seed: u64, stream: u64) -> u64 {
    photofit_sampling::hash(seed, stream, 0)
}

/// A stream of uniform and normal numbers.
#[derive(Clone, Debug)]
pub(crate) struct Noise {
    bits: Rng,
    /// The second normal number of a pair.
    spare: Option<f64>,
}

impl Noise {
    pub(crate) const fn new(seed: u64, stream: u64) -> Self {
        Self { bits: Rng::new(seed, stream), spare: None }
    }

    /// Uniform in the open interval (0, 1): the centre of one of 2^53 cells, never 0, 1/2 or 1.
    #[inline(always)]
    pub(crate) fn uniform(&mut self) -> f64 {
        ((self.bits.next_u64() >> 11) as f64 + 0.5) * (1.0 / (1_u64 << 53) as f64)
    }

    /// Normal with mean 0 and variance 1 (Box and Muller 1958).
    #[inline]
    pub(crate) fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        let radius = (-2.0 * self.uniform().ln()).sqrt();
        let (sin, cos) = (TAU * self.uniform()).sin_cos();
        self.spare = Some(radius * sin);
        radius * cos
    }

    pub(crate) fn fill_normal(&mut self, out: &mut [f64]) {
        out.iter_mut().for_each(|z| *z = self.normal());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_never_change() {
        // Stored: estimates of saved runs depend on them.
        let mut noise = Noise::new(7, 3);
        assert_eq!(hash(7, 3), photofit_sampling::hash(7, 3, 0));
        let centre =
            |index| ((photofit_sampling::hash(7, 3, index) >> 11) as f64 + 0.5) / (1_u64 << 53) as f64;
        assert_eq!(noise.uniform(), centre(0));
        let (radius, angle) = ((-2.0 * centre(1).ln()).sqrt(), TAU * centre(2));
        assert_eq!([noise.normal(), noise.normal()], [radius * angle.cos(), radius * angle.sin()]);
    }

    #[test]
    fn normals_have_the_right_moments() {
        let mut noise = Noise::new(1, 2);
        let n = 200_000;
        let mut moments = [0.0; 4];
        for _ in 0..n {
            let z = noise.normal();
            for (k, m) in moments.iter_mut().enumerate() {
                *m += z.powi(k as i32 + 1) / f64::from(n);
            }
        }
        // Five standard errors of each moment: variances 1, 2, 15 and 96.
        for (k, (expected, variance)) in
            [(0.0, 1.0_f64), (1.0, 2.0), (0.0, 15.0), (3.0, 96.0)].iter().enumerate()
        {
            let error = (moments[k] - expected).abs();
            assert!(error < 5.0 * (variance / f64::from(n)).sqrt(), "moment {} is off by {error}", k + 1);
        }
    }
}
