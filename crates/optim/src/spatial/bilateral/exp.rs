//! A fast exponential that vectorises.

use photofit_scalar::Real;

/// From here on the weight is zero.
const CUT: f32 = 100.0;

/// `2^-a` for `a >= 0`; zero from 100 on, one at zero.
///
/// In f32: the nearest integer by the rounding of an addition, a polynomial of degree 4 for the rest, and the exponent
/// by integer arithmetic; relative error at most 3e-6. Other scalars take the library's exponential.
#[inline(always)]
pub(super) fn exp2_neg<T: Real>(a: T) -> T {
    if size_of::<T>() != size_of::<f32>() {
        return T::of((-a.f64()).exp2());
    }
    let a: f32 = bytemuck::cast(a);
    /// 1.5 2^23: adding it rounds to an integer, which then stands in the low bits.
    const MAGIC: f32 = 12_582_912.0;
    let clamped = if a < CUT { a } else { CUT };
    let shifted = clamped + MAGIC;
    let integer = shifted.to_bits().wrapping_sub(MAGIC.to_bits());
    let r = (shifted - MAGIC) - clamped;
    let p = 0.009_582_853_f32;
    let p = p * r + 0.055_906_426;
    let p = p * r + 0.240_240_99;
    let p = p * r + 0.693_124_2;
    let p = p * r + 1.0;
    let value = f32::from_bits(p.to_bits().wrapping_sub(integer << 23));
    bytemuck::cast(if a < CUT { value } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stated_error_holds() {
        assert_eq!(exp2_neg(0.0_f32), 1.0);
        let mut worst = 0.0_f64;
        for i in 0..200_000_u32 {
            let a = i as f32 * (99.9 / 200_000.0);
            let exact = (-f64::from(a)).exp2();
            worst = worst.max((f64::from(exp2_neg(a)) / exact - 1.0).abs());
        }
        assert!(worst < 3e-6, "{worst:e}");
        for far in [100.0, 1e10, 1e36, f32::INFINITY] {
            assert_eq!(exp2_neg(far), 0.0, "{far}");
        }
        assert_eq!(exp2_neg(3.5_f64), (-3.5_f64).exp2());
    }
}
