//! Nearest weights for given endpoints.

use crate::uastc::axis::square_norm;
use crate::uastc::fit::{Fit, Set, sum};
use crate::uastc::range::Range;

/// Rounding to the nearest whole number for values far below 2^22.
#[inline(always)]
fn whole(value: f32) -> f32 {
    const SHIFT: f32 = 12_582_912.0;
    (value + SHIFT) - SHIFT
}

/// Stored weights per unit of interpolation weight, in the lower half.
#[inline(always)]
const fn per_unit<const BITS: u32>() -> f32 {
    [0.0, 0.0, 1.0 / 21.0, 1.0 / 9.0, 7.0 / 29.0, 0.5][BITS as usize]
}

/// Interpolation weight of a stored weight in the lower half.
#[inline(always)]
fn lower_ramp<const BITS: u32>(stored: f32) -> f32 {
    match BITS {
        1 => 0.0,
        2 => 21.0 * stored,
        3 => 9.0 * stored,
        4 => 4.0 * stored + if stored > 3.5 { 1.0 } else { 0.0 },
        _ => 2.0 * stored,
    }
}

/// Interpolation weight, 0..=64, of a stored weight.
#[inline(always)]
pub(crate) fn ramp<const BITS: u32>(stored: f32) -> f32 {
    let top = ((1u32 << BITS) - 1) as f32;
    let upper = stored * 2.0 > top;
    let value = lower_ramp::<BITS>(if upper { top - stored } else { stored });
    if upper { 64.0 - value } else { value }
}

/// Nearest weights for given endpoints, and the error they leave.
pub(crate) fn assign<const C: usize, const BITS: u32>(
    set: &Set<'_, C>,
    range: &Range,
    ends: [[u8; C]; 2],
) -> Fit<C> {
    let (mut low, mut step) = ([0.0; C], [0.0; C]);
    for c in 0..C {
        low[c] = f32::from(range.value[usize::from(ends[0][c])]);
        step[c] = f32::from(range.value[usize::from(ends[1][c])]) - low[c];
    }
    let norm = square_norm(&step, set.metric);
    let top = ((1u32 << BITS) - 1) as f32;
    let last = ((1u32 << BITS) / 2 - 1) as f32;
    let mut along = [0.0; 16];
    if norm > 0.0 {
        for c in 0..C {
            let factor = step[c] * set.metric[c] * 64.0 / norm;
            for i in 0..16 {
                along[i] += (set.channels[c][i] - low[c]) * factor;
            }
        }
    }
    // Weights mirror each other about 32; in a half they are evenly spaced
    // but for the gap in the middle (and, of four bits, parts of a unit).
    let mut weights = [0.0; 16];
    let mut interpolation = [0.0; 16];
    for i in 0..16 {
        let t = along[i];
        let mirrored = 64.0 - t;
        let upper = t > 32.0;
        let near = if upper { mirrored } else { t };
        let near = if near > 0.0 { near } else { 0.0 };
        let stored = whole(near * per_unit::<BITS>());
        let stored = if stored < last { stored } else { last };
        let value = lower_ramp::<BITS>(stored);
        weights[i] = if upper { top - stored } else { stored };
        interpolation[i] = if upper { 64.0 - value } else { value };
    }
    // A decoder takes floor(n / 2^14) of n = 257 (64 low + step weight) + 32;
    // all terms below are exact in 24 bits.
    let mut errors = [0.0; 16];
    for c in 0..C {
        let origin = (low[c] * (257.0 * 64.0) + (32.0 - 8191.5)) / 16384.0;
        let slope = step[c] * (257.0 / 16384.0);
        for i in 0..16 {
            let value = whole(origin + slope * interpolation[i]);
            let difference = value - set.channels[c][i];
            errors[i] += set.metric[c] * difference * difference;
        }
    }
    Fit { ends, weights, error: sum(|i| errors[i] * set.mask[i]) }
}
