// Compensation of lost energy: twin of `energy.rs` for lobes with `f90 = 1` that are no mirrors. The averages follow the
// split-sum table in `shading_tables`, as pairs of an entry and the next.

const AVERAGES_FIRST: u32 = SPLIT_SUM_COSINES * SPLIT_SUM_ROUGHNESSES;
const AVERAGE_ROUGHNESSES: u32 = 64u;
const LOST_MIN: f32 = 1e-5;
const F0_SHARE: f32 = 20.0 / 21.0;

struct SpecularAlbedo {
    f0: vec3<f32>,
    roughness: f32,
    // Fm.
    multiple: vec3<f32>,
    // 1 - Ea.
    lost: f32,
    // Average of the whole albedo.
    average: vec3<f32>,
}

struct Averages {
    value: vec2<f32>,
    d_roughness: vec2<f32>,
}

fn averages(roughness: f32) -> Averages {
    let slope = f32(AVERAGE_ROUGHNESSES - 1u);
    let x = min(relu(roughness), 1.0) * slope;
    let i = min(u32(x), AVERAGE_ROUGHNESSES - 2u);
    let entry = shading_tables[AVERAGES_FIRST + i];
    let rise = entry.zw - entry.xy;
    return Averages(entry.xy + rise * (x - f32(i)), rise * slope);
}

fn average_fresnel(f0: vec3<f32>) -> vec3<f32> {
    return f0 * F0_SHARE + vec3<f32>(1.0 - F0_SHARE);
}

fn specular_albedo(l: Lobes) -> SpecularAlbedo {
    let a = averages(l.roughness).value;
    let whole = a.x + a.y;
    let lost = 1.0 - whole;
    let f = average_fresnel(l.f0);
    let multiple = f * f * whole / (vec3<f32>(1.0) - f * lost);
    let average = l.f0 * a.x + vec3<f32>(a.y) + multiple * lost;
    return SpecularAlbedo(l.f0, l.roughness, multiple, lost, average);
}

// Whole albedo towards a direction of this scale and bias, and in w the part that single scattering loses.
fn albedo_of(a: SpecularAlbedo, s: SplitSum) -> vec4<f32> {
    let lost = relu(1.0 - s.value.x - s.value.y);
    return vec4<f32>(a.f0 * s.value.x + vec3<f32>(s.value.y) + a.multiple * lost, lost);
}

fn relu3(v: vec3<f32>) -> vec3<f32> {
    return select(vec3<f32>(0.0), v, v > vec3<f32>(0.0));
}

// Value without cosine of the Lambertian lobe and of multiple scattering.
fn broad(a: SpecularAlbedo, diffuse: vec3<f32>, viewer: SplitSum, light: SplitSum) -> vec3<f32> {
    let o = albedo_of(a, viewer);
    let i = albedo_of(a, light);
    let rest = vec3<f32>(1.0) - a.average;
    let enough = rest > vec3<f32>(LOST_MIN);
    let guarded = select(vec3<f32>(1.0), rest, enough);
    let ratio = relu3(vec3<f32>(1.0) - o.xyz) * relu3(vec3<f32>(1.0) - i.xyz) / guarded;
    var out = diffuse * select(vec3<f32>(0.0), ratio, enough) * FRAC_1_PI;
    if a.lost > LOST_MIN {
        out += a.multiple * (o.w * i.w * FRAC_1_PI / a.lost);
    }
    return out;
}

// Integral of `broad` times the cosine of the light.
fn broad_albedo(a: SpecularAlbedo, diffuse: vec3<f32>, viewer: SplitSum) -> vec3<f32> {
    let e = albedo_of(a, viewer);
    return diffuse * relu3(vec3<f32>(1.0) - e.xyz) + select(vec3<f32>(0.0), a.multiple * e.w, a.lost > LOST_MIN);
}

// Gradients of what `SpecularAlbedo` holds.
struct AlbedoGradient {
    f0: vec3<f32>,
    roughness: f32,
    multiple: vec3<f32>,
    lost: f32,
    average: vec3<f32>,
}

struct BroadGradient {
    lobes: Lobes,
    // Of the cosines of the viewer and of the light.
    cosines: vec2<f32>,
}

