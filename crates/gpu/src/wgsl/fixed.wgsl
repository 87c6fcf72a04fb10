// Sums whose result does not depend on the order of their terms: 64-bit fixed point in two words, low first, with a carry
// from one to the other. The kernel declares
//     var<storage, read_write> sums: array<atomic<u32>>;
// with two words a sum and one status word at the end, which is not zero once a term was not finite or too
// large (bit 0), or a sum left its range (bit 1).

// Terms reach 2^54 units: 512 of the largest fit into a sum.
const FIXED_LIMIT: f32 = 18014398509481984.0;
const TWO_32: f32 = 4294967296.0;

// `x` in units of `1 / scale` (a power of two), rounded, as the two words of a signed number.
fn fixed_words(x: f32, scale: f32) -> vec2<u32> {
    let y = abs(x) * scale;
    let high = floor(y / TWO_32);
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

// Adds `x` to sum number `at`.
fn add_fixed(at: u32, x: f32, scale: f32) {
    // Also false for what is not a number.
    if !(abs(x) * scale < FIXED_LIMIT) {
        atomicOr(&sums[arrayLength(&sums) - 1u], 1u);
        return;
    }
    let words = fixed_words(x, scale);
    let before = atomicAdd(&sums[2u * at], words.x);
    let high = words.y + select(0u, 1u, before > 0xffffffffu - words.x);
    if high != 0u {
        let old = atomicAdd(&sums[2u * at + 1u], high);
        let after = old + high;
        // Terms of one sign whose sum has the other.
        if ((old ^ after) & (high ^ after)) >= 0x80000000u {
            atomicOr(&sums[arrayLength(&sums) - 1u], 2u);
        }
    }
}
