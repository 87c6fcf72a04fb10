//! PNG, JPEG and WebP: decoding to linear light or to undecoded texels, and encoding.

use super::limits::{MAX_RATIO, MAX_RATIO_WEBP};
use super::{Format, Limits, ktx2, write_atomically};
use crate::{Image, ImageError, color};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{
    ColorType, DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, ImageFormat, ImageReader,
};
use rayon::prelude::*;
use std::io::Cursor;
use std::path::Path;

/// Effort of PNG compression.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PngCompression {
    /// Fast, some tens of percent larger: previews and reports.
    #[default]
    Fast,
    /// Slow and small: shipped textures.
    Small,
}

/// Decodes a PNG, JPEG, WebP or KTX 2.0 texture (of the latter the first level) of an asset in memory to `(width, height, texels)`: RGBA, 8 bits, row-major from the
/// top, transfer not decoded; alpha is 255 where the file has none, grey is replicated, 16 bits are rounded to 8.
///
/// Errors speak of "texture"; see [`ImageError::at`].
///
/// # Errors
/// If the bytes are no complete file of these formats, or the image is larger than the limits.
pub fn decode_texture(bytes: &[u8], limits: &Limits) -> Result<(usize, usize, Vec<[u8; 4]>), ImageError> {
    let TextureTexels { width, height, texels, .. } = decode_texture_texels(bytes, limits, false)?;
    Ok((width, height, texels))
}

/// The texels of a texture in 8 bits a channel, and in 16 where its file has more than 8.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TextureTexels {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// RGBA, row-major from the top.
    pub texels: Vec<[u8; 4]>,
    /// The same in 16 bits; empty where `texels` say all that the file does.
    pub texels16: Vec<[u16; 4]>,
}

/// [`decode_texture`], with all bits of a 16-bit PNG where they are `wanted`.
///
/// ```
/// use photofit_image::{Limits, PngCompression, decode_texture_texels, encode_png16};
/// let png = encode_png16(2, 1, 3, &[1, 2, 3, 257, 514, 65535], PngCompression::Fast)?;
/// let read = decode_texture_texels(&png, &Limits::default(), true)?;
/// assert_eq!(read.texels16, [[1, 2, 3, 65535], [257, 514, 65535, 65535]]);
/// assert_eq!(read.texels, [[0, 0, 0, 255], [1, 2, 255, 255]]);
/// # Ok::<(), photofit_image::ImageError>(())
/// ```
///
/// # Errors
/// As [`decode_texture`].
pub fn decode_texture_texels(
    bytes: &[u8],
    limits: &Limits,
    wanted: bool,
) -> Result<TextureTexels, ImageError> {
    if Format::of(bytes) == Some(Format::Ktx2) {
        let (width, height, texels) = ktx2::decode(bytes, "texture", limits)?;
        return Ok(TextureTexels { width, height, texels, texels16: Vec::new() });
    }
    let image = decode_dynamic(bytes, "texture", limits)?;
    let (width, height) = (image.width() as usize, image.height() as usize);
    if wanted && is_deep(image.color()) {
        let texels16: Vec<[u16; 4]> = by_four(image.into_rgba16().into_raw());
        let texels = texels16.iter().map(|t| t.map(round_to_8_bits)).collect();
        // Multiples of 257 are the numbers of 8 bits.
        let more = texels16.as_flattened().iter().any(|s| s % 257 != 0);
        return Ok(TextureTexels {
            width,
            height,
            texels,
            texels16: if more { texels16 } else { Vec::new() },
        });
    }
    let texels = by_four(image.into_rgba8().into_raw());
    Ok(TextureTexels { width, height, texels, texels16: Vec::new() })
}

/// The same memory as texels.
fn by_four<S: bytemuck::Pod>(samples: Vec<S>) -> Vec<[S; 4]> {
    bytemuck::try_cast_vec(samples).unwrap_or_else(|(_, samples)| samples.as_chunks().0.to_vec())
}

/// A sample of 16 bits rounded to 8.
pub fn round_to_8_bits(sample: u16) -> u8 {
    ((u32::from(sample) + 128) / 257) as u8
}

