//! Textures: mip pyramids, lookups with glTF's wrap modes and filters, and the adjoints of both.
//!
//! One definition for rasterizer, path tracer and fit. [`Pyramid`] holds levels of any number of channels in `f32` or
//! `f64` and passes gradients back ([`sample_vjp`], [`ScatterQueue`], [`Pyramid::collapse_vjp`]); [`MipTexture`] holds the
//! four channels of a file in the file's precision and is read forward. Both are read through a [`Lookup`], so they agree
//! wherever they hold the same texels.
//!
//! Texel centres lie at `fold(u) * width - 0.5`, row 0 at v = 0. The level is the logarithm of the longer axis of the
//! pixel's footprint ellipse (Laine et al. 2020; Williams 1983): with the uv derivatives scaled by the base size,
//! `a = sx^2+tx^2, b = sy^2+ty^2, c = sx sy + tx ty, L = (a+b)/2 + sqrt((a-b)^2/4 + c^2), level = log2(L)/2 + bias`.
//! Levels are exact area averages ([`MipRule`]): by area, or with colours weighted by alpha where alpha is coverage.

mod filter;
#[cfg(feature = "gpu")]
pub mod gpu;
mod layout;
mod level;
mod lookup;
mod pyramid;
mod sampler;
mod scatter;
mod stored;
mod taps;
#[cfg(test)]
mod tests;
mod texture;

pub use layout::{Level, MipLayout, MipSizes, mip_levels, mip_size};
pub use level::{LevelOfDetail, level_of_detail};
pub use lookup::{Lookup, lookup, sample, sample_vjp};
pub use pyramid::{MipAdjoint, MipRule, Pyramid};
pub use sampler::{AlphaMode, Filter, Sampler, Wrap};
pub use scatter::{Scatter, ScatterQueue};
pub use stored::{MipTexture, Texels};
pub use taps::{Taps, taps};
pub use texture::Texture;
