//! Assertions of the tests of this crate.

use crate::chi_square::deviation;

/// Asserts that `counts` come from equal probabilities.
pub(crate) fn chi_square_uniform(name: &str, counts: &[u64]) {
    let probability = 1.0 / counts.len() as f64;
    chi_square(name, counts, &vec![probability; counts.len()]);
}

/// Asserts that `counts` come from `probabilities`: the statistic lies within 4.5 standard deviations of its mean, on
/// both sides (a statistic near 0 means draws that are not random).
pub(crate) fn chi_square(name: &str, counts: &[u64], probabilities: &[f64]) {
    let deviation = deviation(counts, probabilities);
    assert!(
        deviation.abs() < 4.5,
        "{name}: chi-square lies {deviation:.2} standard deviations from its mean"
    );
}
