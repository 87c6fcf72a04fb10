//! Pixel filters, applied by importance sampling: a sample is placed with the filter's density and counts for its pixel
//! alone (Ernst, Stamminger and Greiner 2006), so that pixels stay independent of each other. In a sum over pixels, as
//! the gradient of a loss is one, it counts for all pixels that the filter reaches ([`Filter::shared`]).

use photofit_image::Image;
use photofit_sampling::inverse_normal_cdf;
use photofit_scalar::Vec3f;

/// Pixels up to which samples are shared.
const MOST_REACH: usize = 8;

/// The weight of light around the centre of a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Filter {
    /// The area of the pixel.
    #[default]
    Box,
    /// A pyramid of the given half width, in pixels.
    Tent {
        /// Half width.
        radius: f32,
    },
    /// A Gaussian, cut off at four standard deviations.
    Gaussian {
        /// Standard deviation, in pixels.
        sigma: f32,
    },
}

impl Filter {
    /// Half of its width, in pixels: no light counts that lies farther from the centre along an axis.
    fn reach(self) -> f32 {
        match self {
            Self::Box => 0.5,
            Self::Tent { radius } => radius,
            Self::Gaussian { sigma } => 4.0 * sigma,
        }
    }

    /// Its value along one axis at a distance within [`Self::reach`], up to a factor.
    #[inline]
    fn value(self, distance: f32) -> f32 {
        match self {
            Self::Box => 1.0,
            Self::Tent { radius } => (1.0 - distance.abs() / radius).max(0.0),
            Self::Gaussian { sigma } => (-0.5 * (distance / sigma).powi(2)).exp(),
        }
    }

    /// Whether the filters of pixels overlap, and not over so many that telling the shares of all costs more than a path.
    pub(crate) fn is_shared(self) -> bool {
        self != Self::Box && self.reach() <= MOST_REACH as f32
    }

    /// What a sample at `at` (pixels from the upper left corner of the picture) counts in the sum of all pixels times
    /// `weights`: their mean over the pixels whose filters place samples there, by the density with which they do. That is the
    /// balance heuristic over pixels: the sum has the same expectation as with samples that count for
    /// their own pixel, and less noise where weights of neighbours differ. For filters that [`Self::is_shared`] tells.
    pub(crate) fn shared(self, weights: &Image, at: [f32; 2]) -> Vec3f {
        let reach = self.reach();
        // Centres lie at halves.
        let range = |at: f32, size: usize| {
            let first = (at - 0.5 - reach).ceil().max(0.0) as usize;
            let last = (at - 0.5 + reach).floor().max(0.0) as usize;
            first..=last.min(size - 1)
        };
        let mut columns = [0.0; 2 * MOST_REACH + 1];
        let xs = range(at[0], weights.width);
        for (share, x) in columns.iter_mut().zip(xs.clone()) {
            *share = self.value(at[0] - 0.5 - x as f32);
        }
        let (mut sum, mut density) = (Vec3f::zero(), 0.0);
        for y in range(at[1], weights.height) {
            let row = self.value(at[1] - 0.5 - y as f32);
            for (x, column) in xs.clone().zip(columns) {
                let share = row * column;
                let w = weights.pixel(x, y);
                sum += Vec3f { x: w[0], y: w[1], z: w[2] } * share;
                density += share;
            }
        }
        if density > 0.0 { sum * (1.0 / density) } else { Vec3f::zero() }
    }

    /// Whether the widths are positive and finite.
    pub(crate) fn is_valid(self) -> bool {
        match self {
            Self::Box => true,
            Self::Tent { radius: r } | Self::Gaussian { sigma: r } => r > 0.0 && r <= 100.0,
        }
    }

    /// Offset from the centre of the pixel along one axis, for `u` in `[0, 1)`.
    #[inline]
    pub(crate) fn offset(self, u: f32) -> f32 {
        match self {
            Self::Box => u - 0.5,
            Self::Tent { radius } => {
                let x = if u < 0.5 { (2.0 * u).sqrt() - 1.0 } else { 1.0 - (2.0 - 2.0 * u).sqrt() };
                radius * x
            }
            Self::Gaussian { sigma } => {
                // The mass beyond four standard deviations on either side.
                const TAIL: f64 = 3.167_124_183_311_998e-5;
                sigma * inverse_normal_cdf(TAIL + (1.0 - 2.0 * TAIL) * f64::from(u)) as f32
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_counts_for_the_pixels_around_it() {
        // Two pixels in a row: weights 1 and 3.
        let weights = Image::from_fn(2, 1, 3, |x, _, _| if x == 0 { 1.0 } else { 3.0 });
        let shared = |filter: Filter, x: f32| filter.shared(&weights, [x, 0.5]).x;
        let tent = Filter::Tent { radius: 1.5 };
        assert!((shared(tent, 1.0) - 2.0).abs() < 1e-6, "half way");
        // A third of the first one's filter and all of the second one's.
        assert!((shared(tent, 1.5) - (1.0 / 3.0 + 3.0) / (4.0 / 3.0)).abs() < 1e-6);
        assert!((shared(tent, 2.5) - 3.0).abs() < 1e-6, "beyond the reach of the first one");
        assert_eq!(shared(Filter::Box, 0.7), 1.0);
        let gaussian = Filter::Gaussian { sigma: 0.5 };
        let far = (-2.0_f32).exp();
        assert!((shared(gaussian, 1.5) - (far + 3.0) / (far + 1.0)).abs() < 1e-6);
    }

    #[test]
    fn offsets_have_the_moments_of_the_filter() {
        for (filter, reach, variance) in [
            (Filter::Box, 0.5, 1.0 / 12.0),
            (Filter::Tent { radius: 1.5 }, 1.5, 2.25 / 6.0),
            (Filter::Gaussian { sigma: 0.5 }, 2.0, 0.25 * 0.998_93),
        ] {
            let n = 100_000;
            let x = |i| f64::from(filter.offset((i as f32 + 0.5) / n as f32));
            let mean = (0..n).map(x).sum::<f64>() / f64::from(n);
            let second = (0..n).map(|i| x(i) * x(i)).sum::<f64>() / f64::from(n);
            assert!(mean.abs() < 1e-4, "{filter:?}: {mean}");
            assert!((second - variance).abs() < 2e-3 * variance, "{filter:?}: {second} {variance}");
            assert!((0..n).all(|i| x(i).abs() <= reach + 1e-6), "{filter:?}");
            // Monotone: the stratification of the samples is kept.
            assert!((1..n).all(|i| x(i) >= x(i - 1)), "{filter:?}");
        }
        assert!(!Filter::Tent { radius: f32::NAN }.is_valid() && !Filter::Gaussian { sigma: 0.0 }.is_valid());
    }
}
