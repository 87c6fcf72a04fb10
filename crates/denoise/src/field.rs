//! Shapes of planar images, and what to do with values that are not finite.

use photofit_scalar::Real;

use crate::DenoiseError;

/// Width, height and channels of a planar image: the sample of channel `c` at row `y` and column `x` is number
/// `(c * height + y) * width + x`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Number of columns (N in the papers).
    pub width: usize,
    /// Number of rows (M in the papers); row 0 is at the top.
    pub height: usize,
    /// Number of channels, one plane each.
    pub channels: usize,
}

impl Shape {
    /// A shape; width first, as everywhere.
    pub const fn new(width: usize, height: usize, channels: usize) -> Self {
        Self { width, height, channels }
    }

    /// Number of pixels of one plane.
    pub const fn pixels(self) -> usize {
        self.width * self.height
    }

    /// Number of samples of all planes.
    pub const fn len(self) -> usize {
        self.width * self.height * self.channels
    }

    /// True when there is no sample.
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// Row, column and channel of sample `index`.
    pub const fn position(self, index: usize) -> (usize, usize, usize) {
        let within = index % self.pixels();
        (within / self.width, within % self.width, index / self.pixels())
    }

    /// Refuses empty and absurd sizes, without overflow.
    pub(crate) fn check(self) -> Result<(), DenoiseError> {
        let samples = self.width.checked_mul(self.height).and_then(|n| n.checked_mul(self.channels));
        match samples {
            Some(1..=0x8000_0000) => Ok(()),
            _ => Err(DenoiseError::Size { shape: self }),
        }
    }
}

impl std::fmt::Display for Shape {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} x {} pixels x {} channels", self.width, self.height, self.channels)
    }
}

/// Checks that every sample is finite.
///
/// # Errors
/// [`DenoiseError::Length`] if `values` does not have the shape, [`DenoiseError::NotFinite`] with the place of the
/// first NaN or infinity; `what` names the slice in the message.
pub fn check_finite<T: Real>(what: &'static str, values: &[T], shape: Shape) -> Result<(), DenoiseError> {
    DenoiseError::length(what, values.len(), shape.len(), shape)?;
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(index) => Err(not_finite(what, values[index], index, shape)),
    }
}

pub(crate) fn not_finite<T: Real>(what: &'static str, value: T, index: usize, shape: Shape) -> DenoiseError {
    let (row, col, channel) = shape.position(index);
    DenoiseError::NotFinite { what, value: value.f64(), row, col, channel }
}

/// Turns pixels with a NaN or infinity in any channel into holes: their samples become 0 and their entry of
/// `weight` (one per pixel, `width * height`) becomes 0. Returns how many pixels were masked.
///
/// ```
/// use photofit_denoise::{Shape, mask_non_finite};
/// let (mut image, mut weight) = (vec![1.0, f32::NAN, 3.0, 4.0], vec![8.0; 4]);
/// assert_eq!(mask_non_finite(&mut image, &mut weight, Shape::new(2, 2, 1)), 1);
/// assert_eq!((image[1], weight), (0.0, vec![8.0, 0.0, 8.0, 8.0]));
/// ```
///
/// # Panics
/// If a slice does not have its length.
pub fn mask_non_finite<T: Real>(values: &mut [T], weight: &mut [T], shape: Shape) -> usize {
    assert_eq!(values.len(), shape.len(), "samples of the image");
    assert_eq!(weight.len(), shape.pixels(), "one weight per pixel");
    let mut masked = 0;
    for (pixel, w) in weight.iter_mut().enumerate() {
        let samples = (0..shape.channels).map(|c| c * shape.pixels() + pixel);
        if samples.clone().all(|i| values[i].is_finite()) {
            continue;
        }
        for i in samples {
            values[i] = T::zero();
        }
        *w = T::zero();
        masked += 1;
    }
    masked
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_place_of_the_first_nan_is_named() {
        let shape = Shape::new(4, 3, 2);
        let mut values = vec![0.0_f32; shape.len()];
        assert_eq!(check_finite("target", &values, shape), Ok(()));
        values[12 + 2 * 4 + 3] = f32::INFINITY;
        let error = check_finite("target", &values, shape).expect_err("an infinity");
        assert_eq!(error.to_string(), "target is inf at row 2, column 3, channel 1");
        let error = check_finite("target", &values[1..], shape).expect_err("too short");
        assert_eq!(error.to_string(), "target has 23 values, expected 24 (4 x 3 pixels x 2 channels)");
    }

    #[test]
    fn a_bad_channel_masks_the_pixel() {
        let shape = Shape::new(3, 1, 2);
        let mut values = vec![1.0, 2.0, 3.0, 4.0, f64::NAN, 6.0];
        let mut weight = vec![1.0; 3];
        assert_eq!(mask_non_finite(&mut values, &mut weight, shape), 1);
        assert_eq!(values, [1.0, 0.0, 3.0, 4.0, 0.0, 6.0]);
        assert_eq!(weight, [1.0, 0.0, 1.0]);
    }

    #[test]
    fn sizes_that_overflow_are_refused() {
        assert!(Shape::new(2, usize::MAX, 3).check().is_err());
        assert!(Shape::new(2, 0, 3).check().is_err());
        assert!(Shape::new(1, 1, 1).check().is_ok());
    }
}
