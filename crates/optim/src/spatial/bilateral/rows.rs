//! One level of the à-trous filter on rows of planes: the inner loop.

use super::exp::exp2_neg;
use super::planes::Planes;
use photofit_scalar::Real;
use rayon::prelude::*;

/// Columns that are worked on together: their sums stay in the nearest cache.
const SPAN: usize = 128;

/// Taps whose products are added in one pass over the sums.
const TAPS: usize = 3;

/// One neighbour of a row's samples: where it starts in the planes, and its weight by distance.
#[derive(Clone, Copy, Debug)]
struct Tap<T> {
    guide: usize,
    field: usize,
    weight: T,
}

/// One level: weights by distance along one axis, from `-radius` to `radius`, and the stride between taps.
#[derive(Clone, Copy, Debug)]
pub(super) struct Level<'a> {
    pub(super) taps: &'a [f64],
    pub(super) stride: usize,
}

/// Filters all planes of `fields` to `out`, guided by all planes of `guide`, on a grid of `shape` sites.
///
/// `F(x) = sum_y k w f(y) / sum_y k w`, `w = 2^-|guide_x - guide_y|`; neighbours outside the grid are left out.
pub(super) fn filter<T: Real>(
    shape: [usize; 3],
    level: Level<'_>,
    guide: &Planes<T>,
    fields: &Planes<T>,
    out: &mut Planes<T>,
) {
    let [nx, ny, nz] = shape;
    let row_length = out.planes * out.pitch;
    let mut rows: Vec<(usize, &mut [T])> = out.data.chunks_exact_mut(row_length).enumerate().collect();
    // Rows of the same phase one after the other: those that a tap apart meet in the cache.
    let s = level.stride;
    rows.sort_unstable_by_key(|(r, _)| {
        let (y, z) = (r % ny, r / ny);
        (z % s, y % s, z / s, y / s)
    });
    let run = |(r, out): (usize, &mut [T])| {
        let mut taps: Vec<Tap<T>> = Vec::with_capacity(125);
        let radius = level.taps.len() / 2;
        let reach = |at: usize, k: usize, n: usize| {
            let to = (at + k * s).checked_sub(radius * s)?;
            (to < n).then_some(to)
        };
        let (y, z) = (r % ny, r / ny);
        for (kz, wz) in level.taps.iter().enumerate() {
            let Some(z) = reach(z, kz, nz) else { continue };
            for (ky, wy) in level.taps.iter().enumerate() {
                let Some(y) = reach(y, ky, ny) else { continue };
                let row = z * ny + y;
                for (kx, wx) in level.taps.iter().enumerate() {
                    if kx.abs_diff(radius) * s >= nx && kx != radius {
                        continue;
                    }
                    let x = guide.pad + kx * s - radius * s;
                    taps.push(Tap {
                        guide: row * guide.planes * guide.pitch + x,
                        field: row * fields.planes * fields.pitch + x,
                        weight: T::of(wx * wy * wz),
                    });
                }
            }
        }
        let own = r * guide.planes * guide.pitch + guide.pad;
        let job = Job { guide, fields, own, taps: &taps };
        job.run(out);
    };
    rows.into_par_iter().with_min_len(4).for_each(run);
}

/// One row to filter.
#[derive(Clone, Copy)]
struct Job<'a, T> {
    guide: &'a Planes<T>,
    fields: &'a Planes<T>,
    own: usize,
    taps: &'a [Tap<T>],
}

