// Radiance that a surface reflects from the lights: twin of `light.rs`. The parameters of the kernel have a member
// `lights: Lights`.

const LIGHT_POINT: u32 = 0u;
// The least normal number: its inverse is finite.
const DISTANCE_SQUARED_MIN: f32 = 1.1754944e-38;

struct Light {
    // A point light has 0.
    kind: u32,
    // First entry of an environment in `shading_tables`.
    map: u32,
    pad: vec2<u32>,
    // Position, direction, or cosine, sine and scale of an environment.
    a: vec4<f32>,
    // Intensity or irradiance.
    b: vec4<f32>,
}

struct Lights {
    // Point and directional lights, then environments.
    sources: array<Light, 64>,
    // Radiance of all ambient lights.
    ambient: vec4<f32>,
    punctual: u32,
    count: u32,
    pad_a: u32,
    pad_b: u32,
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

// Unit direction to a point light, inverse squared distance and inverse distance; zero on the spot.
fn towards(at: vec3<f32>, position: vec3<f32>) -> Towards {
    let v = at - position;
    let d2 = dot(v, v);
    let falloff = select(0.0, 1.0 / max(d2, DISTANCE_SQUARED_MIN), d2 >= DISTANCE_SQUARED_MIN);
    let inverse = sqrt(falloff);
    return Towards(v * inverse, falloff, inverse);
}

fn viewer_split_sum(l: Lobes, c: Compensation, n: vec3<f32>, wo: vec3<f32>) -> SplitSum {
    if c.on {
        return c.viewer;
    }
    return split_sum(dot(n, wo), l.roughness);
}

// Part of uniform light that the Lambertian lobe and multiple scattering reflect.
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

// Direction, falloff and inverse distance of a point light or a directional one.
fn incident(k: Light, position: vec3<f32>) -> Towards {
    if k.kind == LIGHT_POINT {
        return towards(k.a.xyz, position);
    }
    return Towards(k.a.xyz, 1.0, 0.0);
}

// Radiance reflected towards `wo`. Lights from all around share the albedos: what arrives for each lobe is summed first.
// Long functions are called in one place, here and in the adjoint: compilers put them in line.
fn shade(s: Surface, compensated: bool, position: vec3<f32>, n: vec3<f32>, wo: vec3<f32>) -> vec3<f32> {
    let l = lobes(s);
    let c = compensation(compensated, l, dot(n, wo));
    var sum = vec3<f32>(0.0);
    for (var i = 0u; i < params.lights.punctual; i++) {
        let k = params.lights.sources[i];
        let to = incident(k, position);
        sum += eval_lobes(l, c, n, wo, to.wi) * k.b.xyz * to.falloff;
    }
    var diffuse = params.lights.ambient.xyz;
    var specular = diffuse;
    for (var i = params.lights.punctual; i < params.lights.count; i++) {
        let k = params.lights.sources[i];
        let axis = yaw_invert(k.a, lobe_axis(n, wo, l.roughness));
        diffuse += environment_diffuse(k.map, yaw_invert(k.a, n)) * k.a.z;
        specular += environment_specular(k.map, axis, l.roughness) * k.a.z;
    }
    let split = viewer_split_sum(l, c, n, wo).value;
    return sum + broad_part(l, c) * diffuse + (l.f0 * split.x + vec3<f32>(split.y)) * specular;
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

fn punctual_vjp(
    k: Light,
    l: Lobes,
    c: Compensation,
    position: vec3<f32>,
    n: vec3<f32>,
    wo: vec3<f32>,
    g: vec3<f32>,
    sum: ptr<function, LightSum>,
) {
    let to = incident(k, position);
    let g_f = g * k.b.xyz;
    let e = eval_lobes_vjp(l, c, n, wo, to.wi, g_f * to.falloff);
    (*sum).lobes.diffuse += e.d.lobes.diffuse;
    (*sum).lobes.f0 += e.d.lobes.f0;
    (*sum).lobes.roughness += e.d.lobes.roughness;
    (*sum).n += e.d.n;
    (*sum).wo += e.d.wo;
    // wi = v / |v| and falloff = 1 / |v|^2 with v = at - position; the inverse distance of a directional light is 0.
    let g_wi = e.d.wi - to.wi * dot(to.wi, e.d.wi);
    let g_falloff = dot(g_f, e.value) * to.falloff;
    (*sum).position += (to.wi * (g_falloff + g_falloff) - g_wi) * to.inverse;
}

// Adjoint of the light from all around for the gradient `g` of the radiance.
fn surroundings_vjp(
    l: Lobes,
    c: Compensation,
    n: vec3<f32>,
    wo: vec3<f32>,
    g: vec3<f32>,
    sum: ptr<function, LightSum>,
) {
    let r = l.roughness;
    let t = r * r;
    let cosine = dot(n, wo);
    let split = viewer_split_sum(l, c, n, wo);
    let g_diffuse = g * broad_part(l, c);
    let g_specular = g * (l.f0 * split.value.x + vec3<f32>(split.value.y));
    var diffuse = params.lights.ambient.xyz;
    var specular = diffuse;
    // Gradient of the lobe's axis.
    var g_axis = vec3<f32>(0.0);
    for (var i = params.lights.punctual; i < params.lights.count; i++) {
        let k = params.lights.sources[i];
        let d = environment_diffuse_vjp(k.map, yaw_invert(k.a, n), g_diffuse * k.a.z);
        let s = environment_specular_vjp(k.map, yaw_invert(k.a, lobe_axis(n, wo, r)), r, g_specular * k.a.z);
        diffuse += d.value * k.a.z;
        specular += s.value * k.a.z;
        g_axis += yaw_apply(k.a, s.direction);
        (*sum).n += yaw_apply(k.a, d.direction);
        (*sum).lobes.roughness += s.roughness;
    }
    let g_albedo = g * specular;
    let g_split = vec2<f32>(dot(g_albedo, l.f0), sum3(g_albedo));
    // axis = k n - (1 - t) wo, k = 2 (1 - t)(n.wo) + t, t = r^2
    let g_k = dot(g_axis, n);
    let g_t = g_k * (1.0 - 2.0 * cosine) + dot(g_axis, wo);
    var g_cosine = dot(g_split, split.d_cosine) + g_k * 2.0 * (1.0 - t);
    g_cosine += broad_part_vjp(l, c, g * diffuse, sum);
    (*sum).lobes.f0 += g_albedo * split.value.x;
    (*sum).lobes.roughness += dot(g_split, split.d_roughness) + 2.0 * r * g_t;
    (*sum).n += g_axis * (2.0 * (1.0 - t) * cosine + t) + wo * g_cosine;
    (*sum).wo += n * g_cosine - g_axis * (1.0 - t);
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
    for (var i = 0u; i < params.lights.punctual; i++) {
        punctual_vjp(params.lights.sources[i], l, c, position, n, wo, g, &sum);
    }
    surroundings_vjp(l, c, n, wo, g, &sum);
    return ShadeGradient(lobes_vjp(s, sum.lobes), sum.position, sum.n, sum.wo);
}
