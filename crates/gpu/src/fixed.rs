//! Sums that do not depend on the order of their terms.

/// WGSL of `add(at, x, scale)`, which adds a term to sum number `at` of a buffer of [`FIXED`](crate::FIXED) sums, from the
/// names of both: WGSL hands no buffer to a function.
///
/// ```
/// const MORE: &str = photofit_gpu::fixed_adding!("add_more", "more_sums");
/// assert!(MORE.contains("fn add_more(at: u32, x: f32, scale: f32)"));
/// ```
#[macro_export]
macro_rules! fixed_adding {
    ($add:literal, $sums:literal) => {
        concat!(
            "// Adds to the high word of sum number `at` what term `x` adds to it; large terms are counted.\n",
            "fn ",
            $add,
            "_high(at: u32, x: f32, scale: f32, high: u32) {
    if high == 0u {
        return;
    }
    // Its result is not used, so that a device need not wait for it.
    atomicAdd(&",
            $sums,
            "[at].high, high);
    if !fixed_is_large(x, scale) {
        return;
    }
    let last = arrayLength(&",
            $sums,
            ") - 1u;
    let count = last - 1u - at / FIXED_SHARED;
    let size = fixed_size(x, scale);
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
}

// Adds `x` to sum number `at`.
fn ",
            $add,
            "(at: u32, x: f32, scale: f32) {
    if !fixed_is_finite(x) {
        atomicOr(&",
            $sums,
            "[arrayLength(&",
            $sums,
            ") - 1u].high, FIXED_NOT_FINITE);
        return;
    }
    let words = fixed_words(x, scale);
    let before = atomicAdd(&",
            $sums,
            "[at].low, words.x);
    ",
            $add,
            "_high(at, x, scale, words.y + fixed_carry(before, words.x));
}
"
        )
    };
}

/// Sums that do not depend on the order of their terms (`add_fixed`), in a buffer of [`fixed_words`].
pub const FIXED: &str = concat!(include_str!("wgsl/fixed.wgsl"), fixed_adding!("add_fixed", "sums"));
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
