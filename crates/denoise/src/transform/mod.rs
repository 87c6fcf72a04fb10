//! Linear systems `(c0 + c1 L + c2 L^2) u = f`, where `L = -div grad`, by fast transforms.
//!
//! | solver | boundary | method | use |
//! |---|---|---|---|
//! | [`SpectralSolver`] | periodic or Neumann | real FFT or DCT-II (by one real FFT) in both directions | oracle; problems like Poisson's |
//! | [`StripSolver`] | periodic along rows, Neumann along columns | real FFT along rows, then for each frequency a banded Cholesky solve down the columns (Hockney 1965) | production |
//!
//! All are exact up to rounding, and with natural-boundary masks ([`crate::operators::gradient_mask`]) all lead a
//! splitting method to the same optimum. The strip solver replaces two column transforms and two transposes by two
//! sweeps of a few multiplications, and does not care about the number of rows.

mod banded;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;
mod line;
mod spectral;
mod strip;

#[cfg(feature = "gpu")]
pub(crate) use gpu::DeviceStrip;
pub use line::LineTransform;
pub use spectral::SpectralSolver;
pub use strip::StripSolver;
pub(crate) use strip::{Block, RowScratch};

pub use photofit_fft::Sample;

/// The system `c0 + c1 L + c2 L^2`; positive definite for `c0 > 0` and `c1, c2 >= 0`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Symbol {
    /// Weight of the identity.
    pub c0: f64,
    /// Weight of `L = grad^T grad`.
    pub c1: f64,
    /// Weight of `L^2 = H^T H`.
    pub c2: f64,
}

impl Symbol {
    /// The value at an eigenvalue `l` of `L`.
    pub fn at(self, l: f64) -> f64 {
        self.c0 + l * (self.c1 + l * self.c2)
    }

    fn check(self) {
        let ok = |v: f64| v.is_finite() && v >= 0.0;
        assert!(
            self.c0 > 0.0 && ok(self.c0) && ok(self.c1) && ok(self.c2),
            "{self:?} is not positive definite"
        );
    }
}

/// The smallest even length from `n` on whose transform is fast: only the factors 2, 3 and 5.
///
/// Columns added to reach it are holes that no term of the energy sees, so that they change no optimum.
pub fn fast_length(n: usize) -> usize {
    let smooth = |candidate: usize| {
        let mut rest = candidate;
        for factor in [2, 3, 5] {
            while rest.is_multiple_of(factor) {
                rest /= factor;
            }
        }
        rest == 1
    };
    let mut candidate = n.max(2).next_multiple_of(2);
    while !smooth(candidate) {
        candidate += 2;
    }
    candidate
}

#[cfg(test)]
mod tests;
