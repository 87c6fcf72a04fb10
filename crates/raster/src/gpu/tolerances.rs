//! How far twins may be from their operations on the CPU, each with its reason.

/// Half of the distance between neighbouring numbers at one: what an operation in single precision loses.
pub(crate) const ROUNDING: f64 = 1.0 / (1 << 24) as f64;
/// What moves an edge on the CPU, in samples: its coefficients are rounded about the corner of a tile of 32 samples.
pub(crate) const TILE_ROUNDING: f64 = 100.0 * ROUNDING;
/// Distance from an edge within which a centre may belong to either side, and error of a depth, in multiples of the bound
/// for one rounding of each operand.
pub(crate) const EDGE: f64 = 2.0;
pub(crate) const DEPTH: f64 = 1.0;
/// Share of samples that may show another triangle because of a centre on an edge or of equal depths, and a number that small pictures may have.
pub(crate) const OTHER_TRIANGLES: f64 = 1e-5;
pub(crate) const FEW: usize = 4;
/// Clip-space positions, relative to the sum of magnitudes: a device may fuse products and sums.
pub(crate) const CLIP: f32 = 4e-7;
/// Share of silhouettes that only one side finds: edges almost along the line between two centres, vertices on it, and
/// folds of triangles seen edge-on are decided by rounding.
pub(crate) const OTHER_SILHOUETTES: f64 = 2e-3;
/// Colours after antialiasing, relative to the largest: blend factors are differences of places of up to 2^12 samples.
pub(crate) const ANTIALIASED: f32 = 1e-4;
/// Gradients of clip-space positions and colours by antialiasing, relative to the largest: as colours, and the derivative
/// divides by the edge's extent.
pub(crate) const ANTIALIASED_VJP: f32 = 3e-4;
/// Layers over one another and means of samples: a few roundings (`photofit_gradcheck::worst_difference`).
pub(crate) const COMPOSITE: f64 = 1e-6;
/// Radiance of a pixel, relative to one or to itself: shading, the mean of samples, layers over one another.
pub(crate) const PICTURE: f32 = 1e-4;
/// Share of pixels that may differ by more: those of a few samples that show another triangle or silhouette.
pub(crate) const PICTURE_PIXELS: f64 = 2e-3;
/// Gradients of whole pictures, relative in norm.
pub(crate) const GRADIENT: f64 = 1e-3;
/// Losses, relative: sums of 2^20 terms in single precision, by a tree.
pub(crate) const LOSS: f64 = 4e-6;
/// Gradients of losses, relative to themselves or a share of the largest: differences of numbers of like size.
/// Seen on an NVIDIA H100: 1.2e-5.
pub(crate) const LOSS_GRADIENT: f32 = 3e-5;
/// Structural similarity, relative, and its gradient, relative to the largest, against the CPU in `f64`: variances under a
/// window are differences of squares, over a constant of 9e-4.
pub(crate) const SIMILARITY: f64 = 2e-5;
pub(crate) const SIMILARITY_GRADIENT: f64 = 2e-5;
/// Pixels of a shaded layer (`photofit_gradcheck::worst_difference`): interpolation, lookups and lights, a few hundred
/// operations; the share of a mip level is known to some 1e-6.
pub(crate) const SHADED: f64 = 5e-5;
/// Gradients of a shaded layer, as above: terms of both signs are summed in `f32` on the CPU, per texel up to hundreds.
/// Seen on an H100: 5.8e-4; 1.8e-3 of earlier kernels, positions at 16 samples a pixel, why is not known.
pub(crate) const SHADED_VJP: f64 = 1e-3;
/// Both, of meshes with corners behind the eye and surfaces as smooth as can be: lobes narrower than what the rounding of
/// normals turns them by.
pub(crate) const SHADED_BROKEN: f64 = 2e-2;
