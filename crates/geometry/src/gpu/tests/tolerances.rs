//! The largest relative errors that twins may have against the CPU in `f32`, each with its reason and the worst one seen on
//! the software driver (Mesa's llvmpipe) and, where it is larger, in hardware. The test says what an error is relative to.

/// Copies, and sums of the same terms in the same order. Seen: 0.
pub(super) const EXACT: f64 = 0.0;
/// Unit vectors: a few roundings, and angles of polynomials within 2e-8. Seen: 1.0e-6; 1.5e-5 on an NVIDIA H100,
/// whose reciprocals and roots are not those of the CPU.
pub(super) const FORWARD: f64 = 3e-5;
/// Gradients: as above, divided by lengths twice. Seen: 8.3e-7.
pub(super) const GRADIENT: f64 = 4e-6;
/// Gradients at random and degenerate triangles, where slivers divide by what cancels. Seen: 4.0e-5; 1.8e-3 on an H100.
pub(super) const SLIVER: f64 = 4e-3;
