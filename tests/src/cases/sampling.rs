//! Cases of `photofit-sampling`: points as dots.

use photofit_image::Image;
use photofit_sampling::{Rng, Sobol, cosine_hemisphere};

/// An image `[64, 64, 1]` with a dot at each point of the unit square.
fn dots(points: impl Iterator<Item = [f32; 2]>) -> Image {
    let mut image = Image::new(64, 64, 1);
    for [x, y] in points {
        image.pixel_mut((64.0 * x) as usize, (64.0 * y) as usize)[0] += 0.5;
    }
    image.map(|v| v.min(1.0))
}

/// The first 256 scrambled Sobol points.
pub(super) fn sobol() -> Image {
    let points = Sobol::new(5, 0);
    dots((0..256).map(|i| points.sample_2d(i, 0)))
}

/// 512 directions of the cosine-weighted hemisphere, seen from above.
pub(super) fn cosine() -> Image {
    let mut rng = Rng::new(5, 1);
    dots((0..512).map(|_| {
        let d = cosine_hemisphere([rng.next_f32(), rng.next_f32()]);
        [0.5 + 0.4999 * d.x, 0.5 + 0.4999 * d.y]
    }))
}
