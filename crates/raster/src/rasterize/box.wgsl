// Boxes of samples and the classes of triangles by their size.

const TILE: u32 = 16u;
// Drawn by one invocation, by one workgroup, by several.
const SMALL: u32 = 0u;
const MEDIUM: u32 = 1u;
const LARGE: u32 = 2u;
// Samples of the largest box of a small triangle, tiles of that of a medium one.
const SMALL_SAMPLES: u32 = 64u;
const MEDIUM_TILES: u32 = 64u;
// Workgroups that draw a large triangle.
const SLICES: u32 = 256u;

// First and last column and row, 16 bits each.
fn packed(b: vec4<u32>) -> vec2<u32> {
    return vec2<u32>(b.x | (b.z << 16u), b.y | (b.w << 16u));
}

// First column and row, last column and row.
fn unpacked(b: vec2<u32>) -> vec4<u32> {
    return vec4<u32>(b & vec2<u32>(0xffffu), b >> vec2<u32>(16u));
}

// Columns and rows of the tiles of a box.
fn tiles_of(b: vec4<u32>) -> vec2<u32> {
    return b.zw / TILE - b.xy / TILE + 1u;
}

fn class_of(b: vec4<u32>) -> u32 {
    if (b.z - b.x + 1u) * (b.w - b.y + 1u) <= SMALL_SAMPLES {
        return SMALL;
    }
    let tiles = tiles_of(b);
    return select(LARGE, MEDIUM, tiles.x * tiles.y <= MEDIUM_TILES);
}
