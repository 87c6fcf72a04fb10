// Radiance that a surface reflects from the lights: twin of `light.rs`. The parameters of the kernel have a member
// `lights: Lights`.

const LIGHT_POINT: u32 = 0u;
const LIGHT_DIRECTIONAL: u32 = 1u;
const LIGHT_AMBIENT: u32 = 2u;
const LIGHT_ENVIRONMENT: u32 = 3u;
const DISTANCE_SQUARED_MIN: f32 = 1e-8;

struct Light {
    kind: u32,
    // First entry of an environment in `shading_tables`.
    map: u32,
    pad: vec2<u32>,
    // Position, direction, or cosine, sine and scale of an environment.
    a: vec4<f32>,
    // Intensity, irradiance or radiance.
    b: vec4<f32>,
}

struct Lights {
    sources: array<Light, 16>,
    count: u32,
    pad_a: u32,
    pad_b: u32,
    pad_c: u32,
}

fn view_direction(eye: vec3<f32>, position: vec3<f32>) -> vec3<f32> {
    return normalize_or_zero(eye - position);
}

fn view_direction_vjp(eye: vec3<f32>, position: vec3<f32>, g: vec3<f32>) -> vec3<f32> {
    return -normalize_vjp(eye - position, g);
}

// Turn about y by the cosine and sine in `a`, and back.
fn yaw_apply(a: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(a.x * v.x + a.y * v.z, v.y, a.x * v.z - a.y * v.x);
}

fn yaw_invert(a: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(a.x * v.x - a.y * v.z, v.y, a.x * v.z + a.y * v.x);
}

struct Towards {
    wi: vec3<f32>,
    falloff: f32,
    inverse: f32,
}

// Unit direction to a point light, inverse squared distance and inverse distance.
fn towards(at: vec3<f32>, position: vec3<f32>) -> Towards {
    let v = at - position;
    let d2 = dot(v, v);
    let falloff = 1.0 / select(DISTANCE_SQUARED_MIN, d2, d2 > DISTANCE_SQUARED_MIN);
    let inverse = sqrt(falloff);
    return Towards(v * inverse, falloff, inverse);
}

fn viewer_split_sum(l: Lobes, c: Compensation, n: vec3<f32>, wo: vec3<f32>) -> SplitSum {
    if c.on {
        return c.viewer;
    }
    return split_sum(dot(n, wo), l.roughness);
}

fn broad_part(l: Lobes, c: Compensation) -> vec3<f32> {
    if c.on {
        return broad_albedo(c.albedo, l.diffuse, c.viewer);
    }
    return l.diffuse;
}

// Axis of the specular lobe.
fn lobe_axis(n: vec3<f32>, wo: vec3<f32>, r: f32) -> vec3<f32> {
    let t = r * r;
    let cosine = dot(n, wo);
    return n * ((1.0 - t) * (cosine + cosine) + t) - wo * (1.0 - t);
}

// Functions that are long are called in one place each, here and in the adjoint: compilers put them in line.
fn shade_light(k: Light, l: Lobes, c: Compensation, position: vec3<f32>, n: vec3<f32>, wo: vec3<f32>) -> vec3<f32> {
    if k.kind <= LIGHT_DIRECTIONAL {
        var to = Towards(k.a.xyz, 1.0, 0.0);
        if k.kind == LIGHT_POINT {
            to = towards(k.a.xyz, position);
        }
        return eval_lobes(l, c, n, wo, to.wi) * k.b.xyz * to.falloff;
    }
    let s = viewer_split_sum(l, c, n, wo).value;
    let albedo = l.f0 * s.x + vec3<f32>(s.y);
    let wide = broad_part(l, c);
    if k.kind == LIGHT_AMBIENT {
        return (wide + albedo) * k.b.xyz;
    }
    let reflected = environment_specular(k.map, yaw_invert(k.a, lobe_axis(n, wo, l.roughness)), l.roughness);
    return (wide * environment_diffuse(k.map, yaw_invert(k.a, n)) + reflected * albedo) * k.a.z;
}

// Radiance reflected towards `wo`, summed over the lights in order.
fn shade(s: Surface, compensated: bool, position: vec3<f32>, n: vec3<f32>, wo: vec3<f32>) -> vec3<f32> {
    let l = lobes(s);
    let c = compensation(compensated, l, dot(n, wo));
    var sum = vec3<f32>(0.0);
    for (var k = 0u; k < params.lights.count; k++) {
        sum += shade_light(params.lights.sources[k], l, c, position, n, wo);
    }
    return sum;
}

// Gradients summed over the lights.
struct LightSum {
    lobes: Lobes,
    position: vec3<f32>,
    n: vec3<f32>,
    wo: vec3<f32>,
}

