// Vertex tangents, and their vector-Jacobian product: twin of tangents/mod.rs.

@group(0) @binding(2) var<storage, read> positions: array<f32>;
@group(0) @binding(3) var<storage, read> normals: array<f32>;
// What uvs say: per triangle the factors of its two edges and its handedness, then the handedness of each welded id.
@group(0) @binding(4) var<storage, read> frames: array<f32>;
@group(0) @binding(5) var<storage, read_write> tangents: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> d_tangents: array<f32>;
// Gradient of the unnormalised tangent of each welded id.
@group(0) @binding(7) var<storage, read_write> d_sums: array<f32>;
@group(0) @binding(8) var<storage, read_write> d_positions: array<f32>;
@group(0) @binding(9) var<storage, read_write> d_normals: array<f32>;

fn position(v: u32) -> vec3<f32> {
    return vec3<f32>(positions[3u * v], positions[3u * v + 1u], positions[3u * v + 2u]);
}

fn normal_of(v: u32) -> vec3<f32> {
    return vec3<f32>(normals[3u * v], normals[3u * v + 1u], normals[3u * v + 2u]);
}

fn handedness_of(w: u32) -> f32 {
    return frames[3u * params.triangles + w];
}

fn project(n: vec3<f32>, x: vec3<f32>) -> vec3<f32> {
    return x - n * dot(n, x);
}

// Adjoint of `project` in `x`.
fn project_vjp(n: vec3<f32>, g: vec3<f32>) -> vec3<f32> {
    return g - n * dot(n, g);
}

// Adjoint of `project` in `n`.
fn project_vjp_normal(n: vec3<f32>, x: vec3<f32>, g: vec3<f32>) -> vec3<f32> {
    return -(x * dot(n, g) + g * dot(n, x));
}

// Everything one corner needs, and the intermediate values of its contribution.
struct Corner {
    // Whether the face counts at this corner.
    counts: bool,
    normal: vec3<f32>,
    scale: f32,
    uv: vec2<f32>,
    along: vec3<f32>,
    projected: vec3<f32>,
    // Edges to the next and the last corner, and their projections.
    leg0: vec3<f32>,
    leg1: vec3<f32>,
    flat0: vec3<f32>,
    flat1: vec3<f32>,
}

fn corner(t: u32, k: u32) -> Corner {
    var c: Corner;
    let v = triangle(t);
    let vertex = v[k];
    if frames[3u * t + 2u] != handedness_of(weld_of(vertex)) {
        return c;
    }
    let p0 = position(v.x);
    let p1 = position(v.y);
    let p2 = position(v.z);
    if all(p0 == p1) || all(p1 == p2) || all(p2 == p0) {
        return c;
    }
    let d1 = p1 - p0;
    let d2 = p2 - p0;
    c.scale = max(reach(d1), reach(d2));
    c.normal = normal_of(vertex);
    c.counts = c.scale > MIN_POSITIVE && is_finite3(d1) && is_finite3(d2) && is_finite3(c.normal);
    if !c.counts {
        return c;
    }
    let e1 = d1 / c.scale;
    let e2 = d2 / c.scale;
    c.uv = vec2<f32>(frames[3u * t], frames[3u * t + 1u]);
    c.along = e1 * c.uv.x + e2 * c.uv.y;
    c.projected = project(c.normal, c.along);
    if k == 0u {
        c.leg0 = e1;
        c.leg1 = e2;
    } else if k == 1u {
        c.leg0 = e2 - e1;
        c.leg1 = -e1;
    } else {
        c.leg0 = -e2;
        c.leg1 = e1 - e2;
    }
    c.flat0 = project(c.normal, c.leg0);
    c.flat1 = project(c.normal, c.leg1);
    return c;
}

// Sum of the corners' contributions at a welded id.
fn weighted_sum(w: u32) -> vec3<f32> {
    let span = corners_of_weld(w);
    var sum = vec3<f32>(0.0);
    for (var i = span.x; i < span.y; i++) {
        let at = topology[i];
        let c = corner(at / 3u, at % 3u);
        if c.counts {
            sum += unit(c.projected) * angle(c.flat0, c.flat1);
        }
    }
    return sum;
}

