// Texel gradients of lookups: twin of `scatter.rs`, as fixed-point sums (`add_fixed`), so many a texel as there are
// channels with gradients.
//
// The lanes of a workgroup of 64 keep their lookups and gradients; then sixteen lanes together, one a channel, take those of
// one lane after another, tap by tap: the sums of a texel lie beside each other, and what neighbours add at once goes to
// memory at once.

const NO_SUM: u32 = 0xffffffffu;
// Eight taps of a lane: texels, then weights. Odd numbers a lane, so that lanes write to different banks.
const TAPS_PITCH: u32 = 17u;

var<workgroup> taps_of_lanes: array<u32, 1088>;
var<workgroup> gradients_of_lanes: array<f32, 1088>;

// By the bits: comparisons may take what is not a number for zero, and it must reach the status of the sums.
fn is_zero(x: f32) -> bool {
    return (bitcast<u32>(x) << 1u) == 0u;
}

// The lane has no lookup.
fn keep_no_taps(lane: u32) {
    taps_of_lanes[lane * TAPS_PITCH + 16u] = 0u;
}

// Keeps a lookup of a lane and its gradient for `scatter_lanes`.
fn keep_taps(lane: u32, at: Lookup, g: Texel) {
    let first = lane * TAPS_PITCH;
    let near = bitcast<vec4<u32>>(tap_weights(at.fine) * (1.0 - at.share));
    let far = bitcast<vec4<u32>>(tap_weights(at.coarse) * at.share);
    for (var k = 0u; k < 4u; k++) {
        taps_of_lanes[first + k] = at.fine.index[k];
        taps_of_lanes[first + 4u + k] = at.coarse.index[k];
        taps_of_lanes[first + 8u + k] = near[k];
        taps_of_lanes[first + 12u + k] = far[k];
    }
    taps_of_lanes[first + 16u] = select(4u, 8u, at.share > 0.0);
    for (var q = 0u; q < 4u; q++) {
        let column = g[q];
        for (var c = 0u; c < 4u; c++) {
            gradients_of_lanes[first + 4u * q + c] = column[c];
        }
    }
}

fn taps_from(at: u32) -> vec4<u32> {
    return vec4<u32>(taps_of_lanes[at], taps_of_lanes[at + 1u], taps_of_lanes[at + 2u], taps_of_lanes[at + 3u]);
}

// Adds what all lanes have kept; after a barrier.
fn scatter_lanes(lane: u32) {
    let channel = lane & 15u;
    let slot = params.maps.slots[channel >> 2u][channel & 3u];
    if slot == NO_SUM {
        return;
    }
    for (var other = lane >> 4u; other < 64u; other += 4u) {
        let first = other * TAPS_PITCH;
        let count = taps_of_lanes[first + 16u];
        let g = gradients_of_lanes[first + channel];
        if count == 0u || is_zero(g) {
            continue;
        }
        for (var k = 0u; k < count; k += 4u) {
            let at = taps_from(first + k) * params.maps.channels + slot;
            add_fixed_4(at, g * bitcast<vec4<f32>>(taps_from(first + 8u + k)), params.maps.scale);
        }
    }
}
