//! Sobol points with hash-based Owen scrambling (Burley 2020).

use crate::rng::{hash, keys, unit_f32, value};

/// Dimensions of [`sobol_u32`].
pub const SOBOL_DIMENSIONS: usize = 4;

/// Degree, inner coefficients and first direction numbers of the primitive polynomials of dimensions 1 to 3 (Joe and
/// Kuo 2008); dimension 0 is the van der Corput sequence.
const POLYNOMIALS: [(usize, u32, [u32; 3]); SOBOL_DIMENSIONS - 1] =
    [(1, 0, [1, 0, 0]), (2, 1, [1, 3, 0]), (3, 1, [1, 3, 1])];

/// The exclusive or of the direction numbers that each value of each byte of an index selects, dimensions 1 to 3; lowest
/// bit first, as scrambling wants them.
static TABLES: [[[u32; 256]; 4]; SOBOL_DIMENSIONS - 1] = tables();

const fn tables() -> [[[u32; 256]; 4]; SOBOL_DIMENSIONS - 1] {
    let directions = directions();
    let mut out = [[[0; 256]; 4]; SOBOL_DIMENSIONS - 1];
    let mut i = 0;
    while i < (SOBOL_DIMENSIONS - 1) * 4 * 256 {
        let (d, byte, value) = (i / 1024, (i / 256) % 4, i % 256);
        if value > 0 {
            // The entry without the lowest set bit comes before this one.
            let low = value.trailing_zeros() as usize;
            let direction = directions[d + 1][8 * byte + low].reverse_bits();
            out[d][byte][value] = out[d][byte][value & (value - 1)] ^ direction;
        }
        i += 1;
    }
    out
}

const fn directions() -> [[u32; 32]; SOBOL_DIMENSIONS] {
    let mut out = [[0; 32]; SOBOL_DIMENSIONS];
    let mut k = 0;
    while k < 32 {
        out[0][k] = 1 << (31 - k);
        k += 1;
    }
    let mut d = 1;
    while d < SOBOL_DIMENSIONS {
        let (degree, coefficients, initial) = POLYNOMIALS[d - 1];
        let mut k = 0;
        while k < 32 {
            out[d][k] = if k < degree {
                initial[k] << (31 - k)
            } else {
                // Bratley and Fox's recurrence over the polynomial modulo 2.
                let mut v = out[d][k - degree] ^ (out[d][k - degree] >> degree);
                let mut j = 1;
                while j < degree {
                    if (coefficients >> (degree - 1 - j)) & 1 == 1 {
                        v ^= out[d][k - j];
                    }
                    j += 1;
                }
                v
            };
            k += 1;
        }
        d += 1;
    }
    out
}

/// Coordinate `dimension` of Sobol point `index`, as a fraction of 2^32, not scrambled. The first two dimensions are a
/// (0,2)-sequence.
///
/// # Panics
/// If `dimension >= SOBOL_DIMENSIONS`.
#[inline]
pub fn sobol_u32(index: u32, dimension: usize) -> u32 {
    reversed_u32(index, dimension).reverse_bits()
}

/// [`sobol_u32`] with its bits in reverse.
#[inline(always)]
fn reversed_u32(index: u32, dimension: usize) -> u32 {
    if dimension == 0 {
        return index;
    }
    let [t0, t1, t2, t3] = &TABLES[dimension - 1];
    let [b0, b1, b2, b3] = index.to_le_bytes();
    t0[b0 as usize] ^ t1[b1 as usize] ^ t2[b2 as usize] ^ t3[b3 as usize]
}

/// Owen's nested uniform scrambling of the bits of `x`, upper bits first: each bit flips by a hash of `seed` and of the
/// bits above it, after Laine and Karras (2011) with the constants of Burley (2020).
#[inline]
pub fn nested_uniform_scramble(x: u32, seed: u32) -> u32 {
    scramble_reversed(x.reverse_bits(), seed).reverse_bits()
}

/// [`nested_uniform_scramble`] of numbers whose bits are in reverse: a product with an even number then only carries from
/// what are upper bits to lower ones.
#[inline(always)]
fn scramble_reversed(mut x: u32, seed: u32) -> u32 {
    x = x.wrapping_add(seed);
    x ^= x.wrapping_mul(0x6c50_b47c);
    x ^= x.wrapping_mul(0xb82f_1e52);
    x ^= x.wrapping_mul(0xc7af_e638);
    x ^ x.wrapping_mul(0x8d22_f6e6)
}

/// An Owen-scrambled Sobol sequence of any number of dimensions.
///
/// Dimensions come in groups of four; each group is a scrambled four-dimensional Sobol sequence visited in a scrambled
/// order of its own, so that groups are independent of each other (padding). Every prefix of a power of two points keeps
/// the stratification of the Sobol sequence inside a group, most strongly in its first two dimensions, and every point
/// is uniform by itself. Sequences with different seeds are independent.
///
/// ```
/// use photofit_sampling::Sobol;
/// let pixel = Sobol::new(0, 1234);
/// let mean: f32 = (0..64).map(|i| pixel.sample(i, 0)).sum::<f32>() / 64.0;
/// assert!((mean - 0.5).abs() < 1.0 / 64.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sobol {
    keys: [u64; 2],
}

