// The box filter between levels and its adjoints: twin of `filter.rs`, for texels of 16 channels.

struct Params {
    // First texel, columns and rows.
    fine: vec4<u32>,
    coarse: vec4<u32>,
    // Whether alpha is coverage; then the first channels, so many, are colours, and `alpha` is the channel of alpha.
    coverage: u32,
    colors: u32,
    alpha: u32,
    // Adjoint: 0 the exact transpose, 1 bilinear upsampling.
    upsampled: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> texels: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> gradient: array<vec4<f32>>;

// Mean alpha up to which colours count by area alone.
const LEAST_COVERAGE: f32 = 1.0 / 4096.0;

fn value(i: u32) -> mat4x4<f32> {
    return mat4x4<f32>(texels[4u * i], texels[4u * i + 1u], texels[4u * i + 2u], texels[4u * i + 3u]);
}

fn gradient_of(i: u32) -> mat4x4<f32> {
    return mat4x4<f32>(gradient[4u * i], gradient[4u * i + 1u], gradient[4u * i + 2u], gradient[4u * i + 3u]);
}

// 1 in the channels from `first` on that lie before `end`.
fn channels(first: u32, end: u32) -> mat4x4<f32> {
    var out: mat4x4<f32>;
    for (var q = 0u; q < 4u; q++) {
        let c = 4u * q + vec4<u32>(0u, 1u, 2u, 3u);
        out[q] = select(vec4<f32>(0.0), vec4<f32>(1.0), (c >= vec4<u32>(first)) & (c < vec4<u32>(end)));
    }
    return out;
}

fn times(a: mat4x4<f32>, b: mat4x4<f32>) -> mat4x4<f32> {
    return mat4x4<f32>(a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3]);
}

fn total(a: mat4x4<f32>, b: mat4x4<f32>) -> f32 {
    return (dot(a[0], b[0]) + dot(a[1], b[1])) + (dot(a[2], b[2]) + dot(a[3], b[3]));
}

struct Children {
    first: u32,
    count: u32,
    weights: vec3<f32>,
}

// First input, number of inputs and weights of output `i` of an axis of `n` texels.
fn children(i: u32, n: u32) -> Children {
    if n == 1u {
        return Children(0u, 1u, vec3<f32>(1.0, 0.0, 0.0));
    }
    if n % 2u == 0u {
        return Children(2u * i, 2u, vec3<f32>(0.5, 0.5, 0.0));
    }
    let m = n / 2u;
    let weights = vec3<f32>(f32(m - i), f32(m), f32(i + 1u)) / f32(n);
    return Children(2u * i, 3u, weights);
}

struct Parents {
    outputs: vec2<u32>,
    weights: vec2<f32>,
}

// The one or two outputs (of `m`) that input `i` (of `n`) gives its gradient to, and their weights.
fn parents(i: u32, n: u32, m: u32) -> Parents {
    if params.upsampled == 0u {
        let o = i * m / n;
        let one = max(min((i + 1u) * m, (o + 1u) * n), i * m) - i * m;
        let start = (o + 1u) * n;
        let two = max((i + 1u) * m, start) - start;
        return Parents(vec2<u32>(o, min(o + 1u, m - 1u)), vec2<f32>(f32(one), f32(two)) / f32(n));
    }
    // (i + 1/2) m/n - 1/2 as a fraction, so that large sizes keep their weights.
    let scale = f32(m) / f32(n);
    let below = i32((2u * i + 1u) * m) - i32(n);
    let period = i32(2u * n);
    var whole = below / period;
    if below < 0 && whole * period != below {
        whole -= 1;
    }
    let f = f32(below - whole * period) / f32(period);
    let last = i32(m) - 1;
    let outputs = vec2<u32>(u32(clamp(whole, 0, last)), u32(clamp(whole + 1, 0, last)));
    return Parents(outputs, vec2<f32>((1.0 - f) * scale, f * scale));
}

// One invocation for a texel of the coarse level.
@compute @workgroup_size(64)
fn downsample(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index(group, groups, lane, 64u);
    if at >= params.coarse.y * params.coarse.z {
        return;
    }
    let columns = children(at % params.coarse.y, params.fine.y);
    let rows = children(at / params.coarse.y, params.fine.z);
    var mean = mat4x4<f32>();
    for (var j = 0u; j < rows.count; j++) {
        let first = params.fine.x + (rows.first + j) * params.fine.y + columns.first;
        for (var i = 0u; i < columns.count; i++) {
            mean += value(first + i) * (columns.weights[i] * rows.weights[j]);
        }
    }
    if params.coverage != 0u {
        let alpha = channels(params.alpha, params.alpha + 1u);
        let cover = total(mean, alpha);
        if cover > LEAST_COVERAGE {
            let share = 1.0 / cover;
            var colors = mat4x4<f32>();
            for (var j = 0u; j < rows.count; j++) {
                let first = params.fine.x + (rows.first + j) * params.fine.y + columns.first;
                for (var i = 0u; i < columns.count; i++) {
                    let v = value(first + i);
                    colors += v * (columns.weights[i] * rows.weights[j] * total(v, alpha) * share);
                }
            }
            let rest = channels(params.colors, 16u);
            mean = times(colors, channels(0u, params.colors)) + times(mean, rest);
        }
    }
    let out = 4u * (params.coarse.x + at);
    for (var q = 0u; q < 4u; q++) {
        texels[out + q] = mean[q];
    }
}

// The share of one texel in the gradient of an average by coverage.
fn coverage_vjp(fine: mat4x4<f32>, mean: mat4x4<f32>, g: mat4x4<f32>) -> mat4x4<f32> {
    let colors = channels(0u, params.colors);
    let alpha = channels(params.alpha, params.alpha + 1u);
    let share = 1.0 / total(mean, alpha);
    let moved = total(times(g, colors), fine - mean);
    let scaled = times(g, colors) * (total(fine, alpha) * share) + times(g, channels(params.colors, 16u));
    return scaled + alpha * (share * moved);
}

// One invocation for a texel of the fine level: a gather.
@compute @workgroup_size(64)
fn downsample_vjp(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index(group, groups, lane, 64u);
    if at >= params.fine.y * params.fine.z {
        return;
    }
    let columns = parents(at % params.fine.y, params.fine.y, params.coarse.y);
    let rows = parents(at / params.fine.y, params.fine.z, params.coarse.z);
    let out = params.fine.x + at;
    let alpha = channels(params.alpha, params.alpha + 1u);
    var g = gradient_of(out);
    for (var j = 0u; j < 2u; j++) {
        for (var i = 0u; i < 2u; i++) {
            let k = columns.weights[i] * rows.weights[j];
            let parent = params.coarse.x + rows.outputs[j] * params.coarse.y + columns.outputs[i];
            var part = gradient_of(parent);
            if params.coverage != 0u {
                let mean = value(parent);
                if total(mean, alpha) > LEAST_COVERAGE {
                    part = coverage_vjp(value(out), mean, part);
                }
            }
            g += part * k;
        }
    }
    for (var q = 0u; q < 4u; q++) {
        gradient[4u * out + q] = g[q];
    }
}
