//! Reading KTX 2.0 textures of Basis Universal: their first mip level.

use super::Limits;
use super::limits::{MAX_RATIO_UASTC, MAX_RATIO_UASTC_ZSTANDARD};
use crate::{Image, ImageError, color};

/// Width and height from the header.
pub(super) fn size(bytes: &[u8], place: &str) -> Result<(usize, usize), ImageError> {
    photofit_ktx2::size(bytes).map_err(|e| invalid(place, &e))
}

/// Width, height and RGBA texels of the first level.
pub(super) fn decode(
    bytes: &[u8],
    place: &str,
    limits: &Limits,
) -> Result<(usize, usize, Vec<[u8; 4]>), ImageError> {
    let (width, height) = size(bytes, place)?;
    let packed = photofit_ktx2::is_supercompressed(bytes).map_err(|e| invalid(place, &e))?;
    let ratio = if packed { MAX_RATIO_UASTC_ZSTANDARD } else { MAX_RATIO_UASTC };
    limits.check(place, (width as u64, height as u64), 4, 4, bytes.len(), ratio)?;
    let (_, _, texels) = photofit_ktx2::decode(bytes, 0).map_err(|e| invalid(place, &e))?;
    Ok((width, height, texels))
}

/// Decodes to linear light: 3 channels, or 4 where a texel is not opaque.
pub(super) fn decode_linear(bytes: &[u8], place: &str, limits: &Limits) -> Result<Image, ImageError> {
    let (width, height, texels) = decode(bytes, place, limits)?;
    let channels = if texels.iter().all(|t| t[3] == 255) { 3 } else { 4 };
    let linear = |t: &[u8; 4]| {
        let [r, g, b] = [t[0], t[1], t[2]].map(color::srgb_u8_to_linear);
        [r, g, b, f32::from(t[3]) / 255.0].into_iter().take(channels)
    };
    Ok(Image::from_data(width, height, channels, texels.iter().flat_map(linear).collect()))
}

fn invalid(place: &str, error: &photofit_ktx2::Ktx2Error) -> ImageError {
    ImageError::invalid(place, format!("not a valid KTX 2.0 texture: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file() -> Vec<u8> {
        let texels: Vec<[u8; 4]> =
            (0..64).map(|i| if i % 8 < 4 { [200, 100, 50, 255] } else { [0, 0, 0, 0] }).collect();
        photofit_ktx2::encode(&[(8, 8, texels)], &photofit_ktx2::Options::new(true)).unwrap()
    }

    #[test]
    fn textures_and_pictures_of_ktx2_are_read_within_the_limits() {
        let limits = Limits::default();
        assert_eq!(crate::texture_size(&file()).unwrap(), (8, 8));
        let (_, _, texels) = crate::decode_texture(&file(), &limits).unwrap();
        assert_eq!((texels[0], texels[4]), ([200, 100, 50, 255], [0, 0, 0, 0]));
        let image = crate::decode(&file(), "a.ktx2", &limits).unwrap();
        assert_eq!((image.width, image.channels), (8, 4));
        assert_eq!(image.pixel(0, 0)[0], color::srgb_u8_to_linear(200));
        let small = Limits { max_side: 4, ..limits };
        let error = crate::decode_texture(&file(), &small).unwrap_err().to_string();
        assert!(error.contains("8 x 8"), "{error}");
        // A few bytes that claim 2^29 texels: 4 KiB of them are not enough for a side of 2^15.
        let mut claim = file();
        claim.truncate(4096);
        let sides: [u32; 2] = [1 << 15, 1 << 14];
        claim[20..28].copy_from_slice(sides.map(u32::to_le_bytes).as_flattened());
        claim[40..44].copy_from_slice(&1_u32.to_le_bytes());
        claim[44..48].copy_from_slice(&2_u32.to_le_bytes());
        let blocks = u64::from(sides[0]) * u64::from(sides[1]);
        claim[96..104].copy_from_slice(&blocks.to_le_bytes());
        let wide = Limits { max_samples: u64::MAX, ..limits };
        let error = crate::decode_texture(&claim, &wide).unwrap_err().to_string();
        assert!(error.contains("no codec packs that"), "{error}");
        let error = crate::decode_texture(&file()[..100], &limits).unwrap_err().to_string();
        assert!(error.contains("KTX 2.0"), "{error}");
    }
}
