//! Pictures that only renderers' scenes use: PFM and BMP.

use photofit_image::{Image, srgb_u8_to_linear};

/// Decodes a PFM file (`PF` or `Pf`) or a BMP file in linear light; `None` for other formats. Sides are at most `side`.
pub(super) fn decode(bytes: &[u8], side: usize) -> Option<Result<Image, String>> {
    match bytes {
        [b'P', b'F' | b'f', ..] => Some(pfm(bytes, side)),
        [b'B', b'M', ..] => Some(bmp(bytes, side)),
        _ => None,
    }
}

/// Rows are stored from the bottom; a negative scale says that the least significant byte comes first.
fn pfm(bytes: &[u8], side: usize) -> Result<Image, String> {
    let mut at = 0;
    let mut word = || {
        let end = bytes[at..].iter().position(u8::is_ascii_whitespace)? + at;
        let word = std::str::from_utf8(&bytes[at..end]).ok()?;
        at = end + 1;
        Some(word)
    };
    let mut header = || Some((word()?, word()?, word()?, word()?));
    let (kind, width, height, scale) =
        header().ok_or("the PFM header is cut off; it must have four words")?;
    let channels = if kind == "PF" { 3 } else { 1 };
    let number = |text: &str| text.parse::<usize>().ok().filter(|n| (1..=side).contains(n));
    let (Some(width), Some(height)) = (number(width), number(height)) else {
        return Err(format!("the PFM has a side of {width} x {height}; sides must be 1 to {side}"));
    };
    let scale: f32 = scale.parse().ok().filter(|s: &f32| *s != 0.0 && s.is_finite()).ok_or_else(|| {
        format!("the scale of the PFM is `{}`; it must be a number other than 0", crate::load::clip(scale))
    })?;
    let row = width * channels * 4;
    let data = &bytes[at.min(bytes.len())..];
    if data.len() < row * height {
        return Err(format!("the PFM has {} bytes of pixels; it must have {}", data.len(), row * height));
    }
    let mut values = Vec::with_capacity(width * height * channels);
    for y in (0..height).rev() {
        for sample in data[y * row..][..row].as_chunks::<4>().0 {
            values.push(if scale < 0.0 { f32::from_le_bytes(*sample) } else { f32::from_be_bytes(*sample) });
        }
    }
    Ok(Image::from_data(width, height, channels, values))
}

