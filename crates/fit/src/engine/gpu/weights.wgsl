// Twin of `relative_weights`: means over a square around each pixel, along the rows and across them.

struct Params {
    width: u32,
    height: u32,
    // Pixels on either side.
    aside: u32,
    pad: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> picture: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> rows: array<f32>;

// One pixel an invocation.
@compute @workgroup_size(64)
fn along(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane, 64u);
    if i >= params.width * params.height {
        return;
    }
    let column = i % params.width;
    let first = column - min(column, params.aside);
    let last = min(column + params.aside, params.width - 1u);
    var sum = 0.0;
    for (var k = first; k <= last; k++) {
        let p = picture[i - column + k];
        sum += (p.x + p.y + p.z) / 3.0;
    }
    rows[i] = sum / f32(last - first + 1u);
}

@group(0) @binding(1) var<storage, read> mean: array<f32>;
@group(0) @binding(2) var<storage, read_write> weights: array<f32>;

// One pixel an invocation.
@compute @workgroup_size(64)
fn weigh(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane, 64u);
    if i >= params.width * params.height {
        return;
    }
    let row = i / params.width;
    let first = row - min(row, params.aside);
    let last = min(row + params.aside, params.height - 1u);
    var sum = 0.0;
    for (var k = first; k <= last; k++) {
        sum += mean[k * params.width + i % params.width];
    }
    let m = sum / f32(last - first + 1u);
    weights[i] = 1.0 / (m * m + 0.01);
}
