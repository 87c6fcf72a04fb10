//! Monotone splines of the unit interval: the warps of single coordinates, from the logits of a network.

mod quadratic;
mod rational;

pub use quadratic::Quadratic;
pub use rational::Rational;

use photofit_scalar::Real;

/// Most bins of a spline.
pub const BINS_MAX: usize = 31;

/// Which family of monotone functions warps a coordinate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Family {
    /// A piecewise linear density: a piecewise quadratic distribution (Müller et al. 2019).
    #[default]
    Quadratic,
    /// A piecewise rational quadratic distribution (Durkan et al. 2019).
    Rational,
}

impl Family {
    /// Logits of a spline of `bins` bins.
    pub fn logits(self, bins: usize) -> usize {
        match self {
            Self::Quadratic => 2 * bins + 1,
            Self::Rational => 3 * bins + 1,
        }
    }
}

/// A spline of one of the families: a strictly increasing map of `[0, 1]` onto itself with its density.
#[derive(Clone, Debug)]
pub enum Spline<T> {
    /// See [`Quadratic`].
    Quadratic(Quadratic<T>),
    /// See [`Rational`].
    Rational(Rational<T>),
}

impl<T: Real> Spline<T> {
    /// The spline of `logits` ([`Family::logits`] of them, finite).
    ///
    /// # Panics
    /// If there are more than [`BINS_MAX`] bins, or fewer logits than that.
    #[inline]
    pub fn new(family: Family, bins: usize, logits: &[T]) -> Self {
        match family {
            Family::Quadratic => Self::Quadratic(Quadratic::new(bins, logits)),
            Family::Rational => Self::Rational(Rational::new(bins, logits)),
        }
    }

    /// `(u, du/dx)` at `x` in `[0, 1]`.
    #[inline]
    pub fn forward(&self, x: T) -> (T, T) {
        match self {
            Self::Quadratic(s) => s.forward(x),
            Self::Rational(s) => s.forward(x),
        }
    }

    /// `(x, du/dx)` at which [`Self::forward`] gives `u` in `[0, 1]`.
    #[inline]
    pub fn inverse(&self, u: T) -> (T, T) {
        match self {
            Self::Quadratic(s) => s.inverse(u),
            Self::Rational(s) => s.inverse(u),
        }
    }

    /// Vector-Jacobian product of `(u, ln du/dx)` at `x` for the gradients `[g_u, g_ln]`: adds to those of the logits, and
    /// returns that of `x`.
    pub fn forward_vjp(&self, x: T, g: [T; 2], logits: &mut [T]) -> T {
        match self {
            Self::Quadratic(s) => s.forward_vjp(x, g, logits),
            Self::Rational(s) => s.forward_vjp(x, g, logits),
        }
    }
}

/// `floor + (1 - n floor) softmax(logits)` into `out`.
#[inline(always)]
fn shares<T: Real>(logits: &[T], floor: T, out: &mut [T]) {
    let largest = logits.iter().fold(T::neg_infinity(), |a, b| a.max(*b));
    let mut sum = T::zero();
    for (o, l) in out.iter_mut().zip(logits) {
        *o = (*l - largest).exp();
        sum += *o;
    }
    let scale = (T::one() - T::of(logits.len() as f64) * floor) / sum;
    for o in out.iter_mut().take(logits.len()) {
        *o = floor + *o * scale;
    }
}

/// Vector-Jacobian product of [`shares`] at its output `w`: adds to the gradients of the logits.
fn shares_vjp<T: Real>(w: &[T], floor: T, g: &[T], logits: &mut [T]) {
    // With s = (w - floor) / (1 - n floor), the factor of s cancels against that of dw/ds.
    let rest = T::one() - T::of(w.len() as f64) * floor;
    let mean = w.iter().zip(g).map(|(w, g)| (*w - floor) / rest * *g).sum::<T>();
    for ((l, w), g) in logits.iter_mut().zip(w).zip(g) {
        *l += (*w - floor) * (*g - mean);
    }
}

/// The last index of ascending `knots` (of which the first is below all `x`) that is at most `x`, among the first `n`.
#[inline(always)]
fn bin<T: Real>(knots: &[T], n: usize, x: T) -> usize {
    // Without branches: the count of inner knots at or below x.
    knots[1..n].iter().map(|k| usize::from(*k <= x)).sum()
}

#[cfg(test)]
mod tests;
