//! Best endpoints for given weights.

use crate::uastc::fit::{Channel, Ends, Set, sum};
use crate::uastc::range::Range;

/// Best endpoints for given interpolation weights (0..=64), and the coefficients (low, mixed, high)
/// of the squared error's growth around them. `None` where the weights do not
/// determine two endpoints.
pub(crate) fn best_ends<const C: usize>(
    set: &Set<'_, C>,
    interpolation: &Channel,
) -> Option<(Ends<C>, [f32; 3])> {
    let (mut far, mut near) = ([0.0; 16], [0.0; 16]);
    for i in 0..16 {
        let t = interpolation[i] * (1.0 / 64.0);
        far[i] = t * set.mask[i];
        near[i] = (1.0 - t) * set.mask[i];
    }
    let low = sum(|i| near[i] * near[i]);
    let mixed = sum(|i| near[i] * far[i]);
    let high = sum(|i| far[i] * far[i]);
    let determinant = low * high - mixed * mixed;
    if determinant < 1e-4 {
        return None;
    }
    let scale = 1.0 / determinant;
    let mut ends = [[0.0; C]; 2];
    for c in 0..C {
        let to_low = sum(|i| near[i] * set.channels[c][i]);
        let to_high = sum(|i| far[i] * set.channels[c][i]);
        ends[0][c] = (high * to_low - mixed * to_high) * scale;
        ends[1][c] = (low * to_high - mixed * to_low) * scale;
    }
    Some((ends, [low, mixed, high]))
}

/// Ranks around the unrounded endpoints that raise the error least.
pub(crate) fn round_ends<const C: usize>(
    range: &Range,
    ends: &Ends<C>,
    [low, mixed, high]: [f32; 3],
) -> [[u8; C]; 2] {
    let mut out = [[0; C]; 2];
    for c in 0..C {
        // Decoders multiply by 257/256 and cut: a value between endpoints comes
        // out lower by half at 0 and higher by half at 255. Half of that, since
        // texels at an endpoint itself come out exact.
        let [low_end, high_end] = [ends[0][c], ends[1][c]].map(|e| e + 0.249 - e * (0.249 / 128.0));
        let (first, a) = around(range, low_end);
        let (second, b) = around(range, high_end);
        let growth = |i: usize, j: usize| (low * a[i] + 2.0 * mixed * b[j]) * a[i] + high * b[j] * b[j];
        let below = [growth(0, 0), growth(0, 1)];
        let above = [growth(1, 0), growth(1, 1)];
        let pick = [usize::from(below[1] < below[0]), usize::from(above[1] < above[0])];
        let side = usize::from(above[pick[1]] < below[pick[0]]);
        out[0][c] = first[side];
        out[1][c] = second[pick[side]];
    }
    out
}

/// Ranks below and above a value, and how far their values lie from it.
#[inline(always)]
fn around(range: &Range, value: f32) -> ([u8; 2], [f32; 2]) {
    let below = range.floor[usize::from(value as u8)];
    let above = (usize::from(below) + 1).min(range.levels - 1) as u8;
    let ranks = [below, above];
    (ranks, ranks.map(|r| f32::from(range.value[usize::from(r)]) - value))
}
