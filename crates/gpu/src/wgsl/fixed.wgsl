// Sums whose result does not depend on the order of their terms: 64-bit fixed point in two words, low first, with a carry
// from one to the other. The kernel declares
//     var<storage, read_write> sums: array<FixedSum>;
// with the sums, then for each 16 of them a count, and the status in the last word: not zero once a term was not finite
// (bit 0), large terms were too many (bit 1), or a term ended at its limit (bit 2).
//
// Sums are exact modulo 2^64 units. That none leaves its 63 bits is known by its terms, so that the verdict does not depend
// on their order either: those of 2^32 units and more are large, and counted by their size. As long as the large ones of
// each sign among 16 sums beside each other are below 2^62 units together, they and 2^30 smaller ones fit into any of them.

struct FixedSum {
    low: atomic<u32>,
    high: atomic<u32>,
}

// Terms end at 2^54 units: larger ones count as that. 255 of one sign fit into a sum.
const FIXED_LIMIT: f32 = 18014398509481984.0;
// Large terms below 2^62, in units of 2^32: the sizes of the positive ones in the low word of a count, of the others in
// the high one.
const FIXED_FULL: u32 = 0x40000000u;
// Sums with one count.
const FIXED_SHARED: u32 = 16u;
const TWO_32: f32 = 4294967296.0;
const TWO_MINUS_32: f32 = 2.3283064365386963e-10;

const FIXED_NOT_FINITE: u32 = 1u;
const FIXED_TOO_MANY: u32 = 2u;
const FIXED_LIMITED: u32 = 4u;

// Whether a term is finite. Decided by the bits: devices may compare as if all numbers were.
fn fixed_is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) < 0x7f800000u;
}

// The size of a term in units of `1 / scale` (a power of two), limited before the product, which may leave the range of numbers.
fn fixed_units(x: f32, scale: f32) -> f32 {
    return min(abs(x), FIXED_LIMIT / scale) * scale;
}

// `x` in units, rounded, as the two words of a signed number.
fn fixed_words(x: f32, scale: f32) -> vec2<u32> {
    let y = fixed_units(x, scale);
    let high = floor(y * TWO_MINUS_32);
    // Exact: a number of 24 bits minus its upper part. Rounding fills no word: what has a fraction is below 2^24.
    let low = round(y - high * TWO_32);
    let words = vec2<u32>(u32(low), u32(high));
    if x < 0.0 {
        let flipped = ~words.x + 1u;
        return vec2<u32>(flipped, ~words.y + select(0u, 1u, flipped == 0u));
    }
    return words;
}

// What adding `term` to a low word that was `before` carries to the high one.
fn fixed_carry(before: u32, term: u32) -> u32 {
    return select(0u, 1u, before > 0xffffffffu - term);
}

// Whether a term is counted. The high word that it adds is not 0, whatever is carried to it.
fn fixed_is_large(x: f32, scale: f32) -> bool {
    return abs(x) >= TWO_32 / scale;
}

// By how much: the most is 2^22.
fn fixed_size(x: f32, scale: f32) -> u32 {
    return u32(ceil(fixed_units(x, scale) * TWO_MINUS_32));
}

// What the status learns of a large term, with which the count becomes `counted`.
fn fixed_verdict(x: f32, scale: f32, counted: u32) -> u32 {
    let many = select(0u, FIXED_TOO_MANY, counted >= FIXED_FULL);
    return many | select(0u, FIXED_LIMITED, abs(x) > FIXED_LIMIT / scale);
}

// `add_fixed` of four terms: all are on their way to memory before the first one's answer is waited for.
fn add_fixed_4(at: vec4<u32>, x: vec4<f32>, scale: f32) {
    if !(fixed_is_finite(x.x) && fixed_is_finite(x.y) && fixed_is_finite(x.z) && fixed_is_finite(x.w)) {
        atomicOr(&sums[arrayLength(&sums) - 1u].high, FIXED_NOT_FINITE);
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
        add_fixed_high(at[k], x[k], scale, high[k]);
    }
}
