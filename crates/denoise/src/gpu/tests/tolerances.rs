//! The largest errors that twins may have against the CPU, each with its reason and the worst one seen on the software driver
//! (Mesa's llvmpipe).

/// Solutions of the linear step, over the largest entry of the solution times the condition number (largest over smallest
/// entry of the symbol): transforms and eliminations in other orders.
/// Seen: 6.6e-7.
pub(super) const STRIP: f64 = 1e-6;
/// Estimates after 20 steps and more, over the contrast of the target (largest less smallest): products and sums fused or not,
/// at thresholds where shrinking is continuous. Seen: 1.0e-6.
pub(super) const SPLITTING: f64 = 2e-5;
/// Irradiance after the way back, relative to the value and a floor of a hundredth of the mean: exponentials of a device, means over 41 x 41 pixels.
/// Seen: 8.6e-7.
pub(super) const WAY_BACK: f64 = 2e-5;
/// Denoised radiance, relative to the value and a floor of a hundredth of the mean. What is seen comes from nearly black pixels: their
/// logarithm is near 0, but has the absolute error of the solver like all others (`SPLITTING`), and the exponential near 0 keeps it. With guides
/// and `TvL1` at 75 x 41, a pixel of .0008 of the mean differs by 2.4e-4: by 4.2e-7 in the logarithm, at a contrast of 1.5; 4 of
/// 9225 samples differ by more than 2e-5. Seen: 2.5e-4 (320 x 180, one sample a pixel), 8.0e-6 for a sequence of three frames.
pub(super) const DENOISED: f64 = 5e-4;
/// Scores of strengths, relative: 64 terms of squares in single precision, added up in double. Seen: 2.0e-7.
pub(super) const SCORE: f64 = 2e-6;
