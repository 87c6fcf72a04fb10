// Textures of four channels in the precision of their files: twin of `stored.rs` and `lookup.rs`. The kernel declares
//     var<storage, read> stored: array<u32>;
// that begins with 256 numbers, bytes of sRGB in linear light. A texture is known by the place of its description: the place
// of its first texel, the format, and for each level the first texel, columns and rows.

const STORED_SRGB8: u32 = 0u;
const STORED_UNORM8: u32 = 1u;
const STORED_UNORM16: u32 = 2u;

struct StoredLookup {
    fine: Taps,
    coarse: Taps,
    // Share of the coarse level in (0, 1]; 0: the fine one alone.
    share: f32,
}

// How a texture is read: two bits each for the continuation along u and v and for the filter.
fn stored_sampler(bits: u32) -> MapSampler {
    return MapSampler(bits & 3u, (bits >> 2u) & 3u, (bits >> 4u) & 3u);
}

fn stored_level(texture: u32, k: u32) -> Level {
    let at = texture + 2u + 3u * k;
    return Level(stored[at], stored[at + 1u], stored[at + 2u]);
}

// Plans the lookup at `uv` with the level of detail `lod` in the first `levels` levels of a texture, and of all that have
// levels of the same sizes.
fn stored_lookup(texture: u32, levels: u32, uv: vec2<f32>, lod: f32, how: MapSampler) -> StoredLookup {
    let chosen = choose_level(lod, levels, how.filtering);
    let fine = taps(uv, stored_level(texture, chosen.level), how);
    if chosen.share > 0.0 {
        return StoredLookup(fine, taps(uv, stored_level(texture, chosen.level + 1u), how), chosen.share);
    }
    return StoredLookup(fine, fine, 0.0);
}

// A texel, of whose numbers `stored_unit` makes those of the texture.
fn stored_texel(first: u32, format: u32, i: u32) -> vec4<f32> {
    if format <= STORED_UNORM8 {
        let word = stored[first + i];
        let bytes = vec4<u32>(word & 0xffu, (word >> 8u) & 0xffu, (word >> 16u) & 0xffu, word >> 24u);
        if format == STORED_UNORM8 {
            return vec4<f32>(bytes);
        }
        let color = vec3<u32>(stored[bytes.x], stored[bytes.y], stored[bytes.z]);
        return vec4<f32>(bitcast<vec3<f32>>(color), f32(bytes.w));
    }
    if format == STORED_UNORM16 {
        let low = stored[first + 2u * i];
        let high = stored[first + 2u * i + 1u];
        return vec4<f32>(vec4<u32>(low & 0xffffu, low >> 16u, high & 0xffffu, high >> 16u));
    }
    let at = first + 4u * i;
    return bitcast<vec4<f32>>(vec4<u32>(stored[at], stored[at + 1u], stored[at + 2u], stored[at + 3u]));
}

fn stored_unit(format: u32) -> vec4<f32> {
    if format == STORED_SRGB8 {
        return vec4<f32>(1.0, 1.0, 1.0, 1.0 / 255.0);
    }
    if format == STORED_UNORM8 {
        return vec4<f32>(1.0 / 255.0);
    }
    if format == STORED_UNORM16 {
        return vec4<f32>(1.0 / 65535.0);
    }
    return vec4<f32>(1.0);
}

fn stored_taps(first: u32, format: u32, t: Taps) -> vec4<f32> {
    let w = tap_weights(t);
    let upper = stored_texel(first, format, t.index.x) * w.x + stored_texel(first, format, t.index.y) * w.y;
    return upper + (stored_texel(first, format, t.index.z) * w.z + stored_texel(first, format, t.index.w) * w.w);
}

// The filtered value, in linear light.
fn stored_read(texture: u32, at: StoredLookup) -> vec4<f32> {
    let first = stored[texture];
    let format = stored[texture + 1u];
    var value = stored_taps(first, format, at.fine);
    if at.share > 0.0 {
        value += (stored_taps(first, format, at.coarse) - value) * at.share;
    }
    return value * stored_unit(format);
}
