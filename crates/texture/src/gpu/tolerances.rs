//! Worst errors that the twins may have against the CPU (see [`photofit_gradcheck::worst_difference`]), each with its
//! reason.

/// Levels and their adjoints: up to nine products a texel, whose weights are rounded from `f64` on the CPU, over all
/// levels of a chain.
pub(crate) const LEVELS: f64 = 2e-6;
/// Values of lookups: the share of a level, a difference of logarithms of squares, is known to some 1e-6, and it weighs
/// texels that differ by several times their root mean square.
pub(crate) const LOOKUP: f64 = 2e-5;
/// Derivatives of lookups: the same shares, and sums over 16 channels in another order.
pub(crate) const LOOKUP_VJP: f64 = 2e-5;
/// Texel gradients: the same shares; sums of hundreds of terms in `f32` on the CPU (texels at a clamped border), exact on
/// the device.
pub(crate) const SCATTER: f64 = 5e-5;
/// Values of textures in the precision of files: as [`LOOKUP`].
pub(crate) const STORED: f64 = 2e-5;
