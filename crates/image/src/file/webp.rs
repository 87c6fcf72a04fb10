//! Encoding of WebP, without loss and with; sizes of its frames.

use crate::ImageError;
use webp::{ColorType, EncoderParams, WebPEncoder};

/// Largest side that the decoders of all programs take.
const SIDE_MAX: usize = (1 << 14) - 1;

/// Encodes 8-bit RGB or RGBA samples (row-major from the top) as a WebP without loss.
///
/// ```
/// use photofit_image::{Limits, decode_texture, encode_webp};
/// let webp = encode_webp(2, 1, 4, &[1, 2, 3, 0, 5, 6, 7, 8])?;
/// assert_eq!(decode_texture(&webp, &Limits::default())?, (2, 1, vec![[1, 2, 3, 0], [5, 6, 7, 8]]));
/// # Ok::<(), photofit_image::ImageError>(())
/// ```
///
/// # Errors
/// If a side is not 1 to 16383 pixels.
///
/// # Panics
/// If `data.len() != width * height * channels`, or `channels` is not 3 or 4.
pub fn encode_webp(width: usize, height: usize, channels: usize, data: &[u8]) -> Result<Vec<u8>, ImageError> {
    encode(width, height, channels, data, None)
}

/// Encodes 8-bit RGB or RGBA samples (row-major from the top) as a lossy WebP of `quality` 1 to 100 (others are clamped):
/// a key frame of VP8 (RFC 6386), whose chroma has half the width and height; alpha is exact. About a third of the bytes of
/// a JPEG that keeps chroma whole, but data other than colour, such as normals, do not come closer than some 37 dB.
///
/// ```
/// use photofit_image::{Limits, decode_texture, encode_webp_lossy};
/// let texels = [[200, 100, 50, 7], [200, 100, 50, 255]].concat().repeat(128);
/// let webp = encode_webp_lossy(16, 16, 4, &texels, 95)?;
/// let (width, height, again) = decode_texture(&webp, &Limits::default())?;
/// assert!((width, height) == (16, 16) && again[0][0].abs_diff(200) < 6);
/// assert_eq!((again[0][3], again[1][3]), (7, 255));
/// # Ok::<(), photofit_image::ImageError>(())
/// ```
///
/// # Errors
/// If a side is not 1 to 16383 pixels.
///
/// # Panics
/// If `data.len() != width * height * channels`, or `channels` is not 3 or 4.
pub fn encode_webp_lossy(
    width: usize,
    height: usize,
    channels: usize,
    data: &[u8],
    quality: u8,
) -> Result<Vec<u8>, ImageError> {
    let mut data = data.to_vec();
    round_chroma(&mut data, width, channels);
    encode(width, height, channels, &data, Some(quality.clamp(1, 100)))
}

/// The encoder rounds the mean chroma of four pixels down, which takes half a step from U and V: colours would come back
/// with .8 less red, .6 more green and 1 less blue. That is made up for before, in whole steps over four pixels.
fn round_chroma(data: &mut [u8], width: usize, channels: usize) {
    const LESS_RED: [u8; 4] = [1, 1, 1, 0];
    const MORE_GREEN: [u8; 4] = [1, 0, 0, 1];
    for (i, texel) in data.chunks_exact_mut(channels).enumerate() {
        let k = 2 * (i / width.max(1) % 2) + i % width.max(1) % 2;
        texel[0] = texel[0].saturating_add(LESS_RED[k]);
        texel[1] = texel[1].saturating_sub(MORE_GREEN[k]);
        texel[2] = texel[2].saturating_add(1);
    }
}

fn encode(
    width: usize,
    height: usize,
    channels: usize,
    data: &[u8],
    lossy: Option<u8>,
) -> Result<Vec<u8>, ImageError> {
    assert_eq!(data.len(), width * height * channels, "one sample per pixel and channel");
    assert!(channels == 3 || channels == 4, "3 or 4 channels");
    if !(1..=SIDE_MAX).contains(&width) || !(1..=SIDE_MAX).contains(&height) {
        let rule = format!("{width} x {height} pixels; sides must be in 1..{SIDE_MAX}");
        return Err(ImageError::invalid("WebP", rule));
    }
    let color = if channels == 4 { ColorType::Rgba8 } else { ColorType::Rgb8 };
    let mut out = Vec::new();
    let mut encoder = WebPEncoder::new(&mut out);
    let mut params = EncoderParams::default();
    params.use_lossy = lossy.is_some();
    params.lossy_quality = lossy.unwrap_or(params.lossy_quality);
    encoder.set_params(params);
    encoder
        .encode(data, width as u32, height as u32, color)
        .map_err(|e| ImageError::invalid("WebP", e.to_string()))?;
    Ok(out)
}

