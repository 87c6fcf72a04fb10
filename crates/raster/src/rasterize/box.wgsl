// Boxes of samples and the classes of triangles by their size.

// Drawn by one invocation; by one workgroup sample by sample; by several workgroups tile by tile.
const SMALL: u32 = 0u;
const MEDIUM: u32 = 1u;
const LARGE: u32 = 2u;
// Samples of the largest box of a small and of a medium triangle.
const SMALL_SAMPLES: u32 = 16u;
const MEDIUM_SAMPLES: u32 = 4096u;
// Width of the tiles of a large triangle.
const TILE: u32 = 16u;

// Workgroups that draw each of `n` large triangles: few triangles are split among many.
fn slices_of(n: u32) -> u32 {
    return clamp(16384u / max(n, 1u), 8u, 512u);
}

// First and last column and row, 16 bits each.
fn packed(b: vec4<u32>) -> vec2<u32> {
    return vec2<u32>(b.x | (b.z << 16u), b.y | (b.w << 16u));
}

// First column and row, last column and row.
fn unpacked(b: vec2<u32>) -> vec4<u32> {
    return vec4<u32>(b & vec2<u32>(0xffffu), b >> vec2<u32>(16u));
}

// The class of a triangle by its box, which is not empty.
fn class_of(b: vec4<u32>) -> u32 {
    let samples = (b.z - b.x + 1u) * (b.w - b.y + 1u);
    if samples <= SMALL_SAMPLES {
        return SMALL;
    }
    return select(LARGE, MEDIUM, samples <= MEDIUM_SAMPLES);
}
