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

/// Forward difference along x of a plane of `width` columns.
pub(crate) fn dx_forward<T: Real>(boundary: Boundary, width: usize, u: &[T]) -> Vec<T> {
    let mut out = vec![T::zero(); u.len()];
    for (o, r) in out.chunks_mut(width).zip(u.chunks(width)) {
        forward_row(boundary, r, o);
    }
    out
}

/// Backward difference along x.
pub(crate) fn dx_backward<T: Real>(boundary: Boundary, width: usize, w: &[T]) -> Vec<T> {
    let mut out = vec![T::zero(); w.len()];
    for (o, r) in out.chunks_mut(width).zip(w.chunks(width)) {
        backward_row(boundary, r, o);
    }
    out
}

/// Forward difference along y.
pub(crate) fn dy_forward<T: Real>(boundary: Boundary, width: usize, u: &[T]) -> Vec<T> {
    let height = u.len() / width;
    let mut out = vec![T::zero(); u.len()];
    for i in 0..height {
        let next = if i + 1 < height {
            i + 1
        } else if boundary == Boundary::Periodic {
            0
        } else {
            break;
        };
        for j in 0..width {
            out[i * width + j] = u[next * width + j] - u[i * width + j];
        }
    }
    out
}

/// Backward difference along y: minus the adjoint of [`dy_forward`].
pub(crate) fn dy_backward<T: Real>(boundary: Boundary, width: usize, w: &[T]) -> Vec<T> {
    let height = w.len() / width;
    let mut out = vec![T::zero(); w.len()];
    for i in 0..height {
        let own = boundary == Boundary::Periodic || i + 1 < height;
        let previous = if i > 0 {
            Some(i - 1)
        } else if boundary == Boundary::Periodic {
            Some(height - 1)
        } else {
            None
        };
        for j in 0..width {
            let a = if own { w[i * width + j] } else { T::zero() };
            let b = previous.map_or(T::zero(), |p| w[p * width + j]);
            out[i * width + j] = a - b;
        }
    }
    out
}

pub(crate) fn check_plane<T>(what: &str, values: &[T], width: usize, height: usize, components: usize) {
    assert!(width > 0 && height > 0, "an image of {width} x {height} has no pixels");
    assert_eq!(
        values.len(),
        components * width * height,
        "{what}: {components} planes of {width} x {height}"
    );
}

#[cfg(test)]
mod tests;
