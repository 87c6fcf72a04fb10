// What the loop of a fit adds to the operations of other crates.

struct Params {
    // Texels that are parameters, losses of a batch, or locked vertices.
    count: u32,
    // Classes of held texels, or where the loss goes.
    which: u32,
    // Samples of a texel, and the one that is held.
    width: u32,
    column: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> gradient: array<f32>;
@group(0) @binding(2) var<storage, read> held: array<u32>;
@group(0) @binding(3) var<storage, read> losses: array<f32>;
@group(0) @binding(4) var<storage, read_write> course: array<f32>;
@group(0) @binding(5) var<storage, read_write> positions: array<f32>;
@group(0) @binding(6) var<storage, read> locked: array<u32>;
@group(0) @binding(7) var<storage, read> places: array<f32>;

// Takes the gradient of one column from the texels of these classes. One texel an invocation.
@compute @workgroup_size(64)
fn hold(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane, 64u);
    if i < params.count && (held[i] & params.which) != 0u {
        gradient[i * params.width + params.column] = 0.0;
    }
}

// The loss of a batch: the sum of those of its pictures.
@compute @workgroup_size(1)
fn add_losses() {
    var sum = 0.0;
    for (var k = 0u; k < params.count; k++) {
        sum += losses[k];
    }
    course[params.which] = sum;
}

// Puts locked vertices back where they were. One vertex an invocation.
@compute @workgroup_size(64)
fn put_back(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane, 64u);
    if i < params.count {
        for (var k = 0u; k < 3u; k++) {
            positions[3u * locked[i] + k] = places[3u * i + k];
        }
    }
}
