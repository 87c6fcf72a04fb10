//! Symbols of a block, their packing into 16 bytes, and their texels.

use crate::uastc::hints::Hints;
use crate::uastc::mode::{MODES, Mode, SOLID, interpolation_weight};
use crate::uastc::partition::{anchor, pattern};

/// A block before packing, in any mode but the solid one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Symbols {
    /// Mode number.
    pub(crate) mode: u8,
    /// Place of the pattern in the mode's list.
    pub(crate) pattern: u8,
    /// Channel (0 red .. 3 alpha) that takes the second weight, in modes of two planes.
    pub(crate) channel: u8,
    /// Endpoint codes: for each subset and component the low and the high one.
    pub(crate) endpoints: [u8; 18],
    /// Stored weights, `planes` per texel.
    pub(crate) weights: [u8; 32],
}

impl Symbols {
    /// The same block with no top bit in the weights whose top bit is not written.
    pub(crate) fn settled(mut self) -> Self {
        self.settle_anchors(&MODES[usize::from(self.mode)]);
        self
    }

    /// Turns weights over, and endpoints with them, where a subset's first
    /// weight has its top bit: that bit is not written and reads as nil.
    fn settle_anchors(&mut self, mode: &Mode) {
        let top = 1 << (mode.weight_bits - 1);
        let full = (2 << (mode.weight_bits - 1)) - 1;
        let Some(pattern) = pattern(self.mode, mode.subsets, self.pattern) else { return };
        for subset in 0..mode.subsets {
            let first = anchor(pattern, subset);
            for plane in 0..mode.planes {
                if self.weights[first * mode.planes + plane] & top == 0 {
                    continue;
                }
                for texel in (0..16).filter(|&t| usize::from(pattern[t]) == subset) {
                    let weight = &mut self.weights[texel * mode.planes + plane];
                    *weight = full - *weight;
                }
                for component in 0..mode.components {
                    if mode.planes == 1 || (plane == 1) == self.in_second_plane(mode, component) {
                        let at = (subset * mode.components + component) * 2;
                        self.endpoints.swap(at, at + 1);
                    }
                }
            }
        }
    }

    fn in_second_plane(&self, mode: &Mode, component: usize) -> bool {
        let channel = if mode.components == 2 && component == 1 { 3 } else { component };
        channel == usize::from(self.channel)
    }

    /// The block's 16 bytes.
    pub(crate) fn pack(mut self, hints: &Hints) -> [u8; 16] {
        let mode = &MODES[usize::from(self.mode)];
        self.settle_anchors(mode);
        let mut out = BitWriter::default();
        out.put(mode.prefix, mode.prefix_bits);
        hints.write(mode, &mut out);
        out.put(self.pattern.into(), mode.pattern_bits);
        if mode.writes_channel {
            out.put(self.channel.into(), 2);
        }
        let values = &self.endpoints[..mode.components * 2 * mode.subsets];
        let (group, widths): (usize, &[u32]) = match mode.range.base {
            3 => (5, &[2, 4, 5, 7, 8]),
            5 => (3, &[3, 5, 7]),
            _ => (values.len(), &[]),
        };
        if !widths.is_empty() {
            for chunk in values.chunks(group) {
                let number =
                    chunk.iter().rev().fold(0, |n, &v| n * mode.range.base + u32::from(v >> mode.range.bits));
                out.put(number, widths[chunk.len() - 1]);
            }
        }
        for &value in values {
            out.put(u32::from(value) & ((1 << mode.range.bits) - 1), mode.range.bits);
        }
        let Some(pattern) = pattern(self.mode, mode.subsets, self.pattern) else {
            return out.bytes();
        };
        let anchors = [0, 1, 2].map(|s| if s < mode.subsets { anchor(pattern, s) } else { 0 });
        for texel in 0..16 {
            let bits = mode.weight_bits - u32::from(anchors.contains(&texel));
            for plane in 0..mode.planes {
                out.put(self.weights[texel * mode.planes + plane].into(), bits);
            }
        }
        out.bytes()
    }

    /// The texels that a decoder makes of the block (with linear, not sRGB,
    /// rounding, as the reference transcoder to RGBA does).
    pub(crate) fn texels(&self) -> [[u8; 4]; 16] {
        let mode = &MODES[usize::from(self.mode)];
        let Some(pattern) = pattern(self.mode, mode.subsets, self.pattern) else {
            return [[0; 4]; 16];
        };
        let mut ends = [[0; 2]; 12];
        for (i, pair) in ends.iter_mut().enumerate().take(mode.components * mode.subsets) {
            *pair = [0, 1].map(|e| mode.range.value_of_code(self.endpoints[2 * i + e]));
        }
        let mut second = [0; 4];
        for (component, plane) in second.iter_mut().enumerate() {
            *plane = usize::from(mode.planes == 2 && self.in_second_plane(mode, component));
        }
        let mut texels = [[255; 4]; 16];
        for (texel, out) in texels.iter_mut().enumerate() {
            let first = usize::from(pattern[texel]) * mode.components;
            for component in 0..mode.components {
                let stored = self.weights[texel * mode.planes + second[component]];
                let [low, high] = ends[first + component];
                out[component] = interpolate(low, high, interpolation_weight(mode.weight_bits, stored));
            }
            if mode.components == 2 {
                *out = [out[0], out[0], out[0], out[1]];
            }
        }
        texels
    }
}

/// Value between two endpoint values at a weight in 0..=64.
#[inline]
fn interpolate(low: u8, high: u8, weight: u8) -> u8 {
    let (low, high, weight) = (u32::from(low) * 257, u32::from(high) * 257, u32::from(weight));
    ((low * (64 - weight) + high * weight + 32) >> 14) as u8
}

/// The 16 bytes of a block of one colour.
pub(crate) fn pack_solid(colour: [u8; 4], hints: &Hints) -> [u8; 16] {
    let mode = &MODES[usize::from(SOLID)];
    let mut out = BitWriter::default();
    out.put(mode.prefix, mode.prefix_bits);
    for channel in colour {
        out.put(channel.into(), 8);
    }
    hints.write_solid(&mut out);
    out.bytes()
}

/// Bits of a block, the lowest of the first byte first.
#[derive(Debug, Default)]
pub(crate) struct BitWriter {
    bits: u128,
    len: u32,
}

impl BitWriter {
    /// Appends the `len` low bits of `value`.
    #[inline]
    pub(crate) fn put(&mut self, value: u32, len: u32) {
        debug_assert!(len == 32 || value >> len == 0);
        self.bits |= u128::from(value) << self.len;
        self.len += len;
        debug_assert!(self.len <= 128);
    }

    /// The bits so far, the rest nil.
    pub(crate) fn bytes(&self) -> [u8; 16] {
        self.bits.to_le_bytes()
    }
}
