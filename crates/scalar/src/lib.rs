//! Generic scalar, small vectors and the sRGB transfer.
//!
//! Per-element arithmetic of photofit is written once over [`Real`]: `f32` in production, `f64` in gradient checks.
//! The vectors are plain `repr(C)` structs, so that slices of them can be cast to slices of numbers.
//!
//! ```
//! use photofit_scalar::{Vec3, vec3};
//! let n: Vec3<f64> = vec3(3.0, 0.0, 4.0).normalize_or_zero();
//! assert!((n.dot(vec3(0.6, 0.0, 0.8)) - 1.0).abs() < 1e-12);
//! ```

mod real;
mod srgb;
mod vector;
pub mod wide;

pub use real::{Real, halved_sum};
pub use srgb::{linear_to_srgb_u8, srgb_decode, srgb_encode, srgb_table, srgb_u8_to_linear};
pub use vector::{Vec2, Vec3, Vec4, vec2, vec3, vec4};

/// The guarded operations of this crate in WGSL, for kernels: `relu`, `clamp_to`, `normalize_or_zero` and its adjoint.
pub const WGSL: &str = include_str!("vector.wgsl");

/// Single-precision 2-vector.
pub type Vec2f = Vec2<f32>;
/// Single-precision 3-vector.
pub type Vec3f = Vec3<f32>;
/// Single-precision 4-vector.
pub type Vec4f = Vec4<f32>;
