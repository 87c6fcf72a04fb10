//! The largest errors that twins may have against the CPU, each with its reason and the worst one seen on the software driver
//! (Mesa's llvmpipe).

/// Constraints: a few roundings of a unit vector. Seen: 0.
pub(super) const CONSTRAIN: f64 = 3e-7;
/// Parameters after 50 steps of Adam, over the sum of the rates: constants in `f32` where the CPU has `f64`. Seen: 2.4e-7.
pub(super) const ADAM: f64 = 1e-6;
/// Moments after 50 steps, over the largest one. Seen: 0; devices that fuse products and sums round otherwise.
pub(super) const MOMENTS: f64 = 2e-6;
/// Solutions of Large Steps against the direct solve in `f64`, over the largest entry: the iteration ends below the rounding
/// of `f32`. Seen: 1.7e-7 at condition numbers up to 239, 1.2e-6 at 12518; 8.4e-6 there on an NVIDIA H100.
pub(super) const SOLVE: f64 = 3.6e-6;
/// Positions after 50 steps of Large Steps, over the largest move. The CPU moves `u = M x` in `f32` and solves for `x`, which
/// rounds positions; the device adds moves to `x`. Seen: 1.1e-5.
pub(super) const LARGE_STEPS: f64 = 3e-5;
/// Positions after 50 steps of which the first moments are diffused but not over creases, over the largest move:
/// weights and solves in `f32` where the CPU factorises in `f64`. Seen: 7.2e-7.
pub(super) const EDGE_AWARE: f64 = 5e-6;
