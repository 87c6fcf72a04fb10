// Adds the fixed-point sums of texel gradients to the gradients, and empties the sums.

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
@group(0) @binding(1) var<storage, read_write> sums: array<u32>;
@group(0) @binding(2) var<storage, read_write> gradient: array<vec4<f32>>;
// Not 0 once a sum or a term of one did not fit.
@group(0) @binding(3) var<storage, read_write> status: array<u32>;

fn take(first: u32, slot: u32) -> f32 {
    if slot == 0xffffffffu {
        return 0.0;
    }
    let at = 2u * (first + slot);
    let low = sums[at];
    let high = sums[at + 1u];
    sums[at] = 0u;
    sums[at + 1u] = 0u;
    return read_fixed(low, high, params.scale);
}

// One invocation for four channels of a texel.
@compute @workgroup_size(64)
fn collect_texels(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane, 64u);
    if i == 0u {
        let last = arrayLength(&sums) - 1u;
        status[0] |= sums[last];
        sums[last] = 0u;
    }
    if i >= 4u * params.texels {
        return;
    }
    let slots = params.slots[i & 3u];
    if all(slots == vec4<u32>(0xffffffffu)) {
        return;
    }
    let first = (i >> 2u) * params.channels;
    gradient[i] += vec4<f32>(take(first, slots.x), take(first, slots.y), take(first, slots.z), take(first, slots.w));
}
