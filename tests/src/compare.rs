//! The comparison of an image with its golden file.

use photofit_image::Image;

use crate::tolerances::Tolerance;

/// What a comparison found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Largest absolute difference of a sample; infinite where only one side is a number.
    pub largest: f32,
    /// Pixel `(x, y)` of the largest difference.
    pub at: (usize, usize),
    /// Root of the mean squared difference of the finite samples.
    pub rmse: f64,
    /// Pixels that have a sample outside the bound.
    pub outliers: usize,
    /// Pixels compared.
    pub pixels: usize,
    /// The bound on a sample that was applied.
    pub bound: f32,
    /// Whether the image passes.
    pub within: bool,
}

/// The absolute difference of two samples: zero for equal non-finite values, infinite if only one is finite.
fn distance(a: f32, b: f32) -> f32 {
    if a == b || (a.is_nan() && b.is_nan()) {
        return 0.0;
    }
    let d = (a - b).abs();
    if d.is_nan() { f32::INFINITY } else { d }
}

/// Compares two images of one shape; `step` is the quantisation step of the stored one.
///
/// # Errors
/// The two shapes `height x width x channels` when they differ.
pub fn compare(
    actual: &Image,
    expected: &Image,
    step: f32,
    tolerance: &Tolerance,
) -> Result<Difference, String> {
    let shape = |image: &Image| format!("{}x{}x{}", image.height, image.width, image.channels);
    if shape(actual) != shape(expected) {
        return Err(format!("shape {} against the golden {}", shape(actual), shape(expected)));
    }
    let bound = tolerance.sample + 0.5 * step;
    let pixels = actual.width * actual.height;
    let mut found =
        Difference { largest: 0.0, at: (0, 0), rmse: 0.0, outliers: 0, pixels, bound, within: true };
    let (mut squares, mut finite) = (0.0_f64, 0_usize);
    let rows = actual.data.chunks_exact(actual.channels).zip(expected.data.chunks_exact(actual.channels));
    for (i, (a, b)) in rows.enumerate() {
        let mut worst = 0.0_f32;
        for (a, b) in a.iter().zip(b) {
            let d = distance(*a, *b);
            worst = worst.max(d);
            if d.is_finite() {
                squares += f64::from(d) * f64::from(d);
                finite += 1;
            }
        }
        if worst > found.largest {
            found.largest = worst;
            found.at = (i % actual.width, i / actual.width);
        }
        found.outliers += usize::from(worst > bound);
    }
    found.rmse = (squares / finite.max(1) as f64).sqrt();
    found.within = found.outliers as f64 <= tolerance.outliers * pixels as f64;
    Ok(found)
}

/// The difference as a picture `[height, width, 3]`: black for none, yellow at `sample`, red from four times that.
///
/// `step` is the quantisation step of the stored image; what it explains is left out.
///
/// # Panics
/// If the shapes differ.
pub fn heat(actual: &Image, expected: &Image, step: f32, sample: f32) -> Image {
    assert_eq!(
        (actual.width, actual.height, actual.channels),
        (expected.width, expected.height, expected.channels),
        "one shape"
    );
    let mut out = Image::new(actual.width, actual.height, 3);
    let samples = actual.data.chunks_exact(actual.channels).zip(expected.data.chunks_exact(actual.channels));
    for ((a, b), rgb) in samples.zip(out.data.chunks_exact_mut(3)) {
        let worst = a.iter().zip(b).map(|(a, b)| distance(*a, *b)).fold(0.0, f32::max);
        let ratio = (worst - 0.5 * step).max(0.0) / sample.max(f32::MIN_POSITIVE);
        rgb[0] = ratio.min(1.0);
        rgb[1] = if ratio <= 1.0 { ratio } else { ((4.0 - ratio) / 3.0).max(0.0) };
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tolerances::{EDGES, EXACT};

    fn ramp() -> Image {
        let data = (0..40 * 30 * 3).map(|i| (i % 97) as f32 / 97.0).collect();
        Image::from_data(40, 30, 3, data)
    }

    #[test]
    fn the_same_image_passes_and_quantisation_is_allowed_for() {
        let image = ramp();
        assert!(compare(&image, &image, 0.0, &EXACT).expect("one shape").within);
        let mut stored = image.clone();
        stored.data.iter_mut().for_each(|v| *v = (*v * 255.0).round() / 255.0);
        assert!(compare(&image, &stored, 1.0 / 255.0, &EXACT).expect("one shape").within);
        assert!(!compare(&image, &stored, 0.0, &EXACT).expect("one shape").within);
    }

    #[test]
    fn one_perturbed_sample_fails() {
        let image = ramp();
        let mut other = image.clone();
        other.pixel_mut(7, 11)[1] += 2.0 * EXACT.sample;
        let found = compare(&other, &image, 0.0, &EXACT).expect("one shape");
        assert!(!found.within);
        assert_eq!((found.at, found.outliers), ((7, 11), 1));
    }

    #[test]
    fn a_share_of_outliers_is_a_share_and_no_more() {
        let image = ramp();
        let mut other = image.clone();
        for i in 0..2 {
            other.pixel_mut(i, 3)[0] += 0.5;
        }
        assert!(compare(&other, &image, 0.0, &EDGES).expect("one shape").within, "2 of 1200 pixels");
        other.pixel_mut(2, 3)[0] += 0.5;
        assert!(!compare(&other, &image, 0.0, &EDGES).expect("one shape").within, "3 of 1200 pixels");
    }

    #[test]
    fn a_shift_by_one_pixel_fails() {
        let image = ramp();
        let mut other = image.clone();
        other.data.rotate_left(3);
        assert!(!compare(&other, &image, 0.0, &EDGES).expect("one shape").within);
    }

    #[test]
    fn non_finite_samples_do_not_pass() {
        let image = ramp();
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut other = image.clone();
            other.data[100] = bad;
            for (a, b) in [(&other, &image), (&image, &other)] {
                let found = compare(a, b, 0.0, &EXACT).expect("one shape");
                assert!(!found.within && found.largest.is_infinite() && found.rmse.is_finite(), "{bad}");
            }
            assert!(compare(&other, &other, 0.0, &EXACT).expect("one shape").within, "{bad} on both sides");
        }
    }

    #[test]
    fn another_shape_is_an_error() {
        let error =
            compare(&Image::new(4, 3, 1), &Image::new(3, 4, 1), 0.0, &EXACT).expect_err("shapes differ");
        assert_eq!(error, "shape 3x4x1 against the golden 4x3x1");
    }

    #[test]
    fn the_heat_map_marks_what_exceeds_the_bound() {
        let a = Image::new(3, 1, 1);
        let b = Image::from_data(3, 1, 1, vec![0.0, 0.1, 0.9]);
        let map = heat(&a, &b, 0.0, 0.1);
        assert_eq!(map.data, [0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 1.0, 0.0, 0.0]);
        assert_eq!(heat(&a, &b, 0.2, 0.1).data[3..6], [0.0; 3], "half a step is left out");
    }
}
