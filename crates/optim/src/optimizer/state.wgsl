// What an optimizer on a device remembers, and the constants of the present step: twin of State and Constants.

struct State {
    // Running mean of the squared gradients over 4^mean_exponent, in [1, 4), or zero.
    mean: f32,
    mean_exponent: i32,
    // Binary exponent of the moments' unit.
    scale_exponent: i32,
    // Not zero once a gradient was not finite: nothing moves any more.
    halted: u32,
    // The first such gradient, and the step it came at.
    bad_index: u32,
    bad_bits: u32,
    bad_step: u32,
    unused: u32,
    // 2^-scale_exponent.
    inverse_scale: f32,
    epsilon: f32,
    // Factors that bring the moments of the step before into the present unit.
    rescale_first: f32,
    rescale_second: f32,
    // What the first moments are multiplied with to move, where all entries share it.
    factor: f32,
    unused_1: u32,
    unused_2: u32,
    unused_3: u32,
}

// Below this (in units of the gradients' root mean square) moments count as zero, and the denominator ends.
const TINY: f32 = 1e-18;

// 2^e, zero below 2^-126 and 2^127 above that.
fn power_of_two(e: i32) -> f32 {
    return select(bitcast<f32>(u32(min(e, 127) + 127) << 23u), 0.0, e < -126);
}
