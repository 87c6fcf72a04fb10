//! The fused row kernels of the splitting: proximal maps, shrinkage, differences and their adjoints.
//!
//! Each works on rows that lie in the first cache and has no branches in its loops, so that it vectorises.

use photofit_scalar::Real;

/// The weights of one row of the data term.
#[derive(Clone, Copy, Debug)]
pub(crate) enum DataRow<'a, T> {
    /// Absolute value and square.
    Hybrid(&'a [T], &'a [T]),
    /// Weight and end of the square of the one-sided Huber function.
    Huber(&'a [T], &'a [T]),
}

/// One step of the data split: `q = qh + a u`, `p = prox(q)`, `qh = q - a p`, `f = t0 (2p - q)`.
///
/// `qh` holds `b0 + (1 - a) p`. Samples beyond the target have no data: there `p = q`.
#[inline(always)]
pub(crate) fn data_row<T: Real>(
    data: DataRow<'_, T>,
    target: &[T],
    u: &[T],
    qh: &mut [T],
    f: &mut [T],
    t0: T,
    [gain, a]: [T; 2],
) {
    let n = target.len();
    let two = T::of(2.0);
    match data {
        DataRow::Hybrid(l1, l2) => {
            let (l1, l2) = (&l1[..n], &l2[..n]);
            let (u, qh, f) = (&u[..n], &mut qh[..n], &mut f[..n]);
            for j in 0..n {
                let q = qh[j] + gain * u[j];
                let s = q - target[j];
                // sgn(s) max(t0 |s| - l1, 0), without the sign.
                let clipped = (t0 * s).max(-l1[j]).min(l1[j]);
                let p = target[j] + (t0 * s - clipped) / (l2[j] + t0);
                qh[j] = q - a * p;
                f[j] = t0 * (two * p - q);
            }
        }
        DataRow::Huber(lambda, delta) => {
            let (lambda, delta) = (&lambda[..n], &delta[..n]);
            let (u, qh, f) = (&u[..n], &mut qh[..n], &mut f[..n]);
            for j in 0..n {
                let q = qh[j] + gain * u[j];
                let s = q - target[j];
                // The square's step, or the line's where that leaves the square: the line's is then the larger.
                let square = s * t0 / (lambda[j] + t0);
                let line = s + lambda[j] * delta[j] / t0;
                let p = target[j] + if square >= -delta[j] { square } else { line };
                qh[j] = q - a * p;
                f[j] = t0 * (two * p - q);
            }
        }
    }
    for ((u, qh), f) in u[n..].iter().zip(&mut qh[n..]).zip(&mut f[n..]) {
        let q = *qh + gain * *u;
        *qh = q - a * q;
        *f = t0 * q;
    }
}

/// Adds `z * z * weight` to `sum`.
#[inline(always)]
pub(crate) fn add_square<T: Real>(z: &[T], weight: T, sum: &mut [T]) {
    for (s, z) in sum.iter_mut().zip(z) {
        *s += weight * *z * *z;
    }
}

/// Turns squared norms into the share of each vector that shrinking takes away: `min(tau / |z|, 1)`, 0 for `tau = 0`.
#[inline(always)]
pub(crate) fn shares<T: Real>(squares: &mut [T], weight: &[T], scale: T) {
    let tiny = T::min_positive_value();
    for (s, w) in squares.iter_mut().zip(weight) {
        let tau = *w * scale;
        *s = tau / s.sqrt().max(tau).max(tiny);
    }
}

/// Shrinks one component: `s = z (1 - share)`, leaves `z - a s` in `zh` and the reflection `2 s - z` in `z`.
#[inline(always)]
pub(crate) fn shrink<T: Real>(z: &mut [T], zh: &mut [T], share: &[T], a: T) {
    for ((z, zh), share) in z.iter_mut().zip(zh).zip(share) {
        let s = *z - *z * *share;
        *zh = *z - a * s;
        *z = s + s - *z;
    }
}

/// Components that count for nothing pass through: `s = z`.
#[inline(always)]
pub(crate) fn pass<T: Real>(z: &[T], zh: &mut [T], a: T) {
    for (z, zh) in z.iter().zip(zh) {
        *zh = *z - a * *z;
    }
}

/// `z = zh + a Dx+ u`, periodic.
#[inline(always)]
pub(crate) fn forward_x<T: Real>(u: &[T], zh: &[T], a: T, z: &mut [T]) {
    let n = u.len();
    for j in 0..n - 1 {
        z[j] = zh[j] + a * (u[j + 1] - u[j]);
    }
    z[n - 1] = zh[n - 1] + a * (u[0] - u[n - 1]);
}

