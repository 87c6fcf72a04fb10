//! Least-squares fit of two endpoints and a weight per texel.
//!
//! A set of texels is approached by points on a line between two endpoints.
//! The start is the principal axis of the set; rounds of "nearest weights for
//! the endpoints" and "best endpoints for the weights" follow. Endpoints are
//! rounded to the mode's range jointly: of the values around the unrounded
//! optimum, those that raise the squared error least. Errors are those of
//! decoded texels, rounding included.

use crate::uastc::ends::{best_ends, round_ends};
use crate::uastc::range::Range;
use crate::uastc::weights::{assign, ramp};

/// One channel of a block's texels.
pub(crate) type Channel = [f32; 16];

/// A sum over 16 texels, in four lanes so that it can be vectorized; the
/// order of additions is fixed.
#[inline(always)]
pub(crate) fn sum(f: impl Fn(usize) -> f32) -> f32 {
    let mut lanes = [0.0; 4];
    for k in 0..4 {
        for (j, lane) in lanes.iter_mut().enumerate() {
            *lane += f(4 * k + j);
        }
    }
    (lanes[0] + lanes[2]) + (lanes[1] + lanes[3])
}

/// Texels to be fitted by one line: `C` channels and who takes part.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Set<'a, const C: usize> {
    /// Channels of all 16 texels.
    pub(crate) channels: &'a [Channel; C],
    /// 1 for texels of the set, 0 for others.
    pub(crate) mask: &'a Channel,
    /// Factor of each channel's squared error.
    pub(crate) metric: &'a [f32; C],
}

/// Unrounded endpoints.
pub(crate) type Ends<const C: usize> = [[f32; C]; 2];

/// Endpoints (as ranks of the range), stored weights and squared error.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fit<const C: usize> {
    /// Ranks of the low and the high endpoint.
    pub(crate) ends: [[u8; C]; 2],
    /// Stored weight of each texel; of no meaning outside of the set.
    pub(crate) weights: Channel,
    /// Squared error of the decoded texels over the set.
    pub(crate) error: f32,
}

/// Fits a set in weights of `BITS` bits and endpoints of `range`, from
/// `start`, in at most `rounds` rounds.
pub(crate) fn fit<const C: usize, const BITS: u32>(
    set: &Set<'_, C>,
    range: &Range,
    start: &Ends<C>,
    rounds: u32,
) -> Fit<C> {
    // Until there are weights, they are taken as evenly spread.
    let mut ends = round_ends(range, start, [2.0, 1.0, 2.0]);
    let mut best = assign::<C, BITS>(set, range, ends);
    let mut last = best;
    for _ in 1..rounds {
        if last.error <= 0.0 {
            break;
        }
        let Some((optimum, form)) = best_ends(set, &last.weights.map(ramp::<BITS>)) else { break };
        let next = round_ends(range, &optimum, form);
        if next == ends {
            break;
        }
        ends = next;
        last = assign::<C, BITS>(set, range, ends);
        if last.error < best.error {
            best = last;
        } else {
            break;
        }
    }
    best
}

/// Betters a fit by single steps of endpoint ranks, as long as steps help.
pub(crate) fn polish<const C: usize, const BITS: u32>(set: &Set<'_, C>, range: &Range, best: &mut Fit<C>) {
    const STEPS: [[i32; 2]; 8] = [[1, 0], [-1, 0], [0, 1], [0, -1], [1, -1], [-1, 1], [1, 1], [-1, -1]];
    let top = range.levels as i32 - 1;
    let mut idle = 0;
    let mut turn = 0;
    while idle < 8 * C && best.error > 0.0 {
        let c = turn % C;
        let [a, b] = STEPS[turn / C % 8];
        turn += 1;
        idle += 1;
        let mut ends = best.ends;
        ends[0][c] = (i32::from(ends[0][c]) + a).clamp(0, top) as u8;
        ends[1][c] = (i32::from(ends[1][c]) + b).clamp(0, top) as u8;
        let next = assign::<C, BITS>(set, range, ends);
        if next.error < best.error {
            *best = next;
            idle = 0;
        }
    }
}