impl<T: Real> Job<'_, T> {
    /// Filters all planes, as many together as there is code for, on the widest instructions of this machine: the same
    /// operations on every one of them, so the same bits.
    fn run(&self, out: &mut [T]) {
        let planes = self.fields.planes;
        let mut first = 0;
        while first < planes {
            first += match planes - first {
                1 => self.planes::<1>(first, out),
                2 | 3 => self.planes::<2>(first, out),
                4 | 5 => self.planes::<4>(first, out),
                6 | 7 => self.planes::<6>(first, out),
                _ => self.planes::<8>(first, out),
            };
        }
    }

    /// Filters `P` planes from `first` on; returns `P`.
    fn planes<const P: usize>(&self, first: usize, out: &mut [T]) -> usize {
        #[cfg(target_arch = "x86_64")]
        {
            if std::arch::is_x86_feature_detected!("avx512f") {
                #[expect(unsafe_code, reason = "calling a function compiled for AVX-512")]
                // SAFETY: the feature was just detected.
                unsafe {
                    self.tiles_avx512::<P>(first, out);
                }
                return P;
            }
            if std::arch::is_x86_feature_detected!("avx2") {
                #[expect(unsafe_code, reason = "calling a function compiled for AVX2")]
                // SAFETY: the feature was just detected.
                unsafe {
                    self.tiles_avx2::<P>(first, out);
                }
                return P;
            }
        }
        self.tiles::<P>(first, out);
        P
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f")]
    fn tiles_avx512<const P: usize>(&self, first: usize, out: &mut [T]) {
        self.tiles::<P>(first, out);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn tiles_avx2<const P: usize>(&self, first: usize, out: &mut [T]) {
        self.tiles::<P>(first, out);
    }

    #[inline(always)]
    fn tiles<const P: usize>(&self, first: usize, out: &mut [T]) {
        let (pad, pitch) = (self.fields.pad, self.fields.pitch);
        let width = pitch - 2 * pad;
        let mut w = [[T::zero(); SPAN]; TAPS];
        for x in (0..width).step_by(SPAN) {
            // Not known to the compiler: a loop of constant length is unrolled before it is vectorised.
            let n = (width - x).min(SPAN);
            let mut total = [T::zero(); SPAN];
            let mut sums = [[T::zero(); SPAN]; P];
            let (threes, rest) = self.taps.as_chunks::<TAPS>();
            for taps in threes {
                self.add::<P, TAPS>(taps, first, x, n, &mut w, &mut total, &mut sums);
            }
            for tap in rest {
                self.add::<P, 1>(&[*tap], first, x, n, &mut w, &mut total, &mut sums);
            }
            total[..n].iter_mut().for_each(|total| *total = T::one() / *total);
            for (p, sum) in sums.iter().enumerate() {
                let at = (first + p) * pitch + pad + x;
                for ((out, sum), inverse) in out[at..at + n].iter_mut().zip(&sum[..n]).zip(&total[..n]) {
                    *out = *sum * *inverse;
                }
            }
        }
    }

    /// Adds `K` taps to the sums of `n` columns from `x` on.
    #[inline(always)]
    fn add<const P: usize, const K: usize>(
        &self,
        taps: &[Tap<T>; K],
        first: usize,
        x: usize,
        n: usize,
        w: &mut [[T; SPAN]; TAPS],
        total: &mut [T; SPAN],
        sums: &mut [[T; SPAN]; P],
    ) {
        let pitch = self.fields.pitch;
        for (tap, w) in taps.iter().zip(w.iter_mut()) {
            self.weights(*tap, x, &mut w[..n]);
            total[..n].iter_mut().zip(&w[..n]).for_each(|(total, w)| *total += *w);
        }
        for (p, sum) in sums.iter_mut().enumerate() {
            let at = (first + p) * pitch + x;
            let mut pairs = taps.iter().zip(w.iter()).map(|(tap, w)| {
                let field = &self.fields.data[tap.field + at..][..n];
                w[..n].iter().zip(field)
            });
            // Zipped iterators have no bounds checks, which would end the vector loop early.
            match (K, pairs.next(), pairs.next(), pairs.next()) {
                (3, Some(a), Some(b), Some(c)) => {
                    for (((s, a), b), c) in sum[..n].iter_mut().zip(a).zip(b).zip(c) {
                        *s = *s + *a.0 * *a.1 + *b.0 * *b.1 + *c.0 * *c.1;
                    }
                }
                (_, Some(a), ..) => sum[..n].iter_mut().zip(a).for_each(|(s, (w, f))| *s += *w * *f),
                _ => {}
            }
        }
    }

    /// Weights of one tap for the columns from `x` on.
    #[inline(always)]
    fn weights(&self, tap: Tap<T>, x: usize, w: &mut [T]) {
        let n = w.len();
        let both = |c: usize| {
            let plane = |at: usize| &self.guide.data[at + c * self.guide.pitch + x..][..n];
            plane(self.own).iter().zip(plane(tap.guide))
        };
        let planes = self.guide.planes;
        if planes == 1 {
            for (w, (a, b)) in w.iter_mut().zip(both(0)) {
                *w = tap.weight * exp2_neg((*a - *b).abs());
            }
            return;
        }
        let square = |(a, b): (&T, &T)| (*a - *b) * (*a - *b);
        for ((w, first), second) in w.iter_mut().zip(both(0)).zip(both(1)) {
            *w = square(first) + square(second);
        }
        let mut c = 2;
        while c + 1 < planes {
            for ((w, first), second) in w.iter_mut().zip(both(c)).zip(both(c + 1)) {
                *w += square(first) + square(second);
            }
            c += 2;
        }
        if c < planes {
            w.iter_mut().zip(both(c)).for_each(|(w, pair)| *w += square(pair));
        }
        for w in w {
            *w = tap.weight * exp2_neg(w.sqrt());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_gradcheck::Uniform;

    #[test]
    #[cfg(target_arch = "x86_64")]
    fn wide_instructions_give_the_same_bits() {
        let mut rng = Uniform::new(1);
        let mut planes = |n: usize| {
            let mut planes = Planes::<f32>::default();
            planes.shape(1, 40, n, 8);
            planes.data.iter_mut().for_each(|x| *x = rng.range(-2.0, 2.0) as f32);
            planes
        };
        let (guide, fields) = (planes(3), planes(2));
        let tap = |x: usize| Tap { guide: x, field: x, weight: 0.1 + x as f32 };
        let taps: Vec<Tap<f32>> = [0, 3, 8, 13, 16].map(tap).to_vec();
        let job = Job { guide: &guide, fields: &fields, own: 8, taps: &taps };
        let mut out = [vec![0.0_f32; 160], vec![0.0; 160], vec![0.0; 160]];
        job.tiles::<2>(0, &mut out[0]);
        for (k, wide) in [(1, "avx2"), (2, "avx512f")] {
            #[expect(unsafe_code, reason = "calling functions compiled for wide instructions")]
            // SAFETY: the features are detected.
            unsafe {
                match wide {
                    "avx2" if std::arch::is_x86_feature_detected!("avx2") => {
                        job.tiles_avx2::<2>(0, &mut out[k])
                    }
                    "avx512f" if std::arch::is_x86_feature_detected!("avx512f") => {
                        job.tiles_avx512::<2>(0, &mut out[k]);
                    }
                    _ => job.tiles::<2>(0, &mut out[k]),
                }
            }
            assert!(out[0] == out[k] && out[0].iter().any(|x| *x != 0.0), "{wide}");
        }
    }
}
