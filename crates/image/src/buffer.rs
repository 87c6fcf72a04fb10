//! The image buffer.

use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};

/// Pixels that one thread takes at a time where channels are moved.
const RUN: usize = 1 << 14;

/// An image of `f32` samples, interleaved, row-major, row 0 at the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Image {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Samples per pixel.
    pub channels: usize,
    /// `height * width * channels` samples.
    pub data: Vec<f32>,
}

impl Image {
    /// An image of zeros.
    pub fn new(width: usize, height: usize, channels: usize) -> Self {
        Self { width, height, channels, data: vec![0.0; width * height * channels] }
    }

    /// Wraps existing samples.
    ///
    /// # Panics
    /// If `data.len() != width * height * channels`.
    pub fn from_data(width: usize, height: usize, channels: usize, data: Vec<f32>) -> Self {
        assert_eq!(data.len(), width * height * channels, "one sample per pixel and channel");
        Self { width, height, channels, data }
    }

    /// An image of `f(x, y, channel)`.
    pub fn from_fn(
        width: usize,
        height: usize,
        channels: usize,
        mut f: impl FnMut(usize, usize, usize) -> f32,
    ) -> Self {
        let mut data = Vec::with_capacity(width * height * channels);
        for y in 0..height {
            for x in 0..width {
                data.extend((0..channels).map(|c| f(x, y, c)));
            }
        }
        Self { width, height, channels, data }
    }

    /// The samples of one pixel.
    #[inline]
    pub fn pixel(&self, x: usize, y: usize) -> &[f32] {
        let i = (y * self.width + x) * self.channels;
        &self.data[i..i + self.channels]
    }

    /// The samples of one pixel, mutable.
    #[inline]
    pub fn pixel_mut(&mut self, x: usize, y: usize) -> &mut [f32] {
        let i = (y * self.width + x) * self.channels;
        &mut self.data[i..i + self.channels]
    }

    /// Number of pixels.
    #[inline]
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// Whether width, height and channels agree.
    #[inline]
    pub fn same_shape(&self, other: &Self) -> bool {
        (self.width, self.height, self.channels) == (other.width, other.height, other.channels)
    }

    /// The image of `f(sample)`.
    pub fn map(&self, f: impl Fn(f32) -> f32) -> Self {
        Self { data: self.data.iter().map(|v| f(*v)).collect(), ..*self }
    }

    /// The channels with the given indices, in that order; an index may repeat.
    ///
    /// ```
    /// use photofit_image::Image;
    /// let rgba = Image::from_data(1, 1, 4, vec![0.1, 0.2, 0.3, 0.4]);
    /// assert_eq!(rgba.select(&[3, 0]).data, [0.4, 0.1]);
    /// ```
    ///
    /// # Panics
    /// If an index is not below `self.channels`.
    pub fn select(&self, channels: &[usize]) -> Self {
        assert!(channels.iter().all(|c| *c < self.channels), "channel indices below {}", self.channels);
        let mut data = Vec::with_capacity(self.pixels() * channels.len());
        for pixel in self.data.chunks_exact(self.channels.max(1)) {
            data.extend(channels.iter().map(|c| pixel[*c]));
        }
        Self { width: self.width, height: self.height, channels: channels.len(), data }
    }

    /// The channels one after the other, `width * height` samples each.
    ///
    /// ```
    /// use photofit_image::Image;
    /// let image = Image::from_data(2, 1, 2, vec![0.1, 0.2, 0.3, 0.4]);
    /// assert_eq!(image.planes(), [0.1, 0.3, 0.2, 0.4]);
    /// assert_eq!(Image::from_planes(2, 1, &image.planes()), image);
    /// ```
    pub fn planes(&self) -> Vec<f32> {
        let mut planes = vec![0.0; self.data.len()];
        planes.par_chunks_mut(self.pixels().max(1)).enumerate().for_each(|(c, plane)| {
            let samples = self.data[c..].iter().step_by(self.channels);
            plane.iter_mut().zip(samples).for_each(|(p, v)| *p = *v);
        });
        planes
    }

