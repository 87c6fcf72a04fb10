// Twin of the score of a trial strength in variational.rs: the weighted squared distance of an estimate from the other half, as
// partial sums.

struct Params {
    pixels: u32,
    // Samples, and partial sums of them from place `first` on.
    count: u32,
    sums: u32,
    first: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> u: array<f32>;
@group(0) @binding(2) var<storage, read> wanted: array<f32>;
// Of each pixel.
@group(0) @binding(3) var<storage, read> mask: array<f32>;
@group(0) @binding(4) var<storage, read_write> sums: array<f32>;

const LANES: u32 = 256u;

@compute @workgroup_size(256)
fn score(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
         @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, LANES);
    if i >= params.sums { return; }
    var sum = 0.0;
    for (var k = i; k < params.count; k += params.sums) {
        let d = u[k] - wanted[k];
        sum += mask[k % params.pixels] * d * d;
    }
    sums[params.first + i] = sum;
}
