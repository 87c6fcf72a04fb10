// Welded values to vertices, and back: twin of Weld.

@group(0) @binding(2) var<storage, read> source: array<f32>;
@group(0) @binding(3) var<storage, read_write> out: array<f32>;

// out[v] = source[ids[v]], vectors of three.
@compute @workgroup_size(64)
fn expand(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let v = index(group, groups, lane, 64u);
    if v >= params.vertices {
        return;
    }
    let w = weld_of(v);
    for (var k = 0u; k < 3u; k++) {
        out[3u * v + k] = source[3u * w + k];
    }
}

// out[w] += the sum of source[v] over the vertices of w, in ascending order.
@compute @workgroup_size(64)
fn expand_vjp(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let w = index(group, groups, lane, 64u);
    if w >= params.welds {
        return;
    }
    let span = members_of(w);
    var sum = vec3<f32>(out[3u * w], out[3u * w + 1u], out[3u * w + 2u]);
    for (var i = span.x; i < span.y; i++) {
        let v = 3u * topology[i];
        sum += vec3<f32>(source[v], source[v + 1u], source[v + 2u]);
    }
    out[3u * w] = sum.x;
    out[3u * w + 1u] = sum.y;
    out[3u * w + 2u] = sum.z;
}
