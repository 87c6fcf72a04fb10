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
    let t = terms(l.roughness, n, wo, nl, half_vector(n, wo, wi));
    if c.on {
        return broad(c.albedo, l.diffuse, c.viewer, split_sum(nl, l.roughness)) * nl + specular(t, l);
    }
    return l.diffuse * (nl * FRAC_1_PI) + specular(t, l);
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
    let half = half_vector(n, wo, wi);
    let t = terms(l.roughness, n, wo, nl, half);
    if !c.on {
        out.value = l.diffuse * (nl * FRAC_1_PI) + specular(t, l);
        out.d = specular_vjp(t, l, n, wo, wi, half, g, dot(g, l.diffuse) * FRAC_1_PI);
        out.d.lobes.diffuse = g * (nl * FRAC_1_PI);
        return out;
    }
    let light = split_sum(nl, l.roughness);
    let wide = broad(c.albedo, l.diffuse, c.viewer, light);
    out.value = wide * nl + specular(t, l);
    let b = broad_vjp(c.albedo, l.diffuse, c.viewer, light, g * nl);
    out.d = specular_vjp(t, l, n, wo, wi, half, g, dot(g, wide) + b.cosines.y);
    out.d.lobes.diffuse += b.lobes.diffuse;
    out.d.lobes.f0 += b.lobes.f0;
    out.d.lobes.roughness += b.lobes.roughness;
    out.d.n += wo * b.cosines.x;
    out.d.wo += n * b.cosines.x;
    return out;
}
