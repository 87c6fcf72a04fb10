// Sums whose result does not depend on the order of their terms: 64-bit fixed point in two words, low first, with a carry
// from one to the other. The kernel declares
//     var<storage, read_write> sums: array<FixedSum>;
// with an element more than there are sums, whose last word is the status: not zero once a term was not finite (bit 0), a
// sum left its range (bit 1), or a term ended at its limit (bit 2).

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

// What the status learns of a large term.
fn fixed_verdict(x: f32, scale: f32, before: u32, term: u32) -> u32 {
    return select(0u, 2u, fixed_overflows(before, term)) | select(0u, 4u, abs(x) * scale > FIXED_LIMIT);
}

// Adds to the high word of sum number `at` what term `x` adds to it.
fn add_high(at: u32, x: f32, scale: f32, high: u32) {
    if !fixed_is_large(x, scale) {
        // What was there before is not asked for: devices need not wait for it.
        atomicAdd(&sums[at].high, high);
    } else {
        atomicOr(&sums[arrayLength(&sums) - 1u].high, fixed_verdict(x, scale, atomicAdd(&sums[at].high, high), high));
    }
}

// Adds `x` to sum number `at`.
fn add_fixed(at: u32, x: f32, scale: f32) {
    if !fixed_fits(x) {
        atomicOr(&sums[arrayLength(&sums) - 1u].high, 1u);
        return;
    }
    let words = fixed_words(x, scale);
    let before = atomicAdd(&sums[at].low, words.x);
    let high = words.y + select(0u, 1u, before > 0xffffffffu - words.x);
    if high != 0u {
        add_high(at, x, scale, high);
    }
}

// `add_fixed` of four terms: all are on their way to memory before the first one's answer is waited for.
fn add_fixed_4(at: vec4<u32>, x: vec4<f32>, scale: f32) {
    if !(fixed_fits(x.x) && fixed_fits(x.y) && fixed_fits(x.z) && fixed_fits(x.w)) {
        atomicOr(&sums[arrayLength(&sums) - 1u].high, 1u);
        return;
    }
    let a = fixed_words(x.x, scale);
    let b = fixed_words(x.y, scale);
    let c = fixed_words(x.z, scale);
    let d = fixed_words(x.w, scale);
    let before = vec4<u32>(
        atomicAdd(&sums[at.x].low, a.x),
        atomicAdd(&sums[at.y].low, b.x),
        atomicAdd(&sums[at.z].low, c.x),
        atomicAdd(&sums[at.w].low, d.x),
    );
    let low = vec4<u32>(a.x, b.x, c.x, d.x);
    let carry = select(vec4<u32>(0u), vec4<u32>(1u), before > vec4<u32>(0xffffffffu) - low);
    let high = vec4<u32>(a.y, b.y, c.y, d.y) + carry;
    for (var k = 0u; k < 4u; k++) {
        if high[k] != 0u {
            add_high(at[k], x[k], scale, high[k]);
        }
    }
}
