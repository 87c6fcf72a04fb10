//! Gradient and divergence.

use photofit_scalar::Real;

use super::{Boundary, check_plane, dx_backward, dx_forward, dy_backward, dy_forward};

/// Gradient of a plane: `(Dx+ u, Dy+ u)`, two planes.
///
/// # Panics
/// If `u` is not a plane of `rows x cols`.
pub fn gradient<T: Real>(boundary: Boundary, rows: usize, cols: usize, u: &[T]) -> Vec<T> {
    check_plane("gradient", u, rows, cols, 1);
    let mut out = dx_forward(boundary, cols, u);
    out.extend(dy_forward(boundary, cols, u));
    out
}

/// Divergence of two planes: `Dx- w1 + Dy- w2`; `<gradient(u), w> = -<u, divergence(w)>`.
///
/// # Panics
/// If `w` is not two planes of `rows x cols`.
pub fn divergence<T: Real>(boundary: Boundary, rows: usize, cols: usize, w: &[T]) -> Vec<T> {
    check_plane("divergence", w, rows, cols, 2);
    let (x, y) = w.split_at(rows * cols);
    let mut out = dx_backward(boundary, cols, x);
    for (o, v) in out.iter_mut().zip(dy_backward(boundary, cols, y)) {
        *o += v;
    }
    out
}
