// Twin of `project` and `project_vjp`.
@group(0) @binding(1) var<storage, read> positions: array<f32>;
@group(0) @binding(2) var<storage, read_write> clip: array<vec4<f32>>;

// One invocation per vertex.
@compute @workgroup_size(64)
fn forward(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
           @builtin(local_invocation_index) lane: u32) {
    let v = index(group, groups, lane, 64u);
    if v >= params.vertices {
        return;
    }
    let p = vec3<f32>(positions[3u * v], positions[3u * v + 1u], positions[3u * v + 2u]);
    clip[v] = vec4<f32>(row(0u, p), row(1u, p), row(2u, p), row(3u, p));
}

fn row(k: u32, p: vec3<f32>) -> f32 {
    let r = params.rows[k];
    return r.x * p.x + r.y * p.y + r.z * p.z + r.w;
}

// Gradient of a position for that of its clip-space position.
fn project_vjp(g: vec4<f32>) -> vec3<f32> {
    let r = params.rows;
    return r[0].xyz * g.x + r[1].xyz * g.y + r[2].xyz * g.z + r[3].xyz * g.w;
}

@group(0) @binding(1) var<storage, read> sums: array<u32>;
@group(0) @binding(2) var<storage, read_write> g_positions: array<f32>;
@group(0) @binding(3) var<storage, read_write> g_normals: array<f32>;
@group(0) @binding(4) var<storage, read_write> g_tangents: array<f32>;
// What the sums of all pictures told of their terms, by the bits of `fixed.wgsl`.
@group(0) @binding(5) var<storage, read_write> status: array<u32>;

fn sum(v: u32, c: u32) -> f32 {
    let at = 2u * (13u * v + c);
    return read_fixed(sums[at], sums[at + 1u], params.scale);
}

// One invocation per vertex: adds the sums of a picture to the gradients, those of clip-space positions through the
// projection.
@compute @workgroup_size(64)
fn gather(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
          @builtin(local_invocation_index) lane: u32) {
    let v = index(group, groups, lane, 64u);
    if v >= params.vertices {
        return;
    }
    if v == 0u {
        status[0] |= sums[arrayLength(&sums) - 1u];
    }
    let g_clip = vec4<f32>(sum(v, 0u), sum(v, 1u), sum(v, 2u), sum(v, 3u));
    let g_position = project_vjp(g_clip);
    for (var k = 0u; k < 3u; k++) {
        g_positions[3u * v + k] += sum(v, 4u + k) + g_position[k];
        g_normals[3u * v + k] += sum(v, 7u + k);
        g_tangents[3u * v + k] += sum(v, 10u + k);
    }
}
