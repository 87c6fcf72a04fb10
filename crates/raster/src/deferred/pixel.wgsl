// One pixel: interpolate, texture, normal map, shade; forward and adjoint: twin of `packet.rs`. The kernel declares
//     var<storage, read> corners: array<vec4<u32>>;
// and says whether scattering is compensated and what gets gradients:
//     const COMPENSATED: bool
//     const POSITION_GRADIENTS: bool
//     const MAP_GRADIENTS: bool

const NORMAL_MAP: u32 = 1u;
const EMISSIVE: u32 = 2u;
const ALPHA_GRADIENTS: u32 = 4u;
const FADED_MASKS: u32 = 8u;

const ALPHA_OPAQUE: u32 = 0u;
const ALPHA_MASK: u32 = 1u;
const ALPHA_BLEND: u32 = 2u;

fn runs(flag: u32) -> bool {
    return (params.flags & flag) != 0u;
}

// The corners of one triangle, a column each.
struct Corners {
    clip: mat3x4<f32>,
    position: mat3x3<f32>,
    normal: mat3x3<f32>,
    tangent: mat3x3<f32>,
    u: vec3<f32>,
    v: vec3<f32>,
    handedness: f32,
    cutoff: f32,
    alpha: u32,
    geometric_normal: vec3<f32>,
}

fn vector_at(i: u32) -> vec4<f32> {
    return bitcast<vec4<f32>>(corners[i]);
}

fn corners_of(triangle: u32) -> Corners {
    let at = 13u * triangle;
    let p0 = vector_at(at + 3u);
    let p1 = vector_at(at + 4u);
    let p2 = vector_at(at + 5u);
    let n0 = vector_at(at + 6u);
    let n1 = vector_at(at + 7u);
    let n2 = vector_at(at + 8u);
    let t0 = vector_at(at + 9u);
    let t1 = vector_at(at + 10u);
    let t2 = vector_at(at + 11u);
    return Corners(
        mat3x4<f32>(vector_at(at), vector_at(at + 1u), vector_at(at + 2u)),
        mat3x3<f32>(p0.xyz, p1.xyz, p2.xyz),
        mat3x3<f32>(n0.xyz, n1.xyz, n2.xyz),
        mat3x3<f32>(t0.xyz, t1.xyz, t2.xyz),
        vec3<f32>(p0.w, p1.w, p2.w),
        vec3<f32>(n0.w, n1.w, n2.w),
        t0.w,
        t1.w,
        corners[at + 12u].w,
        cross(p1.xyz - p0.xyz, p2.xyz - p0.xyz),
    );
}

// Everything that a pixel computes on the way to its colour.
struct Pixel {
    weights: vec3<f32>,
    at: Lookup,
    texel: Texel,
    position: vec3<f32>,
    normal: vec3<f32>,
    tangent: vec3<f32>,
    perturbed: vec3<f32>,
    shading_normal: vec3<f32>,
    wo: vec3<f32>,
}

fn map_normal(t: Texel) -> vec3<f32> {
    return vec3<f32>(t[1].w, t[2].xy);
}

fn surface_of(t: Texel) -> Surface {
    return Surface(t[0].xyz, t[1].y, t[1].z, t[1].x);
}

// Screen derivatives of an interpolated attribute.
fn derivatives(b: Barycentrics, a: vec3<f32>) -> vec2<f32> {
    return b.du * (a.x - a.z) + b.dv * (a.y - a.z);
}

// Runs the stages up to the shading normal, at the normalized device coordinates `f`.
fn pixel(c: Corners, f: vec2<f32>) -> Pixel {
    let b = barycentrics(c.clip, f, params.footprint);
    var p: Pixel;
    p.weights = vec3<f32>(b.u, b.v, 1.0 - b.u - b.v);
    let uv = vec2<f32>(dot(c.u, p.weights), dot(c.v, p.weights));
    let base = mip_level(0u);
    let coarsest = params.maps.count - 1u;
    let lod = level_of_detail(
        derivatives(b, c.u), derivatives(b, c.v), base.width, base.height, params.lod_bias, coarsest,
    );
    p.at = lookup(uv, lod, MapSampler(WRAP_CLAMP, WRAP_CLAMP, FILTER_TRILINEAR));
    p.texel = sample_maps(p.at);
    p.position = c.position * p.weights;
    p.normal = c.normal * p.weights;
    p.tangent = c.tangent * p.weights;
    if runs(NORMAL_MAP) {
        p.perturbed = perturb(p.normal, p.tangent, c.handedness, map_normal(p.texel));
    } else {
        p.perturbed = normalize_or_zero(p.normal);
    }
    p.wo = view_direction(params.eye, p.position);
    p.shading_normal = face_viewer(p.perturbed, c.geometric_normal, p.wo);
    return p;
}

