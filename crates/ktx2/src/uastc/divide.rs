//! Choice of partition patterns: an estimate, for all patterns at once, of
//! what a line through each subset would leave of the texels' scatter.

use crate::uastc::fit::{Channel, sum};
use crate::uastc::partition::{PATTERNS_2, PATTERNS_3, PATTERNS_7, Pattern};

/// Patterns of [`PATTERNS_2`] then [`PATTERNS_7`], padded to whole vectors.
const LANES: usize = 52;
/// Number of true patterns among the lanes.
const PATTERNS: usize = PATTERNS_2.len() + PATTERNS_7.len();

/// For each four patterns and texel, 1 where the texel is in subset 1.
static MASKS: [[Lanes; 16]; LANES / 4] = {
    let mut masks = [[[0.0; 4]; 16]; LANES / 4];
    let mut lane = 0;
    while lane < PATTERNS {
        let pattern = at(lane);
        let mut texel = 0;
        while texel < 16 {
            masks[lane / 4][texel][lane % 4] = pattern[texel] as f32;
            texel += 1;
        }
        lane += 1;
    }
    masks
};

/// One over the number of texels in subsets 1 and 0; for padding, of which
/// the result is not looked at, any finite number.
static SHARES: [[Lanes; 2]; LANES / 4] = {
    let mut shares = [[[1.0; 4]; 2]; LANES / 4];
    let mut lane = 0;
    while lane < PATTERNS {
        let pattern = at(lane);
        let mut count = 0.0;
        let mut texel = 0;
        while texel < 16 {
            count += pattern[texel] as f32;
            texel += 1;
        }
        shares[lane / 4][0][lane % 4] = 1.0 / count;
        shares[lane / 4][1][lane % 4] = 1.0 / (16.0 - count);
        lane += 1;
    }
    shares
};

const fn at(lane: usize) -> Pattern {
    if lane < PATTERNS_2.len() { PATTERNS_2[lane] } else { PATTERNS_7[lane - PATTERNS_2.len()] }
}

/// A two-subset pattern and the scatter that it would leave.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Division {
    /// Whether the pattern is of the list of mode 7.
    pub(crate) seventh: bool,
    /// Place in its list.
    pub(crate) index: u8,
    /// Estimate of the squared error with unrounded lines.
    pub(crate) error: f32,
}

/// The best `N` two-subset patterns, best first.
pub(crate) fn two_subsets<const C: usize, const N: usize>(
    channels: &[Channel; C],
    metric: &[f32; C],
    with_seventh: bool,
) -> [Division; N] {
    let lanes = if with_seventh { PATTERNS } else { PATTERNS_2.len() };
    let errors = residuals(channels, metric, lanes.div_ceil(4));
    let mut best = [Division { seventh: false, index: 0, error: f32::MAX }; N];
    for (lane, &error) in errors[..lanes].iter().enumerate() {
        if error >= best[N - 1].error {
            continue;
        }
        let place = best.iter().position(|b| error < b.error).unwrap_or(N - 1);
        best.copy_within(place..N - 1, place + 1);
        let seventh = lane >= PATTERNS_2.len();
        let index = if seventh { lane - PATTERNS_2.len() } else { lane } as u8;
        best[place] = Division { seventh, index, error };
    }
    best
}

/// The best three-subset pattern and its estimated error.
pub(crate) fn three_subsets(channels: &[Channel; 3]) -> (u8, f32) {
    let mut best = (0, f32::MAX);
    for (index, pattern) in PATTERNS_3.iter().enumerate() {
        let error = (0..3u8)
            .map(|subset| {
                let members = |i: usize| f32::from(u8::from(pattern[i] == subset));
                let count = sum(members);
                let mean = [0, 1, 2].map(|c| sum(|i| members(i) * channels[c][i]) / count);
                let pair = |a: usize, b: usize| {
                    sum(|i| members(i) * (channels[a][i] - mean[a]) * (channels[b][i] - mean[b]))
                };
                let mut matrix = [[[0.0; 4]; 3]; 3];
                for a in 0..3 {
                    for b in 0..=a {
                        matrix[a][b] = [pair(a, b); 4];
                    }
                }
                off_axis(&matrix)[0]
            })
            .sum();
        if error < best.1 {
            best = (index as u8, error);
        }
    }
    best
}

/// Scatter off the principal axis for scatter matrices (lower halves), one
/// per lane: the trace less an estimate of the greatest eigenvalue,
/// (sum l^4 / sum l^2)^1/2.
#[inline(always)]
fn off_axis<const C: usize>(matrix: &[[Lanes; C]; C]) -> Lanes {
    let (mut trace, mut second, mut fourth) = ([0.0; 4], [1e-9; 4], [0.0; 4]);
    for a in 0..C {
        trace = add(trace, matrix[a][a]);
        for b in 0..=a {
            // Element of the square of the matrix.
            let mut square = [0.0; 4];
            for k in 0..C {
                let left = if k <= a { matrix[a][k] } else { matrix[k][a] };
                let right = if k <= b { matrix[b][k] } else { matrix[k][b] };
                square = add(square, mul(left, right));
            }
            let power = mul(square, square);
            fourth = add(fourth, power);
            if a == b {
                second = add(second, square);
            } else {
                fourth = add(fourth, power);
            }
        }
    }
    let mut rest = [0.0; 4];
    for j in 0..4 {
        let off = trace[j] - (fourth[j] / second[j]).sqrt();
        rest[j] = if off > 0.0 { off } else { 0.0 };
    }
    rest
}

/// Four patterns side by side.
type Lanes = [f32; 4];

#[inline(always)]
fn add(a: Lanes, b: Lanes) -> Lanes {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]]
}

#[inline(always)]
fn sub(a: Lanes, b: Lanes) -> Lanes {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]]
}

#[inline(always)]
fn mul(a: Lanes, b: Lanes) -> Lanes {
    [a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3]]
}

/// Estimated error of the first `4 * chunks` patterns.
fn residuals<const C: usize>(channels: &[Channel; C], metric: &[f32; C], chunks: usize) -> [f32; LANES] {
    let mut centred = [[0.0; 16]; C];
    let mut whole = [[[0.0; 4]; C]; C];
    for a in 0..C {
        let mean = sum(|i| channels[a][i]) * (1.0 / 16.0);
        let factor = metric[a].sqrt();
        for i in 0..16 {
            centred[a][i] = (channels[a][i] - mean) * factor;
        }
        for b in 0..=a {
            whole[a][b] = [sum(|i| centred[a][i] * centred[b][i]); 4];
        }
    }
    let mut out = [0.0; LANES];
    for chunk in 0..chunks {
        let mut first = [[0.0; 4]; C];
        let mut second = [[[0.0; 4]; C]; C];
        for (i, mask) in MASKS[chunk].iter().enumerate() {
            for a in 0..C {
                let member = mul([centred[a][i]; 4], *mask);
                first[a] = add(first[a], member);
                for b in 0..=a {
                    second[a][b] = add(second[a][b], mul(member, [centred[b][i]; 4]));
                }
            }
        }
        let [inside, outside] = SHARES[chunk];
        let mut one = [[[0.0; 4]; C]; C];
        let mut other = [[[0.0; 4]; C]; C];
        for a in 0..C {
            for b in 0..=a {
                let product = mul(first[a], first[b]);
                one[a][b] = sub(second[a][b], mul(product, inside));
                other[a][b] = sub(sub(whole[a][b], second[a][b]), mul(product, outside));
            }
        }
        let left = add(off_axis(&one), off_axis(&other));
        out[4 * chunk..4 * chunk + 4].copy_from_slice(&left);
    }
    out
}
