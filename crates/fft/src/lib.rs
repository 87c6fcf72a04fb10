//! Fourier and cosine transforms of rows of real numbers.
//!
//! The transforms of `rustfft` are generic code, which every crate that plans one compiles anew; here they are planned for `f32` and
//! `f64`, so that other crates link to them.

mod cosine;
mod real;

pub use cosine::Cosine;
pub use real::{Buffers, RealFft, Sample};
pub use realfft::num_complex::Complex;
