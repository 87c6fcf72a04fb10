//! The counter-based random number generator.

/// [`Rng::next_f32`] in WGSL: `uniform_draw(keys, draw)`, with the words of [`Rng::keys`], lower ones first.
pub const WGSL: &str = include_str!("rng.wgsl");

/// Weyl increment: 2^64 over the golden ratio, made odd.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// Bijective mixing of 64 bits (the finalizer of `SplitMix64`; Steele, Lea and Flood 2014, constants by Stafford).
#[inline(always)]
const fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Two keys per stream: sequences of different streams are no shifted copies of each other.
#[inline(always)]
pub(crate) const fn keys(seed: u64, stream: u64) -> [u64; 2] {
    let first = mix(mix(seed.wrapping_add(GOLDEN)) ^ stream.wrapping_mul(GOLDEN));
    [first, mix(first ^ stream.wrapping_add(GOLDEN.rotate_left(32)))]
}

#[inline(always)]
pub(crate) const fn value(keys: [u64; 2], index: u64) -> u64 {
    mix(mix(index.wrapping_mul(GOLDEN).wrapping_add(keys[0])) ^ keys[1])
}

/// The random 64 bits number `index` of stream `stream` under `seed`, without state: what [`Rng`] gives after `index`
/// earlier draws. The same on every platform.
///
/// ```
/// use photofit_sampling::{Rng, hash};
/// let mut rng = Rng::new(5, 2);
/// rng.next_u64();
/// assert_eq!(rng.next_u64(), hash(5, 2, 1));
/// ```
#[inline]
pub const fn hash(seed: u64, stream: u64, index: u64) -> u64 {
    value(keys(seed, stream), index)
}

/// The upper 24 of 32 bits as a number in `[0, 1)`.
#[inline(always)]
pub fn unit_f32(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / (1 << 24) as f32)
}

/// The upper 53 of 64 bits as a number in `[0, 1)`.
#[inline(always)]
pub fn unit_f64(bits: u64) -> f64 {
    (bits >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
}

/// A generator that counts: draw `i` is [`hash`]`(seed, stream, i)`. Each pixel, sample or parameter may have its own
/// stream; any position is reached at once with [`Rng::skip_to`]. Not for cryptography.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rng {
    keys: [u64; 2],
    index: u64,
}

impl Rng {
    /// The generator of `stream` under `seed`, at its first draw.
    #[inline]
    pub const fn new(seed: u64, stream: u64) -> Self {
        Self { keys: keys(seed, stream), index: 0 }
    }

    /// What, with its number, determines a draw.
    #[inline]
    pub const fn keys(&self) -> [u64; 2] {
        self.keys
    }

    /// Number of draws so far.
    #[inline]
    pub const fn position(&self) -> u64 {
        self.index
    }

    /// Goes to draw `index`, forward or back.
    #[inline]
    pub const fn skip_to(&mut self, index: u64) {
        self.index = index;
    }

    /// The next 64 random bits.
    #[inline]
    pub const fn next_u64(&mut self) -> u64 {
        let bits = value(self.keys, self.index);
        self.index = self.index.wrapping_add(1);
        bits
    }

    /// The next 32 random bits.
    #[inline]
    pub const fn next_u32(&mut self) -> u32 {
        (self.next_u64() >> 32) as u32
    }

    /// Uniform in `[0, 1)`, a multiple of 2^-24.
    #[inline]
    pub fn next_f32(&mut self) -> f32 {
        unit_f32(self.next_u32())
    }

    /// Uniform in `[0, 1)`, a multiple of 2^-53.
    #[inline]
    pub fn next_f64(&mut self) -> f64 {
        unit_f64(self.next_u64())
    }

    /// Uniform in `lo..hi`; may round to `hi` where the range is not exactly representable.
    #[inline]
    pub fn uniform(&mut self, lo: f32, hi: f32) -> f32 {
        lo + (hi - lo) * self.next_f32()
    }