    /// The inverse of [`Self::planes`].
    ///
    /// # Panics
    /// If these are not whole planes.
    pub fn from_planes(width: usize, height: usize, planes: &[f32]) -> Self {
        let n = width * height;
        let channels = planes.len() / n.max(1);
        let mut image = Self::new(width, height, channels);
        assert_eq!(image.data.len(), planes.len(), "whole planes");
        image.data.par_chunks_mut((RUN * channels).max(1)).enumerate().for_each(|(k, run)| {
            for (c, plane) in planes.chunks(n.max(1)).enumerate() {
                let samples = run[c..].iter_mut().step_by(channels);
                samples.zip(&plane[k * RUN..]).for_each(|(s, v)| *s = *v);
            }
        });
        image
    }

    /// The rectangle of `width x height` pixels whose upper left pixel is `(x, y)`.
    ///
    /// # Panics
    /// If the rectangle does not lie inside the image.
    pub fn crop(&self, x: usize, y: usize, width: usize, height: usize) -> Self {
        assert!(x + width <= self.width && y + height <= self.height, "a rectangle inside the image");
        let mut data = Vec::with_capacity(width * height * self.channels);
        for row in y..y + height {
            let i = (row * self.width + x) * self.channels;
            data.extend_from_slice(&self.data[i..i + width * self.channels]);
        }
        Self { width, height, channels: self.channels, data }
    }

    /// RGB of this RGBA image (straight alpha) over a background colour.
    ///
    /// # Panics
    /// If the image has not four channels.
    pub fn over(&self, background: [f32; 3]) -> Self {
        assert_eq!(self.channels, 4, "RGBA");
        let mut data = Vec::with_capacity(self.pixels() * 3);
        for p in self.data.chunks_exact(4) {
            data.extend((0..3).map(|c| p[c] * p[3] + background[c] * (1.0 - p[3])));
        }
        Self { width: self.width, height: self.height, channels: 3, data }
    }

    /// The first sample of which `is` holds: its column, its row and what it is.
    pub fn find(&self, is: impl Fn(f32) -> bool) -> Option<(usize, usize, f32)> {
        let i = self.data.iter().position(|v| is(*v))?;
        let pixel = i / self.channels;
        Some((pixel % self.width, pixel / self.width, self.data[i]))
    }

    /// Whether no sample is NaN or infinite.
    pub fn is_finite(&self) -> bool {
        self.data.iter().all(|v| v.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::Image;

    #[test]
    fn finds_the_pixel_of_a_sample() {
        let image = Image::from_fn(5, 3, 2, |x, y, c| (10 * y + 2 * x + c) as f32);
        assert_eq!(image.find(|v| v > 15.5), Some((3, 1, 16.0)));
        assert_eq!(image.find(|v| v == 27.0), Some((3, 2, 27.0)));
        assert_eq!(image.find(f32::is_nan), None);
    }

    #[test]
    fn crops_selects_and_composites() {
        let image = Image::from_fn(5, 4, 2, |x, y, c| (100 * c + 10 * y + x) as f32);
        let part = image.crop(1, 2, 3, 2);
        assert_eq!(part.data, [21., 121., 22., 122., 23., 123., 31., 131., 32., 132., 33., 133.]);
        assert_eq!(part.select(&[1]).data, [121., 122., 123., 131., 132., 133.]);
        let rgba = Image::from_data(1, 1, 4, vec![1.0, 0.5, 0.0, 0.25]);
        assert_eq!(rgba.over([0.0, 1.0, 0.8]).data, [0.25, 0.875, 0.6]);
        assert_eq!(image.crop(5, 4, 0, 0).data.len(), 0);
        assert!(!image.map(|v| 1.0 / v).is_finite());
    }
}
