// Texel gradients of lookups: twin of `scatter.rs`, as fixed-point sums (`add_fixed`), so many a texel as there are
// channels with gradients.

const NO_SUM: u32 = 0xffffffffu;

// By the bits: comparisons may take what is not a number for zero, and it must reach the status of the sums.
fn is_zero(x: f32) -> bool {
    return (bitcast<u32>(x) << 1u) == 0u;
}

// Adds the adjoint of one lookup: its taps one after the other, so that the code of a sum stands here once.
fn scatter(at: Lookup, g: Texel) {
    var columns = g;
    let near = tap_weights(at.fine) * (1.0 - at.share);
    let far = tap_weights(at.coarse) * at.share;
    let taps = select(4u, 8u, at.share > 0.0);
    for (var k = 0u; k < taps; k++) {
        let coarse = k >= 4u;
        let weight = select(near[k & 3u], far[k & 3u], coarse);
        if weight == 0.0 {
            continue;
        }
        let first = select(at.fine.index[k & 3u], at.coarse.index[k & 3u], coarse) * params.maps.channels;
        for (var q = 0u; q < 4u; q++) {
            let slots = params.maps.slots[q];
            let column = columns[q] * weight;
            for (var c = 0u; c < 4u; c++) {
                if slots[c] != NO_SUM && !is_zero(column[c]) {
                    add_fixed(first + slots[c], column[c], params.maps.scale);
                }
            }
        }
    }
}
