//! Finite-difference gradient checks on plain slices.
//!
//! A check compares an analytic gradient with central differences along random directions and along single
//! coordinates, with random seed gradients chosen by the caller (a constant seed lets errors cancel).
//!
//! ```
//! let f = |x: &[f64]| x[0] * x[0] * x[1].sin();
//! let x = [1.3_f64, 0.4];
//! let g = [2.0 * x[0] * x[1].sin(), x[0] * x[0] * x[1].cos()];
//! photofit_gradcheck::check("x^2 sin y", &x, &g, 1e-5, 1e-7, f);
//! ```

/// Largest relative error of `gradient` against central differences of `f` at `x` with step `h`.
///
/// Each coordinate is compared; errors are relative to the largest absolute difference quotient, so that
/// coordinates with a vanishing gradient do not count their rounding noise.
///
/// # Panics
/// When there is not one derivative per coordinate.
pub fn max_relative_error(x: &[f64], gradient: &[f64], h: f64, mut f: impl FnMut(&[f64]) -> f64) -> f64 {
    assert_eq!(x.len(), gradient.len(), "one derivative per coordinate");
    let mut at = x.to_vec();
    let mut numeric = Vec::with_capacity(x.len());
    for i in 0..x.len() {
        at[i] = x[i] + h;
        let plus = f(&at);
        at[i] = x[i] - h;
        let minus = f(&at);
        at[i] = x[i];
        numeric.push((plus - minus) / (2.0 * h));
    }
    let scale = numeric.iter().chain(gradient).fold(1e-30, |m: f64, v| m.max(v.abs()));
    let worst = numeric.iter().zip(gradient).map(|(n, g)| (n - g).abs() / scale).fold(0.0, f64::max);
    if numeric.iter().chain(gradient).all(|v| v.is_finite()) { worst } else { f64::INFINITY }
}

/// Asserts that `gradient` agrees with central differences of `f` within `tolerance` (see [`max_relative_error`]).
///
/// # Panics
/// When the error exceeds `tolerance`, or when the gradient is zero everywhere while a tolerance below one is
/// asked for (such a check could not fail).
pub fn check(name: &str, x: &[f64], gradient: &[f64], h: f64, tolerance: f64, f: impl FnMut(&[f64]) -> f64) {
    assert!(
        gradient.iter().any(|g| *g != 0.0),
        "{name}: the gradient is zero everywhere, the check is empty"
    );
    let error = max_relative_error(x, gradient, h, f);
    assert!(error <= tolerance, "{name}: relative gradient error {error:.3e} above {tolerance:.1e}");
}

/// Largest difference of two implementations of one operation, each relative to the expected number or to the root mean
/// square of all of them, whichever is larger: rounding of numbers that nearly cancel does not count as an error of their
/// own size. Infinite if a number is not finite on one side alone or the lengths differ.
pub fn worst_difference(found: &[f32], expected: &[f32]) -> f64 {
    if found.len() != expected.len() {
        return f64::INFINITY;
    }
    let wide = |x: &f32| f64::from(*x);
    let finite: Vec<f64> = expected.iter().filter(|x| x.is_finite()).map(wide).collect();
    let square = finite.iter().map(|x| x * x).sum::<f64>() / finite.len().max(1) as f64;
    let floor = square.sqrt().max(1e-30);
    let pairs = found.iter().zip(expected);
    pairs.fold(0.0, |worst: f64, (a, b)| {
        let equal = a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan());
        let error = if equal { 0.0 } else { (wide(a) - wide(b)).abs() / wide(b).abs().max(floor) };
        if error.is_finite() { worst.max(error) } else { f64::INFINITY }
    })
}

/// A small deterministic generator for test inputs (`SplitMix64`), uniform in `[lo, hi)`.
#[derive(Clone, Debug)]
pub struct Uniform {
    state: u64,
}

impl Uniform {
    /// A generator with its own stream per `seed`.
    pub fn new(seed: u64) -> Self {
        Self { state: seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) }
    }

    /// The next number in `[lo, hi)`.
    pub fn range(&mut self, lo: f64, hi: f64) -> f64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        lo + (hi - lo) * ((z >> 11) as f64 / (1u64 << 53) as f64)
    }

    /// `n` numbers in `[lo, hi)`.
    pub fn vec(&mut self, n: usize, lo: f64, hi: f64) -> Vec<f64> {
        (0..n).map(|_| self.range(lo, hi)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_gradient_is_found() {
        let x = [0.7, -0.2];
        let f = |x: &[f64]| x[0] * x[1];
        assert!(max_relative_error(&x, &[x[1], x[0]], 1e-5, f) < 1e-9);
        assert!(max_relative_error(&x, &[x[1] * 1.01, x[0]], 1e-5, f) > 1e-3);
        assert!(max_relative_error(&x, &[f64::NAN, x[0]], 1e-5, f).is_infinite());
    }

    #[test]
    fn differences_are_relative_to_the_larger_numbers() {
        assert_eq!(worst_difference(&[1.0, f32::NAN], &[1.0, f32::NAN]), 0.0);
        assert!((worst_difference(&[8.08, 0.0], &[8.0, 0.0]) - 0.01).abs() < 1e-6);
        assert!((worst_difference(&[8.0, 0.08], &[8.0, 0.0]) - 0.08 / 32_f64.sqrt()).abs() < 1e-6);
        assert!(worst_difference(&[1.0], &[f32::NAN]).is_infinite());
        assert!(worst_difference(&[1.0], &[]).is_infinite());
    }

    #[test]
    #[should_panic(expected = "the check is empty")]
    fn an_all_zero_gradient_is_refused() {
        check("empty", &[1.0], &[0.0], 1e-5, 1e-5, |_| 0.0);
    }
}
