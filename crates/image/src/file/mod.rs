//! Image files: reading into linear light, limits, and writing under a temporary name.

mod atomic;
mod exr_file;
mod ktx2;
mod limits;
mod png_jpeg;
mod radiance;
mod webp;

pub use atomic::{link_target, set_aside, write_atomically};
pub use exr_file::{
    ExrLayer, read_exr_layers, read_exr_planes, write_exr, write_exr_channels, write_exr_planes,
};
pub use limits::Limits;
pub use png_jpeg::{
    PngCompression, TextureTexels, decode_texture, decode_texture_texels, encode_jpeg, encode_png,
    encode_png16, encode_srgb_png, round_to_8_bits, texture_is_deep, texture_size, write_png,
};
pub use webp::{encode_webp, encode_webp_lossy};

use crate::{Image, ImageError};
use std::io::Read;
use std::path::Path;

/// Reads a PNG, JPEG, WebP, KTX 2.0, Radiance or OpenEXR file into linear light with the default [`Limits`].
///
/// The format is recognised by its content. PNG, JPEG, WebP and KTX 2.0 (the first level of UASTC or ETC1S) are decoded
/// through sRGB (alpha is linear) to 3 channels, or 4 where the file has alpha; Radiance to 3 channels. Of an OpenEXR file the first layer is returned, channels R, G,
/// B, A first and others after them as stored.
///
/// # Errors
/// If the file cannot be read, is no valid image of these formats, or is larger than the limits.
pub fn read(path: impl AsRef<Path>) -> Result<Image, ImageError> {
    read_with_limits(path, &Limits::default())
}

/// As [`read`], with stated limits.
///
/// # Errors
/// If the file cannot be read, is no valid image of these formats, or is larger than the limits.
pub fn read_with_limits(path: impl AsRef<Path>, limits: &Limits) -> Result<Image, ImageError> {
    let path = path.as_ref();
    let place = path.display().to_string();
    let bytes = file_bytes(path, limits.max_file_bytes)?;
    decode(&bytes, &place, limits)
}

/// Decodes the bytes of a PNG, JPEG, WebP, KTX 2.0, Radiance or OpenEXR file as [`read`] does; `place` names them in errors.
///
/// # Errors
/// If the bytes are no valid image of these formats, or the image is larger than the limits.
pub fn decode(bytes: &[u8], place: &str, limits: &Limits) -> Result<Image, ImageError> {
    match Format::of(bytes) {
        Some(Format::Png | Format::Jpeg | Format::WebP) => png_jpeg::decode_linear(bytes, place, limits),
        Some(Format::Ktx2) => ktx2::decode_linear(bytes, place, limits),
        Some(Format::Radiance) => radiance::decode(bytes, place, limits),
        Some(Format::Exr) => exr_file::decode_first(bytes, place, limits),
        None if bytes.is_empty() => Err(ImageError::invalid(place, "the file is empty")),
        None => Err(ImageError::invalid(place, "not a PNG, JPEG, WebP, KTX 2.0, Radiance or OpenEXR file")),
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Png,
    Jpeg,
    WebP,
    Ktx2,
    Radiance,
    Exr,
}

impl Format {
    fn of(bytes: &[u8]) -> Option<Self> {
        let magic: [(&[u8], Self); 5] = [
            (b"\x89PNG\r\n\x1a\n", Self::Png),
            (b"\xff\xd8\xff", Self::Jpeg),
            (b"#?RADIANCE", Self::Radiance),
            (b"#?RGBE", Self::Radiance),
            (b"\x76\x2f\x31\x01", Self::Exr),
        ];
        // The size of the file stands between the two words.
        if bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") {
            return Some(Self::WebP);
        }
        if photofit_ktx2::is_ktx2(bytes) {
            return Some(Self::Ktx2);
        }
        magic.iter().find(|(m, _)| bytes.starts_with(m)).map(|(_, f)| *f)
    }
}

