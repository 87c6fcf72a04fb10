// Sums whose result does not depend on the order of their terms: 64-bit fixed point in two words, low first. A device that adds
// words of 64 bits in memory does; others carry from the low word to the high one, which has to wait for what the low one was.
// The sections are for one of both (`Kernel::text`). The kernel declares
//     var<storage, read_write> sums: array<FixedSum>;
// with the sums, then for each 16 of them a count, and the status in the last word: not zero once a term was not finite
// (bit 0), large terms were too many (bit 1), or a term ended at its limit (bit 2).
//
// Sums are exact modulo 2^64 units. That none leaves its 63 bits is known by its terms, so that the verdict does not depend
// on their order either: those of 2^32 units and more are large, and counted by their size. As long as the large ones of
// each sign among 16 sums beside each other are below 2^62 units together, they and 2^30 smaller ones fit into any of them.

//@ 32
struct FixedSum {
    low: atomic<u32>,
    high: atomic<u32>,
}
//@ 64
alias FixedSum = atomic<u64>;
//@

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

// The bits of the size of a number. Compared as they are: devices may compare numbers as if all were finite.
fn fixed_bits(x: f32) -> u32 {
    return bitcast<u32>(x) & 0x7fffffffu;
}

// The bits of the size of the smallest term that is large.
fn fixed_large(scale: f32) -> u32 {
    return bitcast<u32>(TWO_32 / scale);
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

//@ 64
// `fixed_words` of a term that is not large, as one word.
fn fixed_word(x: f32, scale: f32) -> u64 {
    return bitcast<u64>(i64(round(x * scale)));
}

//@
// By how much a large term is counted: the most is 2^22.
fn fixed_size(x: f32, scale: f32) -> u32 {
    return u32(ceil(fixed_units(x, scale) * TWO_MINUS_32));
}

// What the status learns of a large term, with which the count becomes `counted`.
fn fixed_verdict(x: f32, scale: f32, counted: u32) -> u32 {
    let many = select(0u, FIXED_TOO_MANY, counted >= FIXED_FULL);
    return many | select(0u, FIXED_LIMITED, abs(x) > FIXED_LIMIT / scale);
}

// `add_fixed` of four terms, where `large` is `fixed_large(scale)`.
fn add_fixed_4(at: vec4<u32>, x: vec4<f32>, scale: f32, large: u32) {
//@ 32
    let a = fixed_term(at.x, x.x, scale, large);
    let b = fixed_term(at.y, x.y, scale, large);
    let c = fixed_term(at.z, x.z, scale, large);
    let d = fixed_term(at.w, x.w, scale, large);
    // All are on their way to memory before the first one's answer is waited for.
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
            atomicAdd(&sums[at[k]].high, high[k]);
        }
    }
//@ 64
    let bits = bitcast<vec4<u32>>(x) & vec4<u32>(0x7fffffffu);
    if max(max(bits.x, bits.y), max(bits.z, bits.w)) >= large {
        for (var k = 0u; k < 4u; k++) {
            add_fixed(at[k], x[k], scale);
        }
        return;
    }
    atomicAdd(&sums[at.x], fixed_word(x.x, scale));
    atomicAdd(&sums[at.y], fixed_word(x.y, scale));
    atomicAdd(&sums[at.z], fixed_word(x.z, scale));
    atomicAdd(&sums[at.w], fixed_word(x.w, scale));
//@
}
