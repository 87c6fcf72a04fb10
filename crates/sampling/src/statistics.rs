//! Chi-square tests for the tests of this crate.

/// Asserts that `counts` come from equal probabilities.
pub(crate) fn chi_square_uniform(name: &str, counts: &[u64]) {
    let probability = 1.0 / counts.len() as f64;
    chi_square(name, counts, &vec![probability; counts.len()]);
}

/// Asserts that `counts` come from `probabilities`: the statistic lies within 4.5 standard deviations of its mean, on
/// both sides (a statistic near 0 means draws that are not random). Cells that expect fewer than 5 are pooled.
pub(crate) fn chi_square(name: &str, counts: &[u64], probabilities: &[f64]) {
    let deviation = chi_square_deviation(counts, probabilities);
    assert!(
        deviation.abs() < 4.5,
        "{name}: chi-square lies {deviation:.2} standard deviations from its mean"
    );
}

/// Standard deviations between the statistic and its mean (Wilson and Hilferty's cube root).
pub(crate) fn chi_square_deviation(counts: &[u64], probabilities: &[f64]) -> f64 {
    assert_eq!(counts.len(), probabilities.len(), "one probability per cell");
    let sum: f64 = probabilities.iter().sum();
    assert!((sum - 1.0).abs() < 1e-4, "probabilities sum to {sum}");
    let total = counts.iter().sum::<u64>() as f64;
    let (mut statistic, mut cells, mut rest) = (0.0, 0, (0.0, 0.0));
    for (count, p) in counts.iter().zip(probabilities) {
        let (count, expected) = (*count as f64, p * total);
        if expected < 5.0 {
            rest = (rest.0 + count, rest.1 + expected);
        } else {
            statistic += (count - expected).powi(2) / expected;
            cells += 1;
        }
    }
    if rest.1 >= 5.0 {
        statistic += (rest.0 - rest.1).powi(2) / rest.1;
        cells += 1;
    } else if rest.0 > 30.0 {
        return f64::INFINITY;
    }
    assert!(cells > 1, "the check needs cells");
    let k = f64::from(cells - 1);
    let spread = 2.0 / (9.0 * k);
    ((statistic / k).cbrt() - (1.0 - spread)) / spread.sqrt()
}

#[test]
fn a_wrong_distribution_is_noticed() {
    let counts = [1000, 1010, 990, 1005];
    assert!(chi_square_deviation(&counts, &[0.25; 4]).abs() < 4.5);
    assert!(chi_square_deviation(&counts, &[0.28, 0.25, 0.25, 0.22]) > 4.5);
    assert!(chi_square_deviation(&[100_000; 20], &[0.05; 20]) < -4.5, "too even to be random");
    assert!(chi_square_deviation(&[500, 500, 100], &[0.5, 0.5, 0.0]) > 4.5, "draws where none may be");
}
