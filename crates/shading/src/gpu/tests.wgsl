// The functions on arrays of inputs, for tests.

struct Params {
    lights: Lights,
    count: u32,
    compensated: u32,
    pad_a: u32,
    pad_b: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> shading_tables: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> input: array<f32>;
@group(0) @binding(3) var<storage, read_write> output: array<f32>;

fn vector(i: u32) -> vec3<f32> {
    return vec3<f32>(input[i], input[i + 1u], input[i + 2u]);
}

fn store(i: u32, v: vec3<f32>) {
    output[i] = v.x;
    output[i + 1u] = v.y;
    output[i + 2u] = v.z;
}

// 18 numbers each: surface, position, n, wo, gradient of the radiance; and out: radiance, gradients in the same order.
@compute @workgroup_size(64)
fn radiance(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane, 64u);
    if i >= params.count {
        return;
    }
    let at = 18u * i;
    let s = Surface(vector(at), input[at + 3u], input[at + 4u], input[at + 5u]);
    let position = vector(at + 6u);
    let n = vector(at + 9u);
    let wo = vector(at + 12u);
    let compensated = params.compensated != 0u;
    store(at, shade(s, compensated, position, n, wo));
    let d = shade_vjp(s, compensated, position, n, wo, vector(at + 15u));
    store(at + 3u, d.surface.base_color);
    store(at + 6u, vec3<f32>(d.surface.roughness, d.surface.metallic, d.surface.gamma));
    store(at + 9u, d.position);
    store(at + 12u, d.n);
    store(at + 15u, d.wo);
}

// 22 numbers each: normal, tangent, map, geometric normal, eye, position, gradient, handedness; 27 out.
@compute @workgroup_size(64)
fn normals(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane, 64u);
    if i >= params.count {
        return;
    }
    let at = 22u * i;
    let normal = vector(at);
    let tangent = vector(at + 3u);
    let map = vector(at + 6u);
    let geometric = vector(at + 9u);
    let eye = vector(at + 12u);
    let position = vector(at + 15u);
    let g = vector(at + 18u);
    let handedness = input[at + 21u];
    let perturbed = perturb(normal, tangent, handedness, map);
    let wo = view_direction(eye, position);
    let p = perturb_vjp(normal, tangent, handedness, map, g);
    let f = face_viewer_vjp(perturbed, geometric, wo, g);
    let out = 27u * i;
    store(out, perturbed);
    store(out + 3u, face_viewer(perturbed, geometric, wo));
    store(out + 6u, wo);
    store(out + 9u, p.normal);
    store(out + 12u, p.tangent);
    store(out + 15u, p.map);
    store(out + 18u, f.normal);
    store(out + 21u, f.wo);
    store(out + 24u, view_direction_vjp(eye, position, g));
}