// Adjoint of `broad_part`; returns the gradient of the viewer's cosine.
fn broad_part_vjp(l: Lobes, c: Compensation, g: vec3<f32>, sum: ptr<function, LightSum>) -> f32 {
    if !c.on {
        (*sum).lobes.diffuse += g;
        return 0.0;
    }
    let d = broad_albedo_vjp(c.albedo, l.diffuse, c.viewer, g);
    (*sum).lobes.diffuse += d.lobes.diffuse;
    (*sum).lobes.f0 += d.lobes.f0;
    (*sum).lobes.roughness += d.lobes.roughness;
    return d.cosines.x;
}

// Light from all around: ambient, or an environment.
fn surrounding_vjp(
    k: Light,
    l: Lobes,
    c: Compensation,
    n: vec3<f32>,
    wo: vec3<f32>,
    g_radiance: vec3<f32>,
    sum: ptr<function, LightSum>,
) {
    let s = viewer_split_sum(l, c, n, wo);
    // Gradients of the specular albedo, of the part that other lobes reflect, and of the cosine of the viewer.
    var g_albedo = g_radiance * k.b.xyz;
    var g_wide = g_albedo;
    var g_cosine = 0.0;
    if k.kind == LIGHT_ENVIRONMENT {
        let r = l.roughness;
        let g = g_radiance * k.a.z;
        let albedo = l.f0 * s.value.x + vec3<f32>(s.value.y);
        let diffuse = environment_diffuse_vjp(k.map, yaw_invert(k.a, n), g * broad_part(l, c));
        let reflected = environment_specular_vjp(k.map, yaw_invert(k.a, lobe_axis(n, wo, r)), r, g * albedo);
        g_albedo = g * reflected.value;
        g_wide = g * diffuse.value;
        // axis = k n - (1 - t) wo, k = 2 (1 - t)(n.wo) + t, t = r^2
        let g_axis = yaw_apply(k.a, reflected.direction);
        let t = r * r;
        let cosine = dot(n, wo);
        let g_k = dot(g_axis, n);
        g_cosine = g_k * 2.0 * (1.0 - t);
        let g_t = g_k * (1.0 - 2.0 * cosine) + dot(g_axis, wo);
        (*sum).lobes.roughness += reflected.roughness + 2.0 * r * g_t;
        (*sum).n += yaw_apply(k.a, diffuse.direction) + g_axis * (2.0 * (1.0 - t) * cosine + t);
        (*sum).wo -= g_axis * (1.0 - t);
    }
    let g_split = vec2<f32>(dot(g_albedo, l.f0), sum3(g_albedo));
    g_cosine += dot(g_split, s.d_cosine) + broad_part_vjp(l, c, g_wide, sum);
    (*sum).lobes.f0 += g_albedo * s.value.x;
    (*sum).lobes.roughness += dot(g_split, s.d_roughness);
    (*sum).n += wo * g_cosine;
    (*sum).wo += n * g_cosine;
}

fn shade_light_vjp(
    k: Light,
    l: Lobes,
    c: Compensation,
    position: vec3<f32>,
    n: vec3<f32>,
    wo: vec3<f32>,
    g: vec3<f32>,
    sum: ptr<function, LightSum>,
) {
    if k.kind > LIGHT_DIRECTIONAL {
        surrounding_vjp(k, l, c, n, wo, g, sum);
        return;
    }
    var to = Towards(k.a.xyz, 1.0, 0.0);
    if k.kind == LIGHT_POINT {
        to = towards(k.a.xyz, position);
    }
    let g_f = g * k.b.xyz;
    let e = eval_lobes_vjp(l, c, n, wo, to.wi, g_f * to.falloff);
    (*sum).lobes.diffuse += e.d.lobes.diffuse;
    (*sum).lobes.f0 += e.d.lobes.f0;
    (*sum).lobes.roughness += e.d.lobes.roughness;
    (*sum).n += e.d.n;
    (*sum).wo += e.d.wo;
    if k.kind == LIGHT_POINT {
        // wi = v / |v| and falloff = 1 / |v|^2 with v = at - position.
        let g_wi = e.d.wi - to.wi * dot(to.wi, e.d.wi);
        let g_falloff = dot(g_f, e.value) * to.falloff;
        (*sum).position += (to.wi * (g_falloff + g_falloff) - g_wi) * to.inverse;
    }
}

struct ShadeGradient {
    surface: Surface,
    position: vec3<f32>,
    n: vec3<f32>,
    wo: vec3<f32>,
}

// Adjoint of `shade` for the gradient `g` of the radiance.
fn shade_vjp(
    s: Surface,
    compensated: bool,
    position: vec3<f32>,
    n: vec3<f32>,
    wo: vec3<f32>,
    g: vec3<f32>,
) -> ShadeGradient {
    let l = lobes(s);
    let c = compensation(compensated, l, dot(n, wo));
    var sum: LightSum;
    for (var k = 0u; k < params.lights.count; k++) {
        shade_light_vjp(params.lights.sources[k], l, c, position, n, wo, g, &sum);
    }
    return ShadeGradient(lobes_vjp(s, sum.lobes), sum.position, sum.n, sum.wo);
}
