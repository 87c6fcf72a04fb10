//! Gradient and divergence.

use photofit_scalar::Real;

use super::{Boundary, check_plane, dx_backward, dx_forward, dy_backward, dy_forward};

/// Gradient of a plane: `(Dx+ u, Dy+ u)`, two planes.
///
/// # Panics
/// If `u` is not a plane of `width x height`.
pub fn gradient<T: Real>(boundary: Boundary, width: usize, height: usize, u: &[T]) -> Vec<T> {
    check_plane("gradient", u, width, height, 1);
    let mut out = dx_forward(boundary, width, u);
    out.extend(dy_forward(boundary, width, u));
    out
}

/// Divergence of two planes: `Dx- w1 + Dy- w2`; `<gradient(u), w> = -<u, divergence(w)>`.
///
/// # Panics
/// If `w` is not two planes of `width x height`.
pub fn divergence<T: Real>(boundary: Boundary, width: usize, height: usize, w: &[T]) -> Vec<T> {
    check_plane("divergence", w, width, height, 2);
    let (x, y) = w.split_at(height * width);
    let mut out = dx_backward(boundary, width, x);
    for (o, v) in out.iter_mut().zip(dy_backward(boundary, width, y)) {
        *o += v;
    }
    out
}
