// One iteration of the solve with M = I + lambda L: twin of what LargeSteps does by a factor.
//
// Chebyshev's semi-iteration (Golub and Varga 1961) on Jacobi's: x'' = x + omega (D^-1 (b + lambda A x') - x). `next` holds
// x and takes x''.

struct Params {
    vertices: u32,
    // 1: the first iteration, which reads no x.
    begins: u32,
    lambda: f32,
    omega: f32,
}

@group(0) @binding(0) var<uniform> params: Params;
// Offsets of the rows of neighbours, one more than vertices, then the neighbours.
@group(0) @binding(1) var<storage, read> rings: array<u32>;
@group(0) @binding(2) var<storage, read> b: array<f32>;
@group(0) @binding(3) var<storage, read> present: array<f32>;
@group(0) @binding(4) var<storage, read_write> next: array<f32>;

// One vertex an invocation.
@compute @workgroup_size(64)
fn iterate(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane, 64u);
    if i >= params.vertices {
        return;
    }
    let start = rings[i] + params.vertices + 1u;
    let end = rings[i + 1u] + params.vertices + 1u;
    let at = 3u * i;
    var sum = vec3<f32>(0.0);
    if params.begins == 0u {
        for (var e = start; e < end; e++) {
            let j = 3u * rings[e];
            sum += vec3<f32>(present[j], present[j + 1u], present[j + 2u]);
        }
    }
    let right = vec3<f32>(b[at], b[at + 1u], b[at + 2u]);
    var x = (right + params.lambda * sum) / (1.0 + params.lambda * f32(end - start));
    if params.omega != 1.0 {
        let before = vec3<f32>(next[at], next[at + 1u], next[at + 2u]);
        x = before + params.omega * (x - before);
    }
    next[at] = x.x;
    next[at + 1u] = x.y;
    next[at + 2u] = x.z;
}
