//! The angle between two vectors and small scale-free pieces shared by normals and tangents.

use photofit_scalar::{Real, Vec3};

/// The same functions in WGSL.
#[cfg(feature = "gpu")]
pub(crate) const ANGLE: &str = include_str!("angle.wgsl");

/// Largest absolute component; zero for the zero vector, infinite or NaN components give infinity.
#[inline(always)]
pub(crate) fn reach<T: Real>(v: Vec3<T>) -> T {
    let m = v.x.abs().max(v.y.abs()).max(v.z.abs());
    if v.is_finite() { m } else { T::infinity() }
}

/// Unit vector of `v`, or zero, without under- or overflow of the squared length.
#[inline(always)]
pub(crate) fn unit<T: Real>(v: Vec3<T>) -> Vec3<T> {
    let s = reach(v);
    if s > T::zero() && s.is_finite() { (v / s).normalize_or_zero() } else { Vec3::zero() }
}

/// Adjoint of [`unit`] at `v`: `(g - n (n.g)) / |v|`.
#[inline(always)]
pub(crate) fn unit_vjp<T: Real>(v: Vec3<T>, g: Vec3<T>) -> Vec3<T> {
    let s = reach(v);
    if s > T::zero() && s.is_finite() { (v / s).normalize_vjp(g) / s } else { Vec3::zero() }
}

/// Angle between `a` and `b` in `[0, pi]`, as `atan2(|a x b|, a.b)`: accurate at all angles; zero for zero vectors.
#[inline(always)]
pub(crate) fn angle<T: Real>(a: Vec3<T>, b: Vec3<T>) -> T {
    a.cross(b).length().atan2(a.dot(b))
}

/// Adjoint of [`angle`]: gradients with respect to `a` and `b`, zero where the vectors are parallel (a kink).
///
/// With `m` the unit vector along `a x b`: `d angle/da = -(m x a)/|a|^2`, `d angle/db = (m x b)/|b|^2`.
#[inline(always)]
pub(crate) fn angle_vjp<T: Real>(a: Vec3<T>, b: Vec3<T>, g: T) -> (Vec3<T>, Vec3<T>) {
    let (x, aa, bb) = (a.cross(b), a.length_squared(), b.length_squared());
    let l = x.length();
    let distinct = l > T::epsilon() * (aa * bb).sqrt() && l > T::min_positive_value();
    if !distinct {
        return (Vec3::zero(), Vec3::zero());
    }
    let m = x * (g / l);
    (m.cross(a) * (-T::one() / aa), m.cross(b) * (T::one() / bb))
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_scalar::vec3;

    #[test]
    fn the_angle_and_its_adjoint() {
        let x = [0.3, -1.2, 0.7, 0.9, 0.4, -0.2];
        let f = |x: &[f64]| angle(vec3(x[0], x[1], x[2]), vec3(x[3], x[4], x[5]));
        let (da, db) = angle_vjp(vec3(x[0], x[1], x[2]), vec3(x[3], x[4], x[5]), 1.0);
        let gradient = [da.to_array(), db.to_array()].concat();
        photofit_gradcheck::check("angle", &x, &gradient, 1e-5, 1e-8, f);
        assert!(
            (angle(vec3(1.0, 0.0, 0.0), vec3(0.0_f32, 2.0, 0.0)) - std::f32::consts::FRAC_PI_2).abs() < 1e-6
        );
        assert_eq!(angle_vjp(vec3(1.0, 0.0, 0.0), vec3(2.0_f64, 0.0, 0.0), 1.0).0, Vec3::zero());
    }

    #[test]
    fn tiny_and_huge_vectors_have_a_direction() {
        for s in [1e-30_f32, 1.0, 1e30] {
            let n = unit(vec3(3.0 * s, 0.0, 4.0 * s));
            assert!((n - vec3(0.6, 0.0, 0.8)).length() < 1e-6, "scale {s}");
        }
        assert_eq!(unit(vec3(f32::NAN, 0.0, 1.0)), Vec3::zero());
    }
}
