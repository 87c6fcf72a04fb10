// Vertex normals weighted by angles, and their vector-Jacobian product: twin of normals/mod.rs.

@group(0) @binding(2) var<storage, read> positions: array<f32>;
@group(0) @binding(3) var<storage, read_write> normals: array<f32>;
@group(0) @binding(4) var<storage, read> d_normals: array<f32>;
// Gradient of the unnormalised normal of each welded id.
@group(0) @binding(5) var<storage, read_write> d_sums: array<f32>;
@group(0) @binding(6) var<storage, read_write> d_positions: array<f32>;

fn position(v: u32) -> vec3<f32> {
    return vec3<f32>(positions[3u * v], positions[3u * v + 1u], positions[3u * v + 2u]);
}

// A face's share in the normals of its corners: `normal * weights[k]`; all zero where the face is degenerate.
struct Share {
    // Edges from corner 0 over `scale`.
    e1: vec3<f32>,
    e2: vec3<f32>,
    scale: f32,
    sine: f32,
    normal: vec3<f32>,
    weights: vec3<f32>,
}

fn share(t: u32) -> Share {
    var s: Share;
    let v = triangle(t);
    let p = position(v.x);
    let e1 = position(v.y) - p;
    let e2 = position(v.z) - p;
    let scale = max(reach(e1), reach(e2));
    if !(scale > MIN_POSITIVE && is_finite3(e1) && is_finite3(e2)) {
        return s;
    }
    s.e1 = e1 / scale;
    s.e2 = e2 / scale;
    let normal = cross(s.e1, s.e2);
    let sine = length_of(normal);
    if !(sine > EPSILON) {
        return s;
    }
    s.scale = scale;
    s.sine = sine;
    s.normal = normal / sine;
    let first = arc(sine, dot(s.e1, s.e2));
    let second = arc(sine, dot(s.e1, s.e1 - s.e2));
    s.weights = vec3<f32>(first, second, max(PI - first - second, 0.0));
    return s;
}

// Unnormalised normal of a welded id.
fn weighted_sum(w: u32) -> vec3<f32> {
    let span = corners_of_weld(w);
    var sum = vec3<f32>(0.0);
    for (var i = span.x; i < span.y; i++) {
        let c = topology[i];
        let s = share(c / 3u);
        sum += s.normal * s.weights[c % 3u];
    }
    return sum;
}

// One vertex an invocation.
@compute @workgroup_size(64)
fn forward(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let v = index(group, groups, lane, 64u);
    if v >= params.vertices {
        return;
    }
    let n = unit(weighted_sum(weld_of(v)));
    normals[3u * v] = n.x;
    normals[3u * v + 1u] = n.y;
    normals[3u * v + 2u] = n.z;
}

// One welded id an invocation: the gradient of its sum.
@compute @workgroup_size(64)
fn vjp_sums(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let w = index(group, groups, lane, 64u);
    if w >= params.welds {
        return;
    }
    let span = members_of(w);
    var g = vec3<f32>(0.0);
    for (var i = span.x; i < span.y; i++) {
        let v = 3u * topology[i];
        g += vec3<f32>(d_normals[v], d_normals[v + 1u], d_normals[v + 2u]);
    }
    let d = unit_vjp(weighted_sum(w), g);
    d_sums[3u * w] = d.x;
    d_sums[3u * w + 1u] = d.y;
    d_sums[3u * w + 2u] = d.z;
}

fn d_sum(v: u32) -> vec3<f32> {
    let w = 3u * weld_of(v);
    return vec3<f32>(d_sums[w], d_sums[w + 1u], d_sums[w + 2u]);
}

// Gradient of corner `at` of face `t`.
fn share_vjp(t: u32, at: u32) -> vec3<f32> {
    let s = share(t);
    if !(s.sine > 0.0) {
        return vec3<f32>(0.0);
    }
    let v = triangle(t);
    var g = array<vec3<f32>, 3>(d_sum(v.x), d_sum(v.y), d_sum(v.z));
    let g_normal = g[0] * s.weights.x + g[1] * s.weights.y + g[2] * s.weights.z;
    let n = s.normal;
    let g_cross = (g_normal - n * dot(n, g_normal)) / s.sine;
    let d1 = cross(s.e2, g_cross);
    let d2 = cross(g_cross, s.e1);
    var d = array<vec3<f32>, 3>(-(d1 + d2), d1, d2);
    // The angle at corner k falls as its next corner turns by n x edge, and so for the corner before.
    let side = s.e2 - s.e1;
    var turn = array<vec3<f32>, 3>(
        cross(n, s.e1) / dot(s.e1, s.e1),
        cross(n, side) / dot(side, side),
        cross(n, -s.e2) / dot(s.e2, s.e2),
    );
    for (var k = 0u; k < 3u; k++) {
        let next = (k + 1u) % 3u;
        let last = (k + 2u) % 3u;
        let g_angle = dot(n, g[k]);
        d[next] -= turn[k] * g_angle;
        d[last] -= turn[last] * g_angle;
        d[k] += (turn[k] + turn[last]) * g_angle;
    }
    return d[at] / s.scale;
}

// One vertex an invocation: adds the gradients of its corners.
@compute @workgroup_size(64)
fn vjp(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let v = index(group, groups, lane, 64u);
    if v >= params.vertices {
        return;
    }
    let span = corners_of_vertex(v);
    var d = vec3<f32>(d_positions[3u * v], d_positions[3u * v + 1u], d_positions[3u * v + 2u]);
    for (var i = span.x; i < span.y; i++) {
        let c = topology[i];
        d += share_vjp(c / 3u, c % 3u);
    }
    d_positions[3u * v] = d.x;
    d_positions[3u * v + 1u] = d.y;
    d_positions[3u * v + 2u] = d.z;
}
