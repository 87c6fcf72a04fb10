// Twin of strip.rs on packed pictures: two channels as one picture of complex numbers, which a real system solves at once.
//
// Rows are transformed in workgroup memory (Stockham, radices 2 to 5). Columns are solved in parts of `PART` rows: what is
// inside of a part follows from the row at its end and from that of the part above; these rows have a tridiagonal system of
// their own, whose factors come from the CPU.

struct Params {
    // Columns (the length of the transform), rows, packed pictures.
    width: u32,
    height: u32,
    pictures: u32,
    stages: u32,
    // c0 and c1 of the system.
    c0: f32,
    c1: f32,
    // Of rows: factor of the values that are read; 1 for the transform back.
    scale: f32,
    back: u32,
    radices: array<vec4<u32>, 3>,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> picture: array<vec2<f32>>;
// exp(-2 pi i k / width), and 2 - 2 cos(2 pi k / width).
@group(0) @binding(2) var<storage, read> roots: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read> eigenvalues: array<f32>;
// First and last value of each part as if the rows at the ends were 0.
@group(0) @binding(4) var<storage, read_write> ends: array<vec4<f32>>;
// Of each row at the end of a part and each frequency: 1 / pivot, factor of the one above, factor of the one below.
@group(0) @binding(5) var<storage, read> factors: array<vec4<f32>>;

const LANES: u32 = 256u;
const PART: u32 = 16u;

// WORK is twice the longest row: a constant of the kernel.
var<workgroup> work: array<vec2<f32>, WORK>;

fn times(a: vec2<f32>, b: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x);
}

fn root(k: u32) -> vec2<f32> {
    let r = roots[k];
    return vec2<f32>(r.x, select(r.y, -r.y, params.back != 0u));
}

// One row of a packed picture: forward or back, in place.
@compute @workgroup_size(256)
fn rows(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let n = params.width;
    let row = group.y * groups.x + group.x;
    let count = params.height * params.pictures;
    // Groups beyond the last row do as it does, and write nothing.
    let begin = min(row, count - 1u) * n;
    for (var j = lane; j < n; j += LANES) {
        work[j] = picture[begin + j] * params.scale;
    }
    var source = 0u;
    var done = 1u;
    for (var stage = 0u; stage < params.stages; stage++) {
        workgroupBarrier();
        let radix = params.radices[stage / 4u][stage % 4u];
        let to = n - source;
        let each = n / radix;
        let stride = each / done;
        for (var j = lane; j < each; j += LANES) {
            let k = j % done;
            var v: array<vec2<f32>, 5>;
            for (var q = 0u; q < radix; q++) {
                v[q] = times(work[source + j + q * each], root(q * k * stride));
            }
            let out = to + (j / done) * done * radix + k;
            if radix == 4u {
                let a = v[0] + v[2];
                let b = v[0] - v[2];
                let c = v[1] + v[3];
                // Times -i; i for the way back.
                let d = (v[1] - v[3]).yx * select(vec2<f32>(1.0, -1.0), vec2<f32>(-1.0, 1.0), params.back != 0u);
                work[out] = a + c;
                work[out + done] = b + d;
                work[out + 2u * done] = a - c;
                work[out + 3u * done] = b - d;
            } else {
                for (var q = 0u; q < radix; q++) {
                    var sum = v[0];
                    for (var s = 1u; s < radix; s++) {
                        sum += times(v[s], root((q * s) % radix * each));
                    }
                    work[out + q * done] = sum;
                }
            }
        }
        source = to;
        done *= radix;
    }
    workgroupBarrier();
    if row < count {
        for (var j = lane; j < n; j += LANES) {
            picture[begin + j] = work[source + j];
        }
    }
}

// Rows of a part that are inside of it: all but the last, of the last part all.
fn inside(part: u32) -> u32 {
    let begin = part * PART;
    return select(PART - 1u, params.height - begin, begin + PART >= params.height);
}

fn parts() -> u32 {
    return (params.height + PART - 1u) / PART;
}

