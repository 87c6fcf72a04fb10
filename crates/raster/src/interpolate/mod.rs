//! Interpolation of vertex attributes over a triangle, its screen derivatives, and the adjoints.

use crate::rasterize::Barycentrics;
use photofit_scalar::{Real, Vec2, halved_sum, vec2};

/// `u a0 + v a1 + (1-u-v) a2` for attributes of `C` samples.
#[inline(always)]
pub fn interpolate<T: Real, const C: usize>(a: [&[T; C]; 3], b: &Barycentrics<T>) -> [T; C] {
    let w = T::one() - b.u - b.v;
    let mut out = [T::zero(); C];
    for c in 0..C {
        out[c] = a[0][c] * b.u + a[1][c] * b.v + a[2][c] * w;
    }
    out
}

/// Adjoint of [`interpolate`]: returns (dL/du, dL/dv) and accumulates into the attribute gradients.
#[inline(always)]
pub fn interpolate_vjp<T: Real, const C: usize>(
    a: [&[T; C]; 3],
    b: &Barycentrics<T>,
    g: &[T; C],
    g_a: [&mut [T; C]; 3],
) -> Vec2<T> {
    let w = T::one() - b.u - b.v;
    let (mut u, mut v) = ([T::zero(); C], [T::zero(); C]);
    let [g0, g1, g2] = g_a;
    for c in 0..C {
        g0[c] += b.u * g[c];
        g1[c] += b.v * g[c];
        g2[c] += w * g[c];
        u[c] = g[c] * (a[0][c] - a[2][c]);
        v[c] = g[c] * (a[1][c] - a[2][c]);
    }
    vec2(halved_sum(u), halved_sum(v))
}

/// Screen derivatives of an interpolated attribute, per pixel:
/// `ds/dX = du/dX (a0-a2) + dv/dX (a1-a2)`, and the same for Y.
#[inline(always)]
pub fn derivatives<T: Real, const C: usize>(a: [&[T; C]; 3], b: &Barycentrics<T>) -> [Vec2<T>; C] {
    std::array::from_fn(|c| b.du * (a[0][c] - a[2][c]) + b.dv * (a[1][c] - a[2][c]))
}

/// Adjoint of [`derivatives`] with respect to the attributes, accumulating.
#[inline(always)]
pub fn derivatives_vjp<T: Real, const C: usize>(
    b: &Barycentrics<T>,
    g: &[Vec2<T>; C],
    g_a: [&mut [T; C]; 3],
) {
    let [g0, g1, g2] = g_a;
    for c in 0..C {
        let (s, t) = (g[c].dot(b.du), g[c].dot(b.dv));
        g0[c] += s;
        g1[c] += t;
        g2[c] -= s + t;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_gradcheck::{Uniform, check};

    fn split(x: &[f64]) -> ([[f64; 2]; 3], Barycentrics<f64>) {
        (
            [[x[0], x[1]], [x[2], x[3]], [x[4], x[5]]],
            Barycentrics { u: x[6], v: x[7], du: vec2(0.3, -0.2), dv: vec2(0.1, 0.4) },
        )
    }

    #[test]
    fn gradients_of_value_and_derivatives() {
        let mut rng = Uniform::new(9);
        let (x, g) = (rng.vec(8, -1.0, 1.0), rng.vec(6, -1.0, 1.0));
        let (a, b) = split(&x);
        let mut ga = [[0.0; 2]; 3];
        let [g0, g1, g2] = &mut ga;
        let guv = interpolate_vjp([&a[0], &a[1], &a[2]], &b, &[g[0], g[1]], [g0, g1, g2]);
        let gd = [vec2(g[2], g[3]), vec2(g[4], g[5])];
        let [g0, g1, g2] = &mut ga;
        derivatives_vjp(&b, &gd, [g0, g1, g2]);
        let mut flat: Vec<f64> = ga.concat();
        flat.extend([guv.x, guv.y]);
        check("interpolate", &x, &flat, 1e-6, 1e-8, |x| {
            let (a, b) = split(x);
            let v = interpolate([&a[0], &a[1], &a[2]], &b);
            let d = derivatives([&a[0], &a[1], &a[2]], &b);
            v[0] * g[0] + v[1] * g[1] + d[0].dot(gd[0]) + d[1].dot(gd[1])
        });
    }
}
