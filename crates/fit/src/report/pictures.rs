//! Pictures as data URIs.

use crate::FitError;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use photofit_image::{Image, PngCompression, downsample, encode_png, srgb_encode};

/// A display picture (sRGB values in [0, 1], 1 or 3 channels) as a PNG of at most `side` pixels a side.
pub(super) fn display(image: &Image, side: usize) -> Result<String, FitError> {
    let small = fit_to(image, side);
    let bytes: Vec<u8> = small.data.iter().map(|x| (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u8).collect();
    let png = encode_png(small.width, small.height, small.channels, &bytes, PngCompression::Small)?;
    Ok(format!("data:image/png;base64,{}", STANDARD.encode(png)))
}

/// A linear picture, likewise.
pub(super) fn linear(image: &Image, side: usize) -> Result<String, FitError> {
    display(&fit_to(image, side).map(srgb_encode), side)
}

/// Shrinks a picture to at most `side` pixels a side.
fn fit_to(image: &Image, side: usize) -> Image {
    let factor = image.width.max(image.height) / side.max(1);
    let reduced = if factor > 1 { downsample(image, factor) } else { image.clone() };
    let largest = reduced.width.max(reduced.height);
    if largest <= side {
        return reduced;
    }
    let scaled = |n: usize| (n * side / largest).max(1);
    photofit_image::resize_bilinear(&reduced, scaled(reduced.width), scaled(reduced.height))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_shrunk_to_the_side() {
        for (w, h, side, expected) in
            [(8, 4, 8, (8, 4)), (1000, 500, 400, (400, 200)), (900, 9, 100, (100, 1))]
        {
            let small = fit_to(&Image::new(w, h, 3).map(|_| 0.25), side);
            assert_eq!((small.width, small.height), expected);
            assert!(small.data.iter().all(|x| (x - 0.25).abs() < 1e-6), "a constant stays");
        }
    }
}