fn diagonal(row: u32, eigenvalue: f32) -> f32 {
    let sides = select(0.0, 1.0, row > 0u) + select(0.0, 1.0, row + 1u < params.height);
    return params.c0 + params.c1 * (eigenvalue + sides);
}

// Place of a row of a packed picture at a frequency.
fn place(picture: u32, row: u32, frequency: u32) -> u32 {
    return (picture * params.height + row) * params.width + frequency;
}

// The ends of what is inside of each part: an elimination down for the last value, one up for the first.
@compute @workgroup_size(256)
fn part_ends(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
             @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, LANES);
    if i >= params.pictures * parts() * params.width { return; }
    let frequency = i % params.width;
    let part = i / params.width % parts();
    let first = place(i / params.width / parts(), part * PART, frequency);
    let eigenvalue = eigenvalues[frequency];
    let n = inside(part);
    var f: array<vec2<f32>, 16>;
    var down = vec2<f32>(0.0);
    var c = 0.0;
    for (var k = 0u; k < n; k++) {
        f[k] = picture[first + k * params.width];
        let inverse = 1.0 / (diagonal(part * PART + k, eigenvalue) - params.c1 * c);
        down = (f[k] + params.c1 * down) * inverse;
        c = params.c1 * inverse;
    }
    var up = vec2<f32>(0.0);
    c = 0.0;
    for (var k = 0u; k < n; k++) {
        let r = n - 1u - k;
        let inverse = 1.0 / (diagonal(part * PART + r, eigenvalue) - params.c1 * c);
        up = (f[r] + params.c1 * up) * inverse;
        c = params.c1 * inverse;
    }
    ends[i] = vec4<f32>(up, down);
}

// The rows at the ends of parts, down and up again.
@compute @workgroup_size(64)
fn separators(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
              @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, 64u);
    if i >= params.pictures * params.width { return; }
    let frequency = i % params.width;
    let n = parts();
    let at = i / params.width * n * params.width + frequency;
    let first = place(i / params.width, PART - 1u, frequency);
    let step = PART * params.width;
    var y = vec2<f32>(0.0);
    for (var b = 0u; b + 1u < n; b++) {
        let f = picture[first + b * step]
            + params.c1 * (ends[at + b * params.width].zw + ends[at + (b + 1u) * params.width].xy);
        let factor = factors[b * params.width + frequency];
        y = f * factor.x + y * factor.y;
        picture[first + b * step] = y;
    }
    var x = vec2<f32>(0.0);
    for (var k = 1u; k < n; k++) {
        let b = n - 1u - k;
        x = picture[first + b * step] + x * factors[b * params.width + frequency].z;
        picture[first + b * step] = x;
    }
}

// What is inside of each part, between the rows at the ends.
@compute @workgroup_size(256)
fn part_insides(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
                @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, LANES);
    if i >= params.pictures * parts() * params.width { return; }
    let frequency = i % params.width;
    let part = i / params.width % parts();
    let first = place(i / params.width / parts(), part * PART, frequency);
    let eigenvalue = eigenvalues[frequency];
    let n = inside(part);
    var y: array<vec2<f32>, 16>;
    var c: array<f32, 16>;
    var last = vec2<f32>(0.0);
    if part > 0u {
        last = picture[first - params.width];
    }
    var factor = 0.0;
    for (var k = 0u; k < n; k++) {
        let inverse = 1.0 / (diagonal(part * PART + k, eigenvalue) - params.c1 * factor);
        last = (picture[first + k * params.width] + params.c1 * last) * inverse;
        factor = params.c1 * inverse;
        y[k] = last;
        c[k] = factor;
    }
    var x = vec2<f32>(0.0);
    if part + 1u < parts() {
        x = picture[first + n * params.width];
    }
    for (var k = 0u; k < n; k++) {
        let r = n - 1u - k;
        x = y[r] + c[r] * x;
        picture[first + r * params.width] = x;
    }
}
