//! Tables of albedos that are linear between their points.

use photofit_scalar::Real;

/// Multilinear interpolation of a table whose first axis varies fastest; coordinates in points, clamped to the table.
#[inline]
pub(super) fn interpolate<T: Real, const D: usize, const N: usize>(
    table: &[[f32; N]],
    size: &[usize; D],
    at: [T; D],
) -> [T; N] {
    let (mut index, mut fraction, mut stride) = ([0; D], [T::zero(); D], [1; D]);
    for k in 0..D {
        let x = at[k].clamp_to(T::zero(), T::of((size[k] - 1) as f64));
        index[k] = (x.f64() as usize).min(size[k] - 2);
        fraction[k] = x - T::of(index[k] as f64);
        stride[k] = if k == 0 { 1 } else { stride[k - 1] * size[k - 1] };
    }
    let mut sum = [T::zero(); N];
    for corner in 0..1 << D {
        let (mut weight, mut i) = (T::one(), 0);
        for k in 0..D {
            let far = corner >> k & 1;
            weight *= if far == 1 { fraction[k] } else { T::one() - fraction[k] };
            i += (index[k] + far) * stride[k];
        }
        for (s, &value) in sum.iter_mut().zip(&table[i]) {
            *s += weight * T::of(f64::from(value));
        }
    }
    sum
}

/// Coordinates along the axes of entry `k`, from 0 to 1.
pub(super) fn coordinates<const D: usize>(size: &[usize; D], k: usize) -> [f64; D] {
    let mut rest = k;
    size.map(|n| {
        let i = rest % n;
        rest /= n;
        i as f64 / (n - 1) as f64
    })
}
