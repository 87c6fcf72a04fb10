//! Monotone splines of the unit interval: the warps of single coordinates, from the logits of a network.

mod packet;
mod quadratic;
mod rational;

pub(crate) use packet::warp_packet;
pub use quadratic::Quadratic;
pub use rational::Rational;

use crate::elementary::exp;
use photofit_scalar::{Real, halved_sum};

/// Most bins of a spline.
pub const BINS_MAX: usize = 31;
/// Numbers of a vector: what is computed for all bins is computed for whole vectors, of which the last may be part empty.
const LANES: usize = 16;
/// Least logit of a share below the largest.
const SHARE_LOGIT_MIN: f64 = -80.0;
/// Knots of most bins: whole vectors.
const KNOTS: usize = BINS_MAX + 1;

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
    /// If there are no bins, more than [`BINS_MAX`] of them, or fewer logits than they need.
    #[inline(always)]
    pub fn new(family: Family, bins: usize, logits: &[T]) -> Self {
        match family {
            Family::Quadratic => Self::Quadratic(Quadratic::new(bins, logits)),
            Family::Rational => Self::Rational(Rational::new(bins, logits)),
        }
    }

    /// `(u, du/dx)` at `x` in `[0, 1]`.
    #[inline(always)]
    pub fn forward(&self, x: T) -> (T, T) {
        match self {
            Self::Quadratic(s) => s.forward(x),
            Self::Rational(s) => s.forward(x),
        }
    }

    /// `(x, du/dx)` at which [`Self::forward`] gives `u` in `[0, 1]`.
    #[inline(always)]
    pub fn inverse(&self, u: T) -> (T, T) {
        match self {
            Self::Quadratic(s) => s.inverse(u),
            Self::Rational(s) => s.inverse(u),
        }
    }

    /// Vector-Jacobian product of `(u, ln du/dx)` at `x` for the gradients `[g_u, g_ln]`: adds to those of the logits, and
    /// returns that of `x`.
    #[inline(always)]
    pub fn forward_vjp(&self, x: T, g: [T; 2], logits: &mut [T]) -> T {
        match self {
            Self::Quadratic(s) => s.forward_vjp(x, g, logits),
            Self::Rational(s) => s.forward_vjp(x, g, logits),
        }
    }
}

/// Logits in whole vectors, with room behind for the vector that begins at the last one.
type Logits<T> = [T; (3 * BINS_MAX + 1).next_multiple_of(LANES) + LANES];

/// The first logits of a slice.
#[inline(always)]
fn padded<T: Real>(logits: &[T]) -> Logits<T> {
    let mut out = [T::zero(); (3 * BINS_MAX + 1).next_multiple_of(LANES) + LANES];
    let (vectors, rest) = logits.as_chunks::<LANES>();
    let mut slots = out.as_chunks_mut::<LANES>().0.iter_mut();
    for (from, to) in vectors.iter().zip(slots.by_ref()) {
        *to = *from;
    }
    if let Some(slot) = slots.next() {
        slot.iter_mut().zip(rest).for_each(|(to, from)| *to = *from);
    }
    out
}

/// Exponentials of the `n` logits from `first` on, over that of the largest, at least `e^least`, and zeros behind them. NaN
/// stays NaN; an infinite logit gives NaN.
#[inline(always)]
fn exponentials<T: Real>(logits: &Logits<T>, first: usize, n: usize, least: T, out: &mut [T; KNOTS]) {
    let vectors = n.div_ceil(LANES);
    let mut largest = [T::neg_infinity(); LANES];
    for c in 0..vectors {
        let from = &logits[first + c * LANES..][..LANES];
        for k in 0..LANES {
            let l = if c * LANES + k < n { from[k] } else { T::neg_infinity() };
            largest[k] = if l > largest[k] { l } else { largest[k] };
        }
    }
    let mut half = LANES / 2;
    while half > 0 {
        for k in 0..half {
            largest[k] = if largest[k + half] > largest[k] { largest[k + half] } else { largest[k] };
        }
        half /= 2;
    }
    for (c, out) in out.as_chunks_mut::<LANES>().0.iter_mut().enumerate().take(vectors) {
        let from = &logits[first + c * LANES..][..LANES];
        for k in 0..LANES {
            let l = from[k] - largest[0];
            let e = exp(if l < least { least } else { l });
            out[k] = if c * LANES + k < n { e } else { T::zero() };
        }
    }
}

/// `floor + (1 - n floor) softmax` of the `n` logits from `first` on into `out`, zeros behind them.
#[inline(always)]
fn shares<T: Real>(logits: &Logits<T>, first: usize, n: usize, floor: T, out: &mut [T; KNOTS]) {
    exponentials(logits, first, n, T::of(SHARE_LOGIT_MIN), out);
    let mut sum = [T::zero(); LANES];
    for out in out.as_chunks::<LANES>().0 {
        for k in 0..LANES {
            sum[k] += out[k];
        }
    }
    let scale = (T::one() - T::of(n as f64) * floor) / halved_sum(sum);
    for (c, out) in out.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
        for k in 0..LANES {
            out[k] = if c * LANES + k < n { floor + out[k] * scale } else { T::zero() };
        }
    }
}

/// Vector-Jacobian product of [`shares`] at its output `w`: adds to the gradients of the logits.
#[inline(always)]
fn shares_vjp<T: Real>(w: &[T], floor: T, g: &[T], logits: &mut [T]) {
    // With s = (w - floor) / (1 - n floor), the factor of s cancels against that of dw/ds.
    let rest = T::one() - T::of(w.len() as f64) * floor;
    let mean = w.iter().zip(g).map(|(w, g)| (*w - floor) / rest * *g).sum::<T>();
    for ((l, w), g) in logits.iter_mut().zip(w).zip(g) {
        *l += (*w - floor) * (*g - mean);
    }
}

/// The last of the `n` bins between ascending `knots`, whose first is zero, that begins at or below `x`; behind the knots
/// stand infinities.
#[inline(always)]
fn bin<T: Real>(knots: &[T; KNOTS], n: usize, x: T) -> usize {
    // Without branches: the count of knots at or below x.
    let mut count = [0_u32; LANES];
    for knots in &knots.as_chunks::<LANES>().0[..(n + 1).div_ceil(LANES)] {
        for k in 0..LANES {
            count[k] += u32::from(knots[k] <= x);
        }
    }
    (count.iter().sum::<u32>().saturating_sub(1) as usize).min(n - 1)
}

#[cfg(test)]
mod tests;
