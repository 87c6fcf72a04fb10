//! Image buffers, colour transfer, files, pyramids and metrics.

mod buffer;

pub use buffer::Image;
