//! Rate-distortion optimization: blocks whose bytes repeat those of earlier
//! ones, so that a byte-wise compressor finds matches.
//!
//! For each block, besides the one with the least error, two kinds are
//! weighed: a copy of a recent block, and a block with the mode and weights
//! of a recent one (the latter half of the bytes) and endpoints fitted anew.
//! The one with the least `error + lambda * bits` is taken, with bits
//! estimated as if literals took a little less than their size and a match a
//! fixed number.

use crate::uastc::block::Symbols;
use crate::uastc::ends::{best_ends, round_ends};
use crate::uastc::fit::{Channel, Set};
use crate::uastc::mode::{MODES, interpolation_weight};
use crate::uastc::partition::pattern;
use crate::uastc::search::Found;

/// Number of recent blocks to look at.
const WINDOW: usize = 64;
/// Estimated bits of a match.
const MATCH_BITS: f32 = 22.0;
/// Estimated bits per bit of a literal.
const LITERAL: f32 = 0.92;

/// Replaces found blocks, in file order, by ones that compress better.
///
/// `lambda` is the squared error (summed over a block's texels and channels)
/// that a saved bit is worth; 0 changes nothing. It counts less in blocks with
/// little contrast, where errors are seen more. Returns, for each block, what
/// to write.
pub(crate) fn optimize(blocks: &[[[u8; 4]; 16]], found: &[Found], lambda: f32) -> Vec<Found> {
    let mut out: Vec<Found> = Vec::with_capacity(found.len());
    let mut recent: Vec<(Found, [[u8; 4]; 16])> = Vec::with_capacity(WINDOW);
    let mut next = 0;
    for (texels, &plain) in blocks.iter().zip(found) {
        let chosen = choose(texels, plain, &recent, lambda * weight(texels));
        out.push(chosen);
        if recent.iter().any(|(known, _)| known == &chosen) {
            continue;
        }
        let entry = (chosen, chosen.texels());
        if recent.len() < WINDOW {
            recent.push(entry);
        } else {
            recent[next] = entry;
            next = (next + 1) % WINDOW;
        }
    }
    out
}

/// Factor on lambda for a block: 1 from a standard deviation of 8 upwards.
fn weight(texels: &[[u8; 4]; 16]) -> f32 {
    let mut most = 0.0f32;
    for c in 0..4 {
        let sum: f32 = texels.iter().map(|t| f32::from(t[c])).sum();
        let square: f32 = texels.iter().map(|t| f32::from(t[c]) * f32::from(t[c])).sum();
        most = most.max(square / 16.0 - (sum / 16.0) * (sum / 16.0));
    }
    (most.max(0.0).sqrt() / 8.0).clamp(0.05, 1.0)
}

fn choose(texels: &[[u8; 4]; 16], plain: Found, recent: &[(Found, [[u8; 4]; 16])], lambda: f32) -> Found {
    let Found::Block(..) = plain else { return plain };
    if lambda <= 0.0 {
        return plain;
    }
    let mut best = (error(texels, &plain.texels()) + lambda * 128.0 * LITERAL, plain);
    for (known, decoded) in recent {
        let copied = error(texels, decoded);
        let cost = copied + lambda * MATCH_BITS;
        if cost < best.0 {
            best = (cost, *known);
        }
        let Found::Block(symbols, _) = known else { continue };
        let floor = lambda * (MATCH_BITS + LITERAL * head_bits(symbols));
        if floor >= best.0 {
            continue;
        }
        let Some(refitted) = refit(symbols, texels) else { continue };
        let found = error(texels, &refitted.texels());
        if found + floor < best.0 {
            best = (found + floor, Found::Block(refitted, found));
        }
    }
    best.1
}

/// Bits of a block before its weights, in whole bytes.
fn head_bits(symbols: &Symbols) -> f32 {
    let mode = &MODES[usize::from(symbols.mode)];
    let weights = (16 * mode.weight_bits as usize) * mode.planes - mode.subsets.max(mode.planes);
    ((128 - weights).div_ceil(8) * 8) as f32
}

fn error(a: &[[u8; 4]; 16], b: &[[u8; 4]; 16]) -> f32 {
    let mut sum = 0;
    for (x, y) in a.iter().flatten().zip(b.iter().flatten()) {
        let difference = i32::from(*x) - i32::from(*y);
        sum += difference * difference;
    }
    sum as f32
}

/// The block with the same mode and weights whose endpoints suit `texels`
/// best. `None` where the mode does not hold the texels' alpha.
fn refit(symbols: &Symbols, texels: &[[u8; 4]; 16]) -> Option<Symbols> {
    let mode = &MODES[usize::from(symbols.mode)];
    if !mode.has_alpha() && texels.iter().any(|t| t[3] != 255) {
        return None;
    }
    let pattern = pattern(symbols.mode, mode.subsets, symbols.pattern)?;
    // The weights as a decoder reads them, so that endpoints need no swap.
    let mut out = symbols.settled();
    for subset in 0..mode.subsets {
        let mask: Channel = pattern.map(|s| if usize::from(s) == subset { 1.0 } else { 0.0 });
        for component in 0..mode.components {
            let channel = if mode.components == 2 && component == 1 { 3 } else { component };
            let plane = usize::from(mode.planes == 2 && channel == usize::from(out.channel));
            let mut values = [0.0; 16];
            let mut interpolation = [0.0; 16];
            for i in 0..16 {
                values[i] = texels[i][channel].into();
                let stored = out.weights[i * mode.planes + plane];
                interpolation[i] = interpolation_weight(mode.weight_bits, stored).into();
            }
            let set = Set { channels: &[values], mask: &mask, metric: &[1.0] };
            let (optimum, form) = best_ends(&set, &interpolation)?;
            let ends = round_ends(mode.range, &optimum, form);
            let at = (subset * mode.components + component) * 2;
            for end in 0..2 {
                out.endpoints[at + end] = mode.range.code[usize::from(ends[end][0])];
            }
        }
    }
    Some(out)
}
