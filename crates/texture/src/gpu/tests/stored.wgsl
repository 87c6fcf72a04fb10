// Lookups of many places of one texture, for tests.

struct Params {
    texture: u32,
    levels: u32,
    sampler_bits: u32,
    count: u32,
}

// uv and the derivatives of u and v by X and Y.
struct Place {
    uv: vec2<f32>,
    du: vec2<f32>,
    dv: vec2<f32>,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> stored: array<u32>;
@group(0) @binding(2) var<storage, read> places: array<Place>;
@group(0) @binding(3) var<storage, read_write> values: array<vec4<f32>>;

@compute @workgroup_size(64)
fn read_places(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane, 64u);
    if i >= params.count {
        return;
    }
    let place = places[i];
    let base = stored_level(params.texture, 0u);
    let lod = level_of_detail(place.du, place.dv, base.width, base.height, 0.3, params.levels - 1u);
    let how = stored_sampler(params.sampler_bits);
    values[i] = stored_read(params.texture, stored_lookup(params.texture, params.levels, place.uv, lod, how));
}
