// Material of a surface point and its lobes: twin of `surface.rs`, with `f90 = 1`.

const DIELECTRIC_F0: f32 = 0.04;

struct Surface {
    base_color: vec3<f32>,
    roughness: f32,
    metallic: f32,
    gamma: f32,
}

struct Lobes {
    diffuse: vec3<f32>,
    f0: vec3<f32>,
    roughness: f32,
}

fn lobes(s: Surface) -> Lobes {
    let dielectric = vec3<f32>(DIELECTRIC_F0 * (1.0 - s.metallic));
    let f0 = (dielectric + s.base_color * s.metallic) * (1.0 - s.gamma);
    return Lobes(s.base_color * (1.0 - s.metallic), f0, select(ROUGHNESS_MIN, s.roughness, s.roughness > ROUGHNESS_MIN));
}

// Adjoint of `lobes`: the gradient of the surface from that of its lobes.
fn lobes_vjp(s: Surface, g: Lobes) -> Surface {
    let m = s.metallic;
    let keep = 1.0 - s.gamma;
    let f0 = vec3<f32>(DIELECTRIC_F0 * (1.0 - m)) + s.base_color * m;
    let d_metal = s.base_color - vec3<f32>(DIELECTRIC_F0);
    return Surface(
        g.diffuse * (1.0 - m) + g.f0 * (m * keep),
        select(0.0, g.roughness, s.roughness >= ROUGHNESS_MIN),
        dot(g.f0, d_metal) * keep - dot(g.diffuse, s.base_color),
        -dot(g.f0, f0),
    );
}