/// Whether a texture has more than 8 bits a channel, from its header.
///
/// # Errors
/// As [`texture_size`].
pub fn texture_is_deep(bytes: &[u8]) -> Result<bool, ImageError> {
    if Format::of(bytes) == Some(Format::Ktx2) {
        return Ok(false);
    }
    let place = "texture";
    let decoder = reader(bytes, place)?.into_decoder().map_err(|e| invalid(place, e))?;
    Ok(is_deep(decoder.color_type()))
}

fn is_deep(color: ColorType) -> bool {
    color.bytes_per_pixel() > color.channel_count()
}

/// Width and height of a PNG, JPEG, WebP or KTX 2.0 texture from its header, without decoding it.
///
/// # Errors
/// If the header is no valid one of these formats.
pub fn texture_size(bytes: &[u8]) -> Result<(usize, usize), ImageError> {
    let place = "texture";
    if Format::of(bytes) == Some(Format::Ktx2) {
        return ktx2::size(bytes, place);
    }
    let (width, height) = reader(bytes, place)?.into_dimensions().map_err(|e| invalid(place, e))?;
    Ok((width as usize, height as usize))
}

/// Decodes to linear light: 3 channels, or 4 where the file has alpha.
pub(super) fn decode_linear(bytes: &[u8], place: &str, limits: &Limits) -> Result<Image, ImageError> {
    let image = decode_dynamic(bytes, place, limits)?;
    let (width, height) = (image.width() as usize, image.height() as usize);
    let channels = if image.color().has_alpha() { 4 } else { 3 };
    let wide = image.color().bytes_per_pixel() / image.color().channel_count() > 1;
    let data = match (wide, channels) {
        (false, 3) => linear_u8(&image.into_rgb8().into_raw(), 3),
        (false, _) => linear_u8(&image.into_rgba8().into_raw(), 4),
        (true, 3) => linear_u16(&image.into_rgb16().into_raw(), 3),
        (true, _) => linear_u16(&image.into_rgba16().into_raw(), 4),
    };
    Ok(Image::from_data(width, height, channels, data))
}

fn linear_u8(samples: &[u8], channels: usize) -> Vec<f32> {
    let mut out = vec![0.0; samples.len()];
    for (i, (o, s)) in out.iter_mut().zip(samples).enumerate() {
        *o = if i % channels == 3 { f32::from(*s) / 255.0 } else { color::srgb_u8_to_linear(*s) };
    }
    out
}

fn linear_u16(samples: &[u16], channels: usize) -> Vec<f32> {
    let mut out = vec![0.0; samples.len()];
    let rows = 1 << 12;
    out.par_chunks_mut(channels * rows).zip(samples.par_chunks(channels * rows)).for_each(
        |(out, samples)| {
            for (i, (o, s)) in out.iter_mut().zip(samples).enumerate() {
                let v = f32::from(*s) / 65535.0;
                *o = if i % channels == 3 { v } else { color::srgb_decode(v) };
            }
        },
    );
    out
}

fn invalid(place: &str, e: image::ImageError) -> ImageError {
    ImageError::invalid(place, format!("not a valid PNG, JPEG or WebP: {e}"))
}

fn reader<'a>(bytes: &'a [u8], place: &str) -> Result<ImageReader<Cursor<&'a [u8]>>, ImageError> {
    let format = match Format::of(bytes) {
        Some(Format::Png) => ImageFormat::Png,
        Some(Format::Jpeg) => ImageFormat::Jpeg,
        Some(Format::WebP) => ImageFormat::WebP,
        _ if bytes.is_empty() => return Err(ImageError::invalid(place, "no bytes")),
        _ => return Err(ImageError::invalid(place, "neither PNG nor JPEG nor WebP nor KTX 2.0")),
    };
    Ok(ImageReader::with_format(Cursor::new(bytes), format))
}

