//! Image losses on linear HDR images: value and gradient with respect to the candidate, in one pass.
//!
//! Every loss is a mean over the pixels of a [`PictureLayout`] and the channels that it reads; `x` is the candidate, `y` the
//! reference (constant). Samples are clamped to `[-`[`SAMPLE_MAX`]`, `[`SAMPLE_MAX`]`]`, with a zero gradient beyond;
//! NaN is not hidden, it makes the value NaN. Antialiasing may leave slightly negative samples: the tone curve
//! `S(x) = G(ln(1 + x))`, with G the sRGB transfer, continues as an odd function (it is linear about zero, hence
//! smooth there).
//!
//! Sums run over chunks of rows whose size depends on the image alone, are accumulated in `f64` and added in order:
//! the same bits for any number of threads.
//!
//! On one core of a server with AVX2 (2.6 GHz, shared), value and gradient of a 512x512x3 image take 2.6 ms for the
//! logarithmic losses, 0.4 ms for the rational ones and 33 ms for SSIM.

mod curve;
#[cfg(feature = "gpu")]
pub mod gpu;
mod pointwise;
mod ssim;
#[cfg(test)]
mod tests;

pub use curve::LossScalar;
use std::ops::Range;

/// Samples are clamped to this magnitude.
pub const SAMPLE_MAX: f64 = 65535.0;

/// A loss between a candidate `x` and a reference `y`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Loss {
    /// `|S(x) - S(y)|`, `S(x) = G(ln(1 + x))` (Munkberg et al. 2022).
    #[default]
    LogSrgbL1,
    /// `(S(x) - S(y))^2`.
    LogSrgbL2,
    /// `(x - y)^2`.
    Mse,
    /// `|x - y| / (|x| + |y| + 0.01)`.
    Smape,
    /// `(x - y)^2 / (x^2 + y^2 + 0.1)`.
    RelativeL2,
    /// `1 - SSIM` of the tone-mapped images `S(x)`, `S(y)` (Wang et al. 2004): Gaussian window of 11x11 with standard
    /// deviation 1.5, cut and renormalised at the borders, constants for a range of one.
    Ssim,
}

/// Layout of the images of a loss: `height` rows of `width` pixels of `channels` interleaved samples.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureLayout<'a, T = f32> {
    width: usize,
    height: usize,
    channels: usize,
    read: Range<usize>,
    weights: Option<&'a [T]>,
}

impl<'a, T: LossScalar> PictureLayout<'a, T> {
    /// A layout of which every channel is read, without weights.
    pub fn new(width: usize, height: usize, channels: usize) -> Self {
        Self { width, height, channels, read: 0..channels, weights: None }
    }

    /// Reads only some channels, for example `0..3` of an RGBA image.
    ///
    /// # Panics
    /// If the range is empty or ends beyond the channels.
    #[must_use]
    pub fn only(mut self, read: Range<usize>) -> Self {
        assert!(read.start < read.end && read.end <= self.channels, "a range of existing channels");
        self.read = read;
        self
    }

    /// Multiplies the terms of each pixel by a weight. The mean still divides by the number of pixels, not by the sum
    /// of the weights; samples of pixels with weight zero are not looked at by the pointwise losses.
    ///
    /// # Panics
    /// If there is not one weight per pixel.
    #[must_use]
    pub fn weighted(mut self, weights: &'a [T]) -> Self {
        assert_eq!(weights.len(), self.width * self.height, "one weight per pixel");
        self.weights = Some(weights);
        self
    }

    /// Samples per row.
    fn pitch(&self) -> usize {
        self.width * self.channels
    }

    /// Terms of the mean.
    fn terms(&self) -> usize {
        self.width * self.height * self.read.len()
    }

    fn check(&self, x: &[T], y: &[T]) {
        let n = self.height * self.pitch();
        assert_eq!(x.len(), n, "samples of the candidate");
        assert_eq!(y.len(), n, "samples of the reference");
    }
}

impl Loss {
    /// `factor` times the loss; adds `factor` times its gradient with respect to `x` to `gradient`.
    ///
    /// `x`, `y` and `gradient` have the shape of the layout. An image without pixels has the value zero.
    ///
    /// ```
    /// use photofit_raster::loss::{PictureLayout, Loss};
    /// let (x, y) = ([0.5_f32, 0.2, 0.1], [0.5_f32, 0.1, 0.3]);
    /// let mut gradient = [0.0; 3];
    /// let value = Loss::Mse.value_and_gradient(&x, &y, &PictureLayout::new(1, 1, 3), 1.0, &mut gradient);
    /// assert!((value - 0.05 / 3.0).abs() < 1e-7);
    /// assert!((gradient[2] + 0.4 / 3.0).abs() < 1e-7);
    /// ```
    ///
    /// # Panics
    /// If a slice does not have the shape of the layout.
    pub fn value_and_gradient<T: LossScalar>(
        self,
        x: &[T],
        y: &[T],
        layout: &PictureLayout<'_, T>,
        factor: f64,
        gradient: &mut [T],
    ) -> f64 {
        layout.check(x, y);
        assert_eq!(gradient.len(), x.len(), "samples of the gradient");
        self.dispatch(x, y, layout, factor, Some(gradient))
    }

    /// The loss alone: the same bits as [`Self::value_and_gradient`] with `factor` one.
    ///
    /// # Panics
    /// If a slice does not have the shape of the layout.
    pub fn value<T: LossScalar>(self, x: &[T], y: &[T], layout: &PictureLayout<'_, T>) -> f64 {
        layout.check(x, y);
        self.dispatch(x, y, layout, 1.0, None)
    }

    fn dispatch<T: LossScalar>(
        self,
        x: &[T],
        y: &[T],
        layout: &PictureLayout<'_, T>,
        factor: f64,
        gradient: Option<&mut [T]>,
    ) -> f64 {
        if layout.terms() == 0 {
            return 0.0;
        }
        match self {
            Self::LogSrgbL1 => pointwise::run::<T, pointwise::LogSrgbL1>(x, y, layout, factor, gradient),
            Self::LogSrgbL2 => pointwise::run::<T, pointwise::LogSrgbL2>(x, y, layout, factor, gradient),
            Self::Mse => pointwise::run::<T, pointwise::Mse>(x, y, layout, factor, gradient),
            Self::Smape => pointwise::run::<T, pointwise::Smape>(x, y, layout, factor, gradient),
            Self::RelativeL2 => pointwise::run::<T, pointwise::RelativeL2>(x, y, layout, factor, gradient),
            Self::Ssim => ssim::run(x, y, layout, factor, gradient),
        }
    }
}
