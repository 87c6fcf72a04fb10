//! The largest errors that twins may have against the CPU, each with its reason.

/// Constraints: a few roundings of a unit vector.
pub(super) const CONSTRAIN: f64 = 3e-7;
/// Parameters after 50 steps of Adam, over the sum of the rates: constants in `f32` where the CPU has `f64`.
pub(super) const ADAM: f64 = 2e-6;
/// Moments after 50 steps, over the largest one.
pub(super) const MOMENTS: f64 = 2e-6;
/// Solutions of Large Steps against the direct solve in `f64`, over the largest entry: the iteration ends below this.
pub(super) const SOLVE: f64 = 1e-6;
/// Positions after 50 steps of Large Steps, over the largest move. The CPU moves `u = M x` in `f32` and solves for `x`, which
/// rounds positions; the device adds moves to `x`.
pub(super) const LARGE_STEPS: f64 = 3e-5;
