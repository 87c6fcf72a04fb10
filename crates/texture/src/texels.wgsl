// Taps of texels of 16 channels, four vectors: all levels lie one after the other in a buffer that the kernel declares,
//     var<storage, read> texels: array<vec4<f32>>;
// and the parameters of the kernel have a member `maps: MipTable`.

// What lookups and their adjoints know of the levels.
struct MipTable {
    // First texel, columns and rows of each level.
    levels: array<vec4<u32>, 16>,
    // Place of each channel among the sums of a texel, or NO_SUM.
    slots: array<vec4<u32>, 4>,
    // Number of levels.
    count: u32,
    // Sums of a texel.
    channels: u32,
    // Units of the sums, a power of two.
    scale: f32,
    pad: u32,
}

fn mip_level(k: u32) -> Level {
    let l = params.maps.levels[k];
    return Level(l.x, l.y, l.z);
}

// All channels of a texel.
alias Texel = mat4x4<f32>;

fn texel(i: u32) -> Texel {
    return Texel(texels[4u * i], texels[4u * i + 1u], texels[4u * i + 2u], texels[4u * i + 3u]);
}

// Bilinear value.
fn read_taps(t: Taps) -> Texel {
    let w = tap_weights(t);
    let upper = texel(t.index.x) * w.x + texel(t.index.y) * w.y;
    return upper + (texel(t.index.z) * w.z + texel(t.index.w) * w.w);
}

// Sum over all channels of a product.
fn texel_dot(a: Texel, b: Texel) -> f32 {
    return (dot(a[0], b[0]) + dot(a[1], b[1])) + (dot(a[2], b[2]) + dot(a[3], b[3]));
}

// Adjoint of `read_taps` with respect to uv.
fn taps_uv_vjp(t: Taps, level: Level, g: Texel) -> vec2<f32> {
    let a = texel(t.index.x);
    let b = texel(t.index.y);
    let c = texel(t.index.z);
    let d = texel(t.index.w);
    let x = texel_dot(g, (b - a) * (1.0 - t.fy) + (d - c) * t.fy);
    let y = texel_dot(g, (c - a) * (1.0 - t.fx) + (d - b) * t.fx);
    return vec2<f32>(x * f32(level.width), y * f32(level.height));
}