impl Sobol {
    /// The sequence of `stream` (a pixel, say) under `seed`.
    #[inline]
    pub const fn new(seed: u64, stream: u64) -> Self {
        Self { keys: keys(seed, stream) }
    }

    /// Another sequence that follows from this one, by its number; all are independent of each other.
    #[inline]
    pub const fn branch(&self, number: u64) -> Self {
        Self::new(hash(self.keys[0], self.keys[1], number), number)
    }

    /// Coordinate `dimension` of point `index`, in `[0, 1)`; the same on every platform.
    #[inline]
    pub fn sample(&self, index: u32, dimension: u32) -> f32 {
        unit_f32(self.sample_u32(index, dimension))
    }

    /// Coordinates `dimension` and `dimension + 1`; even dimensions give the best stratified pairs.
    #[inline]
    pub fn sample_2d(&self, index: u32, dimension: u32) -> [f32; 2] {
        [self.sample(index, dimension), self.sample(index, dimension + 1)]
    }

    /// The point `index` of group `group`, dimensions `4 group .. 4 group + 4`: whoever wants several of its
    /// coordinates works out the rest once.
    #[inline(always)]
    pub fn point(&self, index: u32, group: u32) -> SobolPoint {
        // Counters of a group: its order and the scrambling of dimension 0, of 1 and 2, of 3.
        let counter = 4 * u64::from(group);
        let seeds = value(self.keys, counter);
        // Nested from the highest bit on, this maps each aligned block of 2^m indices to another such block.
        let shuffled = nested_uniform_scramble(index, seeds as u32);
        SobolPoint { keys: self.keys, counter, shuffled, first: (seeds >> 32) as u32 }
    }

    /// As [`Self::sample`], as a fraction of 2^32.
    #[inline]
    pub fn sample_u32(&self, index: u32, dimension: u32) -> u32 {
        self.point(index, dimension / 4).bits(dimension % 4)
    }
}

/// A point of four coordinates ([`Sobol::point`]).
#[derive(Clone, Copy, Debug)]
pub struct SobolPoint {
    keys: [u64; 2],
    counter: u64,
    shuffled: u32,
    /// Scrambles the first coordinate.
    first: u32,
}

impl SobolPoint {
    /// Coordinate `inner` of four, in `[0, 1)`.
    ///
    /// # Panics
    /// If `inner` is not below 4.
    #[inline(always)]
    pub fn get(&self, inner: u32) -> f32 {
        unit_f32(self.bits(inner))
    }

    /// The first two coordinates: the best stratified pair.
    #[inline(always)]
    pub fn pair(&self) -> [f32; 2] {
        [self.get(0), self.get(1)]
    }

