//! Radiance RGBE files.

use super::Limits;
use super::limits::MAX_RATIO;
use crate::{Image, ImageError};
use image::ImageDecoder;
use image::codecs::hdr::HdrDecoder;
use std::io::Cursor;

pub(super) fn decode(bytes: &[u8], place: &str, limits: &Limits) -> Result<Image, ImageError> {
    let invalid =
        |e: image::ImageError| ImageError::invalid(place, format!("not a valid Radiance file: {e}"));
    // Not strict: "#?RGBE" is a common first line.
    let decoder = HdrDecoder::new_nonstrict(Cursor::new(bytes)).map_err(invalid)?;
    let (width, height) = decoder.dimensions();
    limits.check(place, (width.into(), height.into()), 3, 4, bytes.len(), MAX_RATIO)?;
    let pixels = image::DynamicImage::from_decoder(decoder).map_err(invalid)?.into_rgb32f();
    Ok(Image::from_data(width as usize, height as usize, 3, pixels.into_raw()))
}
