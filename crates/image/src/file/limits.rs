//! Limits on what an image file may claim.

use crate::ImageError;

/// The best ratio most codecs reach is about 1032 (deflate) to 1400 (subsampled flat JPEG).
pub(crate) const MAX_RATIO: u64 = 2048;
/// WebP stores 4096 equal pixels in two bytes.
pub(crate) const MAX_RATIO_WEBP: u64 = 1 << 14;
/// A block of UASTC holds 16 texels of four bytes in 16.
pub(crate) const MAX_RATIO_UASTC: u64 = 4;
/// Zstandard stores 2^17 equal bytes in four, each of which stands for four of texels; in ETC1S long runs of equal blocks take
/// a few bits.
pub(crate) const MAX_RATIO_UASTC_ZSTANDARD: u64 = 1 << 17;
/// Small files may claim this many bytes regardless of their size.
const FLOOR: u64 = 1 << 20;

/// What an untrusted image file may claim; checked against its header before memory is taken.
///
/// Besides these limits, no file may claim more than 2048 times its own size (and 1 MiB): no codec compresses better, so that
/// such a claim is never honest. Other ratios hold for WebP, 16384, and for KTX 2.0: 4 without supercompression, else 131072.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Largest width and height, in pixels.
    pub max_side: u32,
    /// Largest number of samples (`width * height * channels`, summed over the layers of a file). Decoding takes
    /// about 8 bytes per sample of colour at its peak, of grey, which becomes RGB or RGBA, up to 18.
    pub max_samples: u64,
    /// Largest file, in bytes.
    pub max_file_bytes: u64,
}

impl Default for Limits {
    /// 32768 pixels a side, 2^29 samples (an RGB image of 16384 x 8192, with some space), 4 GiB files.
    fn default() -> Self {
        Self { max_side: 1 << 15, max_samples: 1 << 29, max_file_bytes: 1 << 32 }
    }
}

impl Limits {
    /// Checks a claimed shape with `bytes_per_pixel` in its decoded form against these limits and the file's length.
    pub(crate) fn check(
        &self,
        place: &str,
        (width, height): (u64, u64),
        channels: u64,
        bytes_per_pixel: u64,
        file_len: usize,
        max_ratio: u64,
    ) -> Result<(), ImageError> {
        let too_large = |rule: String| {
            Err(ImageError::TooLarge { place: place.to_owned(), width, height, channels, rule })
        };
        if width == 0 || height == 0 || channels == 0 {
            return Err(ImageError::invalid(place, "an image without pixels"));
        }
        if width.max(height) > u64::from(self.max_side) {
            return too_large(format!("at most {} pixels a side", self.max_side));
        }
        // Sides are at most 2^32, hence their product fits.
        let pixels = width * height;
        if pixels.checked_mul(channels).is_none_or(|n| n > self.max_samples) {
            return too_large(format!("at most {} samples", self.max_samples));
        }
        let allowed = (file_len as u64).saturating_mul(max_ratio).max(FLOOR);
        if pixels.checked_mul(bytes_per_pixel).is_none_or(|n| n > allowed) {
            return too_large(format!("no codec packs that into the {file_len} bytes of the file"));
        }
        Ok(())
    }
}
