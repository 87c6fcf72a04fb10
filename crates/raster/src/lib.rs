//! Differentiable rasterizer on the CPU.

mod maps;

pub use maps::{CHANNELS, Maps, channel};
