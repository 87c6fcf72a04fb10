// Twin of the way back of log_domain.rs: the exponential, and the estimate times the ratio of local means, G(L) / G(u).

struct Params {
    width: u32,
    height: u32,
    // Taps of the Gaussian: 0 to radius.
    radius: u32,
    plane: u32,
    // 0: pixels with diffuse reflectance; 1: those without.
    black: u32,
    count: u32,
    unused_0: u32,
    unused_1: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> u: array<f32>;
@group(0) @binding(2) var<storage, read> noisy: array<f32>;
// Weights, with a minus where a pixel has no diffuse reflectance.
@group(0) @binding(3) var<storage, read> weights: array<f32>;
@group(0) @binding(4) var<storage, read> taps: array<f32>;
// Sums along rows: of the noisy plane, of the estimate, of the weights.
@group(0) @binding(5) var<storage, read_write> sums: array<vec4<f32>>;

const LANES: u32 = 256u;

// exp(x) - 1 without cancellation.
fn expm1(x: f32) -> f32 {
    if x >= 0.5 { return exp(x) - 1.0; }
    var sum = 1.0;
    for (var k = 10.0; k > 1.5; k -= 1.0) {
        sum = 1.0 + sum * x / k;
    }
    return sum * x;
}

@compute @workgroup_size(256)
fn exponential(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
               @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, LANES);
    if i < params.count { u[i] = expm1(max(u[i], 0.0)); }
}

fn weighted(pixel: u32) -> vec4<f32> {
    let sign = weights[pixel];
    let w = max(select(sign, -sign, params.black != 0u), 0.0);
    let k = params.plane * params.width * params.height + pixel;
    return vec4<f32>(noisy[k] * w, u[k] * w, w, 0.0);
}

@compute @workgroup_size(256)
fn mean_rows(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
             @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, LANES);
    if i >= params.width * params.height { return; }
    let x = i % params.width;
    var sum = taps[0] * weighted(i);
    for (var k = 1u; k <= params.radius; k++) {
        if x >= k { sum += taps[k] * weighted(i - k); }
        if x + k < params.width { sum += taps[k] * weighted(i + k); }
    }
    sums[i] = sum;
}

@compute @workgroup_size(256)
fn mean_columns(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
                @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, LANES);
    if i >= params.width * params.height { return; }
    if (weights[i] < 0.0) != (params.black != 0u) { return; }
    let y = i / params.width;
    var sum = taps[0] * sums[i];
    for (var k = 1u; k <= params.radius; k++) {
        if y + k < params.height { sum += taps[k] * sums[i + k * params.width]; }
        if y >= k { sum += taps[k] * sums[i - k * params.width]; }
    }
    if sum.z > 1e-6 {
        let bright = sum.x / sum.z;
        let dark = sum.y / sum.z;
        if dark > 1e-6 {
            let k = params.plane * params.width * params.height + i;
            u[k] = u[k] * clamp(bright / dark, 0.5, 2.0);
        }
    }
}
