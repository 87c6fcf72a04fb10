// Constraints on parameters after a step: twin of constrain.rs. 64 rows a workgroup: first entry by entry, so that neighbours
// read neighbours, then row by row.

struct Params {
    rows: u32,
    width: u32,
    // Whether columns have ranges.
    clamps: u32,
    // First column of the vector that is kept at unit length, and whether there is one.
    unit: u32,
    has_unit: u32,
    // The first row.
    first: u32,
    unused_1: u32,
    unused_2: u32,
    lowest: array<vec4<f32>, 4>,
    highest: array<vec4<f32>, 4>,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> x: array<f32>;

fn is_number(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) <= 0x7f800000u;
}

fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

fn clamp_entry(i: u32) {
    let k = i % params.width;
    let p = x[i];
    let low = params.lowest[k / 4u][k % 4u];
    let high = params.highest[k / 4u][k % 4u];
    let inside = select(low, select(high, p, p < high), p > low);
    let clamped = select(low, inside, is_number(p));
    // Most entries are inside. By the bits, for what is not a number equals nothing.
    if bitcast<u32>(clamped) != bitcast<u32>(p) {
        x[i] = clamped;
    }
}

@compute @workgroup_size(64)
fn constrain(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let begins = index(group, groups, 0u, 64u);
    let first = params.first + begins;
    if params.clamps != 0u {
        let begin = first * params.width;
        let end = min(begin + 64u * params.width, (params.first + params.rows) * params.width);
        for (var i = begin + lane; i < end; i += 64u) {
            clamp_entry(i);
        }
    }
    storageBarrier();
    if params.has_unit != 0u && begins + lane < params.rows {
        normalize_row((first + lane) * params.width + params.unit);
    }
}

// Vectors that are unit to rounding keep their bits; zero and non-finite ones become (0, 0, 1).
fn normalize_row(at: u32) {
    let v = vec3<f32>(x[at], x[at + 1u], x[at + 2u]);
    if abs(dot(v, v) - 1.0) <= 8.0 * 1.1920929e-7 {
        return;
    }
    let size = max(max(abs(v.x), abs(v.y)), abs(v.z));
    var n = vec3<f32>(0.0, 0.0, 1.0);
    if size > 1.1754944e-38 && is_finite(v.x) && is_finite(v.y) && is_finite(v.z) {
        let w = v / size;
        n = w * (1.0 / sqrt(dot(w, w)));
    }
    x[at] = n.x;
    x[at + 1u] = n.y;
    x[at + 2u] = n.z;
}
