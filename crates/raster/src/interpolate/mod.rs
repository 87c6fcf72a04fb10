//! Interpolation of vertex attributes over a triangle, its screen derivatives, and the adjoint.
//!
//! The arithmetic of one channel stands here once: [`interpolate`] and [`derivatives`] loop over the channels of a sample, the
//! packets of [`crate::deferred`] over the samples of a channel.

use crate::rasterize::Barycentrics;
use photofit_scalar::{Real, Vec2};

/// What each corner counts for at the barycentrics u and v: the adjoint with respect to a corner's attribute is its weight
/// times dL/dvalue.
#[inline(always)]
pub fn weights<T: Real>(u: T, v: T) -> [T; 3] {
    [u, v, T::one() - u - v]
}

/// `u p + v q + (1-u-v) r`.
#[inline(always)]
pub fn value<T: Real>([p, q, r]: [T; 3], u: T, v: T) -> T {
    let [a, b, c] = weights(u, v);
    p * a + q * b + r * c
}

/// Adjoint of [`value`] with respect to u and v, for dL/dvalue `g`.
#[inline(always)]
pub fn value_vjp<T: Real>([p, q, r]: [T; 3], g: T) -> [T; 2] {
    [g * (p - r), g * (q - r)]
}

/// Screen derivative of [`value`], per pixel: `ds/dX = du/dX (p-r) + dv/dX (q-r)`, and the same for Y.
#[inline(always)]
pub fn slope<T: Real>([p, q, r]: [T; 3], b: &Barycentrics<T>) -> Vec2<T> {
    b.du * (p - r) + b.dv * (q - r)
}

/// [`value`] of attributes of `C` channels.
#[inline(always)]
pub fn interpolate<T: Real, const C: usize>(a: [&[T; C]; 3], b: &Barycentrics<T>) -> [T; C] {
    std::array::from_fn(|c| value(a.map(|a| a[c]), b.u, b.v))
}

/// [`slope`] of attributes of `C` channels. It has no adjoint: footprints of texture lookups pass nothing to positions.
#[inline(always)]
pub fn derivatives<T: Real, const C: usize>(a: [&[T; C]; 3], b: &Barycentrics<T>) -> [Vec2<T>; C] {
    std::array::from_fn(|c| slope(a.map(|a| a[c]), b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_gradcheck::{Uniform, check};
    use photofit_scalar::vec2;

    #[test]
    fn gradients_of_values() {
        let mut rng = Uniform::new(9);
        let (x, g) = (rng.vec(5, -1.0, 1.0), rng.range(-1.0, 1.0));
        let corners = |x: &[f64]| [x[0], x[1], x[2]];
        let of_corners = weights(x[3], x[4]).map(|w| w * g);
        let gradient = [&of_corners[..], &value_vjp(corners(&x), g)].concat();
        check("interpolate", &x, &gradient, 1e-6, 1e-8, |x| g * value(corners(x), x[3], x[4]));
    }

    #[test]
    fn slopes_are_differences_of_values() {
        let a = [[0.3, -2.0], [1.1, 0.7], [-0.4, 0.2]];
        let at = |x: f64, y: f64| {
            let (du, dv) = (vec2(0.3, -0.2), vec2(0.1, 0.4));
            Barycentrics { u: 0.2 + du.dot(vec2(x, y)), v: 0.5 + dv.dot(vec2(x, y)), du, dv }
        };
        let [p, q, r] = &a;
        let slopes = derivatives([p, q, r], &at(0.0, 0.0));
        let value = |x, y| interpolate([p, q, r], &at(x, y));
        for c in 0..2 {
            let step = vec2(value(1.0, 0.0)[c], value(0.0, 1.0)[c]) - vec2(1.0, 1.0) * value(0.0, 0.0)[c];
            assert!((slopes[c] - step).length() < 1e-12, "{c}: {:?} and {step:?}", slopes[c]);
        }
    }
}