/// All bytes of a regular file, of which there may be `most`. Devices and pipes are refused, so that it ends, and takes no
/// more memory than that.
///
/// # Errors
/// If the file cannot be read, is no regular file, or has more bytes.
pub fn file_bytes(path: impl AsRef<Path>, most: u64) -> Result<Vec<u8>, ImageError> {
    let path = path.as_ref();
    let place = path.display().to_string();
    let meta = std::fs::metadata(path).map_err(|e| ImageError::io(path, e))?;
    if !meta.is_file() {
        return Err(ImageError::invalid(&place, "is not a regular file; it must be one"));
    }
    let too_long =
        |bytes: u64| ImageError::invalid(&place, format!("has {bytes} bytes; it must have at most {most}"));
    if meta.len() > most {
        return Err(too_long(meta.len()));
    }
    let mut bytes = Vec::with_capacity(meta.len() as usize);
    let file = std::fs::File::open(path).map_err(|e| ImageError::io(path, e))?;
    // The file may grow between the two calls.
    file.take(most.saturating_add(1)).read_to_end(&mut bytes).map_err(|e| ImageError::io(path, e))?;
    if bytes.len() as u64 > most {
        return Err(too_long(bytes.len() as u64));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A Radiance file of `width x height` flat pixels with the given bytes.
    fn radiance(width: usize, height: usize, magic: &str, pixels: &[[u8; 4]]) -> Vec<u8> {
        let mut bytes = format!("{magic}\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n").into_bytes();
        bytes.extend(pixels.iter().flatten());
        bytes
    }

    #[test]
    fn radiance_is_decoded_to_linear_light() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sky.hdr");
        for magic in ["#?RADIANCE", "#?RGBE"] {
            std::fs::write(&path, radiance(2, 1, magic, &[[128, 64, 32, 129], [255, 0, 0, 138]])).unwrap();
            let image = read(&path).unwrap();
            assert_eq!((image.width, image.height, image.channels), (2, 1, 3));
            assert_eq!(image.data, [1.0, 0.5, 0.25, 1020.0, 0.0, 0.0], "mantissa / 256 * 2^(exponent - 128)");
        }
    }

    #[test]
    fn radiance_bombs_and_truncations_are_refused() {
        let good = radiance(3, 2, "#?RADIANCE", &[[1, 2, 3, 128]; 6]);
        assert!(decode(&good, "good", &Limits::default()).is_ok());
        for keep in 0..good.len() {
            assert!(
                decode(&good[..keep], "cut", &Limits::default()).is_err(),
                "{keep} of {} bytes",
                good.len()
            );
        }
        for (w, h) in [(100_000, 100_000), (30_000, 30_000), (0, 5), (20_000, 1000)] {
            let message =
                decode(&radiance(w, h, "#?RADIANCE", &[]), "bomb.hdr", &Limits::default()).unwrap_err();
            assert!(message.to_string().starts_with("bomb.hdr: "), "{message}");
        }
        for i in 0..good.len() {
            let mut bad = good.clone();
            bad[i] ^= 0x15;
            let _ = decode(&bad, "flipped", &Limits::default());
        }
    }

    #[test]
    fn errors_name_the_file_and_the_rule() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        };
        let small = Limits { max_file_bytes: 3, ..Limits::default() };
        let default = Limits::default();
        let cases = [
            (write("empty.png", b""), &default, "empty"),
            (write("text.png", b"hello, this is no image"), &default, "not a PNG"),
            (write("long.png", b"\x89PNG\r\n\x1a\n"), &small, "at most 3"),
            (folder.path().to_path_buf(), &default, "not a regular file"),
            (folder.path().join("missing.exr"), &default, "missing.exr"),
        ];
        for (path, limits, rule) in cases {
            let message = read_with_limits(&path, limits).unwrap_err().to_string();
            let name = path.file_name().unwrap().to_str().unwrap();
            assert!(message.contains(name) && message.contains(rule), "{message}");
        }
        // A device of the system: no file, however long it could be read.
        #[cfg(unix)]
        {
            let message = file_bytes("/dev/zero", 1 << 10).unwrap_err().to_string();
            assert!(message.contains("/dev/zero") && message.contains("not a regular file"), "{message}");
        }
        let three = write("three", b"abc");
        assert_eq!(file_bytes(&three, 3).unwrap(), b"abc");
        assert!(file_bytes(&three, 2).unwrap_err().to_string().contains("has 3 bytes"));
        let message = read_exr_layers(write("a.exr", b"\x89PNG\r\n\x1a\n")).unwrap_err().to_string();
        assert!(message.contains("a.exr") && message.contains("not an OpenEXR file"), "{message}");
    }
}
