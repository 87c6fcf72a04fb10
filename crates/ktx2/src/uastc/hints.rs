//! Hints for transcoders to ETC1 and ETC2.
//!
//! A block carries a few bits that spare a transcoder the search for an ETC1
//! block: how to halve the 4x4 texels, how to write the two base colours, and
//! the intensity tables. A block with alpha also names an EAC table. These
//! bits are no mere advice: transcoders to ETC take them as they are, so a
//! block with nil there transcodes badly. The two BC1 hints stay nil, which
//! tells transcoders to make their own BC1 block (the better one).
//!
//! Tables: Khronos Data Format specification, sections on ETC1 and ETC2.

use crate::uastc::block::BitWriter;
use crate::uastc::mode::Mode;

/// The small and the great step of each ETC1 intensity table.
const STEPS: [[i32; 2]; 8] = [[2, 8], [5, 17], [9, 29], [13, 42], [18, 60], [24, 80], [33, 106], [47, 183]];

/// Modifiers of each EAC table in rising order.
const EAC: [[i32; 8]; 16] = [
    [-15, -9, -6, -3, 2, 5, 8, 14],
    [-13, -10, -7, -3, 2, 6, 9, 12],
    [-13, -8, -5, -2, 1, 4, 7, 12],
    [-13, -6, -4, -2, 1, 3, 5, 12],
    [-12, -8, -6, -3, 2, 5, 7, 11],
    [-11, -9, -7, -3, 2, 6, 8, 10],
    [-11, -8, -7, -4, 3, 6, 7, 10],
    [-11, -8, -5, -3, 2, 4, 7, 10],
    [-10, -8, -6, -2, 1, 5, 7, 9],
    [-10, -8, -5, -2, 1, 4, 7, 9],
    [-10, -8, -4, -2, 1, 3, 7, 9],
    [-10, -7, -5, -2, 1, 4, 6, 9],
    [-10, -7, -4, -3, 2, 3, 6, 9],
    [-10, -3, -2, -1, 0, 1, 2, 9],
    [-9, -8, -6, -4, 3, 5, 7, 8],
    [-9, -7, -5, -3, 2, 4, 6, 8],
];

/// The hint bits of one block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Hints {
    /// Halve the block into a top and a bottom part, not left and right.
    pub(crate) flip: bool,
    /// Write the second base colour as a difference (5-bit base colours).
    pub(crate) differential: bool,
    /// Intensity table of each half; of a solid block the first counts.
    pub(crate) intensity: [u32; 2],
    /// Change of the base colours; 13 is none.
    pub(crate) bias: u32,
    /// EAC table (low four bits) and multiplier of the alpha.
    pub(crate) eac: u32,
    /// Selector and base colour of a solid block.
    pub(crate) solid: [u32; 4],
}

impl Default for Hints {
    /// Hints that cost least in a file: the same bits for every block.
    fn default() -> Self {
        Self { flip: false, differential: true, intensity: [0; 2], bias: 13, eac: 13 | 1 << 4, solid: [0; 4] }
    }
}

impl Hints {
    /// Hints for the (decoded) texels of a block.
    pub(crate) fn of_texels(texels: &[[u8; 4]; 16], alpha: bool) -> Self {
        let halves = [false, true].map(|flip| Halves::new(texels, flip));
        // The halves whose texels lie closer to their means.
        let flip = halves[1].between > halves[0].between;
        let half = &halves[usize::from(flip)];
        let base = |limit: u32| half.sum.map(|sum| sum.map(|s| ((s * limit + 1020) / 2040) as i32));
        let fine = base(31);
        let mut second = fine[1];
        for c in 0..3 {
            second[c] = second[c].clamp(fine[0][c] - 4, fine[0][c] + 3);
        }
        let mut differential = true;
        let mut bases = [fine[0], second];
        let (error, mut intensity) = intensities(texels, flip, bases.map(|b| b.map(expand_5)));
        if second != fine[1] {
            // The difference is cut: coarser base colours may be nearer.
            let coarse = base(15);
            let other = intensities(texels, flip, coarse.map(|b| b.map(expand_4)));
            if other.0 < error {
                intensity = other.1;
                (differential, bases) = (false, coarse);
            }
        }
        let limit = if differential { 31 } else { 15 };
        let bias = match () {
            // A base channel at an end of its range would move inward unless
            // the bias points outward.
            () if bases.iter().flatten().all(|&v| v == 0) => 0,
            () if bases.iter().flatten().all(|&v| v == limit) => 26,
            () => 13,
        };
        let eac = if alpha { best_eac(texels) } else { Self::default().eac };
        Self { flip, differential, intensity, bias, eac, solid: [0; 4] }
    }

    /// Hints for a block of one colour.
    pub(crate) fn of_colour(colour: [u8; 4]) -> Self {
        let mut best = (u32::MAX, Self::default());
        for differential in [true, false] {
            let limit: i32 = if differential { 31 } else { 15 };
            let expand = if differential { expand_5 } else { expand_4 };
            for table in 0..8 {
                for selector in 0..4 {
                    let [small, great] = STEPS[table];
                    let step = [-great, -small, small, great][selector];
                    let mut error = 0;
                    let mut solid = [selector as u32, 0, 0, 0];
                    for c in 0..3 {
                        let value = i32::from(colour[c]);
                        let base = (((value - step) * limit + 127).div_euclid(255)).clamp(0, limit);
                        let decoded = (expand(base) + step).clamp(0, 255);
                        error += (decoded - value).pow(2) as u32;
                        solid[c + 1] = base as u32;
                    }
                    if error < best.0 {
                        let intensity = [table as u32; 2];
                        best = (error, Self { differential, intensity, solid, ..Self::default() });
                    }
                }
            }
        }
        best.1
    }

