//! Why arithmetic is generic over the scalar: a central difference in `f32` and in `f64` beside the derivative.
//!
//! `cargo run -p photofit-scalar --example precision`
#![expect(clippy::print_stdout, reason = "an example reports on its stream")]

use photofit_scalar::{Real, Vec3, vec3};

/// Angle between a direction and +z, in radians.
fn angle<T: Real>(v: Vec3<T>) -> T {
    v.normalize_or_zero().z.acos()
}

/// Derivative of [`angle`] in x by a central difference of step `h`.
fn difference<T: Real>(v: Vec3<T>, h: f64) -> f64 {
    let h = T::of(h);
    let moved = |h: T| angle(vec3(v.x + h, v.y, v.z));
    ((moved(h) - moved(-h)) / (h + h)).f64()
}

fn main() {
    let v = vec3(0.3_f64, -0.2, 0.9);
    let across = v.x.hypot(v.y);
    let exact = v.x * v.z / (across * v.length_squared());
    println!("{:>8}  {:>12}  {:>12}", "step", "error in f32", "error in f64");
    for h in [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6] {
        let error = |found: f64| (found / exact - 1.0).abs();
        println!(
            "{h:8.0e}  {:12.1e}  {:12.1e}",
            error(difference(v.cast::<f32>(), h)),
            error(difference(v, h))
        );
    }
}
