// What a triangle covers, and how deep: edge functions about each pixel centre by itself, so that small triangles far
// from the origin of the picture lose nothing.
//
// The edge that two triangles share must give them exactly negated values in whatever kernel they are drawn: its ends are
// taken in an order that depends on their positions alone, and every sum of products is written with `fma`, which leaves a
// compiler nothing to contract.

struct Triangle {
    // x width, y height, w of each corner.
    p: array<vec3<f32>, 3>,
    // z of each corner.
    z: vec3<f32>,
}

const NOTHING: f32 = 2.0;

fn load_triangle(t: u32) -> Triangle {
    var out: Triangle;
    let size = vec2<f32>(f32(params.width), f32(params.height));
    for (var k = 0u; k < 3u; k++) {
        let c = clip[triangles[3u * t + k]];
        out.p[k] = vec3<f32>(c.xy * size, c.w);
        out.z[k] = c.z;
    }
    return out;
}

// Place of a pixel centre in units in which a pixel is 2 wide and the origin is the picture's centre: exact.
fn centre(x: u32, y: u32) -> vec2<f32> {
    let right = 2 * i32(x) + 1 - i32(params.width);
    let up = i32(params.height) - 1 - 2 * i32(y);
    return vec2<f32>(f32(right), f32(up));
}

fn before(a: vec3<f32>, b: vec3<f32>) -> bool {
    if a.x != b.x {
        return a.x < b.x;
    }
    if a.y != b.y {
        return a.y < b.y;
    }
    return a.z < b.z;
}

// Twice the signed area between a pixel centre and an edge, in homogeneous units: the weight of the corner opposite to it.
fn edge(s: vec3<f32>, t: vec3<f32>, n: vec2<f32>) -> f32 {
    let swapped = before(t, s);
    let a = select(s, t, swapped);
    let b = select(t, s, swapped);
    let qa = vec2<f32>(fma(-n.x, a.z, a.x), fma(-n.y, a.z, a.y));
    let qb = vec2<f32>(fma(-n.x, b.z, b.x), fma(-n.y, b.z, b.y));
    let e = fma(qa.x, qb.y, -(qa.y * qb.x));
    return select(e, -e, swapped);
}

// Whether a point exactly on an edge belongs to the triangle on the edge's side of the given sign: a left or upper edge.
fn owns(s: vec3<f32>, t: vec3<f32>, sign: f32) -> bool {
    let swapped = before(t, s);
    let a = select(s, t, swapped);
    let b = select(t, s, swapped);
    // Change of the edge function to the right, and downwards.
    let right = fma(a.y, b.z, -(a.z * b.y));
    let down = fma(a.x, b.z, -(a.z * b.x));
    let turned = select(sign, -sign, swapped);
    if right != 0.0 {
        return right * turned > 0.0;
    }
    if down != 0.0 {
        return down * turned > 0.0;
    }
    return turned > 0.0;
}

// Whether the backs of a triangle with these flags are not drawn.
fn shows_front_only(flags: u32) -> bool {
    return params.backs == 0u && (flags & 4u) == 0u;
}

// z/w in [0, 1] where a triangle covers a pixel centre, else `NOTHING`.
fn cover(t: Triangle, n: vec2<f32>, front_only: bool) -> f32 {
    let e = vec3<f32>(edge(t.p[1], t.p[2], n), edge(t.p[2], t.p[0], n), edge(t.p[0], t.p[1], n));
    let s = fma(e.x, t.p[0].z, fma(e.y, t.p[1].z, e.z * t.p[2].z));
    let size = abs(s);
    if !(size > 0.0 && size < 3e38) || (front_only && s < 0.0) {
        return NOTHING;
    }
    let sign = select(-1.0, 1.0, s > 0.0);
    let inside = e * sign;
    if !all(inside >= vec3<f32>(0.0)) {
        return NOTHING;
    }
    if any(inside == vec3<f32>(0.0)) {
        let x = inside.x > 0.0 || owns(t.p[1], t.p[2], sign);
        let y = inside.y > 0.0 || owns(t.p[2], t.p[0], sign);
        let z = inside.z > 0.0 || owns(t.p[0], t.p[1], sign);
        if !(x && y && z) {
            return NOTHING;
        }
    }
    let z = fma(inside.x, t.z.x, fma(inside.y, t.z.y, inside.z * t.z.z)) / size;
    return select(NOTHING, z, z >= 0.0 && z <= 1.0);
}