    /// Uniform integer below `n` without bias (Lemire 2019); may use more than one draw.
    ///
    /// # Panics
    /// If `n` is 0.
    #[inline]
    pub fn range(&mut self, n: u32) -> u32 {
        assert!(n > 0, "a range with members");
        let threshold = n.wrapping_neg() % n;
        loop {
            let product = u64::from(self.next_u32()) * u64::from(n);
            if product as u32 >= threshold {
                return (product >> 32) as u32;
            }
        }
    }

    /// Normal with mean 0 and variance 1, by inversion of one draw ([`crate::inverse_normal_cdf`]); the same on every
    /// platform.
    #[inline]
    pub fn normal(&mut self) -> f32 {
        // The centre of one of 2^53 cells never is 0 or 1.
        let u = ((self.next_u64() >> 11) as f64 + 0.5) * (1.0 / (1_u64 << 53) as f64);
        crate::inverse_normal_cdf(u) as f32
    }

    /// Puts `items` in random order (Fisher and Yates).
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            // Slices longer than 2^32 draw from the first 2^32 members.
            let j = self.range(u32::try_from(i + 1).unwrap_or(u32::MAX)) as usize;
            items.swap(i, j);
        }
    }
}

/// The sequential generator `SplitMix64` (Steele, Lea and Flood 2014), for a few numbers that follow from one: an [`Rng`]
/// has streams that do not overlap.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SplitMix64 {
    state: u64,
}

impl SplitMix64 {
    /// The generator of `seed` after `index` draws.
    #[inline]
    pub const fn new(seed: u64, index: u64) -> Self {
        Self { state: seed.wrapping_add(index.wrapping_mul(GOLDEN)) }
    }

    /// The next 64 random bits.
    #[inline]
    pub const fn next_u64(&mut self) -> u64 {
        self.state = self.state.wrapping_add(GOLDEN);
        mix(self.state)
    }

