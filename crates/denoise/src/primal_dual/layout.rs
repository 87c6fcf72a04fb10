//! Rows that hold all their components, so that bands of rows are one slice.

use photofit_scalar::Real;
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};

use crate::Shape;

/// Rows of a band.
pub(crate) const BAND: usize = 16;

/// Planes to rows: row by row, of each row the `planes` lanes.
pub(crate) fn to_rows<T: Real>(planes: &[T], width: usize, height: usize) -> Vec<T> {
    let count = planes.len() / (height * width);
    let mut out = vec![T::zero(); planes.len()];
    out.par_chunks_mut(count * width).enumerate().for_each(|(i, row)| {
        for (lane, out) in row.chunks_exact_mut(width).enumerate() {
            out.copy_from_slice(&planes[(lane * height + i) * width..][..width]);
        }
    });
    out
}

/// Inverse of [`to_rows`].
pub(crate) fn to_planes<T: Real>(rows_first: &[T], width: usize, height: usize) -> Vec<T> {
    let count = rows_first.len() / (height * width);
    let mut out = vec![T::zero(); rows_first.len()];
    out.par_chunks_mut(width).enumerate().for_each(|(k, out)| {
        let (lane, i) = (k / height, k % height);
        out.copy_from_slice(&rows_first[(i * count + lane) * width..][..width]);
    });
    out
}

/// Lane `lane` of row `i` of an array with `lanes` lanes.
#[inline(always)]
pub(crate) fn lane<T>(values: &[T], lanes: usize, width: usize, i: usize, lane: usize) -> &[T] {
    &values[(i * lanes + lane) * width..][..width]
}

/// `z += s Dx+ u`, Neumann.
#[inline(always)]
pub(crate) fn add_dx<T: Real>(u: &[T], s: T, z: &mut [T]) {
    let n = u.len();
    for ((z, a), b) in z[..n - 1].iter_mut().zip(&u[..n - 1]).zip(&u[1..]) {
        *z += s * (*b - *a);
    }
}

/// `z += s Dy+ u`, Neumann: nothing without a row below.
#[inline(always)]
pub(crate) fn add_dy<T: Real>(u: &[T], below: Option<&[T]>, s: T, z: &mut [T]) {
    if let Some(below) = below {
        for ((z, a), b) in z.iter_mut().zip(u).zip(below) {
            *z += s * (*b - *a);
        }
    }
}

/// `out += s Dx- w`, minus the adjoint of Dx+; the last column of `w` is not read.
#[inline(always)]
pub(crate) fn add_dx_backward<T: Real>(w: &[T], s: T, out: &mut [T]) {
    let n = w.len();
    if n == 1 {
        return;
    }
    out[0] += s * w[0];
    for ((o, a), b) in out[1..n - 1].iter_mut().zip(&w[..n - 2]).zip(&w[1..n - 1]) {
        *o += s * (*b - *a);
    }
    out[n - 1] -= s * w[n - 2];
}

/// `out += s Dy- w`, minus the adjoint of Dy+: `own` is `None` in the last row, `above` in the first.
#[inline(always)]
pub(crate) fn add_dy_backward<T: Real>(own: Option<&[T]>, above: Option<&[T]>, s: T, out: &mut [T]) {
    match (own, above) {
        (Some(own), Some(above)) => {
            for ((o, a), b) in out.iter_mut().zip(above).zip(own) {
                *o += s * (*b - *a);
            }
        }
        (Some(own), None) => {
            for (o, b) in out.iter_mut().zip(own) {
                *o += s * *b;
            }
        }
        (None, Some(above)) => {
            for (o, a) in out.iter_mut().zip(above) {
                *o -= s * *a;
            }
        }
        (None, None) => {}
    }
}

/// The largest and smallest weight of the data over the samples.
pub(crate) fn range<T: Real>(weight: &crate::admm::Weight<T>, shape: Shape) -> [f64; 2] {
    let values = (0..shape.len()).map(|k| weight.at(k, shape).f64());
    values.fold([f64::INFINITY, 0.0], |[low, high], v| [low.min(v), high.max(v)])
}
