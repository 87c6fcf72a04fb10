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
}
