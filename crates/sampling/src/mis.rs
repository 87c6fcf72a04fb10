//! Multiple importance sampling heuristics (Veach and Guibas 1995).

use photofit_scalar::Real;

/// Balance heuristic: the weight of a sample of strategy `f` with density `pdf_f` (`count_f` samples) against strategy
/// `g`. 0 for densities of 0; an infinite density wins.
#[inline]
pub fn balance_heuristic<T: Real>(count_f: T, pdf_f: T, count_g: T, pdf_g: T) -> T {
    weight(count_f * pdf_f, count_g * pdf_g)
}

/// Power heuristic with exponent 2; arguments as [`balance_heuristic`].
///
/// ```
/// assert_eq!(photofit_sampling::power_heuristic(1.0, 1.0, 1.0, 0.5), 0.8);
/// ```
#[inline]
pub fn power_heuristic<T: Real>(count_f: T, pdf_f: T, count_g: T, pdf_g: T) -> T {
    let (f, g) = (count_f * pdf_f, count_g * pdf_g);
    // Dividing by the larger one first keeps the squares from overflow.
    let largest = f.max(g);
    if largest.is_infinite() || largest <= T::zero() {
        return weight(f, g);
    }
    let (f, g) = (f / largest, g / largest);
    weight(f * f, g * g)
}

#[inline]
fn weight<T: Real>(f: T, g: T) -> T {
    if f.is_infinite() {
        return T::one();
    }
    if f > T::zero() { f / (f + g) } else { T::zero() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_sum_to_one_and_stay_finite() {
        let values = [0.0_f32, 1e-30, 0.3, 2.0, 1e30];
        for f in values {
            for g in values {
                for heuristic in [balance_heuristic::<f32>, power_heuristic::<f32>] {
                    let (a, b) = (heuristic(2.0, f, 1.0, g), heuristic(1.0, g, 2.0, f));
                    assert!(a.is_finite() && (0.0..=1.0).contains(&a), "{f} {g}");
                    let expected = if f == 0.0 && g == 0.0 { 0.0 } else { 1.0 };
                    assert!((a + b - expected).abs() < 1e-6, "{f} {g}: {a} + {b}");
                }
            }
        }
        assert_eq!(balance_heuristic(1.0, 1.0, 3.0, 1.0), 0.25);
        assert_eq!(power_heuristic(1.0, 1.0, 2.0, 1.0), 0.2);
        assert_eq!(power_heuristic(1.0, f32::INFINITY, 1.0, 5.0), 1.0);
        assert_eq!(power_heuristic(1.0, 5.0, 1.0, f32::INFINITY), 0.0);
    }
}
