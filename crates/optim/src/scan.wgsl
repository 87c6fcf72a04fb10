// Finiteness and mean square of the gradients, in a fixed order: twin of scan.rs, and of what State makes of it.
//
// Squares are summed in units of 4^e, e the exponent of the largest gradient of a chunk, so that gradients of 1e-30 and of
// 1e30 neither vanish nor overflow.

struct Params {
    // Samples, and samples of a row.
    count: u32,
    width: u32,
    // Bit k is set where column k moves; the others only have to be finite.
    live: u32,
    chunks: u32,
    // Over the samples that move.
    inverse_count: f32,
    beta2: f32,
    rest2: f32,
    // Bias correction of the second moment.
    correction2: f32,
    relative_epsilon: f32,
    step: u32,
    // 1: these are filtered gradients; what was found in the unfiltered ones stays and comes first.
    filtered: u32,
    // Where the first sample lies in the buffer of gradients.
    first: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> gradients: array<f32>;
// Of each chunk: bits of the sum, its exponent, and the first sample that is not finite.
@group(0) @binding(2) var<storage, read_write> partials: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read_write> state: State;

const NONE: u32 = 0xffffffffu;
// Marks samples of filtered gradients.
const FILTERED: u32 = 0x80000000u;
const LANES: u32 = 256u;
const EACH: u32 = 16u;
// Exponent of a sum of nothing.
const LOWEST: i32 = -1000;

var<workgroup> words: array<u32, 256>;
var<workgroup> sums: array<f32, 256>;
var<workgroup> firsts: array<u32, 256>;

// The largest word, and the smallest of `firsts`, of all lanes.
fn reduce_words(lane: u32, word: u32, first: u32) {
    words[lane] = word;
    firsts[lane] = first;
    for (var half = LANES / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if lane < half {
            words[lane] = max(words[lane], words[lane + half]);
            firsts[lane] = min(firsts[lane], firsts[lane + half]);
        }
    }
    workgroupBarrier();
}

fn reduce_sum(lane: u32, sum: f32) {
    sums[lane] = sum;
    for (var half = LANES / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if lane < half {
            sums[lane] += sums[lane + half];
        }
    }
    workgroupBarrier();
}

// One chunk of 4096 samples a workgroup.
@compute @workgroup_size(256)
fn chunk(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = group.y * groups.x + group.x;
    var values: array<f32, 16>;
    var largest = 0u;
    var bad = NONE;
    for (var k = 0u; k < EACH; k++) {
        let i = (number * EACH + k) * LANES + lane;
        if i < params.count {
            let g = gradients[params.first + i];
            let bits = bitcast<u32>(g) & 0x7fffffffu;
            if bits >= 0x7f800000u {
                bad = min(bad, i);
            } else if (params.live >> (i % params.width)) % 2u == 1u {
                values[k] = g;
                largest = max(largest, bits);
            }
        }
    }
    reduce_words(lane, largest, bad);
    let exponent = clamp(i32(words[0] >> 23u) - 127, -126, 126);
    let scale = power_of_two(-exponent);
    var sum = 0.0;
    for (var k = 0u; k < EACH; k++) {
        let g = values[k] * scale;
        sum += g * g;
    }
    reduce_sum(lane, sum);
    if lane == 0u && number < params.chunks {
        let nothing = !(sums[0] > 0.0);
        let e = select(exponent, LOWEST, nothing);
        var first = firsts[0];
        if params.filtered != 0u {
            first = min(partials[number].z, first | FILTERED);
        }
        partials[number] = vec4<u32>(bitcast<u32>(sums[0]), bitcast<u32>(e), first, 0u);
    }
}

// One workgroup: the mean of all chunks, the running mean, the unit of the moments and the constants of this step.
@compute @workgroup_size(256)
fn observe(@builtin(local_invocation_index) lane: u32) {
    var largest = LOWEST;
    var bad = NONE;
    for (var c = lane; c < params.chunks; c += LANES) {
        let part = partials[c];
        largest = max(largest, bitcast<i32>(part.y));
        bad = min(bad, part.z);
    }
    reduce_words(lane, u32(largest - LOWEST), bad);
    let exponent = i32(words[0]) + LOWEST;
    bad = firsts[0];
    var sum = 0.0;
    for (var c = lane; c < params.chunks; c += LANES) {
        let part = partials[c];
        sum += bitcast<f32>(part.x) * power_of_two(2 * (bitcast<i32>(part.y) - exponent));
    }
    reduce_sum(lane, sum);
    if lane > 0u || state.halted != 0u {
        return;
    }
    if bad != NONE {
        state.halted = 1u;
        state.bad_index = bad & ~FILTERED;
        state.bad_bits = bitcast<u32>(gradients[params.first + (bad & ~FILTERED)]);
        state.bad_step = params.step;
        return;
    }
    take(sums[0] * params.inverse_count, exponent);
}

// Takes the mean squared gradient of this step, over 4^exponent, into account.
fn take(mean: f32, exponent: i32) {
    let before = state.mean;
    let largest = max(select(LOWEST, state.mean_exponent, before > 0.0), exponent);
    var value = 0.0;
    if before > 0.0 {
        value = params.beta2 * before * power_of_two(2 * (state.mean_exponent - largest));
    }
    if mean > 0.0 {
        value += params.rest2 * mean * power_of_two(2 * (exponent - largest));
    }
    state.rescale_first = 1.0;
    state.rescale_second = 1.0;
    state.mean = value;
    if value > 0.0 {
        // Into [1, 4).
        let e = i32(bitcast<u32>(value) >> 23u) - 127;
        let half = (e + 256) / 2 - 128;
        state.mean = value * power_of_two(-2 * half);
        state.mean_exponent = largest + half;
        let wanted = clamp(state.mean_exponent, -120, 120);
        let shift = state.scale_exponent - wanted;
        if before == 0.0 {
            state.scale_exponent = wanted;
        } else if abs(shift) > 30 {
            state.rescale_first = power_of_two(shift);
            state.rescale_second = power_of_two(2 * shift);
            state.scale_exponent = wanted;
        }
    }
    state.inverse_scale = power_of_two(-state.scale_exponent);
    let rms = sqrt(state.mean * params.correction2) * power_of_two(state.mean_exponent - state.scale_exponent);
    state.epsilon = params.relative_epsilon * rms + TINY;
}
