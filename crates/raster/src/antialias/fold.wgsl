// Twin of `Folds`: which edges are silhouettes in a view.
@group(0) @binding(1) var<storage, read> clip: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> triangles: array<u32>;
@group(0) @binding(3) var<storage, read> opposite: array<u32>;
@group(0) @binding(4) var<storage, read_write> folds: array<u32>;

// The line through two points in the image plane, homogeneous.
fn line(a: vec4<f32>, b: vec4<f32>) -> vec3<f32> {
    return vec3<f32>(a.y * b.w - a.w * b.y, a.w * b.x - a.x * b.w, a.x * b.y - a.y * b.x);
}

// On which side of a line a point with positive w lies.
fn side(l: vec3<f32>, p: vec4<f32>) -> f32 {
    return l.x * p.x + l.y * p.y + l.z * p.w;
}

// One invocation per triangle: a bit for each of its edges that is a silhouette.
@compute @workgroup_size(64)
fn fold(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let t = index(group, groups, lane, 64u);
    if t >= params.triangles {
        return;
    }
    var c: array<vec4<f32>, 3>;
    for (var k = 0u; k < 3u; k++) {
        c[k] = clip[triangles[3u * t + k]];
    }
    let own = side(line(c[0], c[1]), c[2]) < 0.0;
    var mask = 0u;
    for (var k = 0u; k < 3u; k++) {
        let across = opposite[3u * t + k];
        var folds_over = across == NONE;
        if !folds_over {
            let o = clip[across];
            folds_over = o.w > 0.0 && (side(line(c[k], c[(k + 1u) % 3u]), o) < 0.0) == own;
        }
        mask |= u32(folds_over) << k;
    }
    folds[t] = mask;
}