fn decode_dynamic(bytes: &[u8], place: &str, limits: &Limits) -> Result<DynamicImage, ImageError> {
    let mut reader = reader(bytes, place)?;
    let mut inner = image::Limits::no_limits();
    inner.max_image_width = Some(limits.max_side);
    inner.max_image_height = Some(limits.max_side);
    // Room for the 16-bit samples and the decoder's own state.
    inner.max_alloc = Some(limits.max_samples.saturating_mul(4).saturating_add(1 << 24));
    reader.limits(inner);
    let jpeg = reader.format() == Some(ImageFormat::Jpeg);
    let webp = reader.format() == Some(ImageFormat::WebP);
    let max_ratio = if webp { MAX_RATIO_WEBP } else { MAX_RATIO };
    let decoder = reader.into_decoder().map_err(|e| invalid(place, e))?;
    let (width, height) = decoder.dimensions();
    let color = decoder.color_type();
    let bytes_per_pixel = u64::from(color.bytes_per_pixel());
    limits.check(
        place,
        (width.into(), height.into()),
        color.channel_count().into(),
        bytes_per_pixel,
        bytes.len(),
        max_ratio,
    )?;
    if webp && let Some(rule) = super::webp::frame_fault(bytes, width, height) {
        return Err(ImageError::invalid(place, rule));
    }
    if jpeg && !jpeg_is_complete(bytes) {
        return Err(ImageError::invalid(place, "the JPEG ends before its end-of-image marker"));
    }
    DynamicImage::from_decoder(decoder).map_err(|e| invalid(place, e))
}

/// Whether an end-of-image marker follows the first scan. The decoder fills missing rows with grey without a word.
fn jpeg_is_complete(bytes: &[u8]) -> bool {
    let mut at = 2;
    // Segments before the first scan are skipped by their length: an embedded thumbnail has its own end marker.
    while let Some(&[0xff, marker]) = bytes.get(at..at + 2) {
        if marker == 0xff {
            at += 1;
            continue;
        }
        let Some(&[high, low]) = bytes.get(at + 2..at + 4) else { return false };
        at += 2 + usize::from(u16::from_be_bytes([high, low]));
        if marker == 0xda {
            return bytes.get(at..).is_some_and(|scan| scan.windows(2).any(|pair| pair == [0xff, 0xd9]));
        }
    }
    false
}

/// Encodes 8-bit samples (grey, grey and alpha, RGB or RGBA; row-major from the top) as a PNG.
///
/// ```
/// use photofit_image::{Limits, PngCompression, decode_texture, encode_png};
/// let png = encode_png(2, 1, 3, &[1, 2, 3, 4, 5, 6], PngCompression::Fast)?;
/// assert_eq!(decode_texture(&png, &Limits::default())?, (2, 1, vec![[1, 2, 3, 255], [4, 5, 6, 255]]));
/// # Ok::<(), photofit_image::ImageError>(())
/// ```
///
/// # Errors
/// If the image has no pixels or a side does not fit 31 bits.
///
/// # Panics
/// If `data.len() != width * height * channels`, or `channels` is not 1 to 4.
pub fn encode_png(
    width: usize,
    height: usize,
    channels: usize,
    data: &[u8],
    compression: PngCompression,
) -> Result<Vec<u8>, ImageError> {
    let colors = [ColorType::L8, ColorType::La8, ColorType::Rgb8, ColorType::Rgba8];
    png((width, height, channels), colors, (data.len(), data), compression)
}

/// [`encode_png`] with samples of 16 bits.
///
/// # Errors
/// As [`encode_png`].
///
/// # Panics
/// As [`encode_png`].
pub fn encode_png16(
    width: usize,
    height: usize,
    channels: usize,
    data: &[u16],
    compression: PngCompression,
) -> Result<Vec<u8>, ImageError> {
    let colors = [ColorType::L16, ColorType::La16, ColorType::Rgb16, ColorType::Rgba16];
    let bytes: Vec<u8> = data.iter().flat_map(|s| s.to_ne_bytes()).collect();
    png((width, height, channels), colors, (data.len(), &bytes), compression)
}

