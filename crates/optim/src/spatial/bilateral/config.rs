//! Settings of the bilateral filter.

use photofit_scalar::Real;

/// Weights by distance along one axis; those of the grid are their products.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Taps {
    /// `[1, 2, 1] / 4`: 9 neighbours in a plane, 27 in a volume.
    #[default]
    Three,
    /// The cubic B-spline `[1, 4, 6, 4, 1] / 16`: 25 in a plane, 125 in a volume, and 1.4 times as wide.
    B3,
}

impl Taps {
    pub(super) fn weights(self) -> &'static [f64] {
        match self {
            Self::Three => &[0.25, 0.5, 0.25],
            Self::B3 => &[0.0625, 0.25, 0.375, 0.25, 0.0625],
        }
    }
}

/// The map from what guides to the domain in which differences are taken.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum GuideMap {
    /// The values themselves.
    #[default]
    Linear,
    /// `ln(|x| + 1e-8)`: for quantities that span decades.
    Log,
    /// `asinh(x / s)`: linear below `s`, logarithmic above; steadier near zero than [`Self::Log`].
    Asinh(f64),
}

impl GuideMap {
    pub(super) fn value<T: Real>(self, x: T) -> T {
        match self {
            Self::Linear => x,
            Self::Log => (x.abs() + T::of(1e-8)).ln(),
            Self::Asinh(s) => (x / T::of(s)).asinh(),
        }
    }

    pub(super) fn slope(self, x: f64) -> f64 {
        match self {
            Self::Linear => 1.0,
            Self::Log => 1.0 / (x.abs() + 1e-8),
            Self::Asinh(s) => 1.0 / x.hypot(s),
        }
    }
}

/// The width of the range weights `exp(-|guide_x - guide_y| / sigma)`, in the guide's units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sigma {
    /// This factor times the median difference between neighbours, anew in every step, but at least a fifth of the
    /// learning rate.
    Auto(f64),
    /// A constant; it must exceed the jitter of the parameters, which is about the learning rate.
    Fixed(f64),
    /// No range weights: a low-pass filter.
    Unlimited,
}

/// What the range weights look at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Source {
    /// The parameters before the step: the cross-bilateral filter.
    #[default]
    Parameters,
    /// The gradients: the plain bilateral filter, which sees their noise.
    Gradients,
}

/// Settings of the bilateral filter on a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bilateral {
    /// Levels `A`, with strides `1, 2, .., 2^(A-1)`. The standard deviation along an axis is
    /// `sqrt(k (4^A - 1) / 3)`, `k` = 1/2 for [`Taps::Three`] and 1 for [`Taps::B3`]: 13 and 18.5 samples for 5 levels.
    pub levels: u32,
    /// Weights by distance.
    pub taps: Taps,
    /// The domain in which parameters are compared.
    pub map: GuideMap,
    /// Width of the range weights.
    pub sigma: Sigma,
    /// What the range weights look at.
    pub source: Source,
    /// Widest level first.
    pub coarse_to_fine: bool,
}

impl Default for Bilateral {
    fn default() -> Self {
        Self {
            levels: 5,
            taps: Taps::default(),
            map: GuideMap::default(),
            sigma: Sigma::Auto(2.0),
            source: Source::default(),
            coarse_to_fine: false,
        }
    }
}

impl Bilateral {
    /// A low-pass filter of `levels` levels.
    pub fn low_pass(levels: u32) -> Self {
        Self { levels, sigma: Sigma::Unlimited, ..Self::default() }
    }
}
