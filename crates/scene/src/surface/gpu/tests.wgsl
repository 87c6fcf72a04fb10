// One material at many points, for tests.

struct Params {
    material: u32,
    count: u32,
    pad_a: u32,
    pad_b: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> points: array<SurfacePoint>;
@group(0) @binding(2) var<storage, read> materials: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> stored: array<u32>;
// Four vectors of a point: base colour and alpha; roughness, metalness and whether it is unlit; normal; emission.
@group(0) @binding(4) var<storage, read_write> out: array<vec4<f32>>;

@compute @workgroup_size(64)
fn surfaces(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane, 64u);
    if i >= params.count {
        return;
    }
    let s = surface_at(params.material, points[i]);
    out[4u * i] = vec4<f32>(s.base_color, s.alpha);
    out[4u * i + 1u] = vec4<f32>(s.roughness, s.metallic, select(0.0, 1.0, s.unlit), 0.0);
    out[4u * i + 2u] = vec4<f32>(s.normal, 0.0);
    out[4u * i + 3u] = vec4<f32>(s.emissive, 0.0);
}
