//! Image metrics; each returns its mean and a map.
//!
//! Both sides are display images: sRGB-encoded, in `[0, 1]`, see [`crate::to_display`].

mod flip;
mod ssim;

pub use flip::{DEFAULT_PIXELS_PER_DEGREE, flip};
pub use ssim::ssim;

use crate::Image;
use crate::convolve::Plane;

/// A metric of every pixel (one channel) and its mean over the image.
#[derive(Clone, Debug, PartialEq)]
pub struct ErrorMap {
    /// Mean over the image.
    pub mean: f64,
    /// The value of each pixel, one channel.
    pub map: Image,
}

impl ErrorMap {
    /// The mean over the pixels where `mask` (`height * width`, row-major) is set; `None` where it is set nowhere.
    ///
    /// # Panics
    /// If the mask has another number of pixels.
    pub fn mean_over(&self, mask: &[bool]) -> Option<f64> {
        assert_eq!(mask.len(), self.map.data.len(), "one flag per pixel");
        let count = mask.iter().filter(|m| **m).count();
        let sum: f64 = self.map.data.iter().zip(mask).filter(|(_, m)| **m).map(|(v, _)| f64::from(*v)).sum();
        (count > 0).then(|| sum / count as f64)
    }

    /// Standard error of [`Self::mean_over`] where the values of pixels are independent draws; `None` where the mask is set at fewer
    /// than two pixels.
    ///
    /// # Panics
    /// As [`Self::mean_over`].
    pub fn standard_error_over(&self, mask: &[bool]) -> Option<f64> {
        let mean = self.mean_over(mask)?;
        let set = || self.map.data.iter().zip(mask).filter(|(_, m)| **m);
        let (count, squares) = (set().count() as f64, set().map(|(v, _)| (f64::from(*v) - mean).powi(2)));
        (count > 1.0).then(|| (squares.sum::<f64>() / (count - 1.0) / count).sqrt())
    }

    fn new(width: usize, height: usize, data: Vec<f32>) -> Self {
        let mean = mean(data.iter().copied());
        Self { mean, map: Image::from_data(width, height, 1, data) }
    }
}

fn mean(values: impl ExactSizeIterator<Item = f32>) -> f64 {
    let n = values.len();
    if n == 0 { 0.0 } else { values.map(f64::from).sum::<f64>() / n as f64 }
}

fn assert_same_shape(reference: &Image, test: &Image) {
    assert!(
        reference.same_shape(test),
        "both images need one shape: {} x {} x {} against {} x {} x {}",
        reference.width,
        reference.height,
        reference.channels,
        test.width,
        test.height,
        test.channels
    );
}

fn plane(image: &Image, channel: usize) -> Plane {
    let data = image.data.iter().skip(channel).step_by(image.channels).copied().collect();
    Plane { width: image.width, height: image.height, data }
}

/// Squared difference, averaged over the channels.
///
/// # Panics
/// If the shapes differ.
pub fn squared_error(reference: &Image, test: &Image) -> ErrorMap {
    assert_same_shape(reference, test);
    let channels = reference.channels.max(1);
    let pairs = reference.data.chunks_exact(channels).zip(test.data.chunks_exact(channels));
    let data = pairs
        .map(|(r, t)| r.iter().zip(t).map(|(a, b)| (a - b) * (a - b)).sum::<f32>() / channels as f32)
        .collect();
    ErrorMap::new(reference.width, reference.height, data)
}

/// Squared error per pixel of two noisy images, each of which was made twice with noise of its own: the product of both differences,
/// whose expectation is the squared difference of what the images would be without noise (as of dual buffers: Rousselle et al.,
/// "Adaptive Rendering with Non-Local Means Filtering", 2012). It may be negative.
///
/// # Panics
/// If the shapes differ.
pub fn squared_error_of_halves([r1, r2]: [&Image; 2], [t1, t2]: [&Image; 2]) -> ErrorMap {
    [r2, t1, t2].into_iter().for_each(|other| assert_same_shape(r1, other));
    let channels = r1.channels.max(1);
    let pixels = |i: &Image| i.data.len() / channels;
    let product = |k: usize| (t1.data[k] - r1.data[k]) * (t2.data[k] - r2.data[k]);
    let of_pixel = |p: usize| (p * channels..(p + 1) * channels).map(product).sum::<f32>() / channels as f32;
    ErrorMap::new(r1.width, r1.height, (0..pixels(r1)).map(of_pixel).collect())
}

/// Mean squared error over all samples; 0 for images without pixels.
///
/// # Panics
/// If the shapes differ.
pub fn mse(reference: &Image, test: &Image) -> f64 {
    assert_same_shape(reference, test);
    let squares = reference.data.iter().zip(&test.data).map(|(a, b)| {
        let d = f64::from(*a) - f64::from(*b);
        d * d
    });
    squares.sum::<f64>() / reference.data.len().max(1) as f64
}

/// Root of the mean squared error.
///
/// # Panics
/// If the shapes differ.
pub fn rmse(reference: &Image, test: &Image) -> f64 {
    mse(reference, test).sqrt()
}

/// Peak signal-to-noise ratio in decibels of display images (peak 1); infinite for equal images.
///
/// # Panics
/// If the shapes differ.
pub fn psnr(reference: &Image, test: &Image) -> f64 {
    psnr_from_mse(mse(reference, test))
}

/// `-10 log10(mse)` for peak 1; infinite for 0.
///
/// ```
/// assert_eq!(photofit_image::psnr_from_mse(1e-4), 40.0);
/// ```
#[inline]
pub fn psnr_from_mse(mse: f64) -> f64 {
    -10.0 * mse.log10()
}

/// The mask (`height * width`) of all pixels within `radius` steps (up, down, left, right) of a set one.
///
/// # Panics
/// If `mask.len() != width * height`.
pub fn dilate(mask: &[bool], width: usize, height: usize, radius: usize) -> Vec<bool> {
    assert_eq!(mask.len(), width * height, "one flag per pixel");
    // City-block distance in two sweeps, exact.
    let far = width + height + 1;
    let mut distance: Vec<usize> = mask.iter().map(|m| if *m { 0 } else { far }).collect();
    for i in 0..distance.len() {
        if i % width > 0 {
            distance[i] = distance[i].min(distance[i - 1] + 1);
        }
        if i >= width {
            distance[i] = distance[i].min(distance[i - width] + 1);
        }
    }
    for i in (0..distance.len()).rev() {
        if i % width + 1 < width {
            distance[i] = distance[i].min(distance[i + 1] + 1);
        }
        if i + width < distance.len() {
            distance[i] = distance[i].min(distance[i + width] + 1);
        }
    }
    distance.into_iter().map(|d| d <= radius && d < far).collect()
}

#[cfg(test)]
mod tests;
