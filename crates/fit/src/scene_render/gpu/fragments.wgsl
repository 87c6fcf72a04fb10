// The samples of a layer of a scene with its own materials: twin of `fragments.rs`.

struct Params {
    lights: Lights,
    eye: vec3<f32>,
    // Vectors of a vertex.
    stride: u32,
    // 2 / width and 2 / height of the samples.
    grid: vec2<f32>,
    width: u32,
    height: u32,
    // Place of tangent, texture coordinates and colour among the vectors of a vertex; 0 where the scene has none.
    tangent: u32,
    uvs: u32,
    color: u32,
    pad: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> triangle: array<u32>;
@group(0) @binding(2) var<storage, read> triangles: array<u32>;
@group(0) @binding(3) var<storage, read> material_of: array<u32>;
@group(0) @binding(4) var<storage, read> clip: array<vec4<f32>>;
// For each vertex position with handedness, normal, then what the scene has of tangent, texture coordinates, colour.
@group(0) @binding(5) var<storage, read> vertices: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> materials: array<vec4<u32>>;
@group(0) @binding(7) var<storage, read> stored: array<u32>;
@group(0) @binding(8) var<storage, read> shading_tables: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> shaded: array<vec4<f32>>;

const NONE: u32 = 0xffffffffu;

// An attribute of the three corners, a column each; `id` are their first vectors.
fn corners(id: vec3<u32>, place: u32) -> mat3x4<f32> {
    return mat3x4<f32>(vertices[id.x + place], vertices[id.y + place], vertices[id.z + place]);
}

fn point(id: vec3<u32>, b: Barycentrics, w: vec3<f32>) -> SurfacePoint {
    var p = SurfacePoint(vec4<f32>(0.0), vec4<f32>(0.0), vec4<f32>(0.0), vec4<f32>(1.0));
    if params.uvs != 0u {
        let uv = corners(id, params.uvs);
        p.uv = uv * w;
        p.dx = (uv[0] - uv[2]) * b.du.x + (uv[1] - uv[2]) * b.dv.x;
        p.dy = (uv[0] - uv[2]) * b.du.y + (uv[1] - uv[2]) * b.dv.y;
    }
    if params.color != 0u {
        p.color = corners(id, params.color) * w;
    }
    return p;
}

// Radiance and alpha of a triangle at the normalized device coordinates `f`.
fn fragment(t: u32, f: vec2<f32>) -> vec4<f32> {
    let vertex = vec3<u32>(triangles[3u * t], triangles[3u * t + 1u], triangles[3u * t + 2u]);
    let b = barycentrics(mat3x4<f32>(clip[vertex.x], clip[vertex.y], clip[vertex.z]), f, params.grid);
    let w = vec3<f32>(b.u, b.v, 1.0 - b.u - b.v);
    let id = vertex * params.stride;
    let m = material_of[t];
    let s = surface_at(m, point(id, b, w));
    if s.unlit || s.alpha <= 0.0 {
        return vec4<f32>(s.base_color, s.alpha);
    }
    let positions = corners(id, 0u);
    let position = (positions * w).xyz;
    let interpolated = (corners(id, 1u) * w).xyz;
    var normal: vec3<f32>;
    if params.tangent != 0u && materials[m + 3u].z != NO_TEXTURE {
        let tangent = (corners(id, params.tangent) * w).xyz;
        normal = perturb(interpolated, tangent, positions[0].w, s.normal);
    } else {
        normal = normalize_or_zero(interpolated);
    }
    let geometric = cross(positions[1].xyz - positions[0].xyz, positions[2].xyz - positions[0].xyz);
    let wo = view_direction(params.eye, position);
    let n = face_viewer(normal, geometric, wo);
    let rgb = shade(Surface(s.base_color, s.roughness, s.metallic, 0.0), COMPENSATED, position, n, wo);
    return vec4<f32>(rgb + s.emissive, s.alpha);
}

// A workgroup takes squares of 8 x 8 samples, whose lanes follow a Z curve.
@compute @workgroup_size(64)
fn shade_fragments(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let columns = (params.width + 7u) / 8u;
    let squares = columns * ((params.height + 7u) / 8u);
    for (var k = index(group, groups, 0u, 1u); k < squares; k += groups.x * groups.y) {
        let at = vec2<u32>(k % columns, k / columns) * 8u + z_curve(lane);
        if at.x >= params.width || at.y >= params.height {
            continue;
        }
        let i = at.y * params.width + at.x;
        let t = triangle[i];
        if t != NONE {
            let place = vec2<f32>(at) + vec2<f32>(0.5);
            shaded[i] = fragment(t, vec2<f32>(place.x * params.grid.x - 1.0, 1.0 - place.y * params.grid.y));
        }
    }
}
