//! Differentiable rasterizer on the CPU.
//!
//! The primitives of Laine et al. (2020) as pairs of a forward function and a vector-Jacobian product (`*_vjp`,
//! accumulating into gradients): [`project`], [`rasterize`], [`interpolate`], [`texture`], [`antialias`]. The fused
//! [`deferred`] pass runs the per-pixel ones tile by tile.
//!
//! Visibility is found in `f32`; everything differentiable is generic over [`photofit_scalar::Real`]. Gradients are
//! reduced in a fixed order: the same bits for any number of threads.
//!
//! Behind the feature `gpu` every operation has a twin on a device, and the module `gpu` records whole pictures of them.

pub mod antialias;
mod cpu;
pub mod deferred;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod interpolate;
pub mod loss;
mod maps;
pub mod project;
pub mod rasterize;

#[cfg(target_arch = "x86_64")]
pub use cpu::has_avx2;
pub use maps::{CHANNELS, Maps, channel};
pub use photofit_scalar::{Real, Vec2, Vec3, Vec4, vec2, vec3, vec4};
pub use photofit_shading::Light;
pub use photofit_texture as texture;
