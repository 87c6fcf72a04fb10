// Value of a sum made by `add_fixed`, from its two words; `scale` as there.
fn read_fixed(low: u32, high: u32, scale: f32) -> f32 {
    var words = vec2<u32>(low, high);
    let negative = high >= 0x80000000u;
    if negative {
        let flipped = ~low + 1u;
        words = vec2<u32>(flipped, ~high + select(0u, 1u, flipped == 0u));
    }
    let x = (f32(words.y) * 4294967296.0 + f32(words.x)) / scale;
    return select(x, -x, negative);
}