// A faded mask before it is clamped.
fn faded(alpha: f32, cutoff: f32) -> f32 {
    return 0.5 + params.slope * (alpha - cutoff);
}

fn drawn_alpha(alpha: f32, c: Corners) -> f32 {
    if c.alpha == ALPHA_OPAQUE {
        return 1.0;
    }
    if c.alpha == ALPHA_BLEND {
        return clamp_to(alpha, 0.0, 1.0);
    }
    if runs(FADED_MASKS) {
        return clamp_to(faded(alpha, c.cutoff), 0.0, 1.0);
    }
    return select(0.0, 1.0, alpha >= c.cutoff);
}

fn drawn_alpha_vjp(alpha: f32, c: Corners, g: f32) -> f32 {
    if c.alpha == ALPHA_BLEND {
        return g;
    }
    if c.alpha == ALPHA_MASK && runs(FADED_MASKS) {
        let f = faded(alpha, c.cutoff);
        return select(0.0, g * params.slope, f >= 0.0 && f <= 1.0);
    }
    return 0.0;
}

// Radiance and alpha.
fn pixel_color(p: Pixel, c: Corners) -> vec4<f32> {
    var rgb = shade(surface_of(p.texel), COMPENSATED, p.position, p.shading_normal, p.wo);
    if runs(EMISSIVE) {
        rgb += vec3<f32>(p.texel[2].zw, p.texel[3].x);
    }
    return vec4<f32>(rgb, drawn_alpha(p.texel[0].w, c));
}

// Gradients of a pixel: of the texel, of the interpolated attributes, and of x, y and w of the corners' clip positions.
struct PixelGradient {
    texel: Texel,
    position: vec3<f32>,
    normal: vec3<f32>,
    tangent: vec3<f32>,
    clip: mat3x3<f32>,
}

// Gradient of one barycentric weight against the third.
fn weight_vjp(a: mat3x3<f32>, g: vec3<f32>) -> vec2<f32> {
    return vec2<f32>(dot(g, a[0] - a[2]), dot(g, a[1] - a[2]));
}

fn pixel_vjp(p: Pixel, c: Corners, f: vec2<f32>, g: vec4<f32>) -> PixelGradient {
    var out: PixelGradient;
    let s = shade_vjp(surface_of(p.texel), COMPENSATED, p.position, p.shading_normal, p.wo, g.xyz);
    var g_emissive = vec3<f32>(0.0);
    if runs(EMISSIVE) {
        g_emissive = g.xyz;
    }
    var g_alpha = 0.0;
    if runs(ALPHA_GRADIENTS) {
        g_alpha = drawn_alpha_vjp(p.texel[0].w, c, g.w);
    }
    let facing = face_viewer_vjp(p.perturbed, c.geometric_normal, p.wo, s.n);
    var g_map = vec3<f32>(0.0);
    if runs(NORMAL_MAP) {
        let d = perturb_vjp(p.normal, p.tangent, c.handedness, map_normal(p.texel), facing.normal);
        out.normal = d.normal;
        out.tangent = d.tangent;
        g_map = d.map;
    } else {
        out.normal = normalize_vjp(p.normal, facing.normal);
    }
    out.texel = Texel(
        vec4<f32>(s.surface.base_color, g_alpha),
        vec4<f32>(s.surface.gamma, s.surface.roughness, s.surface.metallic, g_map.x),
        vec4<f32>(g_map.yz, g_emissive.xy),
        vec4<f32>(g_emissive.z, 0.0, 0.0, 0.0),
    );
    if POSITION_GRADIENTS {
        out.position = s.position + view_direction_vjp(params.eye, p.position, s.wo + facing.wo);
        let g_uv = sample_vjp(p.at, out.texel).xy;
        let g_weights = weight_vjp(c.position, out.position)
            + weight_vjp(c.normal, out.normal)
            + weight_vjp(c.tangent, out.tangent)
            + (c.u.xy - vec2<f32>(c.u.z)) * g_uv.x
            + (c.v.xy - vec2<f32>(c.v.z)) * g_uv.y;
        out.clip = barycentrics_vjp(c.clip, f, g_weights.x, g_weights.y);
    }
    return out;
}
