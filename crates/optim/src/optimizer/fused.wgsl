// Adam in one pass over parameters, moments and gradients: twin of fused.rs. And the stages of Adam with one second moment
// for all entries, the largest: twin of staged.rs.

struct Params {
    count: u32,
    width: u32,
    chunks: u32,
    // Where the first sample lies in the buffers of parameters and gradients.
    first: u32,
    // Decays, and what they leave.
    beta1: f32,
    beta2: f32,
    rest1: f32,
    rest2: f32,
    // Bias corrections.
    correction1: f32,
    correction2: f32,
    unused_1: f32,
    unused_2: f32,
    // Rate of each column; 0 freezes it.
    rates: array<vec4<f32>, 4>,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> state: State;
@group(0) @binding(2) var<storage, read_write> x: array<f32>;
@group(0) @binding(3) var<storage, read> gradients: array<f32>;
@group(0) @binding(4) var<storage, read_write> m: array<f32>;
@group(0) @binding(5) var<storage, read_write> v: array<f32>;
// The largest second moment of each chunk.
@group(0) @binding(6) var<storage, read_write> maxima: array<f32>;
// Direction of the move where entries share their second moment: the first moments, filtered or not.
@group(0) @binding(7) var<storage, read> direction: array<f32>;

fn rate_of(i: u32) -> f32 {
    let column = i % params.width;
    return params.rates[column / 4u][column % 4u];
}

// The gradient in the unit of the moments; frozen columns count as zero.
fn gradient(i: u32) -> f32 {
    return select(0.0, gradients[params.first + i] * state.inverse_scale, rate_of(i) > 0.0);
}

// One sample an invocation.
@compute @workgroup_size(256)
fn dense(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane, 256u);
    if i >= params.count || state.halted != 0u {
        return;
    }
    let g = gradient(i);
    var first = params.beta1 * (m[i] * state.rescale_first) + params.rest1 * g;
    var second = params.beta2 * (v[i] * state.rescale_second) + params.rest2 * (g * g);
    first = select(first, 0.0, abs(first) < TINY);
    second = select(second, 0.0, second < TINY * TINY);
    m[i] = first;
    v[i] = second;
    let size = sqrt(second * params.correction2) + state.epsilon;
    x[params.first + i] -= rate_of(i) * (first * params.correction1) / size;
}

var<workgroup> largest: array<f32, 256>;

fn reduce_largest(lane: u32, value: f32) {
    largest[lane] = value;
    for (var half = 128u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if lane < half {
            largest[lane] = max(largest[lane], largest[lane + half]);
        }
    }
    workgroupBarrier();
}

// One sample an invocation: the moments, and their largest in each workgroup.
@compute @workgroup_size(256)
fn accumulate(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane, 256u);
    var second = 0.0;
    if i < params.count && state.halted == 0u {
        let g = gradient(i);
        second = params.beta2 * (v[i] * state.rescale_second) + params.rest2 * (g * g);
        m[i] = params.beta1 * (m[i] * state.rescale_first) + params.rest1 * g;
        v[i] = second;
    }
    reduce_largest(lane, second);
    let number = group.y * groups.x + group.x;
    if lane == 0u && number < params.chunks {
        maxima[number] = largest[0];
    }
}

// One workgroup: the factor of the move.
@compute @workgroup_size(256)
fn factor(@builtin(local_invocation_index) lane: u32) {
    var most = 0.0;
    for (var c = lane; c < params.chunks; c += 256u) {
        most = max(most, maxima[c]);
    }
    reduce_largest(lane, most);
    if lane == 0u {
        let all = sqrt(largest[0] * params.correction2);
        state.factor = select(0.0, params.correction1 / all, all > 0.0);
    }
}

// One sample an invocation.
@compute @workgroup_size(256)
fn uniform_move(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane, 256u);
    if i >= params.count || state.halted != 0u {
        return;
    }
    x[params.first + i] -= rate_of(i) * state.factor * direction[i];
}