    /// Writes the hints of a block in a mode that is not the solid one.
    pub(crate) fn write(&self, mode: &Mode, out: &mut BitWriter) {
        out.put(0, if mode.full_hints { 2 } else { 1 });
        out.put(self.flip.into(), 1);
        out.put(self.differential.into(), 1);
        out.put(self.intensity[0], 3);
        out.put(self.intensity[1], 3);
        if mode.full_hints {
            out.put(self.bias, 5);
        }
        if mode.has_alpha() {
            out.put(self.eac, 8);
        }
    }

    /// Writes the hints of a solid block.
    pub(crate) fn write_solid(&self, out: &mut BitWriter) {
        out.put(self.differential.into(), 1);
        out.put(self.intensity[0], 3);
        for (value, bits) in self.solid.into_iter().zip([2, 5, 5, 5]) {
            out.put(value, bits);
        }
    }
}

/// Which half of the block a texel is in.
fn half_of(texel: usize, flip: bool) -> usize {
    if flip { texel / 8 } else { texel % 4 / 2 }
}

/// Colour sums of the two halves of a block.
struct Halves {
    sum: [[u32; 3]; 2],
    /// Scatter between the halves (what is left is within them).
    between: u32,
}

impl Halves {
    fn new(texels: &[[u8; 4]; 16], flip: bool) -> Self {
        let mut sum = [[0; 3]; 2];
        for (t, texel) in texels.iter().enumerate() {
            for c in 0..3 {
                sum[half_of(t, flip)][c] += u32::from(texel[c]);
            }
        }
        let between = (0..3).map(|c| sum[0][c].abs_diff(sum[1][c]).pow(2)).sum();
        Self { sum, between }
    }
}

fn luma([r, g, b]: [i32; 3]) -> f32 {
    (54 * r + 183 * g + 19 * b) as f32 / 256.0
}

/// 8-bit value of a channel of a 5-bit base colour.
fn expand_5(base: i32) -> i32 {
    base << 3 | base >> 2
}

/// 8-bit value of a channel of a 4-bit base colour.
fn expand_4(base: i32) -> i32 {
    base << 4 | base
}

/// Tables that suit the halves best, and the squared error they leave.
fn intensities(texels: &[[u8; 4]; 16], flip: bool, bases: [[i32; 3]; 2]) -> (f32, [u32; 2]) {
    let (mut error, mut tables) = (0.0, [0; 2]);
    for (side, base) in bases.into_iter().enumerate() {
        let centre = luma(base);
        let mut offsets = [[0.0; 2]; 8];
        let members = (0..16).filter(|&t| half_of(t, flip) == side);
        for (offset, t) in offsets.iter_mut().zip(members) {
            let [r, g, b, _] = texels[t].map(i32::from);
            let difference = [r - base[0], g - base[1], b - base[2]];
            error += difference.iter().map(|d| d * d).sum::<i32>() as f32;
            *offset = [luma([r, g, b]) - centre, difference.iter().sum::<i32>() as f32];
        }
        let (growth, table) = best_intensity(&offsets);
        error += growth;
        tables[side] = table;
    }
    (error, tables)
}

/// Table that suits a half best, and the growth of its squared error by the
/// steps, from the distances of its texels to the base colour: in luma, by
/// which transcoders pick the step, and in the sum of the channels, which all
/// take that step.
fn best_intensity(offsets: &[[f32; 2]; 8]) -> (f32, u32) {
    let mut best = (f32::MAX, 0);
    for (table, [small, great]) in STEPS.iter().enumerate() {
        let (small, great) = (*small as f32, *great as f32);
        let mut growth = 0.0;
        for [luma, all] in offsets {
            let size = if luma.abs() * 2.0 < small + great { small } else { great };
            let step = if *luma < 0.0 { -size } else { size };
            growth += (3.0 * step - 2.0 * all) * step;
        }
        if growth < best.0 {
            best = (growth, table as u32);
        }
    }
    best
}

/// EAC table and multiplier for the alpha of a block, with the base value
/// that transcoders take: the one that lays the table over the alpha's span.
fn best_eac(texels: &[[u8; 4]; 16]) -> u32 {
    let alpha = texels.map(|t| i32::from(t[3]));
    let (low, high) = alpha.iter().fold((255, 0), |(l, h), &a| (a.min(l), a.max(h)));
    if low == high {
        return Hints::default().eac;
    }
    let mut best = (f32::MAX, 0);
    for (table, steps) in EAC.iter().enumerate() {
        let span = steps[7] - steps[0];
        let multiplier = ((high - low + span / 2) / span).clamp(1, 15);
        let centre = (low as f32 + (high - low) as f32 * (-steps[0] as f32 / span as f32)).round();
        let mut nearest = [f32::MAX; 16];
        for step in steps {
            let value = (centre + (step * multiplier) as f32).clamp(0.0, 255.0);
            for (near, &a) in nearest.iter_mut().zip(&alpha) {
                *near = near.min((a as f32 - value).abs());
            }
        }
        let error = nearest.iter().map(|e| e * e).sum();
        if error < best.0 {
            best = (error, table as u32 | (multiplier as u32) << 4);
        }
    }
    best.1
}
