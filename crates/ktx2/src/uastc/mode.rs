//! The modes of UASTC LDR 4x4 and where the bits of each lie.
//!
//! A block starts with a prefix code that names its mode, then hints for
//! transcoders, the pattern or the channel of the second plane where the mode
//! has them, the endpoint values, and last the weights. Figures are those of
//! the "UASTC LDR 4x4 Texture Specification" of Binomial.

use crate::uastc::range::{
    RANGE_12, RANGE_16, RANGE_32, RANGE_40, RANGE_48, RANGE_160, RANGE_192, RANGE_256, Range,
};

/// The mode whose blocks have one colour.
pub(crate) const SOLID: u8 = 8;

/// What a mode's blocks hold.
#[derive(Debug)]
pub(crate) struct Mode {
    /// Prefix code, first bit lowest.
    pub(crate) prefix: u32,
    /// Number of bits of the prefix code.
    pub(crate) prefix_bits: u32,
    /// Number of subsets of the block's texels, each with its own endpoints.
    pub(crate) subsets: usize,
    /// Number of weights per texel: with two, one channel has its own.
    pub(crate) planes: usize,
    /// Number of values of an endpoint: 2 is luminance and alpha, 3 RGB, 4 RGBA.
    pub(crate) components: usize,
    /// Bits of a weight.
    pub(crate) weight_bits: u32,
    /// Range of the endpoint values.
    pub(crate) range: &'static Range,
    /// Number of bits of the pattern index.
    pub(crate) pattern_bits: u32,
    /// Whether the channel of the second plane is written (else it is alpha).
    pub(crate) writes_channel: bool,
    /// Whether the hints hold a bias of the ETC1 base colours, and the second BC1 hint.
    pub(crate) full_hints: bool,
}

impl Mode {
    /// Whether the mode's texels carry alpha.
    pub(crate) fn has_alpha(&self) -> bool {
        self.components != 3
    }

    /// Number of hint bits.
    #[cfg(test)]
    pub(crate) fn hint_bits(&self) -> u32 {
        9 + if self.full_hints { 6 } else { 0 } + if self.has_alpha() { 8 } else { 0 }
    }
}

const fn mode(
    (prefix, prefix_bits): (u32, u32),
    (subsets, planes, components): (usize, usize, usize),
    weight_bits: u32,
    range: &'static Range,
) -> Mode {
    Mode {
        prefix,
        prefix_bits,
        subsets,
        planes,
        components,
        weight_bits,
        range,
        pattern_bits: [0, 0, 5, 4][subsets],
        writes_channel: planes == 2 && components != 2,
        full_hints: true,
    }
}

/// A mode with the short form of the hints.
const fn brief(mode: Mode) -> Mode {
    Mode { full_hints: false, ..mode }
}

/// All modes by number. [`SOLID`] has only its prefix code here.
pub(crate) static MODES: [Mode; 19] = [
    mode((0x01, 4), (1, 1, 3), 4, &RANGE_192),
    mode((0x35, 6), (1, 1, 3), 2, &RANGE_256),
    mode((0x1d, 5), (2, 1, 3), 3, &RANGE_16),
    mode((0x03, 5), (3, 1, 3), 2, &RANGE_12),
    mode((0x13, 5), (2, 1, 3), 2, &RANGE_40),
    mode((0x0b, 5), (1, 1, 3), 3, &RANGE_256),
    mode((0x1b, 5), (1, 2, 3), 2, &RANGE_160),
    mode((0x07, 5), (2, 1, 3), 2, &RANGE_40),
    mode((0x17, 5), (1, 1, 4), 0, &RANGE_256),
    mode((0x0f, 5), (2, 1, 4), 2, &RANGE_16),
    brief(mode((0x02, 3), (1, 1, 4), 4, &RANGE_48)),
    brief(mode((0x00, 2), (1, 2, 4), 2, &RANGE_48)),
    brief(mode((0x06, 3), (1, 1, 4), 3, &RANGE_192)),
    mode((0x1f, 5), (1, 2, 4), 1, &RANGE_256),
    mode((0x0d, 5), (1, 1, 4), 2, &RANGE_256),
    mode((0x05, 7), (1, 1, 2), 4, &RANGE_256),
    mode((0x15, 6), (2, 1, 2), 2, &RANGE_256),
    mode((0x25, 6), (1, 2, 2), 2, &RANGE_256),
    mode((0x09, 4), (1, 1, 3), 5, &RANGE_32),
];

/// Interpolation weight, 0..=64, of a stored weight of `bits` bits.
#[inline]
pub(crate) fn interpolation_weight(bits: u32, stored: u8) -> u8 {
    let w = stored;
    match bits {
        1 => w * 64,
        2 => w * 21 + u8::from(w > 1),
        3 => w * 9 + u8::from(w > 3),
        4 => w * 4 + w / 4 + u8::from(w > 7),
        _ => w * 2 + 2 * u8::from(w > 15),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every mode but the solid one fills at most the 128 bits of a block.
    #[test]
    fn modes_fit_in_a_block() {
        for (number, mode) in MODES.iter().enumerate().filter(|(n, _)| *n != usize::from(SOLID)) {
            let values = mode.components * 2 * mode.subsets;
            let upper = match mode.range.base {
                3 => (values / 5) * 8 + [0, 2, 4, 5, 7][values % 5],
                5 => (values / 3) * 7 + [0, 3, 5][values % 3],
                _ => 0,
            };
            let endpoints = upper + values * mode.range.bits as usize;
            let weights = (16 * mode.weight_bits as usize - mode.subsets) * mode.planes
                - if mode.planes == 2 { mode.subsets - 1 } else { 0 };
            let total = (mode.prefix_bits + mode.hint_bits() + mode.pattern_bits) as usize
                + if mode.writes_channel { 2 } else { 0 }
                + endpoints
                + weights;
            assert!(total <= 128, "mode {number}: {total} bits");
        }
    }

    /// No prefix code starts another one.
    #[test]
    fn prefixes_are_distinct() {
        for (i, a) in MODES.iter().enumerate() {
            for b in &MODES[..i] {
                let mask = (1 << a.prefix_bits.min(b.prefix_bits)) - 1;
                assert_ne!(a.prefix & mask, b.prefix & mask);
            }
        }
    }
}
