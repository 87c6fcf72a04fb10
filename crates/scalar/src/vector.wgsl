// Scalars and vectors as in `real.rs` and `vector.rs`: clamps that give a number for what is not one, and guarded
// normalisation with its adjoint.

const MIN_POSITIVE: f32 = 1.17549435e-38;
const MAX_FINITE: f32 = 0x1.fffffep+127;

fn relu(x: f32) -> f32 {
    return select(0.0, x, x > 0.0);
}

// Within [lo, hi]; what is not a number becomes `lo`.
fn clamp_to(x: f32, lo: f32, hi: f32) -> f32 {
    return select(lo, select(hi, x, x < hi), x > lo);
}

fn sum3(v: vec3<f32>) -> f32 {
    return v.x + v.y + v.z;
}

// Integer below, saturated; 0 for what is not a number.
fn floor_to_i32(x: f32) -> i32 {
    let inside = x >= -2147483648.0 && x <= 2147483520.0;
    let end = select(select(0, i32(-2147483647 - 1), x < 0.0), 2147483647, x > 0.0);
    return select(end, i32(floor(select(0.0, x, inside))), inside);
}

fn normalize_or_zero(v: vec3<f32>) -> vec3<f32> {
    let l = sqrt(dot(v, v));
    if l > MIN_POSITIVE && l <= MAX_FINITE {
        return v * (1.0 / l);
    }
    return vec3<f32>(0.0);
}

// Adjoint of `normalize_or_zero` at `v`.
fn normalize_vjp(v: vec3<f32>, g: vec3<f32>) -> vec3<f32> {
    let l = sqrt(dot(v, v));
    if !(l > MIN_POSITIVE && l <= MAX_FINITE) {
        return vec3<f32>(0.0);
    }
    let r = 1.0 / l;
    let n = v * r;
    return (g - n * dot(n, g)) * r;
}
