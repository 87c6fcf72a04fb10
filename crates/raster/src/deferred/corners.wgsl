// What shading reads of a triangle, in one place: 13 vectors.
//     0..3    clip-space positions of the corners
//     3..6    positions and u
//     6..9    normals and v
//     9..12   tangents; in w the handedness, the cutoff of a mask, nothing
//     12      vertices, and what alpha means (0 opaque, 1 mask, 2 blend)

struct Params {
    triangles: u32,
    pad_a: u32,
    pad_b: u32,
    pad_c: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> triangles: array<u32>;
@group(0) @binding(2) var<storage, read> surfaces: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> clip: array<vec4<u32>>;
@group(0) @binding(4) var<storage, read> positions: array<u32>;
@group(0) @binding(5) var<storage, read> normals: array<u32>;
@group(0) @binding(6) var<storage, read> tangents: array<vec4<u32>>;
@group(0) @binding(7) var<storage, read> uvs: array<vec2<u32>>;
@group(0) @binding(8) var<storage, read_write> corners: array<vec4<u32>>;

@compute @workgroup_size(64)
fn load_corners(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let t = index(group, groups, lane, 64u);
    if t >= params.triangles {
        return;
    }
    let surface = surfaces[t];
    let out = 13u * t;
    for (var k = 0u; k < 3u; k++) {
        let i = triangles[3u * t + k];
        let uv = uvs[i];
        let tangent = tangents[i];
        var more = 0u;
        if k == 0u {
            more = tangent.w;
        } else if k == 1u {
            more = surface.y;
        }
        corners[out + k] = clip[i];
        corners[out + 3u + k] = vec4<u32>(positions[3u * i], positions[3u * i + 1u], positions[3u * i + 2u], uv.x);
        corners[out + 6u + k] = vec4<u32>(normals[3u * i], normals[3u * i + 1u], normals[3u * i + 2u], uv.y);
        corners[out + 9u + k] = vec4<u32>(tangent.xyz, more);
    }
    corners[out + 12u] =
        vec4<u32>(triangles[3u * t], triangles[3u * t + 1u], triangles[3u * t + 2u], surface.x & 3u);
}
