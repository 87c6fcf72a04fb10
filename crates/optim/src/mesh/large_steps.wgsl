// One iteration of the solve with M = I + lambda L: twin of what LargeSteps does by a factor, and EdgeAware where edges have
// weights.
//
// Chebyshev's semi-iteration (Golub and Varga 1961) on Jacobi's: x'' = x + omega (D^-1 (b + lambda A x') - x). `next` holds
// x and takes x''.

struct Params {
    vertices: u32,
    // 1: the first iteration, which reads no x.
    begins: u32,
    lambda: f32,
    omega: f32,
    // Distance of normals at which weights fall to 1/e.
    sigma: f32,
    unused_1: u32,
    unused_2: u32,
    unused_3: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
// Offsets of the rows of neighbours, one more than vertices, then the neighbours.
@group(0) @binding(1) var<storage, read> rings: array<u32>;
@group(0) @binding(2) var<storage, read> b: array<f32>;
@group(0) @binding(3) var<storage, read> present: array<f32>;
@group(0) @binding(4) var<storage, read_write> next: array<f32>;
// Of each entry of the neighbours.
@group(0) @binding(5) var<storage, read_write> weights: array<f32>;
@group(0) @binding(6) var<storage, read> normals: array<f32>;

struct Row {
    // Weights of the edges times the present values of their ends, and the sum of the weights.
    sum: vec3<f32>,
    weight: f32,
}

fn vertex(i: u32) -> vec3<f32> {
    return vec3<f32>(present[3u * i], present[3u * i + 1u], present[3u * i + 2u]);
}

// What an iteration makes of a row.
fn update(i: u32, row: Row) {
    let at = 3u * i;
    let right = vec3<f32>(b[at], b[at + 1u], b[at + 2u]);
    var x = (right + params.lambda * row.sum) / (1.0 + params.lambda * row.weight);
    if params.omega != 1.0 {
        let before = vec3<f32>(next[at], next[at + 1u], next[at + 2u]);
        x = before + params.omega * (x - before);
    }
    next[at] = x.x;
    next[at + 1u] = x.y;
    next[at + 2u] = x.z;
}

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
    var sum = vec3<f32>(0.0);
    if params.begins == 0u {
        for (var e = start; e < end; e++) {
            sum += vertex(rings[e]);
        }
    }
    update(i, Row(sum, f32(end - start)));
}

// The same with weights.
@compute @workgroup_size(64)
fn iterate_weighted(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane, 64u);
    if i >= params.vertices {
        return;
    }
    var row = Row(vec3<f32>(0.0), 0.0);
    for (var e = rings[i]; e < rings[i + 1u]; e++) {
        row.weight += weights[e];
        if params.begins == 0u {
            row.sum += weights[e] * vertex(rings[params.vertices + 1u + e]);
        }
    }
    update(i, row);
}

// Weights by the distance of the normals of an edge's ends.
@compute @workgroup_size(64)
fn weigh(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane, 64u);
    if i >= params.vertices {
        return;
    }
    let n = vec3<f32>(normals[3u * i], normals[3u * i + 1u], normals[3u * i + 2u]);
    for (var e = rings[i]; e < rings[i + 1u]; e++) {
        let j = 3u * rings[params.vertices + 1u + e];
        let d = n - vec3<f32>(normals[j], normals[j + 1u], normals[j + 2u]);
        weights[e] = exp(-length(d) / params.sigma);
    }
}
