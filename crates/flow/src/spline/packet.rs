//! Splines of many vertices, one in each lane of a vector: the same operations in the same order as one by one, to the same bits.

use super::quadratic::{LOGIT_MIN, Piece, floor};
use super::{Family, KNOTS, LANES, Rational, SHARE_LOGIT_MIN};
use crate::elementary::exp;
use crate::network::PACKET;
use photofit_scalar::Real;

/// A number of each vertex.
type Lanes<T> = [T; PACKET];

/// Warps `x` by the spline of each lane's logits, forward or by the inverse, and gives the slopes `du/dx`.
#[inline(always)]
pub(crate) fn warp_packet<T: Real, const FORWARD: bool>(
    family: Family,
    bins: usize,
    logits: &[Lanes<T>],
    x: &mut Lanes<T>,
) -> Lanes<T> {
    match family {
        Family::Quadratic => quadratic::<T, FORWARD>(bins, logits, x),
        Family::Rational => one_by_one::<T, FORWARD>(bins, logits, x),
    }
}

/// Rational splines one by one: their slopes call for logarithms of the library.
#[inline(always)]
fn one_by_one<T: Real, const FORWARD: bool>(bins: usize, logits: &[Lanes<T>], x: &mut Lanes<T>) -> Lanes<T> {
    let mut slopes = [T::one(); PACKET];
    for (l, (x, slope)) in x.iter_mut().zip(&mut slopes).enumerate() {
        let mut own = [T::zero(); 3 * KNOTS];
        for (to, from) in own.iter_mut().zip(logits) {
            *to = from[l];
        }
        let spline = Rational::new(bins, &own[..logits.len().min(3 * KNOTS)]);
        (*x, *slope) = if FORWARD { spline.forward(*x) } else { spline.inverse(*x) };
    }
    slopes
}

/// See [`super::Quadratic`].
#[inline(always)]
fn quadratic<T: Real, const FORWARD: bool>(bins: usize, logits: &[Lanes<T>], x: &mut Lanes<T>) -> Lanes<T> {
    let zero = [T::zero(); PACKET];
    let (mut w, mut v) = ([zero; KNOTS], [zero; KNOTS]);
    shares(&logits[..bins], floor(bins), &mut w);
    exponentials(&logits[bins..=2 * bins], T::of(LOGIT_MIN), &mut v);
    // Knots and the distribution at them.
    let (mut knots, mut masses) = ([zero; KNOTS], [zero; KNOTS]);
    for b in 0..bins {
        for l in 0..PACKET {
            let area = T::of(0.5) * (v[b][l] + v[b + 1][l]) * w[b][l];
            knots[b + 1][l] = knots[b][l] + w[b][l];
            masses[b + 1][l] = masses[b][l] + area;
        }
    }
    let mut scale = zero;
    for l in 0..PACKET {
        scale[l] = T::one() / masses[bins][l];
    }
    for k in 0..=bins {
        for l in 0..PACKET {
            v[k][l] *= scale[l];
            masses[k][l] *= scale[l];
        }
    }
    (knots[bins], masses[bins]) = ([T::one(); PACKET], [T::one(); PACKET]);
    // The count of knots at or below x.
    let mut count = [0_u32; PACKET];
    for knots in &(if FORWARD { &knots } else { &masses })[..=bins] {
        for l in 0..PACKET {
            count[l] += u32::from(knots[l] <= x[l]);
        }
    }
    let mut pieces = Piece { x: zero, c: zero, w: zero, v: [zero; 2] };
    for l in 0..PACKET {
        let b = (count[l].saturating_sub(1) as usize).min(bins - 1);
        (pieces.x[l], pieces.c[l], pieces.w[l]) = (knots[b][l], masses[b][l], w[b][l]);
        (pieces.v[0][l], pieces.v[1][l]) = (v[b][l], v[b + 1][l]);
    }
    let mut slopes = zero;
    for l in 0..PACKET {
        let v = [pieces.v[0][l], pieces.v[1][l]];
        let piece = Piece { x: pieces.x[l], c: pieces.c[l], w: pieces.w[l], v };
        (x[l], slopes[l]) = if FORWARD { piece.forward(x[l]) } else { piece.inverse(x[l]) };
    }
    slopes
}

/// [`super::exponentials`] of the logits of each lane.
#[inline(always)]
fn exponentials<T: Real>(logits: &[Lanes<T>], least: T, out: &mut [Lanes<T>; KNOTS]) {
    let mut largest = [T::neg_infinity(); PACKET];
    for logit in logits {
        for l in 0..PACKET {
            largest[l] = if logit[l] > largest[l] { logit[l] } else { largest[l] };
        }
    }
    for (out, logit) in out.iter_mut().zip(logits) {
        for l in 0..PACKET {
            let below = logit[l] - largest[l];
            out[l] = exp(if below < least { least } else { below });
        }
    }
}

/// [`super::shares`] of the logits of each lane.
#[inline(always)]
fn shares<T: Real>(logits: &[Lanes<T>], floor: T, out: &mut [Lanes<T>; KNOTS]) {
    exponentials(logits, T::of(SHARE_LOGIT_MIN), out);
    // The order of sums of one vertex: vectors, then halves of one.
    let (low, high) = out.split_at(LANES);
    let mut sums = [[T::zero(); PACKET]; LANES];
    for k in 0..LANES {
        for l in 0..PACKET {
            sums[k][l] = low[k][l] + high[k][l];
        }
    }
    let mut half = LANES / 2;
    while half > 0 {
        for k in 0..half {
            for l in 0..PACKET {
                sums[k][l] += sums[k + half][l];
            }
        }
        half /= 2;
    }
    let mut scale = [T::zero(); PACKET];
    for l in 0..PACKET {
        scale[l] = (T::one() - T::of(logits.len() as f64) * floor) / sums[0][l];
    }
    for out in &mut out[..logits.len()] {
        for l in 0..PACKET {
            out[l] = floor + out[l] * scale[l];
        }
    }
}
