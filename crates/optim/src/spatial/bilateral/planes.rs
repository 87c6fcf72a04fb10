//! Channels of a grid as planes, row by row.

use photofit_scalar::Real;
use rayon::prelude::*;

/// Rows are a multiple of this long.
const TILE: usize = 32;

/// Value of the first guide channel beyond the ends of a row: at weight zero from everything in it.
const OUTSIDE: f64 = 1e18;

/// Planes of a grid, row by row: sample `x` of plane `p` of row `r` lies at `(r planes + p) pitch + pad + x`.
///
/// Rows are padded on both sides by the reach of the widest level, so that the loop over columns has no branches.
#[derive(Clone, Debug, Default)]
pub(super) struct Planes<T> {
    pub(super) planes: usize,
    pub(super) pad: usize,
    pub(super) pitch: usize,
    pub(super) data: Vec<T>,
}

/// One row of all planes.
pub(super) struct RowMut<'a, T> {
    pub(super) index: usize,
    pad: usize,
    pitch: usize,
    data: &'a mut [T],
}

impl<T: Real> Planes<T> {
    /// For `rows` rows of `nx` samples; contents are kept when the shape is.
    pub(super) fn shape(&mut self, rows: usize, nx: usize, planes: usize, pad: usize) {
        let pitch = nx.next_multiple_of(TILE) + 2 * pad;
        let same = (self.planes, self.pad, self.pitch) == (planes, pad, pitch);
        if !(same && self.data.len() == rows * planes * pitch) {
            *self = Self { planes, pad, pitch, data: vec![T::zero(); rows * planes * pitch] };
        }
    }

    /// All rows, for parallel work.
    pub(super) fn rows_mut(&mut self) -> impl IndexedParallelIterator<Item = RowMut<'_, T>> {
        let (pad, pitch) = (self.pad, self.pitch);
        let rows = self.data.par_chunks_mut(self.planes * pitch).enumerate();
        rows.map(move |(index, data)| RowMut { index, pad, pitch, data })
    }

    /// Interleaves `width` planes from `first` on of row `r` to `out`, `nx` rows of `width` samples.
    pub(super) fn store(&self, r: usize, first: usize, width: usize, nx: usize, out: &mut [T]) {
        let plane = |c: usize| &self.data[(r * self.planes + first + c) * self.pitch + self.pad..][..nx];
        match width {
            1 => out.copy_from_slice(plane(0)),
            3 => {
                let planes = plane(0).iter().zip(plane(1)).zip(plane(2));
                for (out, ((a, b), c)) in out.as_chunks_mut::<3>().0.iter_mut().zip(planes) {
                    *out = [*a, *b, *c];
                }
            }
            4 => {
                let planes = plane(0).iter().zip(plane(1)).zip(plane(2)).zip(plane(3));
                for (out, (((a, b), c), d)) in out.as_chunks_mut::<4>().0.iter_mut().zip(planes) {
                    *out = [*a, *b, *c, *d];
                }
            }
            _ => {
                for c in 0..width {
                    out[c..].iter_mut().step_by(width).zip(plane(c)).for_each(|(out, x)| *out = *x);
                }
            }
        }
    }
}

impl<T: Real> RowMut<'_, T> {
    /// Spreads `values`, `nx` rows of `width` samples, over `width` planes from `first` on.
    pub(super) fn load(&mut self, first: usize, width: usize, nx: usize, values: &[T], map: impl Fn(T) -> T) {
        let (pad, pitch) = (self.pad, self.pitch);
        let mut planes =
            self.data[first * pitch..].chunks_exact_mut(pitch).map(|p| p[pad..pad + nx].iter_mut());
        match width {
            1 => planes.next().into_iter().flatten().zip(values).for_each(|(p, x)| *p = map(*x)),
            4 => {
                let four = [planes.next(), planes.next(), planes.next(), planes.next()];
                let [Some(a), Some(b), Some(c), Some(d)] = four else { return };
                for ((((a, b), c), d), x) in a.zip(b).zip(c).zip(d).zip(values.as_chunks::<4>().0) {
                    (*a, *b, *c, *d) = (map(x[0]), map(x[1]), map(x[2]), map(x[3]));
                }
            }
            3 => {
                let [Some(a), Some(b), Some(c)] = [planes.next(), planes.next(), planes.next()] else {
                    return;
                };
                for (((a, b), c), x) in a.zip(b).zip(c).zip(values.as_chunks::<3>().0) {
                    (*a, *b, *c) = (map(x[0]), map(x[1]), map(x[2]));
                }
            }
            _ => {
                for (c, plane) in planes.take(width).enumerate() {
                    plane.zip(values.chunks_exact(width)).for_each(|(p, x)| *p = map(x[c]));
                }
            }
        }
    }

    /// Puts everything beside the `nx` samples out of reach.
    pub(super) fn fence(&mut self, nx: usize) {
        let first = &mut self.data[..self.pitch];
        first[..self.pad].fill(T::of(OUTSIDE));
        first[self.pad + nx..].fill(T::of(OUTSIDE));
    }
}
