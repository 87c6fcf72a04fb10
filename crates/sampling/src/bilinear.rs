//! Points of the unit square by a density that is bilinear between the corners.

use photofit_scalar::Real;

/// A density on the unit square, bilinear between four weights at its corners; as a warp of uniform numbers it keeps
/// their stratification (Hart et al. 2020, "Practical Product Sampling by Fitting and Composing Warps").
///
/// ```
/// use photofit_sampling::Bilinear;
/// let density = Bilinear::new([1.0, 3.0, 1.0, 3.0]).unwrap();
/// assert_eq!(density.pdf([0.5, 0.25]), 1.0);
/// assert!(density.sample([0.5, 0.5])[0] > 0.5);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bilinear<T = f32> {
    /// Densities at `(0, 0)`, `(1, 0)`, `(0, 1)` and `(1, 1)`.
    corners: [T; 4],
}

impl<T: Real> Bilinear<T> {
    /// The density for weights at `(0, 0)`, `(1, 0)`, `(0, 1)` and `(1, 1)`; `None` where they are not finite, not
    /// positive in sum, or one is negative.
    #[inline]
    pub fn new(weights: [T; 4]) -> Option<Self> {
        let [a, b, c, d] = weights;
        let scale = T::of(4.0) / (a + b + c + d);
        let usable = scale > T::zero() && scale.is_finite() && weights.iter().all(|w| *w >= T::zero());
        usable.then(|| Self { corners: weights.map(|w| w * scale) })
    }

    /// The point for `u` in `[0, 1)^2`.
    #[inline]
    pub fn sample(&self, u: [T; 2]) -> [T; 2] {
        let [a, b, c, d] = self.corners;
        let y = linear(u[1], a + b, c + d);
        let x = linear(u[0], a + (c - a) * y, b + (d - b) * y);
        [x, y]
    }

    /// Density per area at a point of the unit square.
    #[inline]
    pub fn pdf(&self, at: [T; 2]) -> T {
        let [a, b, c, d] = self.corners;
        let (low, high) = (a + (c - a) * at[1], b + (d - b) * at[1]);
        low + (high - low) * at[0]
    }
}

/// Inverse of the distribution on `[0, 1]` whose density goes from `a` to `b` (up to a factor).
#[inline(always)]
fn linear<T: Real>(u: T, a: T, b: T) -> T {
    let below = a + (a * a + (b * b - a * a) * u).relu().sqrt();
    let x = u * (a + b) / below;
    if below > T::zero() { if x < T::one() { x } else { T::one() } } else { T::zero() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rng;
    use crate::statistics::chi_square;

    const CASES: [[f64; 4]; 7] = [
        [1.0, 1.0, 1.0, 1.0],
        [1.0, 2.0, 3.0, 4.0],
        [0.0, 1.0, 0.0, 5.0],
        [0.0, 0.0, 0.0, 1.0],
        [1.0, 0.0, 0.0, 0.0],
        [2.0, 0.0, 0.0, 2.0],
        [1e-20, 3e-20, 2e-20, 0.0],
    ];

    #[test]
    fn points_come_from_the_density() {
        const N: usize = 12;
        for (case, weights) in CASES.into_iter().enumerate() {
            let density = Bilinear::new(weights).unwrap();
            let mut rng = Rng::new(3, case as u64);
            let mut counts = vec![0; N * N];
            for _ in 0..100_000 {
                let at = density.sample([rng.next_f64(), rng.next_f64()]);
                let part = |x: f64| ((x * N as f64) as usize).min(N - 1);
                counts[part(at[1]) * N + part(at[0])] += 1;
            }
            // The integral over a cell of what is linear along both axes is the value at its centre.
            let center = |i: usize| (i as f64 + 0.5) / N as f64;
            let cell = |i: usize| density.pdf([center(i % N), center(i / N)]) / (N * N) as f64;
            let probabilities: Vec<f64> = (0..N * N).map(cell).collect();
            assert!((probabilities.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{weights:?}");
            chi_square(&format!("{weights:?}"), &counts, &probabilities);
        }
    }

    #[test]
    fn the_corners_of_the_square_stay_in_it() {
        let below_one = 1.0 - f32::EPSILON / 2.0;
        for weights in CASES {
            let Some(density) = Bilinear::new(weights.map(|w| w as f32)) else { panic!("{weights:?}") };
            for u in [[0.0, 0.0], [0.0, below_one], [below_one, 0.0], [below_one; 2], [1e-30, 0.5]] {
                let at = density.sample(u);
                assert!(at.iter().all(|x| (0.0..=1.0).contains(x)), "{weights:?} {u:?}: {at:?}");
            }
        }
    }

    #[test]
    fn weights_that_are_no_density_are_refused() {
        for bad in [[0.0; 4], [1.0, -0.5, 1.0, 1.0], [f32::NAN; 4], [f32::INFINITY, 1.0, 1.0, 1.0]] {
            assert!(Bilinear::new(bad).is_none(), "{bad:?}");
        }
    }
}
