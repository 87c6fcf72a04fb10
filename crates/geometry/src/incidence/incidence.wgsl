// Gather lists of a topology: twin of Incidence. One buffer of words holds them all; `params` says where each begins. A
// list of rows begins with the offsets of its rows, one more than rows, and its entries follow.

struct Params {
    vertices: u32,
    welds: u32,
    triangles: u32,
    // Welded id of each vertex.
    ids: u32,
    // Corners at each vertex.
    vertex_corners: u32,
    // Corners at each welded id.
    weld_corners: u32,
    // Vertices of each welded id.
    members: u32,
    unused: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
// The vertices of each triangle, and the lists.
@group(0) @binding(1) var<storage, read> topology: array<u32>;

fn triangle(t: u32) -> vec3<u32> {
    return vec3<u32>(topology[3u * t], topology[3u * t + 1u], topology[3u * t + 2u]);
}

fn weld_of(vertex: u32) -> u32 {
    return topology[params.ids + vertex];
}

// First and end of row `i` of the list at `list` of so many rows.
fn row(list: u32, rows: u32, i: u32) -> vec2<u32> {
    return vec2<u32>(topology[list + i], topology[list + i + 1u]) + vec2<u32>(list + rows + 1u);
}

fn corners_of_vertex(v: u32) -> vec2<u32> {
    return row(params.vertex_corners, params.vertices, v);
}

fn corners_of_weld(w: u32) -> vec2<u32> {
    return row(params.weld_corners, params.welds, w);
}

fn members_of(w: u32) -> vec2<u32> {
    return row(params.members, params.welds, w);
}
