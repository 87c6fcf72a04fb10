//! Round trips, bad bytes and bombs of PNG and JPEG.

use super::*;
use crate::{decode, read};

fn limits() -> Limits {
    Limits::default()
}

/// A small photograph-like RGB image.
fn pattern(width: usize, height: usize, channels: usize) -> Vec<u8> {
    (0..width * height * channels).map(|i| ((i * 37) ^ (i / 7)) as u8).collect()
}

fn jpeg(width: usize, height: usize) -> Vec<u8> {
    encode_jpeg(width, height, &vec![128; 3 * width * height], 90).unwrap()
}

#[test]
fn jpeg_keeps_channels_apart_and_gains_with_quality() {
    let (width, height) = (64, 48);
    // Smooth in two channels, stripes of one pixel in the third: subsampled chroma would mix them.
    let data: Vec<u8> = (0..width * height)
        .flat_map(|i| [(i % width * 3) as u8, (i / width * 4) as u8, if i % 2 == 0 { 96 } else { 160 }])
        .collect();
    let error = |quality| {
        let bytes = encode_jpeg(width, height, &data, quality).unwrap();
        let (w, h, texels) = decode_texture(&bytes, &limits()).unwrap();
        assert_eq!((w, h), (width, height));
        let differences = texels.iter().zip(data.chunks_exact(3));
        let worst = differences.flat_map(|(t, d)| (0..3).map(|k| t[k].abs_diff(d[k]))).max().unwrap();
        (worst, bytes.len())
    };
    let (low, middle, high) = (error(20), error(90), error(100));
    assert!(low.0 > middle.0 && middle.0 > high.0 && high.0 <= 4, "{low:?} {middle:?} {high:?}");
    assert!(low.1 < middle.1 && middle.1 < high.1, "{low:?} {middle:?} {high:?}");
    assert!(encode_jpeg(0, 4, &[], 90).is_err() && encode_jpeg(65_536, 1, &vec![0; 3 << 16], 90).is_err());
}

#[test]
fn png_round_trips_all_channel_counts() {
    for channels in 1..=4 {
        for compression in [PngCompression::Fast, PngCompression::Small] {
            let data = pattern(7, 5, channels);
            let png = encode_png(7, 5, channels, &data, compression).unwrap();
            assert_eq!(texture_size(&png).unwrap(), (7, 5));
            let (w, h, texels) = decode_texture(&png, &limits()).unwrap();
            assert_eq!((w, h), (7, 5));
            for (texel, d) in texels.iter().zip(data.chunks_exact(channels)) {
                let expected = match channels {
                    1 => [d[0], d[0], d[0], 255],
                    2 => [d[0], d[0], d[0], d[1]],
                    3 => [d[0], d[1], d[2], 255],
                    _ => [d[0], d[1], d[2], d[3]],
                };
                assert_eq!(*texel, expected, "{channels} channels");
            }
        }
    }
}

#[test]
fn linear_images_survive_the_srgb_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let image = Image::from_fn(16, 9, 4, |x, y, c| match c {
        3 => (x + y) as f32 / 255.0,
        c => color::srgb_u8_to_linear((x * 16 + y + 40 * c) as u8),
    });
    write_png(&path, &image).unwrap();
    assert_eq!(read(&path).unwrap(), image);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file stays");
    let error = write_png(folder.path().join("empty.png"), &Image::new(0, 3, 3)).unwrap_err().to_string();
    assert!(error.contains("empty.png"), "{error}");
}

#[test]
fn sixteen_bits_are_kept_in_linear_light() {
    let samples: Vec<u8> = (0..12_u16).flat_map(|i| (i * 5000 + 77).to_ne_bytes()).collect();
    let mut png = Vec::new();
    PngEncoder::new(&mut png).write_image(&samples, 4, 1, ExtendedColorType::Rgb16).unwrap();
    let image = decode(&png, "deep", &limits()).unwrap();
    for (i, v) in image.data.iter().enumerate() {
        let expected = color::srgb_decode((i as f32 * 5000.0 + 77.0) / 65535.0);
        assert!((v - expected).abs() < 1e-6, "sample {i}");
    }
}

