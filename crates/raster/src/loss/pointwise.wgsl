// Twin of the losses that are a sum of terms of one sample each: value by a tree of a fixed shape, and gradient.
struct Loss {
    // Pixels of the pictures.
    pixels: u32,
    // LOG_L1 to SMAPE below, or one more for relative squares.
    kind: u32,
    // Channels that are read.
    first: u32,
    end: u32,
    // What terms are multiplied by, their number included.
    scale: f32,
    // 1: pixels have weights.
    weighted: u32,
    // 1: adds to the gradient and the value, else overwrites them.
    accumulates: u32,
    // Place of the value.
    place: u32,
    // Pixels that count: from one up to another.
    counted_from: u32,
    counted_to: u32,
    pad_a: u32,
    pad_b: u32,
}

@group(0) @binding(0) var<uniform> params: Loss;
@group(0) @binding(1) var<storage, read> x: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> y: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> weights: array<f32>;
@group(0) @binding(4) var<storage, read_write> gradient: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> partial: array<f32>;

const LOG_L1: u32 = 0u;
const LOG_L2: u32 = 1u;
const SQUARES: u32 = 2u;
const SMAPE: u32 = 3u;

// A term and its derivative with respect to `x`.
fn term(x: f32, y: f32) -> vec2<f32> {
    if params.kind <= LOG_L2 {
        let a = tone(x);
        let d = a.x - tone(y).x;
        if params.kind == LOG_L1 {
            return vec2<f32>(abs(d), sign(d) * a.y);
        }
        return vec2<f32>(d * d, (d + d) * a.y);
    }
    let cx = clamp_magnitude(x);
    let a = select(cx.x, -cx.x, x < 0.0);
    let b = select(1.0, -1.0, y < 0.0) * clamp_magnitude(y).x;
    let d = a - b;
    if params.kind == SQUARES {
        return vec2<f32>(d * d, (d + d) * cx.y);
    }
    if params.kind == SMAPE {
        let inverse = 1.0 / (abs(a) + abs(b) + 0.01);
        let value = abs(d) * inverse;
        return vec2<f32>(value, (sign(d) - value * sign(a)) * inverse * cx.y);
    }
    let inverse = 1.0 / (a * a + b * b + 0.1);
    let value = d * d * inverse;
    let half = (d - value * a) * inverse * cx.y;
    return vec2<f32>(value, half + half);
}

var<workgroup> lanes: array<f32, 256>;

// Sum over the workgroup, in lane 0.
fn reduce(lane: u32, value: f32) -> f32 {
    lanes[lane] = value;
    for (var n = 128u; n > 0u; n >>= 1u) {
        workgroupBarrier();
        if lane < n {
            lanes[lane] += lanes[lane + n];
        }
    }
    return lanes[0];
}

// One invocation per pixel.
@compute @workgroup_size(256)
fn terms(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
         @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, 256u);
    var sum = 0.0;
    if i < params.pixels {
        var weight = 1.0;
        if params.weighted != 0u {
            weight = weights[i];
        }
        var g = vec4<f32>(0.0);
        if params.accumulates != 0u {
            g = gradient[i];
        }
        if weight != 0.0 && i >= params.counted_from && i < params.counted_to {
            let a = x[i];
            let b = y[i];
            for (var c = params.first; c < params.end; c++) {
                let t = term(a[c], b[c]);
                sum += weight * t.x;
                g[c] += t.y * (params.scale * weight);
                if is_nan(a[c]) || is_nan(b[c]) {
                    // Not hidden: a number that is none, made where no compiler can see it.
                    sum = bitcast<f32>(0x7fc00000u | (bitcast<u32>(weight) & 1u));
                }
            }
        }
        gradient[i] = g;
    }
    let whole = reduce(lane, sum);
    let at = group.y * groups.x + group.x;
    if lane == 0u && at * 256u < params.pixels {
        partial[at] = whole;
    }
}

@group(0) @binding(1) var<storage, read> parts: array<f32>;
@group(0) @binding(2) var<storage, read_write> value: array<f32>;

// A single workgroup: adds up the parts.
@compute @workgroup_size(256)
fn finish(@builtin(local_invocation_index) lane: u32) {
    let count = (params.pixels + 255u) / 256u;
    var sum = 0.0;
    for (var i = lane; i < count; i += 256u) {
        sum += parts[i];
    }
    let whole = reduce(lane, sum) * params.scale;
    if lane == 0u {
        if params.accumulates != 0u {
            value[params.place] += whole;
        } else {
            value[params.place] = whole;
        }
    }
}
