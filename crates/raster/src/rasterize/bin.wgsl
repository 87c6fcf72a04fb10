// Which samples a triangle may cover. Small triangles keep their box; large ones are queued tile by tile; those that do
// not fit into the queue keep their box too, however large.
@group(0) @binding(1) var<storage, read> clip: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> triangles: array<u32>;
@group(0) @binding(3) var<storage, read> surfaces: array<vec2<u32>>;
// First and last column and row, 16 bits each; empty where the first is behind the last.
@group(0) @binding(4) var<storage, read_write> boxes: array<vec2<u32>>;
// Number of pairs that were asked for, and the pairs: triangle, tile.
@group(0) @binding(5) var<storage, read_write> queue: array<atomic<u32>>;

const EMPTY: vec2<u32> = vec2<u32>(1u, 1u);
const TILE: u32 = 16u;
// Samples that one invocation draws alone.
const SMALL: u32 = 64u;
// Pixels by which a box is widened, and share of the picture: more than rounding moves a corner.
const SLACK: f32 = 0.02;
const SLACK_SHARE: f32 = 1e-6;

fn finite(v: vec4<f32>) -> bool {
    let bits = bitcast<vec4<u32>>(v) & vec4<u32>(0x7f800000u);
    return all(bits != vec4<u32>(0x7f800000u));
}

// Samples of one axis between two places in pixels: first and last; the last is before the first where there are none.
fn span(low: f32, high: f32, n: u32) -> vec2<i32> {
    let slack = SLACK + SLACK_SHARE * f32(n);
    let first = ceil(clamp(low - 0.5 - slack, 0.0, f32(n)));
    let last = floor(clamp(high - 0.5 + slack, -1.0, f32(n) - 1.0));
    return vec2<i32>(i32(first), i32(last));
}

// Whether a triangle whose corners have positive w certainly turns its back.
fn turns_away(t: Triangle, n: vec2<f32>) -> bool {
    let e = vec3<f32>(edge(t.p[1], t.p[2], n), edge(t.p[2], t.p[0], n), edge(t.p[0], t.p[1], n));
    let w = vec3<f32>(t.p[0].z, t.p[1].z, t.p[2].z);
    return dot(e, w) < -1e-4 * dot(abs(e), w);
}

fn box_of(t: u32) -> vec4<i32> {
    let none = vec4<i32>(0, 0, -1, -1);
    let c0 = clip[triangles[3u * t]];
    let c1 = clip[triangles[3u * t + 1u]];
    let c2 = clip[triangles[3u * t + 2u]];
    if !(finite(c0) && finite(c1) && finite(c2)) {
        return none;
    }
    let w = vec3<f32>(c0.w, c1.w, c2.w);
    let z = vec3<f32>(c0.z, c1.z, c2.z);
    if all(w <= vec3<f32>(0.0)) || all(z < vec3<f32>(0.0)) || all(z > w) {
        return none;
    }
    // A triangle that crosses w = 0 has no bounded box; its edge functions decide.
    if !all(w > vec3<f32>(0.0)) {
        return vec4<i32>(0, 0, i32(params.width) - 1, i32(params.height) - 1);
    }
    let x = (vec3<f32>(c0.x, c1.x, c2.x) / w * 0.5 + 0.5) * f32(params.width);
    let y = (0.5 - vec3<f32>(c0.y, c1.y, c2.y) / w * 0.5) * f32(params.height);
    let columns = span(min(x.x, min(x.y, x.z)), max(x.x, max(x.y, x.z)), params.width);
    let rows = span(min(y.x, min(y.y, y.z)), max(y.x, max(y.y, y.z)), params.height);
    if columns.x > columns.y || rows.x > rows.y {
        return none;
    }
    let front_only = (surfaces[t].x & 4u) == 0u;
    if front_only && turns_away(load_triangle(t), centre(u32(columns.x), u32(rows.x))) {
        return none;
    }
    return vec4<i32>(columns.x, rows.x, columns.y, rows.y);
}

fn packed(b: vec4<u32>) -> vec2<u32> {
    return vec2<u32>(b.x | (b.z << 16u), b.y | (b.w << 16u));
}

// Queues the tiles of a box; false where they do not fit.
fn enqueue(t: u32, b: vec4<u32>) -> bool {
    let first = b.xy / TILE;
    let last = b.zw / TILE;
    let columns = (params.width + TILE - 1u) / TILE;
    let n = (last.x - first.x + 1u) * (last.y - first.y + 1u);
    let start = atomicAdd(&queue[0], n);
    let fits = start < params.capacity && n <= params.capacity - start;
    if !fits {
        // What is left of the queue holds no pairs.
        for (var at = start; at < params.capacity; at++) {
            atomicStore(&queue[1u + 2u * at], NONE);
        }
        return false;
    }
    var at = start;
    for (var row = first.y; row <= last.y; row++) {
        for (var column = first.x; column <= last.x; column++) {
            atomicStore(&queue[1u + 2u * at], t);
            atomicStore(&queue[2u + 2u * at], row * columns + column);
            at++;
        }
    }
    return true;
}

// One invocation per triangle.
@compute @workgroup_size(64)
fn bin(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
       @builtin(local_invocation_index) lane: u32) {
    let t = index(group, groups, lane, 64u);
    if t >= params.triangles {
        return;
    }
    let b = box_of(t);
    if b.z < b.x {
        boxes[t] = EMPTY;
        return;
    }
    let u = vec4<u32>(b);
    let small = (u.z - u.x + 1u) * (u.w - u.y + 1u) <= SMALL;
    boxes[t] = packed(u);
    if !small && enqueue(t, u) {
        boxes[t] = EMPTY;
    }
}
