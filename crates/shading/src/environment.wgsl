// Prefiltered environments in the octahedral parametrisation: twin of `octahedral.rs` and `environment.rs`. An environment
// is ten entries of `shading_tables`, the diffuse image and nine roughness levels: (first texel, texels per side). The
// texels, with their border, lie in the same buffer.

const ENVIRONMENT_LEVELS: u32 = 9u;

struct OctahedralPlace {
    index: u32,
    pitch: u32,
    f: vec2<f32>,
    p: vec2<f32>,
    inv: f32,
    sign: vec3<f32>,
    scale: f32,
    folded: bool,
}

fn octahedral_place(image: vec4<f32>, d: vec3<f32>) -> OctahedralPlace {
    let sign = select(vec3<f32>(1.0), vec3<f32>(-1.0), d < vec3<f32>(0.0));
    let l1 = abs(d.x) + abs(d.y) + abs(d.z);
    let inv = 1.0 / select(1e-30, l1, l1 > 1e-30);
    let p = d.xz * inv;
    let folded = d.y < 0.0;
    let uv = select(p, (vec2<f32>(1.0) - abs(p.yx)) * sign.xz, folded);
    let size = u32(image.y);
    let scale = image.y * 0.5;
    let x = uv.x * scale + (scale + 0.5);
    let y = uv.y * scale + (scale + 0.5);
    let i = min(u32(max(x, 0.0)), size);
    let j = min(u32(max(y, 0.0)), size);
    let f = vec2<f32>(x - f32(i), y - f32(j));
    return OctahedralPlace(u32(image.x) + j * (size + 2u) + i, size + 2u, f, p, inv, sign, scale, folded);
}

struct Octahedral {
    value: vec3<f32>,
    // Derivative of the value by both coordinates of the image.
    d_u: vec3<f32>,
    d_v: vec3<f32>,
}

fn octahedral_read(at: OctahedralPlace) -> Octahedral {
    let a = shading_tables[at.index].xyz;
    let b = shading_tables[at.index + 1u].xyz;
    let c = shading_tables[at.index + at.pitch].xyz;
    let e = shading_tables[at.index + at.pitch + 1u].xyz;
    let low = a + (b - a) * at.f.x;
    let high = c + (e - c) * at.f.x;
    let d_u = (b - a) + ((e - c) - (b - a)) * at.f.y;
    return Octahedral(low + (high - low) * at.f.y, d_u * at.scale, (high - low) * at.scale);
}

// Gradient of the direction from that of the value.
fn octahedral_vjp(at: OctahedralPlace, read: Octahedral, g: vec3<f32>) -> vec3<f32> {
    let g_uv = vec2<f32>(dot(g, read.d_u), dot(g, read.d_v));
    let g_xz = select(g_uv, g_uv.yx * (-at.sign.x * at.sign.z), at.folded);
    let along = dot(g_xz, at.p) * at.inv;
    return vec3<f32>(g_xz.x * at.inv, 0.0, g_xz.y * at.inv) - at.sign * along;
}

struct EnvironmentGradient {
    value: vec3<f32>,
    direction: vec3<f32>,
    roughness: f32,
}

fn environment_diffuse(map: u32, n: vec3<f32>) -> vec3<f32> {
    return octahedral_read(octahedral_place(shading_tables[map], n)).value;
}

fn environment_diffuse_vjp(map: u32, n: vec3<f32>, g: vec3<f32>) -> EnvironmentGradient {
    let at = octahedral_place(shading_tables[map], n);
    let read = octahedral_read(at);
    return EnvironmentGradient(read.value, octahedral_vjp(at, read, g), 0.0);
}

// Level, fraction towards the next level, and levels per roughness (0 where clamped).
fn environment_level(roughness: f32) -> vec3<f32> {
    let slope = f32(ENVIRONMENT_LEVELS - 1u);
    let r = clamp_to(roughness, 0.0, 1.0);
    let i = min(u32(r * slope), ENVIRONMENT_LEVELS - 2u);
    return vec3<f32>(f32(i), r * slope - f32(i), select(0.0, slope, r == roughness));
}

fn environment_specular(map: u32, d: vec3<f32>, roughness: f32) -> vec3<f32> {
    let level = environment_level(roughness);
    let image = map + 1u + u32(level.x);
    let low = octahedral_read(octahedral_place(shading_tables[image], d)).value;
    let high = octahedral_read(octahedral_place(shading_tables[image + 1u], d)).value;
    return low + (high - low) * level.y;
}

fn environment_specular_vjp(map: u32, d: vec3<f32>, roughness: f32, g: vec3<f32>) -> EnvironmentGradient {
    let level = environment_level(roughness);
    let image = map + 1u + u32(level.x);
    let near = octahedral_place(shading_tables[image], d);
    let far = octahedral_place(shading_tables[image + 1u], d);
    let low = octahedral_read(near);
    let high = octahedral_read(far);
    let rise = high.value - low.value;
    let direction = octahedral_vjp(near, low, g * (1.0 - level.y)) + octahedral_vjp(far, high, g * level.y);
    return EnvironmentGradient(low.value + rise * level.y, direction, dot(g, rise) * level.z);
}
