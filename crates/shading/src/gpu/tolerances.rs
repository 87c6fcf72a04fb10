//! Worst errors that the twins may have against the CPU in `f32` (see [`photofit_gradcheck::worst_difference`]), each
//! with its reason.

/// Radiance and gradients for roughness from 0.3: some hundred operations, which devices may fuse, with reciprocals and
/// roots of a few units in the last place. Seen on an NVIDIA H100: 3.0e-5.
pub(crate) const ROUGH: f64 = 6e-5;
/// For roughness down to the smallest: the lobe's axis moves by as much as a rounding of `|n x h|^2` against alpha^2.
/// Seen on an H100: 9.2e-4.
pub(crate) const SMOOTH: f64 = 2e-3;
/// Shading normals.
pub(crate) const NORMALS: f64 = 2e-5;
/// Gradients of shading normals and of the direction to the eye, at tiny and huge vectors too: lengths whose products leave the
/// range of normal numbers, which devices take for 0, and normals that are about to turn to the viewer. Seen: 0; 6.9e-3 on an
/// H100, where which of them is the worst is not known.
pub(crate) const NORMALS_VJP: f64 = 2e-2;
