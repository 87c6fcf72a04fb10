// The four taps of a bilinear lookup on one level: twin of `taps.rs`, for texels of any kind.

struct Level {
    offset: u32,
    width: u32,
    height: u32,
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

// The level that a lookup reads, and the share in (0, 1] of the next coarser one; 0: the level alone.
struct LevelChoice {
    level: u32,
    share: f32,
}

// Among `count` levels, at the level of detail `lod`.
fn choose_level(lod: f32, count: u32, filtering: u32) -> LevelChoice {
    if lod > 0.0 && filtering == FILTER_TRILINEAR {
        let level = min(u32(lod), count - 1u);
        return LevelChoice(level, select(0.0, lod - f32(level), level + 1u < count));
    }
    return LevelChoice(0u, 0.0);
}

struct MapSampler {
    wrap_u: u32,
    wrap_v: u32,
    filtering: u32,
}

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
