//! Partition patterns of multi-subset blocks.
//!
//! UASTC LDR 4x4 only takes patterns that both ASTC and BC7 know, and names
//! them by their place in three short lists of ASTC partition seeds. The
//! pattern of a seed is computed here by the partition function of the ASTC
//! section of the Khronos Data Format specification.

/// A pattern: the subset of each texel in raster order.
pub(crate) type Pattern = [u8; 16];

/// ASTC seeds of the 30 two-subset patterns of modes 2, 4, 9 and 16.
const SEEDS_2: [u32; 30] = [
    28, 20, 16, 29, 91, 9, 107, 72, 149, 204, 50, 114, 496, 17, 78, 39, 252, 828, 43, 156, 116, 210, 476,
    273, 684, 359, 246, 195, 694, 524,
];
/// ASTC seeds of the 11 three-subset patterns of mode 3.
const SEEDS_3: [u32; 11] = [260, 74, 32, 156, 183, 15, 745, 0, 335, 902, 254];
/// ASTC seeds of the 19 two-subset patterns of mode 7.
const SEEDS_7: [u32; 19] =
    [36, 48, 61, 137, 161, 183, 226, 281, 302, 307, 479, 495, 593, 594, 605, 799, 812, 988, 993];

/// Two-subset patterns of modes 2, 4, 9 and 16.
pub(crate) static PATTERNS_2: [Pattern; 30] = patterns(&SEEDS_2, 2);
/// Three-subset patterns of mode 3.
pub(crate) static PATTERNS_3: [Pattern; 11] = patterns(&SEEDS_3, 3);
/// Two-subset patterns of mode 7.
pub(crate) static PATTERNS_7: [Pattern; 19] = patterns(&SEEDS_7, 2);
/// The pattern of a block with one subset.
pub(crate) static WHOLE: Pattern = [0; 16];

/// Pattern `index` of a mode that has `subsets` subsets, or `None` where the
/// mode's list has no such entry.
pub(crate) fn pattern(mode: u8, subsets: usize, index: u8) -> Option<&'static Pattern> {
    let index = usize::from(index);
    match (subsets, mode) {
        (1, _) => Some(&WHOLE),
        (2, 7) => PATTERNS_7.get(index),
        (2, _) => PATTERNS_2.get(index),
        _ => PATTERNS_3.get(index),
    }
}

/// First texel of a subset: its weight is stored without the top bit.
#[inline]
pub(crate) fn anchor(pattern: &Pattern, subset: usize) -> usize {
    pattern.iter().position(|&s| usize::from(s) == subset).unwrap_or(0)
}

const fn patterns<const N: usize>(seeds: &[u32; N], subsets: u32) -> [Pattern; N] {
    let mut out = [[0; 16]; N];
    let mut n = 0;
    while n < N {
        let mut texel = 0;
        while texel < 16 {
            out[n][texel] = subset(seeds[n], texel as u32 % 4, texel as u32 / 4, subsets);
            texel += 1;
        }
        n += 1;
    }
    out
}

/// The ASTC partition function for a 4x4 block (fewer than 31 texels, so
/// coordinates count double; depth is nil).
const fn subset(seed: u32, x: u32, y: u32, subsets: u32) -> u8 {
    let (x, y) = (x * 2, y * 2);
    let seed = seed + (subsets - 1) * 1024;
    let hash = scramble(seed);
    let mut low = [0; 4];
    let mut k = 0;
    while k < 4 {
        let even = (hash >> (8 * k)) & 15;
        let odd = (hash >> (8 * k + 4)) & 15;
        let (shift_x, shift_y) = if seed & 1 == 1 {
            (if seed & 2 == 2 { 4 } else { 5 }, if subsets == 3 { 6 } else { 5 })
        } else {
            (if subsets == 3 { 6 } else { 5 }, if seed & 2 == 2 { 4 } else { 5 })
        };
        let step_x = (even * even) >> shift_x;
        let step_y = (odd * odd) >> shift_y;
        let offset = hash >> (14 - 4 * k as u32);
        low[k] = (step_x * x + step_y * y + offset) & 63;
        k += 1;
    }
    if subsets < 3 {
        low[2] = 0;
    }
    if low[0] >= low[1] && low[0] >= low[2] {
        0
    } else if low[1] >= low[2] {
        1
    } else {
        2
    }
}

/// The integer hash of the ASTC partition function.
const fn scramble(seed: u32) -> u32 {
    let mut p = seed;
    p ^= p >> 15;
    p = p.wrapping_sub(p << 17);
    p = p.wrapping_add(p << 7);
    p = p.wrapping_add(p << 4);
    p ^= p >> 5;
    p = p.wrapping_add(p << 16);
    p ^= p >> 7;
    p ^= p >> 3;
    p ^= p << 6;
    p ^ (p >> 17)
}
