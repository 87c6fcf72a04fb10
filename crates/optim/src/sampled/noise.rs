//! Counter-based random numbers: pure functions of seed, stream and position.
//!
//! The same mixing as the crate `sampling`, which this crate may not name; a test compares the bits.

use std::f64::consts::TAU;

/// Weyl increment: 2^64 over the golden ratio, made odd.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// Bijective mixing of 64 bits (the finalizer of `SplitMix64`; Steele, Lea and Flood 2014).
#[inline(always)]
const fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// One random number of 64 bits.
pub(crate) const fn hash(seed: u64, stream: u64) -> u64 {
    let keys = Noise::new(seed, stream).keys;
    mix(mix(keys[0]) ^ keys[1])
}

/// A stream of uniform and normal numbers.
#[derive(Clone, Debug)]
pub(crate) struct Noise {
    keys: [u64; 2],
    index: u64,
    /// The second normal number of a pair.
    spare: Option<f64>,
}

impl Noise {
    pub(crate) const fn new(seed: u64, stream: u64) -> Self {
        let first = mix(mix(seed.wrapping_add(GOLDEN)) ^ stream.wrapping_mul(GOLDEN));
        let keys = [first, mix(first ^ stream.wrapping_add(GOLDEN.rotate_left(32)))];
        Self { keys, index: 0, spare: None }
    }

    #[inline(always)]
    fn bits(&mut self) -> u64 {
        let bits = mix(mix(self.index.wrapping_mul(GOLDEN).wrapping_add(self.keys[0])) ^ self.keys[1]);
        self.index = self.index.wrapping_add(1);
        bits
    }

    /// Uniform in the open interval (0, 1): the centre of one of 2^53 cells, never 0, 1/2 or 1.
    #[inline(always)]
    pub(crate) fn uniform(&mut self) -> f64 {
        ((self.bits() >> 11) as f64 + 0.5) * (1.0 / (1_u64 << 53) as f64)
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
    fn bits_are_those_of_the_sampling_crate() {
        for (seed, stream) in [(0, 0), (7, 3), (u64::MAX, 1 << 40)] {
            let mut noise = Noise::new(seed, stream);
            for index in 0..5 {
                assert_eq!(
                    noise.bits(),
                    photofit_sampling::hash(seed, stream, index),
                    "{seed} {stream} {index}"
                );
            }
            assert_eq!(hash(seed, stream), photofit_sampling::hash(seed, stream, 0));
        }
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
