// Turns the fixed-point sums of texel gradients into the gradients, and empties the sums.

struct Params {
    // Place of each channel among the sums of a texel, or 0xffffffff.
    slots: array<vec4<u32>, 4>,
    texels: u32,
    // Sums of a texel.
    channels: u32,
    scale: f32,
    pad: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> sums: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read_write> gradient: array<f32>;
// What the sums told of their terms, by the bits of `fixed.wgsl`.
@group(0) @binding(3) var<storage, read_write> status: array<u32>;

// One invocation for a channel of a texel, so that neighbours read and write neighbours.
@compute @workgroup_size(256)
fn collect_texels(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane, 256u);
    let last = arrayLength(&sums) - 1u;
    if i == 0u {
        status[0] |= sums[last].y;
        sums[last].y = 0u;
    }
    if i >= 16u * params.texels {
        return;
    }
    let slot = params.slots[(i & 15u) >> 2u][i & 3u];
    var g = 0.0;
    if slot != 0xffffffffu {
        let at = (i >> 4u) * params.channels + slot;
        let sum = sums[at];
        g = read_fixed(sum.x, sum.y, params.scale);
        // Most texels are not seen by a batch.
        if any(sum != vec2<u32>(0u)) {
            sums[at] = vec2<u32>(0u);
        }
        // The count of this sum and those behind it.
        if (at & 15u) == 0u {
            sums[last - 1u - (at >> 4u)] = vec2<u32>(0u);
        }
    }
    gradient[i] = g;
}