    #[inline(always)]
    fn bits(&self, inner: u32) -> u32 {
        let seed = match inner {
            0 => self.first,
            1 => value(self.keys, self.counter + 1) as u32,
            2 => (value(self.keys, self.counter + 1) >> 32) as u32,
            _ => value(self.keys, self.counter + 2) as u32,
        };
        scramble_reversed(reversed_u32(self.shuffled, inner as usize), seed).reverse_bits()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chi_square::deviation;
    use crate::hash;
    use crate::statistics::chi_square_uniform;

    #[test]
    fn first_points_are_known() {
        // Points of the sequence of Joe and Kuo, in the order of the index rather than of its Gray code.
        let eighths = |d: usize| (0..8).map(|i| sobol_u32(i, d) >> 29).collect::<Vec<_>>();
        assert_eq!(eighths(0), [0, 4, 2, 6, 1, 5, 3, 7]);
        assert_eq!(eighths(1), [0, 4, 6, 2, 5, 1, 3, 7]);
        assert_eq!(eighths(2), [0, 4, 6, 2, 3, 7, 5, 1]);
        assert_eq!(eighths(3), [0, 4, 6, 2, 1, 5, 7, 3]);
        let point: [u32; 4] = std::array::from_fn(|d| sobol_u32(1000, d));
        assert_eq!(point, [0x17c0_0000, 0x2940_0000, 0x7340_0000, 0xe8c0_0000]);
    }

    /// Whether `2^m` points hold one point in every elementary interval of area `2^-m`.
    fn is_net(points: &[(u32, u32)], m: u32) -> bool {
        (0..=m).all(|k| {
            let mut hit = vec![false; 1 << m];
            points.iter().all(|(x, y)| {
                let column = if k == 0 { 0 } else { x >> (32 - k) };
                let row = if k == m { 0 } else { y >> (32 - (m - k)) };
                !std::mem::replace(&mut hit[((column << (m - k)) | row) as usize], true)
            })
        })
    }

    #[test]
    fn the_first_two_dimensions_are_nets_scrambled_or_not() {
        for m in 0..=9 {
            for block in 0..3 {
                let indices = (block << m)..((block + 1) << m);
                let plain: Vec<_> = indices.clone().map(|i| (sobol_u32(i, 0), sobol_u32(i, 1))).collect();
                assert!(is_net(&plain, m), "plain, 2^{m} points, block {block}");
                for seed in 0..5 {
                    let sobol = Sobol::new(seed, 9);
                    for dimension in [0, 4, 40] {
                        let pair = |i| (sobol.sample_u32(i, dimension), sobol.sample_u32(i, dimension + 1));
                        let points: Vec<_> = indices.clone().map(pair).collect();
                        assert!(
                            is_net(&points, m),
                            "seed {seed}, dimension {dimension}, 2^{m}, block {block}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn the_net_check_notices_random_points() {
        let points: Vec<_> = (0..64).map(|i| (hash(1, 0, i) as u32, hash(1, 1, i) as u32)).collect();
        assert!(!is_net(&points, 6));
    }

    #[test]
    fn every_dimension_is_stratified() {
        let sobol = Sobol::new(3, 3);
        for dimension in 0..16 {
            let mut hit = [false; 256];
            for i in 0..256 {
                hit[(sobol.sample_u32(i, dimension) >> 24) as usize] = true;
            }
            assert!(hit.iter().all(|h| *h), "dimension {dimension}");
        }
    }

    #[test]
    fn scrambling_is_nested_and_bijective() {
        // Equal upper bits stay equal, and the first bit that differs still differs.
        for i in 0..2000 {
            let (a, seed) = (hash(1, 2, i) as u32, hash(1, 3, i) as u32);
            for bit in 0..32 {
                let below = if bit == 0 { 0 } else { hash(1, 4, i) as u32 & ((1 << bit) - 1) };
                let b = (a ^ (1 << bit)) ^ below;
                let (sa, sb) = (nested_uniform_scramble(a, seed), nested_uniform_scramble(b, seed));
                assert_eq!((sa ^ sb).leading_zeros(), 31 - bit, "bit {bit}");
            }
        }
    }

    #[test]
    fn single_points_are_uniform_over_seeds() {
        for (index, dimension) in [(0, 0), (0, 1), (5, 2), (1000, 3), (77, 9)] {
            let mut counts = vec![0; 64];
            for seed in 0..64_000 {
                counts[(Sobol::new(seed, 0).sample_u32(index, dimension) >> 26) as usize] += 1;
            }
            chi_square_uniform(&format!("index {index}, dimension {dimension}"), &counts);
        }
    }

    #[test]
    fn points_of_groups_are_the_single_dimensions() {
        let sobol = Sobol::new(8, 5);
        for (index, group) in [(0, 0), (17, 3), (u32::MAX, 100)] {
            let singles: [f32; 4] = std::array::from_fn(|i| sobol.sample(index, 4 * group + i as u32));
            let point = sobol.point(index, group);
            assert_eq!([0, 1, 2, 3].map(|i| point.get(i)), singles, "index {index}, group {group}");
            assert_eq!(point.pair(), [singles[0], singles[1]], "index {index}, group {group}");
        }
    }

    #[test]
    fn dimensions_of_a_point_are_independent() {
        // One dimension against another of one point, over seeds, fills a grid evenly: also those whose scrambling
        // comes from one hash.
        for (x, y) in [(0, 4), (0, 1), (1, 2), (2, 3), (3, 4)] {
            let mut counts = vec![0; 256];
            for seed in 0..100_000 {
                let sobol = Sobol::new(seed, 1);
                let (a, b) = (sobol.sample_u32(3, x) >> 28, sobol.sample_u32(3, y) >> 28);
                counts[(a << 4 | b) as usize] += 1;
            }
            chi_square_uniform(&format!("dimensions {x} and {y}"), &counts);
        }
        // Without a change of order the two would be the same points: the check notices.
        let mut same = vec![0; 256];
        for i in 0..100_000 {
            let x = sobol_u32(i, 0) >> 28;
            same[(x << 4 | x) as usize] += 1;
        }
        assert!(deviation(&same, &[1.0 / 256.0; 256]) > 4.5);
    }

    #[test]
    fn integration_error_falls_faster_than_with_random_numbers() {
        // RMSE over seeds of the mean of a smooth function in two dimensions.
        let rmse = |n: u32| {
            let square = |seed: u64| {
                let sobol = Sobol::new(seed, 0);
                let f = |i| {
                    let [x, y] = sobol.sample_2d(i, 0).map(f64::from);
                    (x * y).exp()
                };
                // The integral of exp(x y) over the unit square.
                ((0..n).map(f).sum::<f64>() / f64::from(n) - 1.317_902_151_454_403_8).powi(2)
            };
            ((0..40).map(square).sum::<f64>() / 40.0).sqrt()
        };
        let (coarse, fine) = (rmse(64), rmse(1024));
        // Random numbers gain a factor of 4 from 16 times as many points, scrambled nets up to 64.
        assert!(coarse / fine > 24.0, "{coarse} to {fine}");
        assert!(fine < 2e-4, "{fine}");
    }
}
