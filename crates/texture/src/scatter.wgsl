// Texel gradients of lookups: twin of `scatter.rs`, as fixed-point sums (`add_fixed`), so many a texel as there are
// channels with gradients.

const NO_SUM: u32 = 0xffffffffu;

// By the bits: comparisons may take what is not a number for zero, and it must reach the status of the sums.
fn is_zero(x: f32) -> bool {
    return (bitcast<u32>(x) << 1u) == 0u;
}

fn add_channels(first: u32, sums: vec4<u32>, g: vec4<f32>) {
    if sums.x != NO_SUM && !is_zero(g.x) {
        add_fixed(first + sums.x, g.x, params.maps.scale);
    }
    if sums.y != NO_SUM && !is_zero(g.y) {
        add_fixed(first + sums.y, g.y, params.maps.scale);
    }
    if sums.z != NO_SUM && !is_zero(g.z) {
        add_fixed(first + sums.z, g.z, params.maps.scale);
    }
    if sums.w != NO_SUM && !is_zero(g.w) {
        add_fixed(first + sums.w, g.w, params.maps.scale);
    }
}

fn scatter_tap(i: u32, weight: f32, g: Texel) {
    if weight == 0.0 {
        return;
    }
    let first = i * params.maps.channels;
    add_channels(first, params.maps.slots[0], g[0] * weight);
    add_channels(first, params.maps.slots[1], g[1] * weight);
    add_channels(first, params.maps.slots[2], g[2] * weight);
    add_channels(first, params.maps.slots[3], g[3] * weight);
}

fn scatter_taps(t: Taps, share: f32, g: Texel) {
    let w = tap_weights(t) * share;
    scatter_tap(t.index.x, w.x, g);
    scatter_tap(t.index.y, w.y, g);
    scatter_tap(t.index.z, w.z, g);
    scatter_tap(t.index.w, w.w, g);
}

// Adds the adjoint of one lookup.
fn scatter(at: Lookup, g: Texel) {
    scatter_taps(at.fine, 1.0 - at.share, g);
    if at.share > 0.0 {
        scatter_taps(at.coarse, at.share, g);
    }
}
