//! Finite differences of planar images: gradient, divergence, Hessian, its adjoint, and the natural-boundary masks.
//!
//! Indices are `u[i, j]`: row `i` of M (y), column `j` of N (x). These plain forms define the operators and are the
//! oracles of the fused passes of [`crate::admm`]. One plane at a time; components are planes one behind the other.
//!
//! | boundary | Dx+ | Dx- |
//! |---|---|---|
//! | periodic | `u[j+1 mod N] - u[j]` | `w[j] - w[j-1 mod N]` |
//! | Neumann | the same, 0 in the last column | `-(Dx+)^T`: `w[0]`, `w[j] - w[j-1]`, `-w[N-2]` |

mod gradient;
mod hessian;
mod mask;

pub use gradient::{divergence, gradient};
pub use hessian::{hessian, hessian_adjoint};
pub use mask::{gradient_mask, hessian_mask};

use photofit_scalar::Real;

/// What happens beyond the border.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Boundary {
    /// The image repeats; diagonal under the Fourier transform.
    Periodic,
    /// Differences across the border are zero; diagonal under the cosine transform (DCT-II).
    Neumann,
}

/// Forward difference along x of one row.
fn forward_row<T: Real>(boundary: Boundary, u: &[T], out: &mut [T]) {
    let n = u.len();
    for ((o, a), b) in out.iter_mut().zip(u).zip(&u[1..]) {
        *o = *b - *a;
    }
    out[n - 1] = match boundary {
        Boundary::Periodic => u[0] - u[n - 1],
        Boundary::Neumann => T::zero(),
    };
}

/// Backward difference along x of one row: minus the adjoint of [`forward_row`].
fn backward_row<T: Real>(boundary: Boundary, w: &[T], out: &mut [T]) {
    let n = w.len();
    for j in 1..n {
        out[j] = w[j] - w[j - 1];
    }
    match boundary {
        Boundary::Periodic => out[0] = w[0] - w[n - 1],
        Boundary::Neumann if n == 1 => out[0] = T::zero(),
        Boundary::Neumann => {
            out[0] = w[0];
            out[n - 1] = -w[n - 2];
        }
    }
}

/// Forward difference along x of a plane of `cols` columns.
pub(crate) fn dx_forward<T: Real>(boundary: Boundary, cols: usize, u: &[T]) -> Vec<T> {
    let mut out = vec![T::zero(); u.len()];
    for (o, r) in out.chunks_mut(cols).zip(u.chunks(cols)) {
        forward_row(boundary, r, o);
    }
    out
}

/// Backward difference along x.
pub(crate) fn dx_backward<T: Real>(boundary: Boundary, cols: usize, w: &[T]) -> Vec<T> {
    let mut out = vec![T::zero(); w.len()];
    for (o, r) in out.chunks_mut(cols).zip(w.chunks(cols)) {
        backward_row(boundary, r, o);
    }
    out
}

/// Forward difference along y.
pub(crate) fn dy_forward<T: Real>(boundary: Boundary, cols: usize, u: &[T]) -> Vec<T> {
    let rows = u.len() / cols;
    let mut out = vec![T::zero(); u.len()];
    for i in 0..rows {
        let next = if i + 1 < rows {
            i + 1
        } else if boundary == Boundary::Periodic {
            0
        } else {
            break;
        };
        for j in 0..cols {
            out[i * cols + j] = u[next * cols + j] - u[i * cols + j];
        }
    }
    out
}

/// Backward difference along y: minus the adjoint of [`dy_forward`].
pub(crate) fn dy_backward<T: Real>(boundary: Boundary, cols: usize, w: &[T]) -> Vec<T> {
    let rows = w.len() / cols;
    let mut out = vec![T::zero(); w.len()];
    for i in 0..rows {
        let own = boundary == Boundary::Periodic || i + 1 < rows;
        let previous = if i > 0 {
            Some(i - 1)
        } else if boundary == Boundary::Periodic {
            Some(rows - 1)
        } else {
            None
        };
        for j in 0..cols {
            let a = if own { w[i * cols + j] } else { T::zero() };
            let b = previous.map_or(T::zero(), |p| w[p * cols + j]);
            out[i * cols + j] = a - b;
        }
    }
    out
}

pub(crate) fn check_plane<T>(what: &str, values: &[T], rows: usize, cols: usize, components: usize) {
    assert!(rows > 0 && cols > 0, "an image of {rows} rows x {cols} columns has no pixels");
    assert_eq!(values.len(), components * rows * cols, "{what}: {components} planes of {rows} x {cols}");
}

#[cfg(test)]
mod tests;