/// Every number of 16 bits, in grey, with alpha and in colour: all bits, rounded to 8 as where 8 alone are read.
#[test]
fn textures_of_sixteen_bits_are_read_in_both_depths() {
    for channels in 1..=4 {
        let samples: Vec<u16> = (0..=u16::MAX).flat_map(|v| vec![v; channels]).collect();
        let png = encode_png16(256, 256, channels, &samples, PngCompression::Fast).unwrap();
        let read = decode_texture_texels(&png, &limits(), true).unwrap();
        let alpha = |v: u16| if channels % 2 == 0 { v } else { u16::MAX };
        assert!(read.texels16.iter().zip(0..=u16::MAX).all(|(t, v)| *t == [v, v, v, alpha(v)]), "{channels}");
        let rounded = |v: u16| (f64::from(v) / 257.0).round() as u8;
        assert!(
            read.texels.iter().zip(&read.texels16).all(|(t, deep)| *t == deep.map(rounded)),
            "{channels}"
        );
        assert_eq!(decode_texture(&png, &limits()).unwrap(), (256, 256, read.texels));
    }
}

#[test]
fn jpeg_decodes_and_must_be_complete() {
    let bytes = jpeg(40, 24);
    let (w, h, texels) = decode_texture(&bytes, &limits()).unwrap();
    assert_eq!((w, h), (40, 24));
    assert!(texels.iter().all(|t| t.iter().zip([128, 128, 128, 255]).all(|(a, b)| a.abs_diff(b) <= 2)));
    for keep in [0, 1, 3, 10, bytes.len() / 2, bytes.len() - 2] {
        let error = decode_texture(&bytes[..keep], &limits()).unwrap_err().to_string();
        assert!(error.starts_with("texture: "), "{error}");
    }
}

#[test]
fn truncated_and_wrong_pngs_are_errors() {
    let png = encode_png(31, 17, 3, &pattern(31, 17, 3), PngCompression::Fast).unwrap();
    for keep in 0..png.len() - 16 {
        assert!(decode_texture(&png[..keep], &limits()).is_err(), "{keep} bytes of {}", png.len());
    }
    assert!(decode_texture(b"GIF89a..............", &limits()).is_err());
}

#[test]
fn flipped_bytes_never_panic() {
    let files = [encode_png(9, 6, 4, &pattern(9, 6, 4), PngCompression::Fast).unwrap(), jpeg(17, 9)];
    for file in files {
        for i in 0..file.len() {
            for flip in [0x01, 0x80, 0xff] {
                let mut bad = file.clone();
                bad[i] ^= flip;
                // Some flips decode; none may panic or take much memory.
                let _ = decode_texture(&bad, &limits());
            }
        }
    }
}

/// A PNG of one chunk `IHDR` with the given claim, then one `IDAT` that holds nothing.
fn png_bomb(width: u32, height: u32) -> Vec<u8> {
    let tiny = encode_png(1, 1, 3, &[0, 0, 0], PngCompression::Fast).unwrap();
    let mut bytes = tiny;
    bytes[16..20].copy_from_slice(&width.to_be_bytes());
    bytes[20..24].copy_from_slice(&height.to_be_bytes());
    let crc = crc32(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&crc.to_be_bytes());
    bytes
}

fn crc32(bytes: &[u8]) -> u32 {
    let step = |c: u32| if c & 1 == 1 { (c >> 1) ^ 0xedb8_8320 } else { c >> 1 };
    !bytes.iter().fold(!0_u32, |c, b| (0..8).fold(c ^ u32::from(*b), |c, _| step(c)))
}

#[test]
fn bombs_are_refused_before_memory_is_taken() {
    assert!(decode_texture(&png_bomb(1, 1), &limits()).is_ok(), "the bomb maker makes valid headers");
    for (w, h) in [(30_000, 30_000), (100_000, 100_000), (8192, 8192), (1, 0x7fff_ffff)] {
        let error = decode_texture(&png_bomb(w, h), &limits()).unwrap_err();
        let message = error.to_string();
        assert!(
            message.contains("too large") || message.contains("limit") || message.contains("exceed"),
            "{message}"
        );
    }
    let small = Limits { max_samples: 100, ..limits() };
    let png = encode_png(7, 5, 3, &pattern(7, 5, 3), PngCompression::Fast).unwrap();
    assert!(matches!(decode_texture(&png, &small), Err(ImageError::TooLarge { .. })));
    let narrow = Limits { max_side: 6, ..limits() };
    assert!(decode_texture(&png, &narrow).is_err());
}

#[test]
fn a_flat_webp_is_small_and_read_again() {
    let side = 2048;
    let webp = crate::encode_webp(side, side, 3, &vec![127; side * side * 3]).unwrap();
    assert!(webp.len() < 4096, "{} bytes", webp.len());
    let (width, height, texels) = decode_texture(&webp, &Limits::default()).unwrap();
    assert_eq!((width, height), (side, side));
    assert!(texels.iter().all(|t| *t == [127, 127, 127, 255]));
}
