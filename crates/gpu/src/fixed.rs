//! Sums that do not depend on the order of their terms.

/// WGSL of `add(at, x, scale)`, which adds a term to sum number `at` of a buffer of [`FIXED`](crate::FIXED) sums, and of its first
/// half `term(at, x, scale, large)`, from the names of all: WGSL hands no buffer to a function.
///
/// ```
/// const MORE: &str = photofit_gpu::fixed_adding!("add_more", "more_term", "more_sums");
/// assert!(MORE.contains("fn add_more(at: u32, x: f32, scale: f32)"));
/// ```
#[macro_export]
macro_rules! fixed_adding {
    ($add:literal, $term:literal, $sums:literal) => {
        concat!(
            "// The words of a term of sum number `at`, where `large` is `fixed_large(scale)`. What the status has to know of the\n",
            "// term is told.\n",
            "fn ",
            $term,
            "(at: u32, x: f32, scale: f32, large: u32) -> vec2<u32> {
    let bits = fixed_bits(x);
    if bits < large {
        return fixed_words(x, scale);
    }
    let last = arrayLength(&",
            $sums,
            ") - 1u;
    if bits >= 0x7f800000u {
//@ 32
        atomicOr(&",
            $sums,
            "[last].high, FIXED_NOT_FINITE);
//@ 64
        atomicOr(&",
            $sums,
            "[last], u64(FIXED_NOT_FINITE) << 32u);
//@
        return vec2<u32>(0u);
    }
    let count = last - 1u - at / FIXED_SHARED;
    let size = fixed_size(x, scale);
//@ 32
    var before: u32;
    if x < 0.0 {
        before = atomicAdd(&",
            $sums,
            "[count].high, size);
    } else {
        before = atomicAdd(&",
            $sums,
            "[count].low, size);
    }
    let verdict = fixed_verdict(x, scale, before + size);
    if verdict != 0u {
        atomicOr(&",
            $sums,
            "[last].high, verdict);
    }
//@ 64
    let word = select(0u, 32u, x < 0.0);
    let before = u32((atomicAdd(&",
            $sums,
            "[count], u64(size) << word) >> word) & 0xfffffffflu);
    let verdict = fixed_verdict(x, scale, before + size);
    if verdict != 0u {
        atomicOr(&",
            $sums,
            "[last], u64(verdict) << 32u);
    }
//@
    return fixed_words(x, scale);
}

// Adds `x` to sum number `at`.
fn ",
            $add,
            "(at: u32, x: f32, scale: f32) {
    let words = ",
            $term,
            "(at, x, scale, fixed_large(scale));
//@ 32
    let before = atomicAdd(&",
            $sums,
            "[at].low, words.x);
    let high = words.y + select(0u, 1u, before > 0xffffffffu - words.x);
    if high != 0u {
        // Its result is not used, so that a device need not wait for it.
        atomicAdd(&",
            $sums,
            "[at].high, high);
    }
//@ 64
    atomicAdd(&",
            $sums,
            "[at], (u64(words.y) << 32u) | u64(words.x));
//@
}
"
        )
    };
}

/// Sums that do not depend on the order of their terms (`add_fixed`), in a buffer of [`fixed_words`].
pub const FIXED: &str =
    concat!(include_str!("wgsl/fixed.wgsl"), fixed_adding!("add_fixed", "fixed_term", "sums"));
/// Bits of the status of such sums by which one is lost: a term was not finite, or large terms were too many for its range.
pub const FIXED_LOST: u32 = 3;
/// Bit of the status of such sums: a term was larger than its limit, and counted as that.
pub const FIXED_LIMITED: u32 = 4;
/// What turns such sums into numbers (`read_fixed`).
pub const FIXED_READ: &str = include_str!("wgsl/fixed_read.wgsl");
/// Sums that share a count of their large terms.
const SHARED: usize = 16;

/// Words of a buffer of `n` sums of [`FIXED`]: two each, two for each 16 of them that count large terms, and two more, the
/// last of which is the status.
pub const fn fixed_words(n: usize) -> usize {
    2 * (n + n.div_ceil(SHARED) + 1)
}
