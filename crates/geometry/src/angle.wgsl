// The angle between two vectors and small scale-free pieces shared by normals and tangents: twin of angle.rs.

const PI: f32 = 3.14159265358979;
const EPSILON: f32 = 1.1920929e-7;
const MIN_POSITIVE: f32 = 1.1754944e-38;

// Whether no component is infinite or not a number; by bits, because compilers may assume that there are none.
fn is_finite3(v: vec3<f32>) -> bool {
    let exponents = bitcast<vec3<u32>>(v) & vec3<u32>(0x7f800000u);
    return all(exponents != vec3<u32>(0x7f800000u));
}

// Largest absolute component.
fn reach(v: vec3<f32>) -> f32 {
    return max(max(abs(v.x), abs(v.y)), abs(v.z));
}

fn length_of(v: vec3<f32>) -> f32 {
    return sqrt(dot(v, v));
}

// Unit vector of `v`, or zero, without under- or overflow of the squared length.
fn unit(v: vec3<f32>) -> vec3<f32> {
    let s = reach(v);
    if !(is_finite3(v) && s > MIN_POSITIVE) {
        return vec3<f32>(0.0);
    }
    let w = v / s;
    return w * (1.0 / length_of(w));
}

// Adjoint of `unit` at `v`: `(g - n (n.g)) / |v|`.
fn unit_vjp(v: vec3<f32>, g: vec3<f32>) -> vec3<f32> {
    let s = reach(v);
    if !(is_finite3(v) && s > MIN_POSITIVE) {
        return vec3<f32>(0.0);
    }
    let w = v / s;
    let r = 1.0 / length_of(w);
    let n = w * r;
    return (g - n * dot(n, g)) * r / s;
}

// Arc tangent of `t` in [0, 1] within 2e-8 relative, before rounding: WGSL allows its own 4096 units in the last place.
fn arc_tangent(t: f32) -> f32 {
    let steep = t > 0.41421356;
    let x = select(t, (t - 1.0) / (t + 1.0), steep);
    let z = x * x;
    let q = 0.333329552 + z * (-0.199779257 + z * (0.138798462 - 0.0806029798 * z));
    return select(0.0, 0.25 * PI, steep) + (x - x * z * q);
}

// Angle in [0, pi] of a direction with `sine >= 0` and `cosine`, of any common length; zero for the zero vector.
fn arc(sine: f32, cosine: f32) -> f32 {
    let c = abs(cosine);
    let most = max(sine, c);
    if !(most > 0.0) {
        return 0.0;
    }
    var a = arc_tangent(min(sine, c) / most);
    if sine > c {
        a = 0.5 * PI - a;
    }
    return select(a, PI - a, cosine < 0.0);
}

// Angle between `a` and `b` in [0, pi]; zero for zero vectors.
fn angle(a: vec3<f32>, b: vec3<f32>) -> f32 {
    return arc(length_of(cross(a, b)), dot(a, b));
}

// Adjoint of `angle`: the gradient with respect to `a` (which = 0) or `b` (which = 1), zero where they are parallel.
fn angle_vjp(a: vec3<f32>, b: vec3<f32>, g: f32, which: u32) -> vec3<f32> {
    let x = cross(a, b);
    let aa = dot(a, a);
    let bb = dot(b, b);
    let l = length_of(x);
    if !(l > EPSILON * sqrt(aa * bb) && l > MIN_POSITIVE) {
        return vec3<f32>(0.0);
    }
    let m = x * (g / l);
    if which == 0u {
        return cross(m, a) * (-1.0 / aa);
    }
    return cross(m, b) * (1.0 / bb);
}
