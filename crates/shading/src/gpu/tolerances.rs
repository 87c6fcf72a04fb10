//! Worst errors that the twins may have against the CPU in `f32` (see [`photofit_gradcheck::worst_difference`]), each
//! with its reason.

/// Radiance and gradients for roughness from 0.3: some hundred operations, which devices may fuse, with reciprocals and
/// roots of a few units in the last place.
pub(crate) const ROUGH: f64 = 2e-5;
/// For roughness down to the smallest: the lobe's axis moves by as much as a rounding of `|n x h|^2` against alpha^2.
pub(crate) const SMOOTH: f64 = 5e-4;
/// Shading normals.
pub(crate) const NORMALS: f64 = 2e-5;
