// Sums whose result does not depend on the order of their terms: 64-bit fixed point in two words, low first, with a carry
// from one to the other. The kernel declares
//     var<storage, read_write> sums: array<FixedSum>;
// with an element more than there are sums, whose last word is the status: not zero once a term was not finite (bit 0), or
// a sum left its range (bit 1).

struct FixedSum {
    low: atomic<u32>,
    high: atomic<u32>,
}

// Terms end at 2^54 units: larger ones count as that. 512 of these fit into a sum.
const FIXED_LIMIT: f32 = 18014398509481984.0;
const TWO_32: f32 = 4294967296.0;
const TWO_MINUS_32: f32 = 2.3283064365386963e-10;

// `x` in units of `1 / scale` (a power of two), rounded, as the two words of a signed number.
fn fixed_words(x: f32, scale: f32) -> vec2<u32> {
    let y = min(abs(x) * scale, FIXED_LIMIT);
    let high = floor(y * TWO_MINUS_32);
    // Exact: a number of 24 bits minus its upper part.
    let low = round(y - high * TWO_32);
    // Rounding up may fill the word.
    var words = vec2<u32>(0u, u32(high) + 1u);
    if low < TWO_32 {
        words = vec2<u32>(u32(low), u32(high));
    }
    if x < 0.0 {
        let flipped = ~words.x + 1u;
        words = vec2<u32>(flipped, ~words.y + select(0u, 1u, flipped == 0u));
    }
    return words;
}

// Whether a term is finite. Decided by the bits: devices may compare as if all numbers were.
fn fixed_fits(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) < 0x7f800000u;
}

// Whether the sum of a term has to be looked at: 2^30 terms below 2^32 units stay within its range by themselves.
fn fixed_is_large(x: f32, scale: f32) -> bool {
    return abs(x) * scale >= TWO_32;
}

// Whether a sum leaves its range: the high words before and of a term have one sign, and their sum the other.
fn fixed_overflows(before: u32, term: u32) -> bool {
    let after = before + term;
    return ((before ^ after) & (term ^ after)) >= 0x80000000u;
}

// Adds `x` to sum number `at`.
fn add_fixed(at: u32, x: f32, scale: f32) {
    let end = arrayLength(&sums) - 1u;
    if !fixed_fits(x) {
        atomicOr(&sums[end].high, 1u);
        return;
    }
    let words = fixed_words(x, scale);
    let before = atomicAdd(&sums[at].low, words.x);
    let high = words.y + select(0u, 1u, before > 0xffffffffu - words.x);
    if high == 0u {
        return;
    }
    if !fixed_is_large(x, scale) {
        // What was there before is not asked for: devices need not wait for it.
        atomicAdd(&sums[at].high, high);
    } else if fixed_overflows(atomicAdd(&sums[at].high, high), high) {
        atomicOr(&sums[end].high, 2u);
    }
}
