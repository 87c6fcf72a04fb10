//! The largest relative errors that twins may have against the CPU in `f32`, each with its reason and the worst one seen on
//! the software driver (Mesa's llvmpipe). The test says what an error is relative to.

/// Copies, and sums of the same terms in the same order. Seen: 0.
pub(super) const EXACT: f64 = 0.0;
/// Unit vectors: a few roundings, and angles of polynomials within 2e-8. Seen: 1.0e-6.
pub(super) const FORWARD: f64 = 3e-6;
/// Gradients: as above, divided by lengths twice. Seen: 8.3e-7.
pub(super) const GRADIENT: f64 = 4e-6;
/// Gradients at random and degenerate triangles, where slivers divide by what cancels. Seen: 4.0e-5.
pub(super) const SLIVER: f64 = 2e-4;
