// Lookups on one or two levels: twin of `lookup.rs`.

struct Lookup {
    level: u32,
    fine: Taps,
    coarse: Taps,
    // Share of the coarse level in (0, 1]; 0: the fine one alone.
    share: f32,
}

// Plans the lookup at `uv` with the level of detail `lod`.
fn lookup(uv: vec2<f32>, lod: f32, how: MapSampler) -> Lookup {
    let chosen = choose_level(lod, params.maps.count, how.filtering);
    let fine = taps(uv, mip_level(chosen.level), how);
    if chosen.share > 0.0 {
        return Lookup(chosen.level, fine, taps(uv, mip_level(chosen.level + 1u), how), chosen.share);
    }
    return Lookup(chosen.level, fine, fine, 0.0);
}

fn sample_maps(at: Lookup) -> Texel {
    let near = read_taps(at.fine);
    if at.share > 0.0 {
        return near + (read_taps(at.coarse) - near) * at.share;
    }
    return near;
}

// Adjoint of `sample_maps` with respect to uv and the level: (d/du, d/dv, d/dlevel).
fn sample_vjp(at: Lookup, g: Texel) -> vec3<f32> {
    let uv = taps_uv_vjp(at.fine, mip_level(at.level), g);
    if at.share > 0.0 {
        let level = texel_dot(g, read_taps(at.coarse) - read_taps(at.fine));
        let far = taps_uv_vjp(at.coarse, mip_level(at.level + 1u), g);
        return vec3<f32>(uv * (1.0 - at.share) + far * at.share, level);
    }
    return vec3<f32>(uv, 0.0);
}
