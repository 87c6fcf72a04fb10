//! Hessian and its adjoint.

use photofit_scalar::Real;

use super::{Boundary, check_plane, dx_backward, dx_forward, dy_backward, dy_forward};

/// Hessian of a plane: `(Dx- Dx+ u, Dy+ Dx+ u, Dx+ Dy+ u, Dy- Dy+ u)`, four planes. The mixed entries are equal:
/// `u[i+1, j+1] - u[i+1, j] - u[i, j+1] + u[i, j]`.
///
/// # Panics
/// If `u` is not a plane of `width x height`.
pub fn hessian<T: Real>(boundary: Boundary, width: usize, height: usize, u: &[T]) -> Vec<T> {
    check_plane("hessian", u, width, height, 1);
    let (ux, uy) = (dx_forward(boundary, width, u), dy_forward(boundary, width, u));
    let mut out = dx_backward(boundary, width, &ux);
    out.extend(dy_forward(boundary, width, &ux));
    out.extend(dx_forward(boundary, width, &uy));
    out.extend(dy_backward(boundary, width, &uy));
    out
}

/// Adjoint of [`hessian`]: `Dx- Dx+ v1 + Dx- Dy- (v2 + v3) + Dy- Dy+ v4`.
///
/// # Panics
/// If `v` is not four planes of `width x height`.
pub fn hessian_adjoint<T: Real>(boundary: Boundary, width: usize, height: usize, v: &[T]) -> Vec<T> {
    check_plane("hessian_adjoint", v, width, height, 4);
    let n = height * width;
    let mixed: Vec<T> = v[n..2 * n].iter().zip(&v[2 * n..3 * n]).map(|(a, b)| *a + *b).collect();
    let mut out = dx_backward(boundary, width, &dx_forward(boundary, width, &v[..n]));
    let mixed = dx_backward(boundary, width, &dy_backward(boundary, width, &mixed));
    let yy = dy_backward(boundary, width, &dy_forward(boundary, width, &v[3 * n..]));
    for ((o, a), b) in out.iter_mut().zip(mixed).zip(yy) {
        *o += a + b;
    }
    out
}
