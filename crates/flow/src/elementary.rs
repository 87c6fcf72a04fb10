//! Elementary functions without branches and calls, so that loops over them become vector instructions. In double
//! precision, which gradients are checked in, they are those of the library.

use photofit_scalar::Real;
use std::f32::consts::{LN_2, LOG2_E};
use std::f64::consts::PI;

/// `e^x` for `x` up to 80, with a relative error below 3e-7; below -87 what it is there. NaN stays NaN.
#[inline(always)]
pub(crate) fn exp<T: Real>(x: T) -> T {
    if size_of::<T>() != size_of::<f32>() {
        return x.exp();
    }
    /// Its last binary digit counts ones.
    const SHIFT: f32 = 12_582_912.0;
    /// `LN_2` in two parts, the first of few digits.
    const LN_2_HIGH: f32 = 0.693_359_4;
    const LN_2_LOW: f32 = LN_2 - LN_2_HIGH - 1.904_654_3e-9;
    // There and back without a change: the compiler knows.
    let x = x.f64() as f32;
    // Not `max`, which would make a number of NaN.
    let x = if x < -87.0 { -87.0 } else { x };
    let shifted = x * LOG2_E + SHIFT;
    let n = shifted - SHIFT;
    let r = x - n * LN_2_HIGH - n * LN_2_LOW;
    let tail = 0.5 + r * (1.666_666_5e-1 + r * (4.166_579_6e-2 + r * (8.333_452e-3 + r * 1.398_2e-3)));
    let power = f32::from_bits((shifted.to_bits() << 23).wrapping_add(1.0_f32.to_bits()));
    T::of(f64::from((1.0 + r + r * r * tail) * power))
}

/// `(sin, cos)` of `pi x` for `x` in `[0, 1]`, with errors below 3e-7.
#[inline(always)]
pub(crate) fn sin_cos_pi<T: Real>(x: T) -> (T, T) {
    if size_of::<T>() != size_of::<f32>() {
        return (x * T::of(PI)).sin_cos();
    }
    // Taylor series of the angle from a half turn, at most a quarter turn.
    let a = (x - T::of(0.5)) * T::of(PI);
    let b = a * a;
    let series = |c: [f64; 6]| c.iter().rev().fold(T::zero(), |sum, c| sum * b + T::of(1.0 / *c));
    let sin = a * series([1.0, -6.0, 120.0, -5040.0, 362_880.0, -39_916_800.0]);
    let cos = T::one() - b * series([2.0, -24.0, 720.0, -40_320.0, 3_628_800.0, -479_001_600.0]);
    (cos, -sin)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponentials_are_as_near_as_stated() {
        let worst = (-8600..=8000).map(|i| {
            let x = i as f32 * 0.01;
            (f64::from(exp(x)) / f64::from(x).exp() - 1.0).abs()
        });
        let worst = worst.fold(0.0, f64::max);
        assert!(worst < 3e-7, "{worst:.1e}");
        assert!(exp(-1e30_f32) < 2e-38 && exp(f32::NEG_INFINITY) < 2e-38 && exp(0.0_f32) == 1.0);
        assert_eq!(exp(1.3_f64), 1.3_f64.exp());
        assert!(exp(f32::NAN).is_nan() && exp(-f32::NAN).is_nan());
    }

    #[test]
    fn sines_and_cosines_are_as_near_as_stated() {
        let worst = (0..=10_000).map(|i| {
            let x = i as f32 * 1e-4;
            let (s, c) = sin_cos_pi(x);
            let (exact_s, exact_c) = (f64::from(x) * PI).sin_cos();
            (f64::from(s) - exact_s).abs().max((f64::from(c) - exact_c).abs())
        });
        let worst = worst.fold(0.0, f64::max);
        assert!(worst < 3e-7, "{worst:.1e}");
        assert_eq!(sin_cos_pi(0.3_f64), (0.3 * PI).sin_cos());
    }
}