/// What is wrong with the frames of a WebP whose picture has `width` x `height` pixels. Each frame has a size of its own, for
/// which the decoder takes memory before it compares: some bytes could take 400 MB.
pub(super) fn frame_fault(bytes: &[u8], width: u32, height: u32) -> Option<String> {
    let mut at = 12;
    while let Some(head) = bytes.get(at..at + 8) {
        let length = u32::from_le_bytes([head[4], head[5], head[6], head[7]]) as usize;
        let data = &bytes[at + 8..];
        let frame = match &head[..4] {
            b"VP8 " => data.get(6..10).map(|b| {
                [u16::from_le_bytes([b[0], b[1]]), u16::from_le_bytes([b[2], b[3]])]
                    .map(|n| u32::from(n & 0x3fff))
            }),
            b"VP8L" => data.get(1..5).map(|b| {
                let sides = u32::from_le_bytes([b[0], b[1], b[2], b[3]]);
                [(sides & 0x3fff) + 1, (sides >> 14 & 0x3fff) + 1]
            }),
            _ => None,
        };
        if let Some([w, h]) = frame.filter(|[w, h]| *w > width || *h > height) {
            return Some(format!(
                "a frame of the WebP has {w} x {h} pixels; it must fit into the picture's {width} x {height}"
            ));
        }
        // The chunks of an animation's frame follow its header of 16 bytes.
        at += 8 + if &head[..4] == b"ANMF" { 16 } else { length.saturating_add(length & 1) };
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Limits, decode_texture};

    /// Waves and noise, alpha in steps.
    fn picture(width: usize, height: usize) -> Vec<u8> {
        let texel = |i: usize| {
            let (x, y) = ((i % width) as f32, (i / width) as f32);
            let wave = |f: f32| (127.0 + 100.0 * (f * x).sin() * (0.7 * f * y).cos()) as u8;
            [wave(0.11), wave(0.07), wave(0.23) / 2 + (i * 7919 % 13) as u8, [0, 128, 255][i / 5 % 3]]
        };
        (0..width * height).flat_map(texel).collect()
    }

    #[test]
    fn lossy_pictures_of_all_sizes_and_qualities_are_read_again() {
        for (width, height) in [(1, 1), (3, 2), (16, 16), (17, 33), (64, 5), (100, 75)] {
            for quality in (1..=100).step_by(9).chain([0, 255]) {
                let data = picture(width, height);
                let webp = encode_webp_lossy(width, height, 4, &data, quality).unwrap();
                let (w, h, texels) = decode_texture(&webp, &Limits::default()).unwrap();
                assert_eq!((w, h), (width, height));
                assert!(texels.iter().zip(data.chunks_exact(4)).all(|(a, b)| a[3] == b[3]), "alpha is exact");
                assert_eq!(webp, encode_webp_lossy(width, height, 4, &data, quality).unwrap());
            }
        }
    }

    #[test]
    fn frames_larger_than_the_picture_are_refused_before_they_take_memory() {
        let data = picture(16, 12);
        let lossy = encode_webp_lossy(16, 12, 4, &data, 70).unwrap();
        let lossless = encode_webp(16, 12, 4, &data).unwrap();
        let chunk = |bytes: &[u8], name: &[u8]| bytes.windows(4).position(|w| w == name).unwrap();
        assert_eq!((frame_fault(&lossy, 16, 12), frame_fault(&lossless, 16, 12)), (None, None));
        let mut large = lossy.clone();
        let at = chunk(&lossy, b"VP8 ") + 8;
        large[at + 6..at + 10].copy_from_slice(&[0x10, 0x3f, 0xff, 0x3f]);
        let text = decode_texture(&large, &Limits::default()).unwrap_err().to_string();
        assert!(text.contains("16144 x 16383 pixels; it must fit into the picture's 16 x 12"), "{text}");
        assert!(frame_fault(&lossless, 16, 11).is_some_and(|t| t.contains("16 x 12 pixels")));
        // Inside of an animation's frame, and cut off.
        let head = [b"RIFF....WEBPANMF", &[255; 4][..], &[0; 16], &large[at - 8..]].concat();
        assert!(frame_fault(&head, 16, 12).is_some());
        for n in 0..head.len() {
            let _ = frame_fault(&head[..n], 16, 12);
        }
    }

    #[test]
    fn flat_colors_come_back_without_a_tint() {
        let mut sums = [0.0; 3];
        let colors =
            [[200, 100, 50], [20, 30, 40], [90, 160, 220], [100, 100, 100], [128, 126, 240], [60, 200, 90]];
        for color in colors {
            let webp = encode_webp_lossy(32, 32, 3, &color.repeat(32 * 32), 100).unwrap();
            let (_, _, texels) = decode_texture(&webp, &Limits::default()).unwrap();
            for k in 0..3 {
                let mean = texels.iter().map(|t| f64::from(t[k])).sum::<f64>() / texels.len() as f64;
                let off = mean - f64::from(color[k]);
                assert!(off.abs() <= 1.3, "{color:?}: {off} in channel {k}");
                sums[k] += off / colors.len() as f64;
            }
        }
        assert!(sums.iter().all(|s| s.abs() < 0.6), "{sums:?}");
    }

    #[test]
    fn better_quality_is_nearer_and_larger() {
        let (width, height) = (128, 96);
        let data: Vec<u8> = picture(width, height).chunks_exact(4).flat_map(|t| [t[0], t[1], t[2]]).collect();
        let made = [20, 50, 80, 98].map(|q| {
            let webp = encode_webp_lossy(width, height, 3, &data, q).unwrap();
            let (_, _, texels) = decode_texture(&webp, &Limits::default()).unwrap();
            let squares = texels
                .iter()
                .zip(data.chunks_exact(3))
                .flat_map(|(a, b)| (0..3).map(|k| (f64::from(a[k]) - f64::from(b[k])).powi(2)));
            (webp.len(), squares.sum::<f64>() / data.len() as f64)
        });
        assert!(made.windows(2).all(|w| w[0].0 < w[1].0 && w[0].1 > w[1].1), "{made:?}");
        assert!(made[3].1 < 12.0 && 2 * made[3].0 < data.len(), "{made:?}");
    }

    #[test]
    fn sides_have_limits() {
        let wide = 1 << 14;
        assert!(encode_webp(wide, 1, 3, &vec![0; 3 * wide]).unwrap_err().to_string().contains("16384 x 1"));
        assert!(encode_webp_lossy(0, 1, 3, &[], 50).is_err());
    }
}
