//! Cases of `photofit-image`.

use photofit_image::{DEFAULT_PIXELS_PER_DEGREE, Image, contact_sheet, flip, heatmap, resize_bilinear, ssim};
use photofit_image::{srgb_encode, to_display};
use photofit_texture::{Pyramid, Texture};

/// A checkerboard under colour ramps `[height, width, 3]`, in `[0, 1]`.
fn checker(width: usize, height: usize) -> Image {
    Image::from_fn(width, height, 3, |x, y, c| {
        let scale = if (x / 8 + y / 8) % 2 == 0 { 0.25 } else { 1.0 };
        let (u, v) = ((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32);
        scale * [u, v, 1.0 - u][c]
    })
}

/// The checkerboard and the same with a dark disc, a shift and a colour cast.
fn pair() -> (Image, Image) {
    let reference = checker(64, 64);
    let test = Image::from_fn(64, 64, 3, |x, y, c| {
        let inside = (x as f32 - 20.0).powi(2) + (y as f32 - 40.0).powi(2) < 100.0;
        let shifted = reference.pixel((x + usize::from(y < 24)).min(63), y)[c];
        if inside { 0.5 * shifted } else { (shifted + [0.04, 0.0, -0.02][c]).clamp(0.0, 1.0) }
    });
    (to_display(&reference), to_display(&test))
}

/// All levels of an odd-sized pyramid.
pub(super) fn pyramid_levels() -> Image {
    let base = checker(61, 37);
    let texels = base.data.as_chunks::<3>().0.to_vec();
    let pyramid = Pyramid::new(Texture { width: base.width, height: base.height, texels });
    let image = |l: Texture<f32, 3>| Image::from_data(l.width, l.height, 3, l.texels.into_flattened());
    let levels: Vec<Image> = pyramid.levels.into_iter().map(image).collect();
    contact_sheet(&levels.iter().collect::<Vec<_>>(), 3, 2)
}

/// A picture made larger and smaller.
pub(super) fn resized() -> Image {
    let source = checker(24, 24);
    contact_sheet(&[&resize_bilinear(&source, 50, 31), &resize_bilinear(&source, 13, 31)], 2, 1)
}

/// The ramp of error maps, through the sRGB transfer.
pub(super) fn srgb_heat() -> Image {
    let ramp = Image::from_fn(128, 8, 1, |x, _, _| x as f32 / 127.0);
    heatmap(&ramp, 0.9).map(|v| srgb_encode(v).clamp(0.0, 1.0))
}

/// FLIP of each pixel.
pub(super) fn flip_map() -> Image {
    let (reference, test) = pair();
    flip(&reference, &test, DEFAULT_PIXELS_PER_DEGREE).map
}

/// SSIM of each pixel.
pub(super) fn ssim_map() -> Image {
    let (reference, test) = pair();
    ssim(&reference, &test).map
}
