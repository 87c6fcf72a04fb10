// Twin of split.rs and rows.rs for the gradient under any data term, on packed pictures (../transform/strip.wgsl): the
// estimate, then the right-hand side in its place.

struct Params {
    // Columns, columns with padding, rows, solved channels.
    width: u32,
    padded: u32,
    height: u32,
    channels: u32,
    // Channels under one norm.
    coupled: u32,
    // Of the weights alpha and those of the data term: 1 for one value per pixel, 0 for one value; and values from one
    // channel to the next.
    alpha_step: u32,
    alpha_plane: u32,
    first_step: u32,
    first_plane: u32,
    second_step: u32,
    second_plane: u32,
    // 0: absolute value and square; 1: one-sided Huber function.
    huber: u32,
    gain: f32,
    relaxation: f32,
    t0: f32,
    t1: f32,
    // The threshold is alpha times this.
    scale: f32,
    // Of `unpack`: the solved channel, the plane to write, what is added.
    channel: u32,
    plane: u32,
    offset: f32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> picture: array<vec2<f32>>;
// The splits of the gradient: what is kept, and the reflection.
@group(0) @binding(2) var<storage, read_write> kept: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read_write> reflected: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read> alpha: array<f32>;
// The split of the data term.
@group(0) @binding(5) var<storage, read_write> data: array<f32>;
@group(0) @binding(6) var<storage, read> goal: array<f32>;
@group(0) @binding(7) var<storage, read> first_weight: array<f32>;
@group(0) @binding(8) var<storage, read> second_weight: array<f32>;
@group(0) @binding(9) var<storage, read_write> planes: array<f32>;

const LANES: u32 = 256u;
const TINY: f32 = 1.17549435e-38;

fn estimate(c: u32, i: u32, j: u32) -> f32 {
    let v = picture[(c / 2u * params.height + i) * params.padded + j];
    return select(v.x, v.y, c % 2u == 1u);
}

// Sample of a channel in planes without padding.
fn sample(c: u32, i: u32, j: u32) -> u32 {
    return (c * params.height + i) * params.width + j;
}

// The reflection of one channel before it is shrunk: what is kept and the gradient of the estimate.
fn moved(c: u32, i: u32, j: u32, at: u32) -> vec2<f32> {
    let own = estimate(c, i, j);
    let right = estimate(c, i, select(j + 1u, 0u, j + 1u == params.padded));
    var z = kept[at];
    z.x += params.gain * (right - own);
    if i + 1u < params.height {
        z.y += params.gain * (estimate(c, i + 1u, j) - own);
    }
    return z;
}

// One step of the splits of the gradient at a pixel.
@compute @workgroup_size(256)
fn gradient(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
            @builtin(local_invocation_index) lane: u32) {
    let pixel = index(group, groups, lane, LANES);
    let count = params.padded * params.height;
    if pixel >= count { return; }
    let i = pixel / params.padded;
    let j = pixel % params.padded;
    // Components at the border count for nothing.
    let across = j + 1u < params.width;
    let down = j < params.width && i + 1u < params.height;
    for (var c0 = 0u; c0 < params.channels; c0 += params.coupled) {
        var square = 0.0;
        for (var c = c0; c < c0 + params.coupled; c++) {
            let z = moved(c, i, j, c * count + pixel);
            if across { square += z.x * z.x; }
            if down { square += z.y * z.y; }
        }
        var share = 0.0;
        if j < params.width {
            let threshold = alpha[params.alpha_step * (i * params.width + j) + params.alpha_plane * c0] * params.scale;
            share = threshold / max(max(sqrt(square), threshold), TINY);
        }
        let shares = vec2<f32>(select(0.0, share, across), select(0.0, share, down));
        for (var c = c0; c < c0 + params.coupled; c++) {
            let at = c * count + pixel;
            let z = moved(c, i, j, at);
            let s = z - z * shares;
            kept[at] = z - params.relaxation * s;
            reflected[at] = s + s - z;
        }
    }
}

// Both weights of the data term of a channel at a pixel.
fn data_weights(c: u32, k: u32) -> vec2<f32> {
    return vec2<f32>(first_weight[params.first_step * k + params.first_plane * c],
                     second_weight[params.second_step * k + params.second_plane * c]);
}

// The data split of a channel at a pixel, and its part of the right-hand side.
fn data_step(c: u32, i: u32, j: u32, at: u32) -> f32 {
    let q = data[at] + params.gain * estimate(c, i, j);
    var p = q;
    if j < params.width {
        let k = i * params.width + j;
        let w = data_weights(c, k);
        let wanted = goal[sample(c, i, j)];
        let s = q - wanted;
        if params.huber != 0u {
            let curved = s * params.t0 / (w.x + params.t0);
            let straight = s + w.x * w.y / params.t0;
            p = wanted + select(straight, curved, curved >= -w.y);
        } else {
            let clipped = min(max(params.t0 * s, -w.x), w.x);
            p = wanted + (params.t0 * s - clipped) / (w.y + params.t0);
        }
    }
    data[at] = q - params.relaxation * p;
    return params.t0 * (2.0 * p - q);
}

// The right-hand side of a channel at a pixel.
fn right_hand_side(c: u32, i: u32, j: u32) -> f32 {
    let count = params.padded * params.height;
    let at = c * count + i * params.padded + j;
    let f = data_step(c, i, j, at);
    let left = select(at - 1u, at + params.padded - 1u, j == 0u);
    var divergence = reflected[at].x - reflected[left].x + reflected[at].y;
    if i > 0u {
        divergence -= reflected[at - params.padded].y;
    }
    return f - params.t1 * divergence;
}

@compute @workgroup_size(256)
fn right_hand_sides(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
                    @builtin(local_invocation_index) lane: u32) {
    let pixel = index(group, groups, lane, LANES);
    let count = params.padded * params.height;
    if pixel >= count { return; }
    let i = pixel / params.padded;
    let j = pixel % params.padded;
    for (var c = 0u; c < params.channels; c += 2u) {
        var f = vec2<f32>(right_hand_side(c, i, j), 0.0);
        if c + 1u < params.channels {
            f.y = right_hand_side(c + 1u, i, j);
        }
        picture[c / 2u * count + pixel] = f;
    }
}

// The target without its holes; of Huber's function a second weight of 0 is no hole.
fn begun(c: u32, i: u32, j: u32) -> f32 {
    let k = i * params.width + j;
    let w = data_weights(c, k);
    let hole = w.x == 0.0 && (w.y == 0.0 || params.huber != 0u);
    return select(goal[sample(c, i, j)], 0.0, hole);
}

// The first estimate of a channel: the padding continues the row back to its beginning.
fn first_estimate(c: u32, i: u32, j: u32) -> f32 {
    if j < params.width { return begun(c, i, j); }
    let last = begun(c, i, params.width - 1u);
    let step = (begun(c, i, 0u) - last) / f32(params.padded - params.width + 1u);
    return last + step * f32(j - params.width + 1u);
}

@compute @workgroup_size(256)
fn begin(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
         @builtin(local_invocation_index) lane: u32) {
    let pixel = index(group, groups, lane, LANES);
    let count = params.padded * params.height;
    if pixel >= count { return; }
    let i = pixel / params.padded;
    let j = pixel % params.padded;
    for (var c = 0u; c < params.channels; c += 2u) {
        var u = vec2<f32>(first_estimate(c, i, j), 0.0);
        if c + 1u < params.channels {
            u.y = first_estimate(c + 1u, i, j);
        }
        picture[c / 2u * count + pixel] = u;
    }
}

// One plane of the estimate without padding.
@compute @workgroup_size(256)
fn unpack(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
          @builtin(local_invocation_index) lane: u32) {
    let pixel = index(group, groups, lane, LANES);
    let count = params.width * params.height;
    if pixel >= count { return; }
    var u = params.offset;
    // A constant channel is not solved.
    if params.channel < params.channels {
        u += estimate(params.channel, pixel / params.width, pixel % params.width);
    }
    planes[params.plane * count + pixel] = u;
}
