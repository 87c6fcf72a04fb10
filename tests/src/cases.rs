//! The registry of golden images: name, file format, tolerance and the function that makes the image.

use photofit_image::Image;

use crate::store::Format;
use crate::tolerances::{EXACT, Tolerance};

/// One golden image.
#[derive(Debug)]
pub struct Case {
    /// Name of the case and of its file, lower case with hyphens.
    pub name: &'static str,
    /// How the image is stored.
    pub format: Format,
    /// How far it may lie from the file.
    pub tolerance: Tolerance,
    /// Makes the image, by the CPU path, without reading files.
    pub make: fn() -> Image,
}

/// All golden images.
pub const CASES: &[Case] =
    &[Case { name: "checker", format: Format::Png, tolerance: EXACT, make: || checker(64, 48) }];

/// A checkerboard under two colour ramps `[height, width, 3]`, in `[0, 1]`.
fn checker(width: usize, height: usize) -> Image {
    let mut image = Image::new(width, height, 3);
    for y in 0..height {
        for x in 0..width {
            let dark = (x / 8 + y / 8) % 2 == 0;
            let scale = if dark { 0.25 } else { 1.0 };
            let (u, v) = ((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32);
            image.pixel_mut(x, y).copy_from_slice(&[scale * u, scale * v, scale * (1.0 - u)]);
        }
    }
    image
}
