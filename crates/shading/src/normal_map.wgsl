// Shading normals: twin of `normal_map.rs`.

const BEND_START: f32 = 0.05;

fn perturb(normal: vec3<f32>, tangent: vec3<f32>, handedness: f32, map: vec3<f32>) -> vec3<f32> {
    let bitangent = cross(normal, tangent) * handedness;
    return normalize_or_zero(tangent * map.x + bitangent * map.y + normal * relu(map.z));
}

struct PerturbGradient {
    normal: vec3<f32>,
    tangent: vec3<f32>,
    map: vec3<f32>,
}

fn perturb_vjp(
    normal: vec3<f32>,
    tangent: vec3<f32>,
    handedness: f32,
    map: vec3<f32>,
    g_unit: vec3<f32>,
) -> PerturbGradient {
    let bitangent = cross(normal, tangent) * handedness;
    let z = relu(map.z);
    let g = normalize_vjp(tangent * map.x + bitangent * map.y + normal * z, g_unit);
    let g_cross = g * (map.y * handedness);
    return PerturbGradient(
        g * z + cross(tangent, g_cross),
        g * map.x + cross(g_cross, normal),
        vec3<f32>(dot(g, tangent), dot(g, bitangent), select(0.0, dot(g, normal), map.z > 0.0)),
    );
}

// How much of `wo` is added for the cosine `d`, and its derivative.
fn bend(d: f32) -> vec2<f32> {
    let r = BEND_START / (BEND_START + BEND_START - d);
    return vec2<f32>(BEND_START * r - d, r * r - 1.0);
}

fn face_viewer(normal: vec3<f32>, n_geometric: vec3<f32>, wo: vec3<f32>) -> vec3<f32> {
    let n = select(normal, -normal, dot(n_geometric, wo) < 0.0);
    let d = dot(n, wo);
    if d >= BEND_START {
        return n;
    }
    return normalize_or_zero(n + wo * bend(d).x);
}

struct FaceViewerGradient {
    normal: vec3<f32>,
    wo: vec3<f32>,
}

fn face_viewer_vjp(normal: vec3<f32>, n_geometric: vec3<f32>, wo: vec3<f32>, g: vec3<f32>) -> FaceViewerGradient {
    let flipped = dot(n_geometric, wo) < 0.0;
    let n = select(normal, -normal, flipped);
    let d = dot(n, wo);
    var out = FaceViewerGradient(g, vec3<f32>(0.0));
    if !(d >= BEND_START) {
        let add = bend(d);
        let g_bent = normalize_vjp(n + wo * add.x, g);
        let g_d = dot(g_bent, wo) * add.y;
        out = FaceViewerGradient(g_bent + wo * g_d, g_bent * add.x + n * g_d);
    }
    out.normal = select(out.normal, -out.normal, flipped);
    return out;
}