/// Uncompressed BMP of 8 (with a palette), 24 or 32 bits a pixel, sRGB.
fn bmp(bytes: &[u8], side: usize) -> Result<Image, String> {
    let word = |at: usize| bytes.get(at..at + 4).map(|b| i32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let fields = || Some((word(10)?, word(14)?, word(18)?, word(22)?, word(28)?, word(30)?));
    let (start, header, width, height, bits, coding) =
        fields().ok_or("the BMP header is cut off; it must have 40 bytes")?;
    let (bits, upright) = (bits & 0xffff, height > 0);
    let known = header >= 40 && (coding == 0 && matches!(bits, 8 | 24 | 32) || coding == 3 && bits == 32);
    if !known {
        return Err(format!(
            "the BMP has {bits} bits a pixel in the compression {coding}; it must have 8, 24 or 32 without compression"
        ));
    }
    let sides = 1..=side as u64;
    let (width, height) = (i64::from(width).unsigned_abs(), i64::from(height).unsigned_abs());
    if !(sides.contains(&width) && sides.contains(&height)) {
        return Err(format!("the BMP has {width} x {height} pixels; sides must be 1 to {side}"));
    }
    let (width, height) = (width as usize, height as usize);
    let row = (width * bits as usize).div_ceil(32) * 4;
    let data = usize::try_from(start).ok().and_then(|s| bytes.get(s..)).unwrap_or_default();
    if data.len() < row * height {
        return Err(format!("the BMP has {} bytes of pixels; it must have {}", data.len(), row * height));
    }
    let palette = bytes.get(14 + header as usize..).unwrap_or_default().as_chunks::<4>().0;
    let mut values = Vec::with_capacity(width * height * 3);
    for y in 0..height {
        let y = if upright { height - 1 - y } else { y };
        let line = &data[y * row..][..row];
        for x in 0..width {
            let pixel = match bits {
                8 => {
                    let entry = palette.get(usize::from(line[x]));
                    let entry = entry
                        .ok_or_else(|| format!("the pixel {} is not in the palette; it must be", line[x]))?;
                    &entry[..3]
                }
                24 => &line[3 * x..][..3],
                _ => &line[4 * x..][..3],
            };
            values.extend(pixel.iter().rev().map(|&v| srgb_u8_to_linear(v)));
        }
    }
    Ok(Image::from_data(width, height, 3, values))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_a_pfm_stand_upside_down() {
        let file = |head: &str, values: &[f32], big: bool| {
            let mut bytes = head.as_bytes().to_vec();
            bytes.extend(values.iter().flat_map(|v| if big { v.to_be_bytes() } else { v.to_le_bytes() }));
            bytes
        };
        let values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        for (scale, big) in [("-1.0", false), ("1.0", true)] {
            let image = decode(&file(&format!("PF\n1 2\n{scale}\n"), &values, big), 64).unwrap().unwrap();
            assert_eq!((image.width, image.height, image.data), (1, 2, vec![4.0, 5.0, 6.0, 1.0, 2.0, 3.0]));
        }
        let grey = decode(&file("Pf\n2 1\n-1\n", &values[..2], false), 64).unwrap().unwrap();
        assert_eq!((grey.channels, grey.data), (1, vec![1.0, 2.0]));
        for (head, part) in [
            ("PF\n1 2", "cut off"),
            ("PF\n0 2\n-1\n", "sides must be 1 to 64"),
            ("PF\n65 2\n-1\n", "65 x 2"),
            ("PF\n1 2\n0\n", "scale"),
            ("PF\n4 4\n-1\n", "it must have 192"),
        ] {
            let text = decode(&file(head, &values, false), 64).unwrap().unwrap_err();
            assert!(text.contains(part), "{part} in {text}");
        }
    }

    fn bitmap(size: (i32, i32), bits: u16, palette: &[u8], data: &[u8]) -> Vec<u8> {
        let mut bytes = b"BM".to_vec();
        let head = [0, 0, 54 + palette.len() as i32, 40, size.0, size.1];
        bytes.extend(head.iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend([1, 0]);
        bytes.extend(bits.to_le_bytes());
        bytes.extend([0; 24]);
        bytes.extend(palette);
        bytes.extend(data);
        bytes
    }

    #[test]
    fn bitmaps_of_every_depth() {
        let of = |bytes: &[u8]| decode(bytes, 64).unwrap();
        // Blue first, rows padded to four bytes, from the bottom.
        let image = of(&bitmap((1, 2), 24, &[], &[0, 0, 255, 0, 255, 0, 0, 0])).unwrap();
        assert_eq!(image.data, [0.0, 0.0, 1.0, 1.0, 0.0, 0.0]);
        let image = of(&bitmap((1, -2), 32, &[], &[0, 0, 255, 7, 255, 0, 0, 7])).unwrap();
        assert_eq!(image.data, [1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        let image = of(&bitmap((2, 1), 8, &[0, 0, 0, 0, 255, 255, 255, 0], &[1, 0, 0, 0])).unwrap();
        assert_eq!(image.data, [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
        for (bytes, part) in [
            (bitmap((1, 1), 8, &[], &[9, 0, 0, 0]), "palette"),
            (bitmap((1, 1), 4, &[], &[0; 4]), "4 bits"),
            (bitmap((0, 1), 24, &[], &[0; 4]), "0 x 1"),
            (bitmap((9, i32::MIN), 24, &[], &[0; 4]), "2147483648"),
            (bitmap((4, 4), 32, &[], &[0; 4]), "it must have 64"),
            (b"BM".to_vec(), "cut off"),
        ] {
            let text = of(&bytes).unwrap_err();
            assert!(text.contains(part), "{part} in {text}");
        }
    }
}