    /// Uniform in `[0, 1)`, a multiple of 2^-53.
    #[inline]
    pub fn next_f64(&mut self) -> f64 {
        unit_f64(self.next_u64())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::chi_square_uniform;

    #[test]
    fn known_values_never_change() {
        // Stored: a change breaks the reproducibility of every saved fit.
        assert_eq!(hash(0, 0, 0), KNOWN[0]);
        assert_eq!(hash(1, 0, 0), KNOWN[1]);
        assert_eq!(hash(0, 1, 0), KNOWN[2]);
        assert_eq!(hash(0, 0, 1), KNOWN[3]);
        assert_eq!(hash(u64::MAX, 12_345, 1 << 40), KNOWN[4]);
        let mut rng = Rng::new(42, 7);
        assert_eq!(rng.next_f32().to_bits(), KNOWN_F32[0].to_bits());
        assert_eq!(rng.normal().to_bits(), KNOWN_F32[1].to_bits());
        assert_eq!(rng.range(1000), 999);
    }

    #[test]
    fn the_sequential_generator_is_the_published_one() {
        let mut bits = SplitMix64::new(1_234_567, 0);
        let published = [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423];
        assert_eq!(published.map(|_| bits.next_u64()), published);
        assert_eq!(SplitMix64::new(1_234_567, 2).next_u64(), published[2]);
        assert_eq!(SplitMix64::new(0, 6).next_f64(), 1_566_062_512_695_462.0 / (1_u64 << 53) as f64);
    }

    const KNOWN: [u64; 5] = [
        0x3e21_9406_aec3_50bc,
        0xe73c_65f3_d64b_2466,
        0xb9bf_d8f6_7317_aa11,
        0xb6dc_b89f_e4ac_2883,
        0x5d7a_c36a_895b_1583,
    ];
    const KNOWN_F32: [f32; 2] = [0.641_018_15, -1.731_929_5];

    #[test]
    fn iterator_and_hash_agree_and_skip() {
        let mut rng = Rng::new(3, 9);
        let draws: Vec<u64> = (0..10).map(|_| rng.next_u64()).collect();
        for (i, d) in draws.iter().enumerate() {
            assert_eq!(*d, hash(3, 9, i as u64));
        }
        rng.skip_to(4);
        assert_eq!((rng.position(), rng.next_u64()), (4, draws[4]));
    }

    #[test]
    fn draws_are_uniform_in_every_byte() {
        for stream in [0, 1, u64::MAX] {
            let mut rng = Rng::new(11, stream);
            let mut counts = vec![vec![0_u64; 256]; 8];
            for _ in 0..100_000 {
                let bytes = rng.next_u64().to_le_bytes();
                for (c, b) in counts.iter_mut().zip(bytes) {
                    c[b as usize] += 1;
                }
            }
            for (byte, counts) in counts.iter().enumerate() {
                chi_square_uniform(&format!("stream {stream} byte {byte}"), counts);
            }
        }
    }

    #[test]
    fn neighbouring_indices_streams_and_seeds_are_independent() {
        // Pairs of draws whose counters differ by one in one place fill a 16 x 16 grid evenly.
        let cell = |a: u64, b: u64| (((a >> 60) << 4) | (b >> 60)) as usize;
        type Pair = fn(u64) -> (u64, u64);
        let pairs: [(&str, Pair); 4] = [
            ("index", |i| (hash(1, 2, i), hash(1, 2, i + 1))),
            ("stream", |i| (hash(1, i, 0), hash(1, i + 1, 0))),
            ("seed", |i| (hash(i, 0, 0), hash(i + 1, 0, 0))),
            ("diagonal", |i| (hash(1, i, i), hash(1, i + 1, i + 1))),
        ];
        for (name, pair) in pairs {
            let mut counts = vec![0_u64; 256];
            for i in 0..100_000 {
                let (a, b) = pair(i);
                counts[cell(a, b)] += 1;
            }
            chi_square_uniform(name, &counts);
        }
    }

    #[test]
    fn one_changed_bit_changes_half_of_the_bits() {
        let mut flips = [0_u32; 64];
        let trials = 2000;
        for i in 0..trials {
            let base = hash(1, 5, i);
            for (bit, f) in flips.iter_mut().enumerate() {
                *f += (base ^ hash(1, 5, i ^ (1 << bit))).count_ones();
            }
        }
        for (bit, f) in flips.iter().enumerate() {
            let mean = f64::from(*f) / trials as f64;
            assert!((mean - 32.0).abs() < 0.6, "bit {bit}: {mean} of 64 change");
        }
    }

    #[test]
    fn ranges_are_uniform_and_bounded() {
        for n in [1_u32, 2, 7, 100, 3_000_000_000] {
            let mut rng = Rng::new(8, u64::from(n));
            let bins = n.min(50) as usize;
            let mut counts = vec![0_u64; bins];
            for _ in 0..50_000 {
                let v = rng.range(n);
                assert!(v < n);
                counts[(u64::from(v) * bins as u64 / u64::from(n)) as usize] += 1;
            }
            if bins > 1 {
                chi_square_uniform(&format!("range {n}"), &counts);
            }
        }
    }

    #[test]
    fn normals_have_the_right_moments() {
        let mut rng = Rng::new(21, 0);
        let n = 200_000;
        let (mut m1, mut m2, mut m3, mut m4) = (0.0, 0.0, 0.0, 0.0);
        for _ in 0..n {
            let x = f64::from(rng.normal());
            m1 += x;
            m2 += x * x;
            m3 += x * x * x;
            m4 += x * x * x * x;
        }
        let n = f64::from(n);
        // Five standard errors of each moment: variances 1, 2, 15 and 96.
        for (name, got, expected, variance) in
            [("1", m1, 0.0, 1.0_f64), ("2", m2, 1.0, 2.0), ("3", m3, 0.0, 15.0), ("4", m4, 3.0, 96.0)]
        {
            let error = (got / n - expected).abs();
            assert!(error < 5.0 * (variance / n).sqrt(), "moment {name} is off by {error}");
        }
    }

    #[test]
    fn shuffles_are_uniform_permutations() {
        let mut counts = vec![0_u64; 24];
        let mut rng = Rng::new(4, 4);
        for _ in 0..24_000 {
            let mut items = [0_usize, 1, 2, 3];
            rng.shuffle(&mut items);
            // Lehmer code.
            let code = (0..4)
                .fold(0, |code, i| code * (4 - i) + items[i + 1..].iter().filter(|v| **v < items[i]).count());
            counts[code] += 1;
        }
        chi_square_uniform("permutations", &counts);
    }
}
