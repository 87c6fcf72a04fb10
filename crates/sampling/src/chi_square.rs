//! Pearson's chi-square test of counts against probabilities, for the tests of whatever draws samples.
//!
//! ```
//! use photofit_sampling::chi_square;
//! let z = chi_square::deviation(&[1000, 1010, 990, 1005], &[0.25; 4]);
//! assert!(z < chi_square::bound(1));
//! assert!(chi_square::deviation(&[1000, 1010, 990, 1005], &[0.28, 0.25, 0.25, 0.22]) > chi_square::bound(1));
//! ```

use crate::inverse_normal_cdf;

/// Significance of a whole set of tests.
const SIGNIFICANCE: f64 = 0.01;
/// Cells that expect fewer counts are pooled.
const EXPECTED_MIN: f64 = 5.0;
/// Counts in pooled cells that expect fewer than [`EXPECTED_MIN`] together, above which the test fails.
const POOLED_MAX: f64 = 30.0;

/// Standard deviations between the chi-square statistic and its mean, by the cube root of Wilson and Hilferty: positive
/// where counts and probabilities (which sum to 1) disagree, strongly negative where draws are too even to be random.
///
/// Cells that expect fewer than 5 are pooled. Infinite where samples fall into a cell of probability 0 or too many into
/// the pool; 0 where fewer than two cells are left.
///
/// # Panics
/// When the lengths differ, or the probabilities do not sum to 1 within 1e-3.
pub fn deviation(counts: &[u64], probabilities: &[f64]) -> f64 {
    assert_eq!(counts.len(), probabilities.len(), "one probability per cell");
    let sum: f64 = probabilities.iter().sum();
    assert!((sum - 1.0).abs() < 1e-3, "probabilities sum to {sum}");
    let total = counts.iter().sum::<u64>() as f64;
    let (mut statistic, mut cells, mut pool) = (0.0, 0, (0.0, 0.0));
    for (&count, &p) in counts.iter().zip(probabilities) {
        let (count, expected) = (count as f64, p * total);
        if p <= 0.0 && count > 0.0 {
            return f64::INFINITY;
        }
        if expected < EXPECTED_MIN {
            pool = (pool.0 + count, pool.1 + expected);
        } else {
            statistic += (count - expected).powi(2) / expected;
            cells += 1;
        }
    }
    if pool.1 >= EXPECTED_MIN {
        statistic += (pool.0 - pool.1).powi(2) / pool.1;
        cells += 1;
    } else if pool.0 > POOLED_MAX {
        return f64::INFINITY;
    }
    if cells < 2 {
        return 0.0;
    }
    let k = f64::from(cells - 1);
    let spread = 2.0 / (9.0 * k);
    ((statistic / k).cbrt() - (1.0 - spread)) / spread.sqrt()
}

/// Largest [`deviation`] of one of `tests` tests, of which right ones fail together with a probability of 0.01 (Šidák's
/// correction).
pub fn bound(tests: usize) -> f64 {
    let each = 1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / tests as f64);
    inverse_normal_cdf(1.0 - each)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_distribution_is_noticed() {
        let counts = [1000, 1010, 990, 1005];
        assert!(deviation(&counts, &[0.25; 4]).abs() < bound(1));
        assert!(deviation(&counts, &[0.28, 0.25, 0.25, 0.22]) > bound(100));
        assert!(deviation(&[100_000; 20], &[0.05; 20]) < -4.5, "too even to be random");
        assert!(deviation(&[500, 500, 1], &[0.5, 0.5, 0.0]) > bound(100), "a draw where none may be");
        assert_eq!(
            deviation(&[500, 500, 40], &[0.499_5, 0.499_5, 1e-3]),
            f64::INFINITY,
            "too many in the pool"
        );
    }

    #[test]
    fn more_tests_allow_more() {
        assert!((bound(1) - 2.326_348).abs() < 1e-5, "{}", bound(1));
        assert!(bound(1000) > bound(10) && bound(1000) < 4.5, "{}", bound(1000));
    }
}
