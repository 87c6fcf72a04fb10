//! Natural-boundary masks: components that would reach across the border count for nothing.
//!
//! The raw operators see a jump at the border (wrap or fold): the sum of |H| of an affine ramp is not 0. With these
//! components excluded from the energy the boundary is natural. In a splitting method an excluded component has the
//! threshold zero (its shrinkage passes it through), so that the linear step stays diagonal.

use photofit_scalar::Real;

/// Masks of [`super::gradient`], two planes of 0 or 1: x is excluded in the last column, y in the last row.
pub fn gradient_mask<T: Real>(width: usize, height: usize) -> Vec<T> {
    planes(width, height, &[|_, j, _, n| j + 1 < n, |i, _, m, _| i + 1 < m])
}

/// Masks of [`super::hessian`], four planes of 0 or 1: xx is excluded in the first and last columns, yy in the first
/// and last rows, the mixed ones in the last row and the last column.
pub fn hessian_mask<T: Real>(width: usize, height: usize) -> Vec<T> {
    planes(
        width,
        height,
        &[
            |_, j, _, n| j > 0 && j + 1 < n,
            |i, j, m, n| i + 1 < m && j + 1 < n,
            |i, j, m, n| i + 1 < m && j + 1 < n,
            |i, _, m, _| i > 0 && i + 1 < m,
        ],
    )
}

/// Whether the component at `(i, j)` of `(M, N)` counts.
type Active = fn(usize, usize, usize, usize) -> bool;

fn planes<T: Real>(width: usize, height: usize, active: &[Active]) -> Vec<T> {
    let mut out = Vec::with_capacity(active.len() * height * width);
    for test in active {
        for i in 0..height {
            out.extend((0..width).map(|j| if test(i, j, height, width) { T::one() } else { T::zero() }));
        }
    }
    out
}
