// Begins a layer.
@group(0) @binding(1) var<storage, read_write> depth: array<f32>;
@group(0) @binding(2) var<storage, read_write> triangle: array<u32>;

// One invocation per sample: nothing is seen.
@compute @workgroup_size(64)
fn empty(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
         @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, 64u);
    if i < sample_count() {
        depth[i] = 1.0;
        triangle[i] = NONE;
    }
}

@group(0) @binding(1) var<storage, read> lists: array<u32>;
@group(0) @binding(2) var<storage, read> live: array<u32>;
@group(0) @binding(3) var<storage, read_write> work: array<u32>;

fn write_groups(at: u32, n: u32) {
    // At most 65,535 groups in a dimension.
    let rows = max((n + 65534u) / 65535u, 1u);
    work[at] = (n + rows - 1u) / rows;
    work[at + 1u] = rows;
    work[at + 2u] = 1u;
}

// A single invocation: the workgroups of a layer's kernels over samples, over triangles, over medium and over large
// triangles; none where nothing lets see the layer.
@compute @workgroup_size(1)
fn count_groups() {
    let seen = params.layer == 0u || live[params.layer] != 0u;
    let at = 12u * params.layer;
    write_groups(at, select(0u, (sample_count() + 63u) / 64u, seen));
    write_groups(at + 3u, select(0u, (params.triangles + 63u) / 64u, seen));
    write_groups(at + 6u, select(0u, lists[0], seen));
    write_groups(at + 9u, select(0u, lists[1] * slices_of(lists[1]), seen));
}
