//! Zstandard frames of blocks.

use structured_zstd::encoding::{
    CompressionLevel, CompressionParameters, StreamingEncoder, compress_slice_to_vec,
};

/// Window of frames, 16 MiB. Greater than most data on purpose: the encoder
/// gives up on what looks like noise at a first glance only in smaller windows,
/// and blocks do look like noise though they shrink by a tenth.
const WINDOW_LOG: u32 = 24;
/// Data below this size takes no window of its own.
const SMALL: usize = 4096;

/// Compresses `data` into one frame at `level` (1..=22).
pub(crate) fn compress(data: &[u8], level: i32) -> Vec<u8> {
    let level = CompressionLevel::from_level(level);
    if data.len() < SMALL {
        return compress_slice_to_vec(data, level);
    }
    stream(data, level).unwrap_or_else(|| compress_slice_to_vec(data, level))
}

fn stream(data: &[u8], level: CompressionLevel) -> Option<Vec<u8>> {
    use std::io::Write;
    let parameters = CompressionParameters::builder(level).window_log(WINDOW_LOG).build().ok()?;
    let mut encoder = StreamingEncoder::new(Vec::new(), level);
    encoder.set_parameters(&parameters).ok()?;
    encoder.write_all(data).ok()?;
    encoder.finish().ok()
}
