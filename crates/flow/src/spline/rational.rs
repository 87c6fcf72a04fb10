//! The piecewise rational quadratic distribution.

use super::{BINS_MAX, KNOTS, bin, padded, shares, shares_vjp};
use crate::elementary::exp;
use photofit_scalar::Real;

/// Least width and height of a bin, as a share of a uniform one, and least density at a knot.
const SHARE_MIN: f64 = 1e-2;
const SLOPE_MIN: f64 = 1e-3;
/// Logit of a density of 1 at a knot: `SLOPE_MIN + ln(1 + e^l) = 1`.
const SLOPE_ONE: f64 = 0.539_743;

/// A monotone rational quadratic spline (Gregory and Delbourgo 1982; Durkan et al. 2019, "Neural Spline Flows").
///
/// Logits: `K` of the widths, `K` of the heights, `K + 1` of the slopes at the knots (zero: slope 1). In a bin of width
/// `w`, height `h`, slopes `d` at its ends and `s = h / w`, with `a` the place in the bin:
/// `u = C_b + h (s a^2 + d_0 a (1 - a)) / (s + (d_0 + d_1 - 2 s) a (1 - a))`.
#[derive(Clone, Debug)]
pub struct Rational<T> {
    bins: usize,
    w: [T; KNOTS],
    h: [T; KNOTS],
    d: [T; BINS_MAX + 1],
    /// Knots, and the distribution at them; infinities behind them.
    x: [T; KNOTS],
    c: [T; KNOTS],
    /// Derivatives of the slopes by their logits.
    d_logit: [T; BINS_MAX + 1],
}

/// The map in one bin of width `w`, height `h` and end slopes `d`.
#[derive(Clone, Copy)]
struct Piece<T> {
    w: T,
    h: T,
    d: [T; 2],
}

impl<T: Real> Piece<T> {
    /// Rise above the bin's left end, and the slope, at `a` in `[0, 1]`.
    #[inline(always)]
    fn at(self, a: T) -> (T, T) {
        let (s, q) = (self.h / self.w, a * (T::one() - a));
        let b = T::one() - a;
        let denominator = s + (self.d[0] + self.d[1] - T::of(2.0) * s) * q;
        let numerator = s * a * a + self.d[0] * q;
        let slope = s * s * (self.d[1] * a * a + T::of(2.0) * s * q + self.d[0] * b * b);
        (self.h * numerator / denominator, slope / (denominator * denominator))
    }

    /// Gradients of `w`, `h`, `d_0`, `d_1` and `a` for those of the rise and of the logarithm of the slope.
    fn vjp(self, a: T, g_rise: T, g_ln: T) -> [T; 5] {
        let two = T::of(2.0);
        let (s, q, b) = (self.h / self.w, a * (T::one() - a), T::one() - a);
        let [d0, d1] = self.d;
        let den = s + (d0 + d1 - two * s) * q;
        let num = s * a * a + d0 * q;
        let top = d1 * a * a + two * s * q + d0 * b * b;
        // rise = h num / den; ln slope = 2 ln s + ln top - 2 ln den.
        let (g_num, g_top) = (g_rise * self.h / den, g_ln / top);
        let g_den = -g_rise * self.h * num / (den * den) - two * g_ln / den;
        let g_s = two * g_ln / s + g_num * a * a + g_top * two * q + g_den * (T::one() - two * q);
        let g_q = g_num * d0 + g_top * two * s + g_den * (d0 + d1 - two * s);
        let g_d0 = g_num * q + g_top * b * b + g_den * q;
        let g_d1 = g_top * a * a + g_den * q;
        let g_a = g_num * two * s * a + g_top * two * (d1 * a - d0 * b) + g_q * (T::one() - two * a);
        [-g_s * s / self.w, g_rise * num / den + g_s / self.w, g_d0, g_d1, g_a]
    }
}

