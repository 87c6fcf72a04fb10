//! A perceptually uniform colour ramp for error maps.

use crate::{Image, srgb_decode};

/// sRGB stops from black over purple and orange to pale yellow, with lightness rising in even steps.
const STOPS: [[u8; 3]; 9] = [
    [0, 0, 4],
    [28, 16, 68],
    [79, 18, 123],
    [129, 37, 129],
    [181, 54, 122],
    [229, 80, 100],
    [251, 135, 97],
    [254, 194, 135],
    [252, 253, 191],
];

/// The sRGB-encoded colour of `t` in `[0, 1]`: black is no error, pale yellow is 1. NaN is shown as 1.
pub fn heatmap_color(t: f32) -> [f32; 3] {
    let t = if t.is_nan() { 1.0 } else { t.clamp(0.0, 1.0) } * (STOPS.len() - 1) as f32;
    let i = (t as usize).min(STOPS.len() - 2);
    let f = t - i as f32;
    std::array::from_fn(|c| {
        let (a, b) = (f32::from(STOPS[i][c]), f32::from(STOPS[i + 1][c]));
        (a + (b - a) * f) / 255.0
    })
}

/// Colours the first channel of `map`, with `max` as the brightest value, as a linear RGB image that
/// [`crate::write_png`] shows in the colours of the ramp.
pub fn heatmap(map: &Image, max: f32) -> Image {
    let mut data = Vec::with_capacity(map.pixels() * 3);
    for pixel in map.data.chunks_exact(map.channels.max(1)) {
        data.extend(heatmap_color(pixel[0] / max).map(srgb_decode));
    }
    Image::from_data(map.width, map.height, 3, data)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::luminance;

    #[test]
    fn luminance_rises_with_the_value() {
        let map = Image::from_fn(200, 1, 1, |x, _, _| x as f32 / 199.0 * 0.5);
        let colors = heatmap(&map, 0.5);
        let luma: Vec<f32> = colors.data.chunks(3).map(|c| luminance([c[0], c[1], c[2]])).collect();
        assert!(luma.windows(2).all(|w| w[1] > w[0]), "strictly rising");
        assert!(luma[0] < 0.001 && luma[199] > 0.9);
        assert_eq!(heatmap_color(f32::NAN), heatmap_color(2.0));
        assert_eq!(heatmap_color(-1.0), heatmap_color(0.0));
    }
}
