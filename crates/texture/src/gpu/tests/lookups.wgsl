// Lookups of many places, for tests.

struct Params {
    maps: MipTable,
    count: u32,
    wrap_u: u32,
    wrap_v: u32,
    filtering: u32,
    bias: f32,
    pad_a: u32,
    pad_b: u32,
    pad_c: u32,
}

// uv and the derivatives of u and v by X and Y.
struct Place {
    uv: vec2<f32>,
    du: vec2<f32>,
    dv: vec2<f32>,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> texels: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> places: array<Place>;
// Values forward, their gradients in reverse.
@group(0) @binding(3) var<storage, read_write> values: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> derivatives: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> sums: array<FixedSum>;

fn plan(i: u32) -> Lookup {
    let base = mip_level(0u);
    let place = places[i];
    let lod =
        level_of_detail(place.du, place.dv, base.width, base.height, params.bias, params.maps.count - 1u);
    return lookup(place.uv, lod, MapSampler(params.wrap_u, params.wrap_v, params.filtering));
}

@compute @workgroup_size(64)
fn forward(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane, 64u);
    if i < params.count {
        let t = sample_maps(plan(i));
        values[4u * i] = t[0];
        values[4u * i + 1u] = t[1];
        values[4u * i + 2u] = t[2];
        values[4u * i + 3u] = t[3];
    }
}

@compute @workgroup_size(64)
fn reverse(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane, 64u);
    keep_no_taps(lane);
    if i < params.count {
        let g = Texel(values[4u * i], values[4u * i + 1u], values[4u * i + 2u], values[4u * i + 3u]);
        let at = plan(i);
        derivatives[i] = vec4<f32>(sample_vjp(at, g), 0.0);
        keep_taps(lane, at, g);
    }
    workgroupBarrier();
    scatter_lanes(lane);
}
