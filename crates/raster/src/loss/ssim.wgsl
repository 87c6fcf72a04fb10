// Twin of structural similarity: the window along rows, then across them; gradients by the same filter in reverse.
struct Similarity {
    // Columns and rows of the pictures.
    width: u32,
    height: u32,
    // Channels that are read.
    first: u32,
    end: u32,
    // What terms are multiplied by, their number included.
    scale: f32,
    // 1: pixels have weights.
    weighted: u32,
    // 1: adds to the gradient, else overwrites it.
    accumulates: u32,
    // Pixels that count: from one up to another.
    counted_from: u32,
    counted_to: u32,
    pad_a: u32,
    pad_b: u32,
    pad_c: u32,
    // Of the window; those beyond TAPS are 0.
    taps: array<vec4<f32>, 3>,
}

const RADIUS: i32 = 5;
const C1: f32 = 1e-4;
const C2: f32 = 9e-4;

@group(0) @binding(0) var<uniform> params: Similarity;

fn tap(k: i32) -> f32 {
    let at = u32(k + RADIUS);
    return params.taps[at / 4u][at % 4u];
}

fn pixels() -> u32 {
    return params.width * params.height;
}

// The channels that are read, as 1 and 0.
fn mask() -> vec4<f32> {
    let c = vec4<u32>(0u, 1u, 2u, 3u);
    return select(vec4<f32>(0.0), vec4<f32>(1.0), (c >= vec4<u32>(params.first)) & (c < vec4<u32>(params.end)));
}

// Reciprocal of the sum of the taps that lie inside of a side of `n` pixels.
fn norm(at: u32, n: u32) -> f32 {
    var sum = 0.0;
    for (var k = -RADIUS; k <= RADIUS; k++) {
        let i = i32(at) + k;
        if i >= 0 && i < i32(n) {
            sum += tap(k);
        }
    }
    return 1.0 / sum;
}

// Three values a pixel: tone of the candidate, its slope, tone of the reference.
@group(0) @binding(1) var<storage, read> x: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> y: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> toned: array<vec4<f32>>;

fn visible_tone(x: f32) -> vec2<f32> {
    if is_nan(x) {
        // Not hidden.
        return vec2<f32>(x, x);
    }
    return tone(x);
}

@compute @workgroup_size(256)
fn tones(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
         @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, 256u);
    if i >= pixels() {
        return;
    }
    let p = x[i];
    let q = y[i];
    var a = vec4<f32>(0.0);
    var slope = vec4<f32>(0.0);
    var b = vec4<f32>(0.0);
    for (var c = params.first; c < params.end; c++) {
        let t = visible_tone(p[c]);
        a[c] = t.x;
        slope[c] = t.y;
        b[c] = visible_tone(q[c]).x;
    }
    toned[3u * i] = a;
    toned[3u * i + 1u] = slope;
    toned[3u * i + 2u] = b;
}

// Five values a pixel: a, b, a^2, b^2, ab filtered along the rows.
@group(0) @binding(1) var<storage, read> tones_of: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> along: array<vec4<f32>>;

@compute @workgroup_size(256)
fn rows(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, 256u);
    if i >= pixels() {
        return;
    }
    let column = i32(i % params.width);
    var sums = array<vec4<f32>, 5>();
    for (var k = max(-RADIUS, -column); k <= min(RADIUS, i32(params.width) - 1 - column); k++) {
        let at = 3u * u32(i32(i) + k);
        let w = tap(k);
        let a = tones_of[at];
        let b = tones_of[at + 2u];
        sums[0] += w * a;
        sums[1] += w * b;
        sums[2] += w * (a * a);
        sums[3] += w * (b * b);
        sums[4] += w * (a * b);
    }
    for (var m = 0u; m < 5u; m++) {
        along[5u * i + m] = sums[m];
    }
}

// Across the rows: similarity, summed by workgroups, and its derivatives by the filtered a, a^2, ab over the norm.
@group(0) @binding(1) var<storage, read> rows_of: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> weights: array<f32>;
@group(0) @binding(3) var<storage, read_write> derivatives: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> partial: array<f32>;

var<workgroup> lanes: array<f32, 256>;

