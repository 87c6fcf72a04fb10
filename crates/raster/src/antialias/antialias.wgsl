// Twin of `antialias` and `antialias_vjp`: every sample gathers from its four pairs.
@group(0) @binding(1) var<storage, read> clip: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> triangles: array<u32>;
@group(0) @binding(3) var<storage, read> pairs: array<u32>;
@group(0) @binding(4) var<storage, read> color: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> out: array<vec4<f32>>;

// The word of the pair of sample `i` and the one after it, and of the one before it and itself.
fn pair_after(i: u32, vertical: bool) -> u32 {
    return pairs[2u * i + u32(vertical)];
}

fn pair_before(i: u32, vertical: bool) -> u32 {
    let step = select(1u, params.width, vertical);
    let exists = select(i % params.width != 0u, i >= params.width, vertical);
    if !exists {
        return NONE;
    }
    return pairs[2u * (i - step) + u32(vertical)];
}

// One invocation per sample: in the order above, left, right, below.
@compute @workgroup_size(64)
fn forward(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
           @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, 64u);
    if i >= sample_count() {
        return;
    }
    let own = color[i];
    var o = own;
    for (var k = 0u; k < 2u; k++) {
        let vertical = k == 0u;
        let word = pair_before(i, vertical);
        if word != NONE {
            let other = i - select(1u, params.width, vertical);
            let alpha = crossing(word, other, vertical).alpha;
            if alpha < 0.0 {
                o += alpha * (own - color[other]);
            }
        }
    }
    for (var k = 0u; k < 2u; k++) {
        let vertical = k == 1u;
        let word = pair_after(i, vertical);
        if word != NONE {
            let alpha = crossing(word, i, vertical).alpha;
            if alpha > 0.0 {
                o += alpha * (color[i + select(1u, params.width, vertical)] - own);
            }
        }
    }
    out[i] = o;
}
