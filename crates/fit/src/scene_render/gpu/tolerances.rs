//! How far pictures of a device may be from those of the CPU, each bound with its reason.

/// Radiance and alpha of a pixel, relative to one or to itself: shading, lookups whose level of detail is known to some 1e-6, layers
/// over one another, the mean of samples.
pub(crate) const CLOSE: f32 = 1e-4;
/// Share of pixels that differ by more: those with a sample whose centre lies on an edge, or at which two depths or the alpha of a
/// mask and its cutoff are equal within rounding.
pub(crate) const SCENE_PIXELS: f64 = 2e-3;
/// Mean difference of all numbers of a picture relative to their mean: such a sample in each of a few thousand pixels, and rounding.
pub(crate) const SCENE_MEAN: f64 = 1e-4;
/// What is seen through glass, relative: one less alpha is a difference of numbers near one.
pub(crate) const THROUGH_GLASS: f64 = 1e-3;