// Adjoint of `albedo_of` for the gradients of both results: the gradient of the cosine.
fn albedo_of_vjp(
    a: SpecularAlbedo,
    s: SplitSum,
    lost: f32,
    g_e: vec3<f32>,
    g_rest: f32,
    sum: ptr<function, AlbedoGradient>,
) -> f32 {
    (*sum).f0 += g_e * s.value.x;
    (*sum).multiple += g_e * lost;
    let g_lost = select(0.0, g_rest + dot(g_e, a.multiple), lost > 0.0);
    let g_value = vec2<f32>(dot(g_e, a.f0), sum3(g_e)) - vec2<f32>(g_lost);
    (*sum).roughness += dot(g_value, s.d_roughness);
    return dot(g_value, s.d_cosine);
}

// Adjoint of `specular_albedo`, and the rest of the gradient beside it.
fn albedo_vjp(a: SpecularAlbedo, diffuse: vec3<f32>, sum: AlbedoGradient, cosines: vec2<f32>) -> BroadGradient {
    let averaged = averages(a.roughness);
    let whole = averaged.value.x + averaged.value.y;
    var f0 = sum.f0 + sum.average * averaged.value.x;
    var g_value = vec2<f32>(dot(sum.average, a.f0), sum3(sum.average));
    let g_multiple = sum.multiple + sum.average * a.lost;
    // multiple = f^2 whole / (1 - f lost), f = f0 20/21 + 1/21
    let f = average_fresnel(a.f0);
    let inv = 1.0 / (vec3<f32>(1.0) - f * a.lost);
    let g_f = g_multiple * f * whole * (vec3<f32>(2.0) - f * a.lost) * inv * inv;
    f0 += g_f * F0_SHARE;
    let g_whole = dot(g_multiple, f * f * inv);
    let g_lost = sum.lost + dot(sum.average, a.multiple) + dot(g_multiple, f * f * f * whole * inv * inv);
    // lost = 1 - whole, whole = scale + bias
    g_value += vec2<f32>(g_whole - g_lost);
    let roughness = sum.roughness + dot(g_value, averaged.d_roughness);
    return BroadGradient(Lobes(diffuse, f0, roughness), cosines);
}

fn broad_vjp(
    a: SpecularAlbedo,
    diffuse: vec3<f32>,
    viewer: SplitSum,
    light: SplitSum,
    g: vec3<f32>,
) -> BroadGradient {
    let zero = vec3<f32>(0.0);
    let one = vec3<f32>(1.0);
    let e_o = albedo_of(a, viewer);
    let e_i = albedo_of(a, light);
    let rest = one - a.average;
    let enough = rest > vec3<f32>(LOST_MIN);
    let guarded = select(one, rest, enough);
    let o = relu3(one - e_o.xyz);
    let i = relu3(one - e_i.xyz);
    let below = select(zero, o * i / guarded, enough);
    let g_diffuse = g * below * FRAC_1_PI;
    let g_below = select(zero, g * diffuse * FRAC_1_PI / guarded, enough);
    let g_o = select(zero, -g_below * i, e_o.xyz < one);
    let g_i = select(zero, -g_below * o, e_i.xyz < one);
    var sum = AlbedoGradient(zero, 0.0, zero, 0.0, g_below * below);
    var g_lost_o = 0.0;
    var g_lost_i = 0.0;
    if a.lost > LOST_MIN {
        let each = FRAC_1_PI / a.lost;
        sum.multiple = g * (e_o.w * e_i.w * each);
        let by_multiple = dot(g, a.multiple) * each;
        g_lost_o = by_multiple * e_i.w;
        g_lost_i = by_multiple * e_o.w;
        sum.lost = -by_multiple * e_o.w * e_i.w / a.lost;
    }
    let cosine_o = albedo_of_vjp(a, viewer, e_o.w, g_o, g_lost_o, &sum);
    let cosine_i = albedo_of_vjp(a, light, e_i.w, g_i, g_lost_i, &sum);
    return albedo_vjp(a, g_diffuse, sum, vec2<f32>(cosine_o, cosine_i));
}

fn broad_albedo_vjp(a: SpecularAlbedo, diffuse: vec3<f32>, viewer: SplitSum, g: vec3<f32>) -> BroadGradient {
    let zero = vec3<f32>(0.0);
    let one = vec3<f32>(1.0);
    let e = albedo_of(a, viewer);
    let g_e = select(-g * diffuse, zero, e.xyz >= one);
    var sum = AlbedoGradient(zero, 0.0, zero, 0.0, zero);
    var g_lost = 0.0;
    if a.lost > LOST_MIN {
        sum.multiple = g * e.w;
        g_lost = dot(g, a.multiple);
    }
    let cosine = albedo_of_vjp(a, viewer, e.w, g_e, g_lost, &sum);
    return albedo_vjp(a, g * relu3(one - e.xyz), sum, vec2<f32>(cosine, 0.0));
}
