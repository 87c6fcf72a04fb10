//! Image buffers, colour transfer, files and metrics.
//!
//! Without the feature `files` (on by default) the crate reads and writes no files and needs neither `exr` nor `image`.
//!
//! An [`Image`] holds interleaved `f32` samples in linear light, row 0 at the top. Files are read into linear light
//! and written back through the sRGB transfer where their format asks for it. Metrics compare display images
//! (sRGB-encoded, in `[0, 1]`) and return a map beside the mean.
//!
//! ```
//! use photofit_image::{Image, to_display, psnr, flip, DEFAULT_PIXELS_PER_DEGREE};
//! let reference = to_display(&Image::from_fn(32, 32, 3, |x, y, c| (x + y + c) as f32 / 66.0));
//! let test = reference.map(|v| (v + 0.02).min(1.0));
//! assert!((psnr(&reference, &test) - 34.0).abs() < 0.3);
//! assert!(flip(&reference, &test, DEFAULT_PIXELS_PER_DEGREE).mean < 0.15);
//! ```

mod buffer;
mod color;
mod convolve;
#[cfg(feature = "files")]
mod error;
#[cfg(feature = "files")]
mod file;
mod heatmap;
mod metrics;
mod resample;
mod sheet;
mod tone;

pub use buffer::Image;
pub use color::{linear_to_srgb_u8, luminance, srgb_decode, srgb_encode, srgb_u8_to_linear, to_display};
#[cfg(feature = "files")]
pub use error::ImageError;
#[cfg(feature = "files")]
pub use file::{
    ExrLayer, Limits, PngCompression, TextureTexels, decode, decode_texture, decode_texture_texels,
    encode_jpeg, encode_png, encode_png16, encode_srgb_png, encode_webp, encode_webp_lossy, file_bytes,
    link_target, read, read_exr_layers, read_exr_planes, read_with_limits, round_to_8_bits, set_aside,
    texture_is_deep, texture_size, write_atomically, write_exr, write_exr_channels, write_exr_planes,
    write_png,
};
pub use heatmap::{heatmap, heatmap_color};
pub use metrics::{
    DEFAULT_PIXELS_PER_DEGREE, ErrorMap, dilate, flip, mse, psnr, psnr_from_mse, rmse, squared_error,
    squared_error_of_halves, ssim,
};
pub use resample::{downsample, downsample_vjp, resize_bilinear};
pub use sheet::contact_sheet;
pub use tone::tone_map;
