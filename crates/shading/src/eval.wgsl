// BSDF times cosine for one pair of directions: twin of `eval.rs`.

// What compensation needs of a material and a viewer; used where `on`.
struct Compensation {
    on: bool,
    albedo: SpecularAlbedo,
    viewer: SplitSum,
}

fn compensation(on: bool, l: Lobes, nv: f32) -> Compensation {
    var c: Compensation;
    c.on = on;
    if on {
        c.albedo = specular_albedo(l);
        c.viewer = split_sum(nv, l.roughness);
    }
    return c;
}

fn eval_lobes(l: Lobes, c: Compensation, n: vec3<f32>, wo: vec3<f32>, wi: vec3<f32>) -> vec3<f32> {
    let nl = dot(n, wi);
    if !(nl > 0.0) {
        return vec3<f32>(0.0);
    }
    var wide = l.diffuse * FRAC_1_PI;
    if c.on {
        wide = broad(c.albedo, l.diffuse, c.viewer, split_sum(nl, l.roughness));
    }
    return wide * nl + specular(terms(l.roughness, n, wo, nl, half_vector(n, wo, wi)), l);
}

struct EvalValueGradient {
    value: vec3<f32>,
    d: LobesEvalGradient,
}

// Value and adjoint of `eval_lobes` for the gradient `g` of the value.
fn eval_lobes_vjp(
    l: Lobes,
    c: Compensation,
    n: vec3<f32>,
    wo: vec3<f32>,
    wi: vec3<f32>,
    g: vec3<f32>,
) -> EvalValueGradient {
    var out: EvalValueGradient;
    let nl = dot(n, wi);
    if !(nl > 0.0) {
        return out;
    }
    // Value and gradients of the Lambertian lobe, or of that and multiple scattering.
    var wide = l.diffuse * FRAC_1_PI;
    var g_nl = dot(g, wide);
    var g_cosine = 0.0;
    var more = Lobes(g * (nl * FRAC_1_PI), vec3<f32>(0.0), 0.0);
    if c.on {
        let light = split_sum(nl, l.roughness);
        wide = broad(c.albedo, l.diffuse, c.viewer, light);
        let b = broad_vjp(c.albedo, l.diffuse, c.viewer, light, g * nl);
        g_nl = dot(g, wide) + b.cosines.y;
        g_cosine = b.cosines.x;
        more = b.lobes;
    }
    let half = half_vector(n, wo, wi);
    let t = terms(l.roughness, n, wo, nl, half);
    out.value = wide * nl + specular(t, l);
    out.d = specular_vjp(t, l, n, wo, wi, half, g, g_nl);
    out.d.lobes.diffuse += more.diffuse;
    out.d.lobes.f0 += more.f0;
    out.d.lobes.roughness += more.roughness;
    out.d.n += wo * g_cosine;
    out.d.wo += n * g_cosine;
    return out;
}
