//! Pixel filters, applied by importance sampling: a sample is placed with the filter's density and counts for its pixel
//! alone (Ernst, Stamminger and Greiner 2006), so that pixels stay independent of each other.

use photofit_sampling::inverse_normal_cdf;

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
