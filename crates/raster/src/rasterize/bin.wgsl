// Which samples a triangle may cover. Triangles of more than a few are listed by their size.
@group(0) @binding(1) var<storage, read> clip: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> triangles: array<u32>;
@group(0) @binding(3) var<storage, read> surfaces: array<vec2<u32>>;
// First and last column and row, 16 bits each; empty where the first is behind the last.
@group(0) @binding(4) var<storage, read_write> boxes: array<vec2<u32>>;
// Numbers of medium and of large triangles; from word 2 on the medium ones; behind room for all, the large ones.
@group(0) @binding(5) var<storage, read_write> lists: array<atomic<u32>>;

const EMPTY: vec2<u32> = vec2<u32>(1u, 1u);
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

// Box around the corners in pixels: left, top, right, bottom. Where some are behind the eye (`ahead` is false), around
// what lies beyond the near plane; boundless where that reaches the plane of the eye.
fn extent(c: array<vec4<f32>, 3>, ahead: bool) -> vec4<f32> {
    let size = vec2<f32>(f32(params.width), f32(params.height));
    var low = vec2<f32>(3e38);
    var high = vec2<f32>(-3e38);
    var corners = c;
    let largest = max(max(magnitude(c[0]), magnitude(c[1])), magnitude(c[2]));
    for (var k = 0u; k < 3u; k++) {
        let a = corners[k];
        let b = corners[(k + 1u) % 3u];
        // The corner, then where its edge meets the near plane.
        for (var m = 0u; m < 2u; m++) {
            var p = a;
            var slack = vec2<f32>(0.0);
            if !ahead {
                if m == 0u && a.z < 0.0 {
                    continue;
                }
                if m == 1u {
                    if (a.z < 0.0) == (b.z < 0.0) {
                        continue;
                    }
                    p = mix(a, b, a.z / (a.z - b.z));
                }
                if !(p.w > 1e-5 * largest) {
                    return vec4<f32>(vec2<f32>(-1.0), size + 1.0);
                }
                slack = 1.0 + size * (4e-6 * largest / p.w);
            } else if m == 1u {
                continue;
            }
            let q = (vec2<f32>(p.x, -p.y) / p.w * 0.5 + 0.5) * size;
            low = min(low, q - slack);
            high = max(high, q + slack);
        }
    }
    return vec4<f32>(low, high);
}

fn magnitude(v: vec4<f32>) -> f32 {
    return max(max(abs(v.x), abs(v.y)), max(abs(v.z), abs(v.w)));
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
    let seen = extent(array<vec4<f32>, 3>(c0, c1, c2), all(w > vec3<f32>(0.0)));
    let columns = span(seen.x, seen.z, params.width);
    let rows = span(seen.y, seen.w, params.height);
    if columns.x > columns.y || rows.x > rows.y {
        return none;
    }
    let front_only = shows_front_only(surfaces[t].x) && all(w > vec3<f32>(0.0));
    if front_only && turns_away(load_triangle(t), centre(u32(columns.x), u32(rows.x))) {
        return none;
    }
    return vec4<i32>(columns.x, rows.x, columns.y, rows.y);
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
    boxes[t] = packed(u);
    let kind = class_of(u);
    if kind == SMALL {
        return;
    }
    let at = atomicAdd(&lists[kind - MEDIUM], 1u);
    atomicStore(&lists[2u + (kind - MEDIUM) * params.triangles + at], t);
}
