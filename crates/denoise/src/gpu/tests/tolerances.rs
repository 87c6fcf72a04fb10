//! The largest errors that twins may have against the CPU, each with its reason and the worst one seen on the software driver
//! (Mesa's llvmpipe).

/// Solutions of the linear step, over the largest entry of the solution times the condition number (largest over smallest
/// entry of the symbol): transforms and eliminations in other orders.
/// Seen: 6.6e-7.
pub(super) const STRIP: f64 = 1e-6;
/// Estimates after 20 steps and more, over the contrast of the target (largest less smallest): products and sums fused or not,
/// at thresholds where shrinking is continuous. Seen: 8.8e-7.
pub(super) const SPLITTING: f64 = 2e-5;
/// Irradiance after the way back, relative to the value and a floor of a hundredth of the mean: exponentials of a device, means over 41 x 41 pixels.
/// Seen: 8.6e-7.
pub(super) const WAY_BACK: f64 = 2e-5;
/// Denoised radiance, relative to the value and a floor of a hundredth of the mean: logarithms that differ by `SPLITTING`, made
/// exponentials. Seen: 2.2e-4 for pictures of few pixels with guides, 8.0e-6 for a sequence of three frames.
pub(super) const DENOISED: f64 = 5e-4;
/// Scores of strengths, relative: 64 terms of squares in single precision, added up in double.
pub(super) const SCORE: f64 = 2e-6;