@compute @workgroup_size(256)
fn similarity(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
              @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, 256u);
    var sum = 0.0;
    if i < pixels() {
        let row = i32(i / params.width);
        var m = array<vec4<f32>, 5>();
        for (var k = max(-RADIUS, -row); k <= min(RADIUS, i32(params.height) - 1 - row); k++) {
            let at = 5u * u32(i32(i) + k * i32(params.width));
            let w = tap(k);
            for (var n = 0u; n < 5u; n++) {
                m[n] += w * rows_of[at + n];
            }
        }
        let normal = norm(i % params.width, params.width) * norm(u32(row), params.height);
        for (var n = 0u; n < 5u; n++) {
            m[n] *= normal;
        }
        var weight = 1.0;
        if params.weighted != 0u {
            weight = weights[i];
        }
        let a1 = 2.0 * m[0] * m[1] + C1;
        let a2 = 2.0 * (m[4] - m[0] * m[1]) + C2;
        let b1 = 1.0 / (m[0] * m[0] + m[1] * m[1] + C1);
        let b2 = 1.0 / ((m[2] - m[0] * m[0]) + (m[3] - m[1] * m[1]) + C2);
        let s = a1 * a2 * (b1 * b2);
        let by_mean = 2.0 * (m[1] * (a2 - a1) * (b1 * b2) + m[0] * s * (b2 - b1));
        if i >= params.counted_from && i < params.counted_to {
            let scale = -(normal * weight) * mask();
            derivatives[3u * i] = scale * by_mean;
            derivatives[3u * i + 1u] = scale * (-s * b2);
            derivatives[3u * i + 2u] = scale * (2.0 * a1 * (b1 * b2));
            sum = weight * dot(mask(), 1.0 - s);
        } else {
            derivatives[3u * i] = vec4<f32>(0.0);
            derivatives[3u * i + 1u] = vec4<f32>(0.0);
            derivatives[3u * i + 2u] = vec4<f32>(0.0);
        }
    }
    lanes[lane] = sum;
    for (var n = 128u; n > 0u; n >>= 1u) {
        workgroupBarrier();
        if lane < n {
            lanes[lane] += lanes[lane + n];
        }
    }
    let at = group.y * groups.x + group.x;
    if lane == 0u && at * 256u < pixels() {
        partial[at] = lanes[0];
    }
}

// Three values a pixel: the derivatives filtered across the rows.
@group(0) @binding(1) var<storage, read> derivatives_of: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> across: array<vec4<f32>>;

@compute @workgroup_size(256)
fn columns(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
           @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, 256u);
    if i >= pixels() {
        return;
    }
    let row = i32(i / params.width);
    var sums = array<vec4<f32>, 3>();
    for (var k = max(-RADIUS, -row); k <= min(RADIUS, i32(params.height) - 1 - row); k++) {
        let at = 3u * u32(i32(i) + k * i32(params.width));
        for (var n = 0u; n < 3u; n++) {
            sums[n] += tap(k) * derivatives_of[at + n];
        }
    }
    for (var n = 0u; n < 3u; n++) {
        across[3u * i + n] = sums[n];
    }
}

// Along the rows, and by the slope of the tone curve.
@group(0) @binding(1) var<storage, read> columns_of: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> tones_at: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> gradient: array<vec4<f32>>;

@compute @workgroup_size(256)
fn collect(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
           @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, 256u);
    if i >= pixels() {
        return;
    }
    let column = i32(i % params.width);
    var sums = array<vec4<f32>, 3>();
    for (var k = max(-RADIUS, -column); k <= min(RADIUS, i32(params.width) - 1 - column); k++) {
        let at = 3u * u32(i32(i) + k);
        for (var n = 0u; n < 3u; n++) {
            sums[n] += tap(k) * columns_of[at + n];
        }
    }
    let a = tones_at[3u * i];
    let slope = tones_at[3u * i + 1u];
    let b = tones_at[3u * i + 2u];
    var g = (sums[0] + (a + a) * sums[1] + b * sums[2]) * slope * params.scale;
    if params.accumulates != 0u {
        g += gradient[i];
    }
    gradient[i] = g;
}
