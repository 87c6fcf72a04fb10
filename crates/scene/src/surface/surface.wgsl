// What a surface is made of at a point: twin of `packet.rs` and `address.rs`. The kernel declares
//     var<storage, read> materials: array<vec4<u32>>;
// A material is known by the place of its five vectors:
//     base colour and its alpha
//     roughness, metalness, scale of the normal map, cutoff of a mask
//     emission, and flags: what alpha means (0 opaque, 1 mask, 2 blend), then a bit for unlit materials
//     for base colour, roughness and metalness, normal and emission: the texture, or NO_TEXTURE
//     for the same: the place of the address that the texture is read at
// An address has two vectors: how it is read (the bits of the sampler, above them the set of texture coordinates and
// whether they are taken as they are), the number of levels, and a transform of two rows of three numbers.

const NO_TEXTURE: u32 = 0xffffffffu;
const SURFACE_MASK: u32 = 1u;
const SURFACE_BLEND: u32 = 2u;
const SURFACE_UNLIT: u32 = 4u;
const SECOND_SET: u32 = 64u;
const AS_IT_IS: u32 = 128u;

// A point of a surface: texture coordinates of the sets 0 and 1, their derivatives along X and Y, and the colour of the
// vertices.
struct SurfacePoint {
    uv: vec4<f32>,
    dx: vec4<f32>,
    dy: vec4<f32>,
    color: vec4<f32>,
}

struct SurfaceSample {
    base_color: vec3<f32>,
    alpha: f32,
    roughness: f32,
    metallic: f32,
    normal: vec3<f32>,
    emissive: vec3<f32>,
    unlit: bool,
}

// Textures at one address share their lookup.
struct SurfaceReader {
    address: u32,
    at: StoredLookup,
}

fn surface_lookup(texture: u32, address: u32, p: SurfacePoint) -> StoredLookup {
    let a = materials[address];
    let b = bitcast<vec4<f32>>(materials[address + 1u]);
    let first = bitcast<vec2<f32>>(a.zw);
    let second = (a.x & SECOND_SET) != 0u;
    var uv = select(p.uv.xy, p.uv.zw, second);
    var dx = select(p.dx.xy, p.dx.zw, second);
    var dy = select(p.dy.xy, p.dy.zw, second);
    // The identity would make coordinates that are not finite of those beside them.
    if (a.x & AS_IT_IS) == 0u {
        // Rows of the transform: (first, b.x), (b.y, b.z, b.w).
        let u = vec3<f32>(first, b.x);
        let v = b.yzw;
        uv = vec2<f32>(dot(u.xy, uv) + u.z, dot(v.xy, uv) + v.z);
        dx = vec2<f32>(dot(u.xy, dx), dot(v.xy, dx));
        dy = vec2<f32>(dot(u.xy, dy), dot(v.xy, dy));
    }
    let how = stored_sampler(a.x);
    var lod = 0.0;
    if how.filtering == FILTER_TRILINEAR && a.y > 1u {
        let du = vec2<f32>(dx.x, dy.x);
        let dv = vec2<f32>(dx.y, dy.y);
        let base = stored_level(texture, 0u);
        lod = level_of_detail(du, dv, base.width, base.height, 0.0, a.y - 1u);
    }
    return stored_lookup(texture, a.y, uv, lod, how);
}

fn surface_read(reader: ptr<function, SurfaceReader>, texture: u32, address: u32, p: SurfacePoint) -> vec4<f32> {
    if (*reader).address != address {
        (*reader).address = address;
        (*reader).at = surface_lookup(texture, address, p);
    }
    return stored_read(texture, (*reader).at);
}

fn surface_normal(t: vec4<f32>, scale: f32) -> vec3<f32> {
    let n = vec3<f32>((2.0 * t.x - 1.0) * scale, (2.0 * t.y - 1.0) * scale, 2.0 * t.z - 1.0);
    let unit = normalize_or_zero(n);
    if all(unit == vec3<f32>(0.0)) {
        return vec3<f32>(0.0, 0.0, 1.0);
    }
    return unit;
}

fn surface_coverage(flags: u32, alpha: f32, cutoff: f32) -> f32 {
    let mode = flags & 3u;
    if mode == SURFACE_BLEND {
        return clamp_to(alpha, 0.0, 1.0);
    }
    return select(1.0, select(0.0, 1.0, alpha >= cutoff), mode == SURFACE_MASK);
}

// The material at place `m` at a point.
fn surface_at(m: u32, p: SurfacePoint) -> SurfaceSample {
    let color = bitcast<vec4<f32>>(materials[m]) * p.color;
    let factors = bitcast<vec4<f32>>(materials[m + 1u]);
    let last = materials[m + 2u];
    let texture = materials[m + 3u];
    let address = materials[m + 4u];
    var out = SurfaceSample(
        color.xyz, color.w, factors.x, factors.y, vec3<f32>(0.0, 0.0, 1.0), bitcast<vec3<f32>>(last.xyz),
        (last.w & SURFACE_UNLIT) != 0u,
    );
    var reader: SurfaceReader;
    reader.address = NO_TEXTURE;
    if texture.x != NO_TEXTURE {
        let t = surface_read(&reader, texture.x, address.x, p);
        out.base_color *= t.xyz;
        out.alpha *= t.w;
    }
    out.alpha = surface_coverage(last.w, out.alpha, factors.w);
    if out.alpha <= 0.0 {
        // Nothing is seen of it.
        return out;
    }
    if texture.y != NO_TEXTURE {
        let t = surface_read(&reader, texture.y, address.y, p);
        out.roughness *= t.y;
        out.metallic *= t.z;
    }
    if texture.z != NO_TEXTURE {
        out.normal = surface_normal(surface_read(&reader, texture.z, address.z, p), factors.z);
    }
    if texture.w != NO_TEXTURE {
        out.emissive *= surface_read(&reader, texture.w, address.w, p).xyz;
    }
    return out;
}
