// Twin of `silhouettes`: follows the closer surface of two samples to the edge where it ends.
@group(0) @binding(1) var<storage, read> clip: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> triangles: array<u32>;
@group(0) @binding(3) var<storage, read> neighbour: array<u32>;
@group(0) @binding(4) var<storage, read> folds: array<u32>;
@group(0) @binding(5) var<storage, read> triangle: array<u32>;
@group(0) @binding(6) var<storage, read> depth: array<f32>;
@group(0) @binding(7) var<storage, read_write> pairs: array<u32>;

// How far outside of the segment between the centres a crossing still counts.
const MARGIN: f32 = 0.0625;
// Triangles that are walked through between two samples.
const WALK: u32 = 16u;

// Whether two triangles are neighbours on a piece of surface that neither ends nor folds over at either of them.
fn continuous(a: u32, b: u32) -> bool {
    let meet = neighbour[3u * a] == b || neighbour[3u * a + 1u] == b || neighbour[3u * a + 2u] == b;
    return meet && (folds[a] | folds[b]) == 0u;
}

// The silhouette between sample `i` and the one to the right or below.
fn find_pair(i: u32, vertical: bool) -> u32 {
    let j = i + select(1u, params.width, vertical);
    let a = triangle[i];
    let b = triangle[j];
    if a == b || (a != NONE && b != NONE && continuous(a, b)) {
        return NONE;
    }
    let first_is_closer = b == NONE || (a != NONE && depth[i] <= depth[j]);
    let sign = select(-1.0, 1.0, first_is_closer);
    let closer = select(j, i, first_is_closer);
    let at = vec2<u32>(closer % params.width, closer / params.width);
    var current = select(b, a, first_is_closer);
    var came_from = NONE;
    for (var step = 0u; step < WALK; step++) {
        var q: array<vec2<f32>, 3>;
        for (var k = 0u; k < 3u; k++) {
            let c = clip[triangles[3u * current + k]];
            if c.w <= 0.0 {
                return NONE;
            }
            q[k] = place(c, at, vertical);
        }
        // The edge through which the line between the centres leaves the triangle, and where.
        var k = 3u;
        var t = 0.0;
        for (var e = 0u; e < 3u; e++) {
            let p = q[e];
            let d = q[(e + 1u) % 3u];
            let entry = came_from != NONE && neighbour[3u * current + e] == came_from;
            if (p.y < 0.0) == (d.y < 0.0) || entry {
                continue;
            }
            let along = sign * (p.x - p.y * (d.x - p.x) / (d.y - p.y));
            if k == 3u || along > t {
                k = e;
                t = along;
            }
        }
        if k == 3u || !(t > -MARGIN && t < 1.0 + MARGIN) {
            return NONE;
        }
        if ((folds[current] >> k) & 1u) == 1u {
            let p = q[k];
            let d = q[(k + 1u) % 3u];
            if abs(d.y - p.y) < abs(d.x - p.x) {
                return NONE;
            }
            return (3u * current + k) | select(SECOND_IS_CLOSER, 0u, first_is_closer);
        }
        came_from = current;
        current = neighbour[3u * current + k];
        if current == NONE {
            return NONE;
        }
    }
    return NONE;
}

// One invocation per sample.
@compute @workgroup_size(64)
fn find(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let i = index(group, groups, lane, 64u);
    if i >= sample_count() {
        return;
    }
    var right = NONE;
    var below = NONE;
    if i % params.width + 1u < params.width {
        right = find_pair(i, false);
    }
    if i / params.width + 1u < params.height {
        below = find_pair(i, true);
    }
    pairs[2u * i] = right;
    pairs[2u * i + 1u] = below;
}
