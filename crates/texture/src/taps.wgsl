// The four taps of a bilinear lookup on one level: twin of `taps.rs`. Texels have 16 channels, four vectors: all levels
// lie one after the other in a buffer that the kernel declares,
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

struct Level {
    offset: u32,
    width: u32,
    height: u32,
}

fn mip_level(k: u32) -> Level {
    let l = params.maps.levels[k];
    return Level(l.x, l.y, l.z);
}

// Texel indices (upper left, upper right, lower left, lower right) and the fractions between them.
struct Taps {
    index: vec4<u32>,
    fx: f32,
    fy: f32,
}

const WRAP_REPEAT: u32 = 0u;
const WRAP_MIRRORED: u32 = 1u;
const WRAP_CLAMP: u32 = 2u;
const FILTER_NEAREST: u32 = 0u;
const FILTER_BILINEAR: u32 = 1u;
const FILTER_TRILINEAR: u32 = 2u;

struct MapSampler {
    wrap_u: u32,
    wrap_v: u32,
    filtering: u32,
}

// All channels of a texel.
alias Texel = mat4x4<f32>;

struct Fold {
    u: f32,
    backwards: bool,
}

fn fold(u: f32, wrap: u32) -> Fold {
    var folded = u;
    var backwards = false;
    if wrap == WRAP_REPEAT {
        folded = u - f32(floor_to_i32(u));
    } else if wrap == WRAP_MIRRORED {
        let m = u - 2.0 * f32(floor_to_i32(u * 0.5));
        backwards = m > 1.0;
        folded = select(m, 2.0 - m, backwards);
    }
    return Fold(clamp_to(folded, 0.0, 1.0), backwards);
}

fn nearest(u: f32, n: u32, wrap: u32) -> u32 {
    return min(u32(fold(u, wrap).u * f32(n)), n - 1u);
}

struct Axis {
    low: u32,
    high: u32,
    share: f32,
}

fn axis(u: f32, n: u32, wrap: u32) -> Axis {
    let folded = fold(u, wrap);
    let x = folded.u * f32(n) - 0.5;
    let whole = floor(x);
    let i = i32(whole);
    let f = x - whole;
    let last = i32(n) - 1;
    // Both ends: coordinates that are no numbers end at some texel.
    var low = clamp(i, 0, last);
    var high = clamp(i + 1, 0, last);
    if wrap == WRAP_REPEAT {
        low = select(i, last, i < 0);
        high = select(i + 1, 0, i >= last);
    }
    if folded.backwards {
        return Axis(u32(high), u32(low), 1.0 - f);
    }
    return Axis(u32(low), u32(high), f);
}

fn taps(uv: vec2<f32>, level: Level, how: MapSampler) -> Taps {
    if how.filtering == FILTER_NEAREST {
        let x = nearest(uv.x, level.width, how.wrap_u);
        let y = nearest(uv.y, level.height, how.wrap_v);
        return Taps(vec4<u32>(level.offset + y * level.width + x), 0.0, 0.0);
    }
    let x = axis(uv.x, level.width, how.wrap_u);
    let y = axis(uv.y, level.height, how.wrap_v);
    let upper = level.offset + y.low * level.width;
    let lower = level.offset + y.high * level.width;
    let index = vec4<u32>(upper + x.low, upper + x.high, lower + x.low, lower + x.high);
    return Taps(index, x.share, y.share);
}

fn tap_weights(t: Taps) -> vec4<f32> {
    let gx = 1.0 - t.fx;
    let gy = 1.0 - t.fy;
    return vec4<f32>(gx * gy, t.fx * gy, gx * t.fy, t.fx * t.fy);
}

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
