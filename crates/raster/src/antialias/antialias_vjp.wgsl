// The adjoint: `g` of the blended samples becomes `g_color` of those before, and edges get theirs.
@group(0) @binding(6) var<storage, read> g: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> g_color: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> sums: array<FixedSum>;

// Gradient of the sample that a pair writes.
fn written(alpha: f32, first: u32, second: u32) -> vec4<f32> {
    if alpha > 0.0 {
        return g[first];
    }
    return g[second];
}

// Adds the gradient of a vertex' place, along and across a pair, to the sums of its clip-space position.
fn add_place(v: u32, along: f32, across: f32, vertical: bool) {
    let c = clip[v];
    let gx = select(along, across, vertical);
    let gy = select(across, along, vertical);
    let r = 0.5 / c.w;
    let x = gx * f32(params.width) * r;
    let y = -gy * f32(params.height) * r;
    add_fixed(13u * v, x, params.scale);
    add_fixed(13u * v + 1u, y, params.scale);
    add_fixed(13u * v + 3u, -(c.x * x + c.y * y) / c.w, params.scale);
}

// Adjoint of a crossing's position for the gradient `d`.
fn add_crossing(c: Crossing, d: f32, vertical: bool) {
    let r = 1.0 / (c.b.y - c.a.y);
    let x = c.a.x - c.a.y * (c.b.x - c.a.x) * r;
    add_place(c.vertices.x, c.b.y * r * d, (x - c.b.x) * r * d, vertical);
    add_place(c.vertices.y, -c.a.y * r * d, -(x - c.a.x) * r * d, vertical);
}

// One invocation per sample.
@compute @workgroup_size(64)
fn reverse(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
           @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, 64u);
    if i >= sample_count() {
        return;
    }
    var sum = g[i];
    for (var k = 0u; k < 2u; k++) {
        let vertical = k == 0u;
        let word = pair_before(i, vertical);
        if word != NONE {
            let other = i - select(1u, params.width, vertical);
            let alpha = crossing(word, other, vertical).alpha;
            sum += alpha * written(alpha, other, i);
        }
    }
    for (var k = 0u; k < 2u; k++) {
        let vertical = k == 1u;
        let word = pair_after(i, vertical);
        if word != NONE {
            let other = i + select(1u, params.width, vertical);
            let c = crossing(word, i, vertical);
            let source = written(c.alpha, i, other);
            sum -= c.alpha * source;
            if params.mode != 0u && c.alpha != 0.0 && abs(c.alpha) < 0.5 {
                add_crossing(c, -dot(source, color[other] - color[i]), vertical);
            }
        }
    }
    g_color[i] = sum;
}
