// Draws in two turns, whose results do not depend on the order of triangles: the smallest depth of each sample, then the
// lowest of the triangles that have it. Depths in [0, 1] are ordered as their bits are.
@group(0) @binding(1) var<storage, read> clip: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> triangles: array<u32>;
@group(0) @binding(3) var<storage, read> surfaces: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> boxes: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read_write> depth: array<atomic<u32>>;
@group(0) @binding(6) var<storage, read_write> triangle: array<atomic<u32>>;
// The layer in front, where it lets see what lies behind.
@group(0) @binding(7) var<storage, read> front: array<u32>;
@group(0) @binding(8) var<storage, read> front_depth: array<f32>;
@group(0) @binding(9) var<storage, read> lists: array<u32>;

const DEPTHS: u32 = 0u;

fn is_behind(i: u32, id: u32, z: f32) -> bool {
    if params.layer == 0u {
        return true;
    }
    let t = front[i];
    let d = front_depth[i];
    return t != NONE && (z > d || (z == d && id > t));
}

fn draw_sample(t: Triangle, id: u32, x: u32, y: u32, front_only: bool) {
    let z = cover(t, centre(x, y), front_only);
    let i = y * params.width + x;
    if z > 1.0 || !is_behind(i, id, z) {
        return;
    }
    // Without the sign of a negative zero.
    let bits = bitcast<u32>(z) & 0x7fffffffu;
    if params.mode == DEPTHS {
        atomicMin(&depth[i], bits);
    } else if atomicLoad(&depth[i]) == bits {
        atomicMin(&triangle[i], id);
    }
}

// One invocation per triangle: draws the small ones.
@compute @workgroup_size(64)
fn small(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
         @builtin(local_invocation_index) lane: u32) {
    let id = index(group, groups, lane, 64u);
    if id >= params.triangles {
        return;
    }
    let b = unpacked(boxes[id]);
    if b.z < b.x || class_of(b) != SMALL {
        return;
    }
    let t = load_triangle(id);
    let front_only = shows_front_only(surfaces[id].x);
    for (var y = b.y; y <= b.w; y++) {
        for (var x = b.x; x <= b.z; x++) {
            draw_sample(t, id, x, y, front_only);
        }
    }
}

// One workgroup per medium triangle: its invocations take the samples of the box in turns.
@compute @workgroup_size(64)
fn medium(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
          @builtin(local_invocation_index) lane: u32) {
    let at = group.y * groups.x + group.x;
    if at >= lists[0] {
        return;
    }
    let id = lists[2u + at];
    let b = unpacked(boxes[id]);
    let size = b.zw - b.xy + 1u;
    let t = load_triangle(id);
    let front_only = shows_front_only(surfaces[id].x);
    for (var k = lane; k < size.x * size.y; k += 64u) {
        draw_sample(t, id, b.x + k % size.x, b.y + k / size.x, front_only);
    }
}

// Whether a tile lies certainly on the outer side of an edge.
fn misses(t: Triangle, corner: vec2<u32>, front_only: bool) -> bool {
    let w = vec3<f32>(t.p[0].z, t.p[1].z, t.p[2].z);
    if !all(w > vec3<f32>(0.0)) {
        return false;
    }
    // With positive w the sign of each edge function inside is that of the area, whose own sign is not known well enough
    // here: a tile is missed where some edge function is clearly positive everywhere and another clearly negative.
    var above = false;
    var below = false;
    for (var k = 0u; k < 3u; k++) {
        let a = t.p[(k + 1u) % 3u];
        let b = t.p[(k + 2u) % 3u];
        var low = 3e38;
        var high = -3e38;
        var size = 0.0;
        for (var c = 0u; c < 4u; c++) {
            let at = corner + vec2<u32>(c & 1u, c >> 1u) * (TILE - 1u);
            let n = centre(at.x, at.y);
            let e = edge(a, b, n);
            low = min(low, e);
            high = max(high, e);
            size = max(size, abs(e));
        }
        above = above || low > 1e-3 * size;
        below = below || high < -1e-3 * size;
    }
    return (above && below) || (front_only && below);
}

// Some workgroups per large triangle: each takes every tile of its slice, as many apart as there are slices, and an
// invocation four samples of a tile.
@compute @workgroup_size(64)
fn large(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
         @builtin(local_invocation_index) lane: u32) {
    let slice = group.y * groups.x + group.x;
    let slices = slices_of(lists[1]);
    let at = slice / slices;
    if at >= lists[1] {
        return;
    }
    let id = lists[2u + params.triangles + at];
    let b = unpacked(boxes[id]);
    let tiles = b.zw / TILE - b.xy / TILE + 1u;
    if slice % slices >= tiles.x * tiles.y {
        return;
    }
    let t = load_triangle(id);
    let front_only = shows_front_only(surfaces[id].x);
    for (var tile = slice % slices; tile < tiles.x * tiles.y; tile += slices) {
        let corner = (b.xy / TILE + vec2<u32>(tile % tiles.x, tile / tiles.x)) * TILE;
        if misses(t, corner, front_only) {
            continue;
        }
        for (var k = 0u; k < 4u; k++) {
            let sample = lane + 64u * k;
            let x = corner.x + sample % TILE;
            let y = corner.y + sample / TILE;
            if x < params.width && y < params.height {
                draw_sample(t, id, x, y, front_only);
            }
        }
    }
}