// A unit vector perpendicular to a unit vector.
fn perpendicular(n: vec3<f32>) -> vec3<f32> {
    let s = select(1.0, -1.0, n.z < 0.0);
    let a = -1.0 / (s + n.z);
    return vec3<f32>(1.0 + s * n.x * n.x * a, s * n.x * n.y * a, -s * n.x);
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
    let w = weld_of(v);
    var tangent = unit(weighted_sum(w));
    if all(tangent == vec3<f32>(0.0)) {
        let n = unit(normal_of(topology[members_of(w).x]));
        tangent = perpendicular(n);
        if all(n == vec3<f32>(0.0)) {
            tangent = vec3<f32>(1.0, 0.0, 0.0);
        }
    }
    tangents[v] = vec4<f32>(tangent, handedness_of(w));
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
        g += vec3<f32>(d_tangents[v], d_tangents[v + 1u], d_tangents[v + 2u]);
    }
    let d = unit_vjp(weighted_sum(w), g);
    d_sums[3u * w] = d.x;
    d_sums[3u * w + 1u] = d.y;
    d_sums[3u * w + 2u] = d.z;
}

// Gradients of what a corner (`c`, number `k` of its face) contributes.
struct Pull {
    // Of the position of corner `at` of the face.
    position: vec3<f32>,
    // Of the corner's normal.
    normal: vec3<f32>,
}

fn corner_vjp(c: Corner, k: u32, at: u32, g: vec3<f32>) -> Pull {
    var out: Pull;
    let d_projected = unit_vjp(c.projected, g * angle(c.flat0, c.flat1));
    let d_along = project_vjp(c.normal, d_projected);
    let g_angle = dot(unit(c.projected), g);
    let d0 = angle_vjp(c.flat0, c.flat1, g_angle, 0u);
    let d1 = angle_vjp(c.flat0, c.flat1, g_angle, 1u);
    let d_next = project_vjp(c.normal, d0);
    let d_last = project_vjp(c.normal, d1);
    out.normal = project_vjp_normal(c.normal, c.along, d_projected)
        + project_vjp_normal(c.normal, c.leg0, d0)
        + project_vjp_normal(c.normal, c.leg1, d1);
    var factors = vec3<f32>(-(c.uv.x + c.uv.y), c.uv.x, c.uv.y);
    var d = d_along * factors[at];
    if at == (k + 1u) % 3u {
        d += d_next;
    } else if at == (k + 2u) % 3u {
        d += d_last;
    } else {
        d -= d_next + d_last;
    }
    out.position = d / c.scale;
    return out;
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
    var d = position_gradient(v);
    var dn = vec3<f32>(d_normals[3u * v], d_normals[3u * v + 1u], d_normals[3u * v + 2u]);
    for (var i = span.x; i < span.y; i++) {
        let t = topology[i] / 3u;
        let at = topology[i] % 3u;
        let corners = triangle(t);
        for (var k = 0u; k < 3u; k++) {
            let c = corner(t, k);
            if c.counts {
                let w = 3u * weld_of(corners[k]);
                let pull = corner_vjp(c, k, at, vec3<f32>(d_sums[w], d_sums[w + 1u], d_sums[w + 2u]));
                d += pull.position;
                if k == at {
                    dn += pull.normal;
                }
            }
        }
    }
    d_positions[3u * v] = d.x;
    d_positions[3u * v + 1u] = d.y;
    d_positions[3u * v + 2u] = d.z;
    d_normals[3u * v] = dn.x;
    d_normals[3u * v + 1u] = dn.y;
    d_normals[3u * v + 2u] = dn.z;
}

fn position_gradient(v: u32) -> vec3<f32> {
    return vec3<f32>(d_positions[3u * v], d_positions[3u * v + 1u], d_positions[3u * v + 2u]);
}
