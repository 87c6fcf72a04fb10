//! The inverse of the normal distribution, from exactly rounded operations alone.

/// Evaluates a polynomial, lowest coefficient first.
#[inline(always)]
fn polynomial<const N: usize>(x: f64, coefficients: [f64; N]) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// Natural logarithm of a normal positive number from additions, products and one quotient, to about 1e-15: the
/// platform's own may differ in its last bit from one system to another.
#[inline]
fn ln(x: f64) -> f64 {
    let bits = x.to_bits();
    let mut exponent = ((bits >> 52) & 0x7ff) as i64 - 1023;
    let mut mantissa = f64::from_bits((bits & 0x000f_ffff_ffff_ffff) | (1023 << 52));
    if mantissa > std::f64::consts::SQRT_2 {
        mantissa *= 0.5;
        exponent += 1;
    }
    // ln m = 2 artanh s; |s| is at most 0.1716, hence ten terms reach 1e-17.
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let odd: [f64; 11] = std::array::from_fn(|i| 2.0 / (2 * i + 1) as f64);
    s * polynomial(s * s, odd) + exponent as f64 * std::f64::consts::LN_2
}

/// The number below which a normal variable of mean 0 and variance 1 falls with probability `p`, to a relative 1e-7
/// (Wichura 1988, algorithm AS 241, PPND7); infinite at 0 and 1, NaN outside.
///
/// The result is the same on every platform.
///
/// ```
/// assert!((photofit_sampling::inverse_normal_cdf(0.975) - 1.959_964).abs() < 1e-6);
/// ```
pub fn inverse_normal_cdf(p: f64) -> f64 {
    let q = p - 0.5;
    if q.abs() <= 0.425 {
        let r = 0.180_625 - q * q;
        return q * polynomial(r, [3.387_132_717_9, 50.434_271_938, 159.291_132_02, 59.109_374_720])
            / polynomial(r, [1.0, 17.895_169_469, 78.757_757_664, 67.187_563_600]);
    }
    let tail = if q < 0.0 { p } else { 1.0 - p };
    if tail.is_nan() || tail < 0.0 {
        return f64::NAN;
    }
    let magnitude = if tail < f64::MIN_POSITIVE {
        f64::INFINITY
    } else {
        let r = (-ln(tail)).sqrt();
        if r <= 5.0 {
            let r = r - 1.6;
            polynomial(r, [1.423_437_277_7, 2.756_815_390_0, 1.306_728_481_6, 0.170_238_211_03])
                / polynomial(r, [1.0, 0.737_001_642_50, 0.120_211_329_75])
        } else {
            let r = r - 5.0;
            polynomial(r, [6.657_905_115_0, 3.081_226_386_0, 0.428_682_943_37, 0.017_337_203_997])
                / polynomial(r, [1.0, 0.241_978_942_25, 0.012_258_202_635])
        }
    };
    if q < 0.0 { -magnitude } else { magnitude }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithm_equals_the_standard_one() {
        for i in 1..2000 {
            for scale in [1e-300, 1e-9, 1e-3, 1.0, 1e12] {
                let x = f64::from(i) * scale;
                assert!((ln(x) - x.ln()).abs() <= 4e-16 * x.ln().abs().max(1.0), "{x}");
            }
        }
    }

    #[test]
    fn quantiles_are_right_in_the_middle_and_in_both_tails() {
        // Quantiles of the standard normal distribution, from double-precision tables.
        let known = [
            (0.5, 0.0),
            (0.6, 0.253_347_103_135_799_7),
            (0.9, 1.281_551_565_544_600_4),
            (0.95, 1.644_853_626_951_472_2),
            (0.999, 3.090_232_306_167_813_5),
            (1e-6, -4.753_424_308_822_899),
            (1e-12, -7.034_483_825_301_131),
            (1e-100, -21.273_453_560_965_155),
        ];
        for (p, z) in known {
            let got = inverse_normal_cdf(p);
            assert!((got - z).abs() <= 2e-7 * z.abs().max(1e-9), "{p}: {got} against {z}");
            if p > 1e-5 {
                assert!((inverse_normal_cdf(1.0 - p) + got).abs() < 1e-6, "symmetry at {p}");
            }
        }
        assert_eq!(inverse_normal_cdf(0.0), f64::NEG_INFINITY);
        assert_eq!(inverse_normal_cdf(1.0), f64::INFINITY);
        assert!(inverse_normal_cdf(-0.1).is_nan() && inverse_normal_cdf(1.1).is_nan());
        assert!(inverse_normal_cdf(f64::NAN).is_nan());
    }
}
