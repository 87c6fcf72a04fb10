//! Environment images.

use crate::SceneError;
use photofit_image::Image;
use std::path::Path;

/// Loads an equirectangular environment: a Radiance `.hdr` or OpenEXR image of linear radiance (PNG and JPEG work
/// too, decoded from sRGB), three channels, row 0 up (+y).
///
/// # Errors
/// If the file cannot be read, is not such an image, or has a radiance that is negative or not finite.
pub fn load_environment(path: impl AsRef<Path>) -> Result<Image, SceneError> {
    let path = path.as_ref();
    let fail = |rule: String| SceneError::Environment { path: path.to_owned(), rule };
    let image = photofit_image::read(path).map_err(|e| {
        let text = e.at("").to_string();
        fail(text.strip_prefix(": ").unwrap_or(&text).to_owned())
    })?;
    let channels = image.channels;
    let pixels = image.width * image.height;
    let mut rgb = Image::new(image.width, image.height, 3);
    for i in 0..pixels {
        let from = &image.data[i * channels..(i + 1) * channels];
        let to = &mut rgb.data[3 * i..3 * i + 3];
        match from {
            [r, g, b, ..] => to.copy_from_slice(&[*r, *g, *b]),
            _ => to.fill(from[0]),
        }
        if let Some(x) = to.iter().find(|x| !(x.is_finite() && **x >= 0.0)) {
            let (x, y) = (*x, (i % image.width, i / image.width));
            return Err(fail(format!("radiance is {x} at pixel {y:?}; it must be finite and not negative")));
        }
    }
    Ok(rgb)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radiance_is_checked_and_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sky.hdr");
        std::fs::write(&path, b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 3\n").unwrap();
        let text = load_environment(&path).unwrap_err().to_string();
        assert!(text.contains("sky.hdr"), "{text}");
        let text = load_environment(folder.path().join("none.exr")).unwrap_err().to_string();
        assert!(text.contains("none.exr") && !text.contains('\n'), "{text}");
        let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n".to_vec();
        bytes.extend_from_slice(&[128, 64, 0, 129, 0, 0, 0, 0]);
        std::fs::write(&path, bytes).unwrap();
        let image = load_environment(&path).unwrap();
        assert_eq!((image.width, image.height, image.channels), (2, 1, 3));
        assert!((image.data[0] - 1.0).abs() < 0.01 && (image.data[1] - 0.5).abs() < 0.01, "{:?}", image.data);
    }
}