/// `z = zh + a (below - u)`; without a row below `z = zh`, which then is 0.
#[inline(always)]
pub(crate) fn forward_y<T: Real>(u: &[T], below: Option<&[T]>, zh: &[T], a: T, z: &mut [T]) {
    match below {
        Some(below) => {
            for (((z, zh), u), b) in z.iter_mut().zip(zh).zip(u).zip(below) {
                *z = *zh + a * (*b - *u);
            }
        }
        None => z.copy_from_slice(zh),
    }
}

/// `f -= t (x[j] - x[j-1] + y[j] - above[j])`, periodic: minus `t` times the divergence.
#[inline(always)]
pub(crate) fn subtract_divergence<T: Real>(f: &mut [T], t: T, x: &[T], y: &[T], above: Option<&[T]>) {
    let n = f.len();
    let (x, y) = (&x[..n], &y[..n]);
    let first = x[0] - x[n - 1];
    match above {
        Some(above) => {
            let above = &above[..n];
            f[0] -= t * (first + y[0] - above[0]);
            for j in 1..n {
                f[j] -= t * (x[j] - x[j - 1] + y[j] - above[j]);
            }
        }
        None => {
            f[0] -= t * (first + y[0]);
            for j in 1..n {
                f[j] -= t * (x[j] - x[j - 1] + y[j]);
            }
        }
    }
}

/// `z = zh + a Dx- Dx+ u`, periodic.
#[inline(always)]
pub(crate) fn second_x<T: Real>(u: &[T], zh: &[T], a: T, z: &mut [T]) {
    let n = u.len();
    let two = T::of(2.0);
    let at = |l: usize, j: usize, r: usize| zh[j] + a * (u[r] - two * u[j] + u[l]);
    for j in 1..n - 1 {
        z[j] = at(j - 1, j, j + 1);
    }
    z[0] = at(n - 1, 0, 1);
    z[n - 1] = at(n - 2, n - 1, 0);
}

/// `z = zh + a Dy- Dy+ u`, Neumann.
#[inline(always)]
pub(crate) fn second_y<T: Real>(
    above: Option<&[T]>,
    u: &[T],
    below: Option<&[T]>,
    zh: &[T],
    a: T,
    z: &mut [T],
) {
    let n = u.len();
    // A missing neighbour mirrors the row itself.
    let (above, below) = (&above.unwrap_or(u)[..n], &below.unwrap_or(u)[..n]);
    for j in 0..n {
        z[j] = zh[j] + a * ((below[j] - u[j]) - (u[j] - above[j]));
    }
}

/// `z = zh + a Dy+ Dx+ u`; without a row below `z = zh`.
#[inline(always)]
pub(crate) fn mixed<T: Real>(u: &[T], below: Option<&[T]>, zh: &[T], a: T, z: &mut [T]) {
    let n = u.len();
    let Some(below) = below else {
        z.copy_from_slice(zh);
        return;
    };
    for j in 0..n - 1 {
        z[j] = zh[j] + a * ((below[j + 1] - below[j]) - (u[j + 1] - u[j]));
    }
    z[n - 1] = zh[n - 1] + a * ((below[0] - below[n - 1]) - (u[0] - u[n - 1]));
}

/// `f += t H^T v` of one row, `v` given as its rows xx, mixed (counted twice) and yy with the neighbours they need.
#[inline(always)]
pub(crate) fn add_hessian_adjoint<T: Real>(
    f: &mut [T],
    t: T,
    xx: &[T],
    mixed: [Option<&[T]>; 2],
    yy: [Option<&[T]>; 3],
    row: &mut [T],
) {
    let n = f.len();
    let two = T::of(2.0);
    let at = |l: usize, j: usize, r: usize| xx[r] - two * xx[j] + xx[l];
    f[0] += t * at(n - 1, 0, 1);
    f[n - 1] += t * at(n - 2, n - 1, 0);
    for j in 1..n - 1 {
        f[j] += t * at(j - 1, j, j + 1);
    }
    if let [above, Some(own)] = mixed {
        match above {
            Some(above) => {
                for ((d, o), a) in row.iter_mut().zip(own).zip(above) {
                    *d = *o - *a;
                }
            }
            None => row.copy_from_slice(own),
        }
        let t = two * t;
        f[0] += t * (row[0] - row[n - 1]);
        for j in 1..n {
            f[j] += t * (row[j] - row[j - 1]);
        }
    }
    if let [above, Some(own), below] = yy {
        let (above, below) = (&above.unwrap_or(own)[..n], &below.unwrap_or(own)[..n]);
        for j in 0..n {
            f[j] += t * ((below[j] - own[j]) - (own[j] - above[j]));
        }
    }
}
