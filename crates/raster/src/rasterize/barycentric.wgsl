// Perspective-correct barycentrics, their screen derivatives, and the adjoint: twin of `barycentric.rs`.

struct Barycentrics {
    u: f32,
    v: f32,
    // d(u)/d(X, Y) and d(v)/d(X, Y), per pixel.
    du: vec2<f32>,
    dv: vec2<f32>,
}

fn area(a: vec2<f32>, b: vec2<f32>) -> f32 {
    return a.x * b.y - b.x * a.y;
}

// Keeps a divisor away from zero.
fn guarded(a: f32) -> f32 {
    return select(select(1e-30, -1e-30, a < 0.0), a, abs(a) > 1e-30);
}

fn homogeneous(p: mat3x4<f32>, f: vec2<f32>) -> mat3x2<f32> {
    return mat3x2<f32>(p[0].xy - f * p[0].w, p[1].xy - f * p[1].w, p[2].xy - f * p[2].w);
}

fn areas(q: mat3x2<f32>) -> vec3<f32> {
    return vec3<f32>(area(q[1], q[2]), area(q[2], q[0]), area(q[0], q[1]));
}

// At the normalized device coordinates `f`; `grid` is 2 / width, 2 / height.
fn barycentrics(p: mat3x4<f32>, f: vec2<f32>, grid: vec2<f32>) -> Barycentrics {
    let a = areas(homogeneous(p, f));
    let r = 1.0 / guarded(a.x + a.y + a.z);
    let u = a.x * r;
    let v = a.y * r;
    let x = vec3<f32>(
        p[1].y * p[2].w - p[2].y * p[1].w,
        p[2].y * p[0].w - p[0].y * p[2].w,
        p[0].y * p[1].w - p[1].y * p[0].w,
    );
    let y = vec3<f32>(
        p[2].x * p[1].w - p[1].x * p[2].w,
        p[0].x * p[2].w - p[2].x * p[0].w,
        p[1].x * p[0].w - p[0].x * p[1].w,
    );
    let s = vec2<f32>(x.x + x.y + x.z, y.x + y.y + y.z);
    let k = vec2<f32>(grid.x * r, -grid.y * r);
    return Barycentrics(u, v, (vec2<f32>(x.x, y.x) - s * u) * k, (vec2<f32>(x.y, y.y) - s * v) * k);
}

// Adjoint of `u` and `v`: gradients of x, y and w of the three clip-space positions.
fn barycentrics_vjp(p: mat3x4<f32>, f: vec2<f32>, g_u: f32, g_v: f32) -> mat3x3<f32> {
    let q = homogeneous(p, f);
    let a = areas(q);
    let r = 1.0 / guarded(a.x + a.y + a.z);
    let s = (g_u * a.x + g_v * a.y) * r;
    let g = vec3<f32>(g_u - s, g_v - s, -s) * r;
    // The area number k is that of the two vectors after it.
    let g_0 = vec2<f32>(q[1].y, -q[1].x) * g.z + vec2<f32>(-q[2].y, q[2].x) * g.y;
    let g_1 = vec2<f32>(q[2].y, -q[2].x) * g.x + vec2<f32>(-q[0].y, q[0].x) * g.z;
    let g_2 = vec2<f32>(q[0].y, -q[0].x) * g.y + vec2<f32>(-q[1].y, q[1].x) * g.x;
    return mat3x3<f32>(
        vec3<f32>(g_0, -dot(f, g_0)),
        vec3<f32>(g_1, -dot(f, g_1)),
        vec3<f32>(g_2, -dot(f, g_2)),
    );
}
