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

/// One step of the data split: `q = qh + gain u`, `p = prox(q)`, `qh = q - a p - carry gain u`, `f = t0 (2p - q)`.
///
/// `qh` holds `b0 + (1 - a) p`, less what the relaxed estimate carries. Samples beyond the target have no data: there `p = q`.
#[inline(always)]
pub(crate) fn data_row<T: Real>(
    data: DataRow<'_, T>,
    target: &[T],
    u: &[T],
    qh: &mut [T],
    f: &mut [T],
    t0: T,
    [gain, a, carry]: [T; 3],
) {
    let n = target.len();
    let two = T::of(2.0);
    match data {
        DataRow::Hybrid(l1, l2) => {
            let (l1, l2) = (&l1[..n], &l2[..n]);
            let (u, qh, f) = (&u[..n], &mut qh[..n], &mut f[..n]);
            for j in 0..n {
                let own = gain * u[j];
                let q = qh[j] + own;
                let s = q - target[j];
                // sgn(s) max(t0 |s| - l1, 0), without the sign.
                let clipped = (t0 * s).max(-l1[j]).min(l1[j]);
                let p = target[j] + (t0 * s - clipped) / (l2[j] + t0);
                qh[j] = q - a * p - carry * own;
                f[j] = t0 * (two * p - q);
            }
        }
        DataRow::Huber(lambda, delta) => {
            let (lambda, delta) = (&lambda[..n], &delta[..n]);
            let (u, qh, f) = (&u[..n], &mut qh[..n], &mut f[..n]);
            for j in 0..n {
                let own = gain * u[j];
                let q = qh[j] + own;
                let s = q - target[j];
                // The square's step, or the line's where that leaves the square: the line's is then the larger.
                let square = s * t0 / (lambda[j] + t0);
                let line = s + lambda[j] * delta[j] / t0;
                let p = target[j] + if square >= -delta[j] { square } else { line };
                qh[j] = q - a * p - carry * own;
                f[j] = t0 * (two * p - q);
            }
        }
    }
    for ((u, qh), f) in u[n..].iter().zip(&mut qh[n..]).zip(&mut f[n..]) {
        let own = gain * *u;
        let q = *qh + own;
        *qh = q - a * q - carry * own;
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

/// Shrinks one component: `s = z (1 - share)`, leaves `z - a s - carry (z - zh)` in `zh` and the reflection `2 s - z`
/// in `z`; `z - zh` is what the operator gave.
#[inline(always)]
pub(crate) fn shrink<T: Real>(z: &mut [T], zh: &mut [T], share: &[T], [a, carry]: [T; 2]) {
    for ((z, zh), share) in z.iter_mut().zip(zh).zip(share) {
        let s = *z - *z * *share;
        *zh = *z - a * s - carry * (*z - *zh);
        *z = s + s - *z;
    }
}

/// Components that count for nothing pass through: `s = z`.
#[inline(always)]
pub(crate) fn pass<T: Real>(z: &[T], zh: &mut [T], [a, carry]: [T; 2]) {
    for (z, zh) in z.iter().zip(zh) {
        *zh = *z - a * *z - carry * (*z - *zh);
    }
}

/// `z = zh + a Dx+ u`; at the end of the row periodic, or 0.
#[inline(always)]
pub(crate) fn forward_x<T: Real>(u: &[T], periodic: bool, zh: &[T], a: T, z: &mut [T]) {
    let n = u.len();
    for j in 0..n - 1 {
        z[j] = zh[j] + a * (u[j + 1] - u[j]);
    }
    z[n - 1] = if periodic { zh[n - 1] + a * (u[0] - u[n - 1]) } else { zh[n - 1] };
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

/// One half of a red-black sweep on a row: where `mask` is 1, `out` becomes the solution of its equation
/// `(t0 + t n) v = f + t (sum of the n neighbours)`, elsewhere it stays `v`. Without neighbours across the border.
#[inline(always)]
pub(crate) fn half_sweep<T: Real>(
    v: &[T],
    above: Option<&[T]>,
    below: Option<&[T]>,
    f: &[T],
    mask: &[T],
    [t0, t]: [T; 2],
    out: &mut [T],
) {
    let n = v.len();
    let (v, f, mask, out) = (&v[..n], &f[..n], &mask[..n], &mut out[..n]);
    let vertical = T::of((usize::from(above.is_some()) + usize::from(below.is_some())) as f64);
    // A missing row counts nothing.
    let own = |row: Option<&[T]>, j: usize| row.map_or(T::zero(), |row| row[j]);
    let end = |j: usize, beside: Option<usize>| {
        let sides = T::of(usize::from(beside.is_some()) as f64);
        let sum = own(above, j) + own(below, j) + beside.map_or(T::zero(), |k| v[k]);
        let new = (f[j] + t * sum) / (t0 + t * (vertical + sides));
        if mask[j] > T::zero() { new } else { v[j] }
    };
    (out[0], out[n - 1]) = (end(0, (n > 1).then_some(1)), end(n - 1, n.checked_sub(2)));
    let inverse = T::one() / (t0 + t * (vertical + T::of(2.0)));
    let zero = T::zero();
    match (above, below) {
        (Some(above), Some(below)) => {
            let (above, below) = (&above[..n], &below[..n]);
            for j in 1..n.max(1) - 1 {
                let new = (f[j] + t * ((v[j - 1] + v[j + 1]) + (above[j] + below[j]))) * inverse;
                out[j] = if mask[j] > zero { new } else { v[j] };
            }
        }
        (Some(one), None) | (None, Some(one)) => {
            let one = &one[..n];
            for j in 1..n.max(1) - 1 {
                let new = (f[j] + t * ((v[j - 1] + v[j + 1]) + one[j])) * inverse;
                out[j] = if mask[j] > zero { new } else { v[j] };
            }
        }
        (None, None) => {
            for j in 1..n.max(1) - 1 {
                let new = (f[j] + t * (v[j - 1] + v[j + 1])) * inverse;
                out[j] = if mask[j] > zero { new } else { v[j] };
            }
        }
    }
}
