// Shading of one layer and its adjoint: twin of `tile.rs`. What is shaded at once is a sample, or all samples of a triangle
// in a block of side x side of them; a workgroup takes 8 x 8 blocks, whose lanes follow a Z curve.

struct Params {
    maps: MipTable,
    lights: Lights,
    eye: vec3<f32>,
    lod_bias: f32,
    // 2 / width and 2 / height of the samples, and of the cells by which texture footprints are measured.
    grid: vec2<f32>,
    footprint: vec2<f32>,
    // Columns and rows of samples.
    width: u32,
    height: u32,
    // Samples per axis of a block.
    side: u32,
    flags: u32,
    // Slope of faded masks.
    slope: f32,
    // Units of the sums of vertices, a power of two.
    scale: f32,
    pad_a: u32,
    pad_b: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> triangle: array<u32>;
@group(0) @binding(2) var<storage, read> corners: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> texels: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> shading_tables: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> shaded: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> g_shaded: array<vec4<f32>>;
// Sums of texels and of vertices.
@group(0) @binding(7) var<storage, read_write> sums: array<FixedSum>;
@group(0) @binding(8) var<storage, read_write> vertex_sums: array<FixedSum>;

const NONE: u32 = 0xffffffffu;
// Gradients of a corner: clip x, y, w, position, normal, tangent.
const CORNER_TERMS: u32 = 12u;
const TERMS: u32 = 36u;
// What the terms of a lane are made of: weights of the corners, clip x, y, w of each, position, normal, tangent. Odd, so
// that lanes write to different banks.
const PITCH: u32 = 21u;
// Sums of a vertex: clip x, y, z, w, position, normal, tangent.
const VERTEX_SUMS: u32 = 13u;

var<workgroup> parts_of_lanes: array<f32, 1344>;
var<workgroup> owners: array<u32, 64>;
var<workgroup> most: atomic<u32>;
var<workgroup> rounds: u32;

// Number of tiles of blocks.
fn tile_count() -> u32 {
    return ((params.width / params.side + 7u) / 8u) * ((params.height / params.side + 7u) / 8u);
}

// Column and row of the first sample of a lane's block; outside of the picture for lanes without a block.
fn block_of(tile: u32, lane: u32) -> vec2<u32> {
    let columns = (params.width / params.side + 7u) / 8u;
    return (vec2<u32>(tile % columns, tile / columns) * 8u + z_curve(lane)) * params.side;
}

fn inside(block: vec2<u32>) -> bool {
    return block.x < params.width && block.y < params.height;
}

fn sample_of(block: vec2<u32>, j: u32) -> vec2<u32> {
    return block + vec2<u32>(j % params.side, j / params.side);
}

fn place_of(block: vec2<u32>, j: u32) -> u32 {
    let at = sample_of(block, j);
    return at.y * params.width + at.x;
}

fn samples_of_block() -> u32 {
    return params.side * params.side;
}

// Whether an earlier sample of the block shows the triangle of sample j. Most often that is the one beside it or above it.
fn repeats(block: vec2<u32>, j: u32, t: u32) -> bool {
    if j % params.side > 0u && triangle[place_of(block, j - 1u)] == t {
        return true;
    }
    if j >= params.side && triangle[place_of(block, j - params.side)] == t {
        return true;
    }
    for (var k = 0u; k < j; k++) {
        if triangle[place_of(block, k)] == t {
            return true;
        }
    }
    return false;
}

// The first sample from `start` on whose triangle no earlier one of the block shows; the number of samples without any.
fn leader(block: vec2<u32>, start: u32) -> u32 {
    for (var j = start; j < samples_of_block(); j++) {
        let t = triangle[place_of(block, j)];
        if t != NONE && !repeats(block, j, t) {
            return j;
        }
    }
    return samples_of_block();
}

// Mean of the places, in normalized device coordinates, of the samples of a triangle from its first on.
fn centroid(block: vec2<u32>, first: u32, t: u32) -> vec2<f32> {
    var sum = vec2<f32>(0.0);
    var count = 0u;
    for (var j = first; j < samples_of_block(); j++) {
        if triangle[place_of(block, j)] == t {
            let at = vec2<f32>(sample_of(block, j)) + vec2<f32>(0.5);
            sum += vec2<f32>(at.x * params.grid.x - 1.0, 1.0 - at.y * params.grid.y);
            count++;
        }
    }
    if count == 1u {
        return sum;
    }
    return sum * (1.0 / f32(count));
}

fn gradient_of(block: vec2<u32>, first: u32, t: u32) -> vec4<f32> {
    var sum = vec4<f32>(0.0);
    for (var j = first; j < samples_of_block(); j++) {
        let i = place_of(block, j);
        if triangle[i] == t {
            sum += g_shaded[i];
        }
    }
    return sum;
}

@compute @workgroup_size(64)
fn shade_layer(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    for (var tile = index(group, groups, 0u, 1u); tile < tile_count(); tile += groups.x * groups.y) {
        let block = block_of(tile, lane);
        if !inside(block) {
            continue;
        }
        var j = leader(block, 0u);
        while j < samples_of_block() {
            let t = triangle[place_of(block, j)];
            let c = corners_of(t);
            let color = pixel_color(pixel(c, centroid(block, j, t)), c);
            for (var k = j; k < samples_of_block(); k++) {
                let i = place_of(block, k);
                if triangle[i] == t {
                    shaded[i] = color;
                }
            }
            j = leader(block, j + 1u);
        }
    }
}

fn add_corner(t: u32, term: u32, x: f32) {
    if t == NONE || is_zero(x) {
        return;
    }
    let ids = corners[13u * t + 12u];
    let corner = term / CORNER_TERMS;
    let kind = term % CORNER_TERMS;
    // Clip z has no gradient.
    add_vertex(VERTEX_SUMS * ids[corner] + select(kind + 1u, kind, kind < 2u), x, params.scale);
}

// Adds one term of all lanes: neighbouring lanes of one triangle first among each other, in order.
fn add_terms(term: u32) {
    let corner = term / CORNER_TERMS;
    let kind = term % CORNER_TERMS;
    // Of clip positions a term is one part, of attributes the product of one with the weight of the corner.
    let weighted = kind >= 3u;
    let part = select(3u + 3u * corner + kind, 9u + kind, weighted);
    var t = NONE;
    var sum = 0.0;
    for (var i = 0u; i < 64u; i++) {
        let owner = owners[i];
        if owner != t {
            add_corner(t, term, sum);
            t = owner;
            sum = 0.0;
        }
        if owner != NONE {
            let at = i * PITCH;
            sum += parts_of_lanes[at + part] * select(1.0, parts_of_lanes[at + corner], weighted);
        }
    }
    add_corner(t, term, sum);
}

fn store_three(at: u32, v: vec3<f32>) {
    parts_of_lanes[at] = v.x;
    parts_of_lanes[at + 1u] = v.y;
    parts_of_lanes[at + 2u] = v.z;
}

fn store_parts(lane: u32, p: Pixel, g: PixelGradient) {
    let at = lane * PITCH;
    store_three(at, p.weights);
    store_three(at + 3u, g.clip[0]);
    store_three(at + 6u, g.clip[1]);
    store_three(at + 9u, g.clip[2]);
    store_three(at + 12u, g.position);
    store_three(at + 15u, g.normal);
    store_three(at + 18u, g.tangent);
}

// The triangle whose parts the lane now has, or NONE; leaves the lane's texel gradients for `scatter_lanes`.
fn reverse_group(lane: u32, block: vec2<u32>, first: u32) -> u32 {
    let t = triangle[place_of(block, first)];
    let g = gradient_of(block, first, t);
    // What does not matter costs nothing.
    if is_zero(g.x) && is_zero(g.y) && is_zero(g.z) && is_zero(g.w) {
        return NONE;
    }
    let c = corners_of(t);
    let f = centroid(block, first, t);
    let p = pixel(c, f);
    let d = pixel_vjp(p, c, f, g);
    if MAP_GRADIENTS {
        keep_taps(lane, p.at, d.texel);
    }
    if POSITION_GRADIENTS {
        store_parts(lane, p, d);
    }
    return t;
}

@compute @workgroup_size(64)
fn shade_layer_vjp(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    for (var tile = index(group, groups, 0u, 1u); tile < tile_count(); tile += groups.x * groups.y) {
        let block = block_of(tile, lane);
        var end = 0u;
        var next = 0u;
        if inside(block) {
            end = samples_of_block();
            next = leader(block, 0u);
        }
        var groups_of_lane = 0u;
        for (var j = next; j < end; j = leader(block, j + 1u)) {
            groups_of_lane++;
        }
        if lane == 0u {
            atomicStore(&most, 0u);
        }
        workgroupBarrier();
        atomicMax(&most, groups_of_lane);
        workgroupBarrier();
        if lane == 0u {
            rounds = atomicLoad(&most);
        }
        // In every round each lane has one more of its groups, as long as some lane has.
        let count = workgroupUniformLoad(&rounds);
        for (var round = 0u; round < count; round++) {
            var owner = NONE;
            if MAP_GRADIENTS {
                keep_no_taps(lane);
            }
            if next < end {
                owner = reverse_group(lane, block, next);
                next = leader(block, next + 1u);
            }
            owners[lane] = owner;
            workgroupBarrier();
            if MAP_GRADIENTS {
                scatter_lanes(lane);
            }
            if POSITION_GRADIENTS && lane < TERMS {
                add_terms(lane);
            }
            workgroupBarrier();
        }
    }
}
