//! The piecewise linear density with its piecewise quadratic distribution.

use super::{BINS_MAX, KNOTS, bin, exponentials, padded, shares, shares_vjp};
use photofit_scalar::Real;

/// Least width of a bin, as a share of a uniform one.
const WIDTH_MIN: f64 = 1e-3;
/// Least logit of the density below the largest: far from zero, where logarithms and roots lose their digits.
pub(super) const LOGIT_MIN: f64 = -20.0;

/// A bin: its left end and the distribution there, its width, the density at both ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece<T> {
    pub(super) x: T,
    pub(super) c: T,
    pub(super) w: T,
    pub(super) v: [T; 2],
}

impl<T: Real> Piece<T> {
    /// `(u, du/dx)`.
    #[inline(always)]
    pub(super) fn forward(self, x: T) -> (T, T) {
        let a = ((x - self.x) / self.w).clamp_to(T::zero(), T::one());
        let rise = self.v[1] - self.v[0];
        let u = self.c + self.w * a * (self.v[0] + T::of(0.5) * rise * a);
        (u.clamp_to(T::zero(), T::one()), self.v[0] + rise * a)
    }

    /// `(x, du/dx)` at `u`, by the root of the quadratic that does not cancel.
    #[inline(always)]
    pub(super) fn inverse(self, u: T) -> (T, T) {
        let y = (u - self.c).max(T::zero());
        let rise = self.v[1] - self.v[0];
        let linear = self.v[0] * self.w;
        let square = rise * self.w;
        let root = (linear * linear + T::of(2.0) * square * y).max(T::zero()).sqrt();
        let a = (T::of(2.0) * y / (linear + root)).clamp_to(T::zero(), T::one());
        ((self.x + a * self.w).clamp_to(T::zero(), T::one()), self.v[0] + rise * a)
    }
}

/// A density on `[0, 1]` that is linear in each of `K` bins (Müller et al. 2019, "Neural Importance Sampling").
///
/// Logits: `K` of the widths `w`, then `K + 1` of the density at the knots, `v_i = e^(v^_i) / Z` where `Z` makes the
/// integral 1. In bin `b`, with `a = (x - X_b) / w_b`: `u = C_b + w_b (v_b a + (v_(b+1) - v_b) a^2 / 2)`.
#[derive(Clone, Debug)]
pub struct Quadratic<T> {
    bins: usize,
    /// Widths; zeros behind them.
    w: [T; KNOTS],
    /// Density at the knots; zeros behind them.
    v: [T; KNOTS],
    /// Knots, and the distribution at them; infinities behind them.
    x: [T; KNOTS],
    c: [T; KNOTS],
}

impl<T: Real> Quadratic<T> {
    /// The density of `2 bins + 1` logits.
    ///
    /// # Panics
    /// As [`super::Spline::new`].
    #[inline(always)]
    pub fn new(bins: usize, logits: &[T]) -> Self {
        assert!(
            (1..=BINS_MAX).contains(&bins) && logits.len() > 2 * bins,
            "{} logits of {bins} bins",
            logits.len()
        );
        let logits = padded(logits);
        let (mut w, mut v) = ([T::zero(); KNOTS], [T::zero(); KNOTS]);
        let (mut x, mut c) = ([T::infinity(); KNOTS], [T::infinity(); KNOTS]);
        shares(&logits, 0, bins, floor(bins), &mut w);
        exponentials(&logits, bins, bins + 1, T::of(LOGIT_MIN), &mut v);
        let mut area = [T::zero(); KNOTS];
        for b in 0..BINS_MAX {
            area[b] = T::of(0.5) * (v[b] + v[b + 1]) * w[b];
        }
        let (mut at, mut mass) = (T::zero(), T::zero());
        (x[0], c[0]) = (at, mass);
        for b in 0..bins {
            (at, mass) = (at + w[b], mass + area[b]);
            (x[b + 1], c[b + 1]) = (at, mass);
        }
        let scale = T::one() / mass;
        for k in 0..KNOTS {
            v[k] *= scale;
            c[k] *= scale;
        }
        (x[bins], c[bins]) = (T::one(), T::one());
        Self { bins, w, v, x, c }
    }

    /// `(u, du/dx)`.
    #[inline(always)]
    pub fn forward(&self, x: T) -> (T, T) {
        self.piece(bin(&self.x, self.bins, x)).forward(x)
    }

    /// `(x, du/dx)` at `u`.
    #[inline(always)]
    pub fn inverse(&self, u: T) -> (T, T) {
        self.piece(bin(&self.c, self.bins, u)).inverse(u)
    }

    #[inline(always)]
    fn piece(&self, b: usize) -> Piece<T> {
        Piece { x: self.x[b], c: self.c[b], w: self.w[b], v: [self.v[b], self.v[b + 1]] }
    }

    /// See [`super::Spline::forward_vjp`].
    #[inline(always)]
    pub fn forward_vjp(&self, x: T, [g_u, g_ln]: [T; 2], logits: &mut [T]) -> T {
        let (k, half) = (self.bins, T::of(0.5));
        let b = bin(&self.x, k, x);
        let (w, v0, v1) = (self.w[b], self.v[b], self.v[b + 1]);
        let a = ((x - self.x[b]) / w).clamp_to(T::zero(), T::one());
        let rise = v1 - v0;
        let p = v0 + rise * a;
        let t = a * (v0 + half * rise * a);
        let (mut g_w, mut g_v) = ([T::zero(); BINS_MAX], [T::zero(); BINS_MAX + 1]);
        let slope = g_ln * rise / (p * w);
        let g_x = g_u * p + slope;
        g_w[b] += g_u * (t - a * p) - slope * a;
        g_v[b] += g_u * w * (a - half * a * a) + g_ln * (T::one() - a) / p;
        g_v[b + 1] += g_u * w * half * a * a + g_ln * a / p;
        for j in 0..b {
            g_w[j] += g_u * half * (self.v[j] + self.v[j + 1]) - g_x;
            g_v[j] += g_u * half * self.w[j];
            g_v[j + 1] += g_u * half * self.w[j];
        }
        // The integral is 1 whatever the widths and heights.
        let total = g_v.iter().zip(&self.v).take(k + 1).map(|(g, v)| *g * *v).sum::<T>();
        for j in 0..k {
            g_w[j] -= total * half * (self.v[j] + self.v[j + 1]);
        }
        for i in 0..=k {
            let left = if i > 0 { self.w[i - 1] } else { T::zero() };
            let right = if i < k { self.w[i] } else { T::zero() };
            logits[k + i] += self.v[i] * (g_v[i] - total * half * (left + right));
        }
        shares_vjp(&self.w[..k], floor(k), &g_w, &mut logits[..k]);
        g_x
    }
}

pub(super) fn floor<T: Real>(bins: usize) -> T {
    T::of(WIDTH_MIN / bins as f64)
}
