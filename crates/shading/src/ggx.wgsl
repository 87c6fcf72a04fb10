// The GGX lobe for one pair of directions: twin of `ggx.rs`, which has the formulas.

const ROUGHNESS_MIN: f32 = 0.03;
const COSINE_MIN: f32 = 1e-4;
const HALF_EPSILON: f32 = 1e-10;
const FRAC_1_PI: f32 = 0.31830988618;

// Unnormalised half vector, and its cross product with the normal.
struct Half {
    h: vec3<f32>,
    c: vec3<f32>,
}

struct Terms {
    nl: f32,
    nv: f32,
    nv_free: bool,
    nh: f32,
    a2: f32,
    inv_s: f32,
    inv_q: f32,
    lo: f32,
    li: f32,
    inv_lo: f32,
    inv_li: f32,
    inv_den: f32,
    vh: f32,
    // (1 - vh)^4 and (1 - vh)^5.
    m4: f32,
    p: f32,
    // D V.
    k: f32,
}

// Gradient with respect to the lobes, the normal and the directions.
struct LobesEvalGradient {
    lobes: Lobes,
    n: vec3<f32>,
    wo: vec3<f32>,
    wi: vec3<f32>,
}

fn half_vector(n: vec3<f32>, wo: vec3<f32>, wi: vec3<f32>) -> Half {
    let h = wo + wi;
    return Half(h, cross(n, h));
}

fn terms(roughness: f32, n: vec3<f32>, wo: vec3<f32>, nl: f32, half: Half) -> Terms {
    let nh = dot(n, half.h);
    let alpha = roughness * roughness;
    let a2 = alpha * alpha;
    let s = dot(half.h, half.h) + HALF_EPSILON;
    let inv_s = 1.0 / s;
    let inv_q = 1.0 / (dot(half.c, half.c) + a2 * (nh * nh + HALF_EPSILON));
    let cosine = dot(n, wo);
    let nv_free = cosine > COSINE_MIN;
    let nv = select(COSINE_MIN, cosine, nv_free);
    let lo = sqrt(nv * nv * (1.0 - a2) + a2);
    let li = sqrt(nl * nl * (1.0 - a2) + a2);
    let inv_den = 1.0 / (nl * lo + nv * li);
    let vh = 0.5 * sqrt(s);
    let m = 1.0 - vh;
    let m4 = (m * m) * (m * m);
    let ratio = s * inv_q;
    let k = a2 * ratio * ratio * inv_den * (0.5 * FRAC_1_PI);
    return Terms(nl, nv, nv_free, nh, a2, inv_s, inv_q, lo, li, 1.0 / lo, 1.0 / li, inv_den, vh, m4, m4 * m, k);
}

fn fresnel(t: Terms, lobes: Lobes) -> vec3<f32> {
    return lobes.f0 * (1.0 - t.p) + vec3<f32>(t.p);
}

// F D V n.wi
fn specular(t: Terms, lobes: Lobes) -> vec3<f32> {
    return fresnel(t, lobes) * (t.k * t.nl);
}

// Adjoint of `specular` for its gradient `g`; `g_more` is what other terms add to the gradient of n.wi.
fn specular_vjp(
    t: Terms,
    lobes: Lobes,
    n: vec3<f32>,
    wo: vec3<f32>,
    wi: vec3<f32>,
    half: Half,
    g: vec3<f32>,
    g_more: f32,
) -> LobesEvalGradient {
    let f = fresnel(t, lobes);
    let spec = t.k * t.nl;
    let g_f = dot(g, f);
    let g_k = g_f * spec;
    let g_p = spec * (sum3(g) - dot(g, lobes.f0));
    let g_vh = -5.0 * g_p * t.m4;
    let g_s = 2.0 * g_k * t.inv_s + g_vh * 0.125 / t.vh;
    let g_q = -2.0 * g_k * t.inv_q;
    let g_den = g_k * t.inv_den;
    let keep = 1.0 - t.a2;
    let g_nl = g_more + g_f * t.k - g_den * (t.lo + t.nv * t.nl * keep * t.inv_li);
    let g_nv = select(0.0, -g_den * (t.li + t.nl * t.nv * keep * t.inv_lo), t.nv_free);
    let d_den_a2 = 0.5 * (t.nl * (1.0 - t.nv * t.nv) * t.inv_lo + t.nv * (1.0 - t.nl * t.nl) * t.inv_li);
    let g_a2 = g_k / t.a2 + g_q * (t.nh * t.nh + HALF_EPSILON) - g_den * d_den_a2;

    // q = |n x h|^2 + a2 (n.h)^2, s = h.h
    let scale = 2.0 * g_q;
    let along = t.a2 * t.nh;
    let g_n = (cross(half.h, half.c) + half.h * along) * scale + wi * g_nl + wo * g_nv;
    let g_h = (cross(half.c, n) + n * along) * scale + half.h * (2.0 * g_s);
    let r = lobes.roughness;
    let g_lobes = Lobes(vec3<f32>(0.0), g * (spec * (1.0 - t.p)), 4.0 * r * r * r * g_a2);
    return LobesEvalGradient(g_lobes, g_n, g_h + n * g_nv, g_h + n * g_nl);
}
