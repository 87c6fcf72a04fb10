//! Constraints on parameters, applied after a step.

use photofit_scalar::{Real, Vec3, vec3};
use rayon::prelude::*;

/// Rows handed to one thread at a time.
const GRAIN: usize = 4096;

/// Clamps each channel to its range: `params` are rows of `ranges.len()` samples, `ranges[c] = [lo, hi]` (infinite ends
/// allowed). NaN becomes `lo`.
///
/// ```
/// let mut texels = [1.5_f32, 0.0, -0.25, 0.5];
/// photofit_optim::clamp_channels(&mut texels, &[[0.0, 1.0], [0.05, 1.0]]);
/// assert_eq!(texels, [1.0, 0.05, 0.0, 0.5]);
/// ```
///
/// # Panics
/// When `ranges` is empty or does not divide `params` into whole rows.
pub fn clamp_channels<T: Real>(params: &mut [T], ranges: &[[T; 2]]) {
    let width = ranges.len();
    assert!(width > 0 && params.len().is_multiple_of(width), "whole rows");
    params.par_chunks_mut(width * GRAIN).for_each(|rows| match ranges.as_chunks::<16>() {
        // Rows of a length known to the compiler are taken four samples at a time.
        ([ranges], []) => rows.as_chunks_mut::<16>().0.iter_mut().for_each(|row| clamp_row(row, ranges)),
        _ => rows.chunks_exact_mut(width).for_each(|row| clamp_row(row, ranges)),
    });
}

#[inline(always)]
fn clamp_row<T: Real>(row: &mut [T], ranges: &[[T; 2]]) {
    for (p, [lo, hi]) in row.iter_mut().zip(ranges) {
        *p = p.clamp_to(*lo, *hi);
    }
}

/// Makes the 3-vector at `offset` of every row of `width` samples a unit vector; zero and non-finite ones become
/// `(0, 0, 1)`, the unperturbed tangent-space normal. Vectors that are unit to rounding keep their bits, so rows that
/// no step touched do not drift.
///
/// # Panics
/// When the vector does not lie inside a row or `params` does not hold whole rows.
pub fn normalize_vectors<T: Real>(params: &mut [T], width: usize, offset: usize) {
    assert!(
        offset.saturating_add(3) <= width && params.len().is_multiple_of(width),
        "whole rows holding the vector"
    );
    let slack = T::of(8.0) * T::epsilon();
    params.par_chunks_mut(width * GRAIN).for_each(|rows| {
        for row in rows.chunks_exact_mut(width) {
            let at = &mut row[offset..offset + 3];
            let v = vec3(at[0], at[1], at[2]);
            if (v.length_squared() - T::one()).abs() <= slack {
                continue;
            }
            // Divided by the largest component first: squares of huge vectors would overflow.
            let size = v.x.abs().max(v.y.abs()).max(v.z.abs());
            let usable = size > T::zero() && v.is_finite();
            let n = if usable { (v / size).normalize_or_zero() } else { Vec3::zero() };
            let up = vec3(T::zero(), T::zero(), T::one());
            at.copy_from_slice(&(if n == Vec3::zero() { up } else { n }).to_array());
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_and_nan() {
        let mut p = [f32::NAN, 9.0, -9.0, 0.5];
        clamp_channels(&mut p, &[[0.0, 1.0], [f32::NEG_INFINITY, f32::INFINITY]]);
        assert_eq!(p, [0.0, 9.0, 0.0, 0.5]);
    }

    #[test]
    fn vectors_become_unit_and_stay() {
        let mut p =
            [7.0_f32, 3.0, 0.0, 4.0, 7.0, 0.0, 0.0, 0.0, 7.0, 1e30, 0.0, 0.0, 7.0, f32::NAN, 0.0, 1.0];
        normalize_vectors(&mut p, 4, 1);
        let expected = [7.0, 0.6, 0.0, 0.8, 7.0, 0.0, 0.0, 1.0, 7.0, 1.0, 0.0, 0.0, 7.0, 0.0, 0.0, 1.0];
        assert!(p.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{p:?}");
        let once = p;
        normalize_vectors(&mut p, 4, 1);
        assert_eq!(p, once);
    }
}