impl<T: Real> Rational<T> {
    /// The spline of `3 bins + 1` logits.
    ///
    /// # Panics
    /// As [`super::Spline::new`].
    #[inline(always)]
    pub fn new(bins: usize, logits: &[T]) -> Self {
        assert!(
            (1..=BINS_MAX).contains(&bins) && logits.len() > 3 * bins,
            "{} logits of {bins} bins",
            logits.len()
        );
        let zero = T::zero();
        let (mut w, mut h) = ([zero; KNOTS], [zero; KNOTS]);
        let (mut d, mut d_logit) = ([zero; BINS_MAX + 1], [zero; BINS_MAX + 1]);
        let (mut x, mut c) = ([T::infinity(); KNOTS], [T::infinity(); KNOTS]);
        let vectors = padded(logits);
        shares(&vectors, 0, bins, floor(bins), &mut w);
        shares(&vectors, bins, bins, floor(bins), &mut h);
        for (i, l) in logits[2 * bins..=3 * bins].iter().enumerate() {
            let l = *l + T::of(SLOPE_ONE);
            let e = exp(-l.abs());
            d[i] = T::of(SLOPE_MIN) + l.relu() + e.ln_1p();
            d_logit[i] = if l > zero { T::one() / (T::one() + e) } else { e / (T::one() + e) };
        }
        (x[0], c[0]) = (zero, zero);
        for b in 0..bins {
            x[b + 1] = x[b] + w[b];
            c[b + 1] = c[b] + h[b];
        }
        (x[bins], c[bins]) = (T::one(), T::one());
        Self { bins, w, h, d, x, c, d_logit }
    }

    #[inline(always)]
    fn piece(&self, b: usize) -> Piece<T> {
        Piece { w: self.w[b], h: self.h[b], d: [self.d[b], self.d[b + 1]] }
    }

    /// `(u, du/dx)`.
    #[inline(always)]
    pub fn forward(&self, x: T) -> (T, T) {
        let b = bin(&self.x, self.bins, x);
        let a = ((x - self.x[b]) / self.w[b]).clamp_to(T::zero(), T::one());
        let (rise, slope) = self.piece(b).at(a);
        ((self.c[b] + rise).clamp_to(T::zero(), T::one()), slope)
    }

    /// `(x, du/dx)` at `u`, by the root of the quadratic that does not cancel.
    #[inline(always)]
    pub fn inverse(&self, u: T) -> (T, T) {
        let b = bin(&self.c, self.bins, u);
        let y = (u - self.c[b]).clamp_to(T::zero(), self.h[b]);
        let piece = self.piece(b);
        let (s, [d0, d1]) = (piece.h / piece.w, piece.d);
        let bend = y * (d0 + d1 - T::of(2.0) * s);
        let (qa, qb, qc) = (piece.h * (s - d0) + bend, piece.h * d0 - bend, -s * y);
        let root = (qb * qb - T::of(4.0) * qa * qc).max(T::zero()).sqrt();
        let a = (T::of(-2.0) * qc / (qb + root)).clamp_to(T::zero(), T::one());
        ((self.x[b] + a * piece.w).clamp_to(T::zero(), T::one()), piece.at(a).1)
    }

    /// See [`super::Spline::forward_vjp`].
    #[inline(always)]
    pub fn forward_vjp(&self, x: T, [g_u, g_ln]: [T; 2], logits: &mut [T]) -> T {
        let k = self.bins;
        let b = bin(&self.x, k, x);
        let a = ((x - self.x[b]) / self.w[b]).clamp_to(T::zero(), T::one());
        let [mut g_width, g_height, g_d0, g_d1, g_a] = self.piece(b).vjp(a, g_u, g_ln);
        let g_x = g_a / self.w[b];
        g_width -= g_x * a;
        let (mut g_w, mut g_h) = ([T::zero(); BINS_MAX], [T::zero(); BINS_MAX]);
        (g_w[b], g_h[b]) = (g_width, g_height);
        g_w[..b].fill(-g_x);
        g_h[..b].fill(g_u);
        shares_vjp(&self.w[..k], floor(k), &g_w, &mut logits[..k]);
        shares_vjp(&self.h[..k], floor(k), &g_h, &mut logits[k..2 * k]);
        logits[2 * k + b] += g_d0 * self.d_logit[b];
        logits[2 * k + b + 1] += g_d1 * self.d_logit[b + 1];
        g_x
    }
}

fn floor<T: Real>(bins: usize) -> T {
    T::of(SHARE_MIN / bins as f64)
}
