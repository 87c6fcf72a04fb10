// Texel gradients of lookups: twin of `scatter.rs`, as fixed-point sums (`add_fixed`), so many a texel as there are
// channels with gradients.
//
// The lanes of a workgroup of 64 keep their lookups and gradients; then sixteen lanes together, one a channel, take those of
// one lane after another, tap by tap: the sums of a texel lie beside each other, and what neighbours add at once goes to
// memory at once.

const NO_SUM: u32 = 0xffffffffu;
const NO_TAPS: u32 = 0xffffffffu;

// Four taps each: those of the fine level, then those of the coarse one. First sums of texels, or NO_TAPS, and weights.
var<workgroup> taps_of_lanes: array<vec4<u32>, 128>;
var<workgroup> weights_of_lanes: array<vec4<f32>, 128>;
// Sixteen a lane, turned by its number, so that lanes write to different banks.
var<workgroup> gradients_of_lanes: array<f32, 1024>;

fn place_of_gradient(lane: u32, channel: u32) -> u32 {
    return 16u * lane + ((channel + lane) & 15u);
}

// By the bits: comparisons may take what is not a number for zero, and it must reach the status of the sums.
fn is_zero(x: f32) -> bool {
    return (bitcast<u32>(x) << 1u) == 0u;
}

// The lane has no lookup.
fn keep_no_taps(lane: u32) {
    taps_of_lanes[lane] = vec4<u32>(NO_TAPS);
}

// Keeps a lookup of a lane and its gradient for `scatter_lanes`.
fn keep_taps(lane: u32, at: Lookup, g: Texel) {
    taps_of_lanes[lane] = at.fine.index * params.maps.channels;
    weights_of_lanes[lane] = tap_weights(at.fine) * (1.0 - at.share);
    taps_of_lanes[lane + 64u] = vec4<u32>(NO_TAPS);
    if at.share > 0.0 {
        taps_of_lanes[lane + 64u] = at.coarse.index * params.maps.channels;
        weights_of_lanes[lane + 64u] = tap_weights(at.coarse) * at.share;
    }
    for (var q = 0u; q < 4u; q++) {
        let column = g[q];
        for (var c = 0u; c < 4u; c++) {
            gradients_of_lanes[place_of_gradient(lane, 4u * q + c)] = column[c];
        }
    }
}

// Adds what all lanes have kept; after a barrier.
fn scatter_lanes(lane: u32) {
    let channel = lane & 15u;
    let slot = params.maps.slots[channel >> 2u][channel & 3u];
    if slot == NO_SUM {
        return;
    }
    let scale = params.maps.scale;
    let large = fixed_large(scale);
    for (var other = lane >> 4u; other < 64u; other += 4u) {
        let fine = taps_of_lanes[other];
        let g = gradients_of_lanes[place_of_gradient(other, channel)];
        if fine.x == NO_TAPS || is_zero(g) {
            continue;
        }
        add_fixed_4(fine + slot, g * weights_of_lanes[other], scale, large);
        let coarse = taps_of_lanes[other + 64u];
        if coarse.x != NO_TAPS {
            add_fixed_4(coarse + slot, g * weights_of_lanes[other + 64u], scale, large);
        }
    }
}
