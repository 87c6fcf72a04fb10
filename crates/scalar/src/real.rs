//! The scalar trait.

use std::fmt::Debug;
use std::iter::Sum;
use std::ops::{AddAssign, DivAssign, MulAssign, SubAssign};

/// A real scalar: `f32` in production, `f64` in gradient checks.
pub trait Real:
    num_traits::Float
    + AddAssign
    + SubAssign
    + MulAssign
    + DivAssign
    + Sum
    + Default
    + Debug
    + Send
    + Sync
    + bytemuck::Pod
{
    /// The nearest value of this type.
    fn of(x: f64) -> Self;
    /// This value in double precision.
    fn f64(self) -> f64;
    /// This value rounded towards zero; saturates, and is 0 of what is not a number.
    fn as_i32(self) -> i32;
    /// Base-2 logarithm of a positive normal number to 1e-5, without a library call: in `f64` the exact one.
    fn log2_fast(self) -> Self;
    /// `max(self, 0)` with a zero derivative at zero.
    #[inline(always)]
    fn relu(self) -> Self {
        if self > Self::zero() { self } else { Self::zero() }
    }
    /// Clamps to `[lo, hi]`; NaN becomes `lo`.
    #[inline(always)]
    fn clamp_to(self, lo: Self, hi: Self) -> Self {
        if self > lo { if self < hi { self } else { hi } } else { lo }
    }
}

impl Real for f32 {
    #[inline(always)]
    fn of(x: f64) -> Self {
        x as Self
    }
    #[inline(always)]
    fn f64(self) -> f64 {
        f64::from(self)
    }
    #[inline(always)]
    fn as_i32(self) -> i32 {
        self as i32
    }
    #[inline(always)]
    fn log2_fast(self) -> Self {
        // x = 2^e m with m in [sqrt(1/2), sqrt(2)); ln m by the odd series of s = (m - 1) / (m + 1).
        let shifted = self.to_bits().wrapping_sub(0x3f35_04f3);
        let e = (shifted as i32) >> 23;
        let m = Self::from_bits((shifted & 0x007f_ffff).wrapping_add(0x3f35_04f3));
        let s = (m - 1.0) / (m + 1.0);
        let s2 = s * s;
        let series = ((0.577_078 * s2 + 0.961_796_7) * s2 + 2.885_39) * s;
        e as Self + series
    }
}

impl Real for f64 {
    #[inline(always)]
    fn of(x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn f64(self) -> f64 {
        self
    }
    #[inline(always)]
    fn as_i32(self) -> i32 {
        self as i32
    }
    #[inline(always)]
    fn log2_fast(self) -> Self {
        self.log2()
    }
}

/// Sum of the samples, folding the upper half onto the lower until one is left: unlike a running sum it vectorises.
#[inline(always)]
pub fn halved_sum<T: Real, const C: usize>(mut x: [T; C]) -> T {
    let mut n = C;
    while n > 1 {
        let half = n / 2;
        for c in 0..half {
            x[c] += x[n - half + c];
        }
        n -= half;
    }
    x.first().copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fast_logarithm_is_close_to_the_exact_one() {
        let mut worst = 0.0_f32;
        for i in 0..100_000_u32 {
            let x = ((i as f32 / 100_000.0 - 0.5) * 80.0).exp2();
            worst = worst.max((x.log2_fast() - x.log2()).abs());
        }
        assert!(worst < 1e-5, "error {worst}");
        assert_eq!([0.25_f32, 1.0, 2.0, 1024.0].map(Real::log2_fast), [-2.0, 0.0, 1.0, 10.0]);
    }
}