/// A PNG of so many samples in the byte order of the machine; `colors` are its types with 1 to 4 channels.
fn png(
    (width, height, channels): (usize, usize, usize),
    colors: [ColorType; 4],
    (samples, bytes): (usize, &[u8]),
    compression: PngCompression,
) -> Result<Vec<u8>, ImageError> {
    assert_eq!(samples, width * height * channels, "one sample per pixel and channel");
    assert!((1..=4).contains(&channels), "1 to 4 channels");
    let mut out = Vec::new();
    let too_large = |_| ImageError::invalid("PNG", "a side that does not fit 31 bits");
    let (w, h) = (u32::try_from(width).map_err(too_large)?, u32::try_from(height).map_err(too_large)?);
    let level = match compression {
        PngCompression::Fast => CompressionType::Fast,
        PngCompression::Small => CompressionType::Best,
    };
    PngEncoder::new_with_quality(&mut out, level, FilterType::Adaptive)
        .write_image(bytes, w, h, colors[channels - 1].into())
        .map_err(|e| ImageError::invalid("PNG", e.to_string()))?;
    Ok(out)
}

/// Encodes 8-bit RGB samples (row-major from the top) as a JPEG of `quality` 1 to 100 (others are clamped), without
/// subsampling of chroma, so that data other than colour keeps its channels apart.
///
/// ```
/// use photofit_image::{Limits, decode_texture, encode_jpeg};
/// let jpeg = encode_jpeg(2, 1, &[200, 100, 50, 200, 100, 50], 95)?;
/// let (width, height, texels) = decode_texture(&jpeg, &Limits::default())?;
/// assert!((width, height) == (2, 1) && texels[0][0].abs_diff(200) < 4);
/// # Ok::<(), photofit_image::ImageError>(())
/// ```
///
/// # Errors
/// If the image has no pixels or a side of more than 65,535.
///
/// # Panics
/// If `data.len() != 3 * width * height`.
pub fn encode_jpeg(width: usize, height: usize, data: &[u8], quality: u8) -> Result<Vec<u8>, ImageError> {
    assert_eq!(data.len(), 3 * width * height, "three samples per pixel");
    let side =
        |n: usize| {
            u16::try_from(n).ok().filter(|n| *n > 0).map(u32::from).ok_or_else(|| {
                ImageError::invalid("JPEG", format!("a side of {n} pixels is not in 1..65535"))
            })
        };
    let (w, h) = (side(width)?, side(height)?);
    let mut out = Vec::new();
    JpegEncoder::new_with_quality(&mut out, quality.clamp(1, 100))
        .write_image(data, w, h, ExtendedColorType::Rgb8)
        .map_err(|e| ImageError::invalid("JPEG", e.to_string()))?;
    Ok(out)
}

/// Encodes a linear image of 1 to 4 channels as an 8-bit sRGB PNG; the alpha of 2 and 4 channels stays linear.
///
/// # Errors
/// If the image has no pixels.
///
/// # Panics
/// If it has not 1 to 4 channels.
pub fn encode_srgb_png(linear: &Image, compression: PngCompression) -> Result<Vec<u8>, ImageError> {
    let channels = linear.channels;
    let alpha = if channels == 2 || channels == 4 { channels - 1 } else { channels };
    let mut bytes = vec![0_u8; linear.data.len()];
    let step = channels.max(1) << 12;
    bytes.par_chunks_mut(step).zip(linear.data.par_chunks(step)).for_each(|(out, samples)| {
        for (i, (o, s)) in out.iter_mut().zip(samples).enumerate() {
            *o = if i % channels == alpha { (s * 255.0 + 0.5) as u8 } else { color::linear_to_srgb_u8(*s) };
        }
    });
    encode_png(linear.width, linear.height, channels, &bytes, compression)
}

/// Writes a linear image of 1 to 4 channels as an 8-bit sRGB PNG (fast compression), under a temporary name first.
///
/// # Errors
/// If the image has no pixels, or the file system refuses.
///
/// # Panics
/// If it has not 1 to 4 channels.
pub fn write_png(path: impl AsRef<Path>, linear: &Image) -> Result<(), ImageError> {
    let path = path.as_ref();
    let bytes =
        encode_srgb_png(linear, PngCompression::Fast).map_err(|e| e.at(path.display().to_string()))?;
    write_atomically(path, &bytes)
}

#[cfg(test)]
mod tests;
