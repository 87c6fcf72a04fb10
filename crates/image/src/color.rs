//! Luminance, display encoding, and the sRGB transfer of photofit-scalar.

pub use photofit_scalar::{linear_to_srgb_u8, srgb_decode, srgb_encode, srgb_u8_to_linear};

use crate::Image;
use photofit_scalar::Real;
use rayon::prelude::*;

/// Relative luminance of linear Rec.709 RGB.
#[inline]
pub fn luminance(rgb: [f32; 3]) -> f32 {
    0.212_639 * rgb[0] + 0.715_168_7 * rgb[1] + 0.072_192_3 * rgb[2]
}

/// The display image that metrics compare: every sample of a linear image sRGB-encoded and clamped to `[0, 1]`
/// (NaN becomes 0). Composite alpha first, see [`Image::over`].
pub fn to_display(linear: &Image) -> Image {
    let mut out = linear.clone();
    out.data.par_chunks_mut(1 << 14).for_each(|chunk| {
        for v in chunk {
            *v = srgb_encode(v.clamp_to(0.0, 1.0));
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn display_is_clamped_and_finite() {
        let image = Image::from_data(4, 1, 1, vec![-1.0, 2.0, f32::NAN, f32::INFINITY]);
        assert_eq!(to_display(&image).data, [0.0, 1.0, 0.0, 1.0]);
    }

    #[test]
    fn luminance_of_white_is_one() {
        assert!((luminance([1.0; 3]) - 1.0).abs() < 1e-6);
        assert!(luminance([0.0, 1.0, 0.0]) > luminance([1.0, 0.0, 1.0]));
    }
}
