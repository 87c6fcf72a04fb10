//! Means of a residual over the pixels around that look alike: a joint bilateral filter [@eisemann2004; @petschnigg2004]
//! without the pixel itself, at two widths at once.
//!
//! Likeness is judged by planes with given scales (features) and by one smoothed plane with a precision of its own at each
//! pixel. The pixel itself has no part in its mean; were its weights independent of it, the squared difference between both would be, on
//! average, the error of the mean plus the noise of the pixel, whatever that is: means are compared without knowing the
//! noise (leave-one-out cross-validation). The smoothed plane holds a twelfth of the pixel, which favours means over none
//! where noise is alike in all channels.

use crate::wide::widest;
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};

/// Pixels on each side that are averaged at most.
pub(crate) const REACH: usize = 5;
/// Deviations of the two Gaussians of the distance, pixels.
pub(crate) const SIGMAS: [f32; 2] = [1.0, 3.0];
/// Planes of a result: two widths of three channels.
pub(crate) const PLANES: usize = 3 * SIGMAS.len();
/// Pixels that are worked on together.
const TILE: usize = 64;
/// Sum of weights below which there is no mean.
const LEAST: f32 = 1e-3;

/// What is averaged, and by what likeness.
pub(crate) struct Bilateral<'a> {
    pub(crate) width: usize,
    /// Planes and the factors of their squared differences in the exponent.
    pub(crate) features: &'a [(&'a [f32], f32)],
    /// The smoothed plane and its factor at each pixel.
    pub(crate) guide: &'a [f32],
    pub(crate) precision: &'a [f32],
    /// 1 at samples, 0 at holes.
    pub(crate) known: &'a [f32],
    /// 3 planes, 0 at holes.
    pub(crate) values: &'a [f32],
}

/// The sums of one tile.
struct Sums {
    exponent: [f32; TILE],
    total: [[f32; TILE]; SIGMAS.len()],
    sum: [[f32; TILE]; PLANES],
}

impl Bilateral<'_> {
    /// The means, row by row: 3 channels of each width. 0 where nothing around is like the pixel.
    pub(crate) fn means(&self) -> Vec<f32> {
        let width = self.width;
        let mut out = vec![0.0; PLANES * self.known.len()];
        let gauss = SIGMAS.map(|sigma| {
            std::array::from_fn::<f32, { REACH * REACH + 1 }, _>(|d2| {
                (-0.5 * d2 as f32 / (sigma * sigma)).exp()
            })
        });
        out.par_chunks_mut(PLANES * width).enumerate().for_each(|(y, out)| {
            widest(|| {
                for x in (0..width).step_by(TILE) {
                    self.tile(y, x, &gauss, out);
                }
            });
        });
        out
    }

    /// The means of at most `TILE` pixels from `(x, y)` on.
    #[inline(always)]
    fn tile(&self, y: usize, x: usize, gauss: &[[f32; REACH * REACH + 1]; SIGMAS.len()], out: &mut [f32]) {
        let (width, height) = (self.width, self.known.len() / self.width);
        let count = TILE.min(width - x);
        let mut sums =
            Sums { exponent: [0.0; TILE], total: [[0.0; TILE]; SIGMAS.len()], sum: [[0.0; TILE]; PLANES] };
        for v in y.saturating_sub(REACH)..(y + REACH + 1).min(height) {
            let dy = v.abs_diff(y);
            for dx in 0..=2 * REACH {
                let d2 = dy * dy + dx.abs_diff(REACH).pow(2);
                if d2 == 0 || d2 > REACH * REACH {
                    continue;
                }
                // Of the tile those pixels whose neighbour lies inside.
                let first = REACH.saturating_sub(x + dx);
                let last = count.min((width + REACH).saturating_sub(x + dx));
                if first < last {
                    let weights = [gauss[0][d2], gauss[1][d2]];
                    let own = y * width + x + first;
                    self.add(
                        own,
                        v * width + x + first + dx - REACH,
                        last - first,
                        first,
                        weights,
                        &mut sums,
                    );
                }
            }
        }
        for (k, (total, sum)) in sums.total.iter().zip(sums.sum.chunks(3)).enumerate() {
            for (c, sum) in sum.iter().enumerate() {
                let out = &mut out[(3 * k + c) * width + x..][..count];
                for ((o, s), t) in out.iter_mut().zip(sum).zip(total) {
                    *o = if *t > LEAST { s / t } else { 0.0 };
                }
            }
        }
    }

    /// Adds the neighbours from `other` on to the pixels from `own` on, which are those from `first` on in the tile.
    #[inline(always)]
    fn add(
        &self,
        own: usize,
        other: usize,
        count: usize,
        first: usize,
        gauss: [f32; SIGMAS.len()],
        sums: &mut Sums,
    ) {
        let n = self.known.len();
        let exponent = &mut sums.exponent[..count];
        let (a, b, p) =
            (&self.guide[own..][..count], &self.guide[other..][..count], &self.precision[own..][..count]);
        for (((e, a), b), p) in exponent.iter_mut().zip(a).zip(b).zip(p) {
            *e = p * ((a - b) * (a - b));
        }
        for (plane, scale) in self.features {
            let (a, b) = (&plane[own..][..count], &plane[other..][..count]);
            for ((e, a), b) in exponent.iter_mut().zip(a).zip(b) {
                *e += scale * ((a - b) * (a - b));
            }
        }
        let known = &self.known[other..][..count];
        for (e, known) in exponent.iter_mut().zip(known) {
            // (1 - t / 8)^8 in place of exp(-t): 0 from t = 8 on.
            let mut w = (1.0 - 0.125 * *e).max(0.0);
            w *= w;
            w *= w;
            *e = known * (w * w);
        }
        for (total, gauss) in sums.total.iter_mut().zip(gauss) {
            for (t, w) in total[first..][..count].iter_mut().zip(&*exponent) {
                *t += gauss * w;
            }
        }
        for c in 0..3 {
            let values = &self.values[c * n + other..][..count];
            for (k, gauss) in gauss.into_iter().enumerate() {
                let sum = &mut sums.sum[3 * k + c][first..][..count];
                for ((s, w), v) in sum.iter_mut().zip(&*exponent).zip(values) {
                    *s += gauss * (w * v);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::Rng;

    const WIDTH: usize = 75;
    const HEIGHT: usize = 40;
    const N: usize = WIDTH * HEIGHT;

    /// The means of `values` (one plane, as all channels) by one feature.
    fn means(values: &[f32], feature: &[f32], known: &[f32]) -> Vec<f32> {
        let zeros = vec![0.0; N];
        let values: Vec<f32> = (0..3 * N).map(|i| known[i % N] * values[i % N]).collect();
        let features = [(feature, 10.0)];
        let (width, guide, precision) = (WIDTH, &zeros[..], &zeros[..]);
        Bilateral { width, features: &features, guide, precision, known, values: &values }.means()
    }

    fn at(means: &[f32], k: usize, i: usize) -> f32 {
        means[(i / WIDTH * PLANES + 3 * k) * WIDTH + i % WIDTH]
    }

    #[test]
    fn constants_stay_and_no_mean_crosses_an_edge_or_reads_a_hole_or_itself() {
        let side = |i: usize| if i % WIDTH < 31 { 0.0 } else { 1.0 };
        let feature: Vec<f32> = (0..N).map(side).collect();
        let mut values: Vec<f32> = (0..N).map(|i| 2.0 + 5.0 * side(i)).collect();
        let (mut known, hole, own) = (vec![1.0; N], 7 * WIDTH + 9, 20 * WIDTH + 64);
        (values[hole], known[hole]) = (1e6, 0.0);
        let found = means(&values, &feature, &known);
        for (k, i) in (0..2).flat_map(|k| (0..N).map(move |i| (k, i))) {
            assert!(
                (at(&found, k, i) - (2.0 + 5.0 * side(i))).abs() < 1e-4,
                "{k}, {i}: {}",
                at(&found, k, i)
            );
        }
        values[own] = 1e6;
        let changed = means(&values, &feature, &known);
        for k in 0..2 {
            assert_eq!(at(&changed, k, own), at(&found, k, own), "its own value has no part in it");
            assert!(at(&changed, k, own + 1) > 1e3, "but in the mean beside");
        }
    }

    #[test]
    fn the_squared_difference_is_the_error_plus_the_noise() {
        // White noise of variance 4 around 0: the narrow mean has the variance 4 sum w^2 / (sum w)^2.
        let mut rng = Rng::new(7, 0);
        let values: Vec<f32> = (0..N).map(|_| 2.0 * rng.normal()).collect();
        let found = means(&values, &vec![0.0; N], &vec![1.0; N]);
        let reach = REACH as i32;
        let offsets = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| x * x + y * y));
        let offsets: Vec<i32> = offsets.filter(|d| *d > 0 && *d <= reach * reach).collect();
        for (k, sigma) in SIGMAS.into_iter().enumerate() {
            let w = |d: &i32| f64::from(-0.5 * *d as f32 / (sigma * sigma)).exp();
            let (sum, square) =
                (offsets.iter().map(w).sum::<f64>(), offsets.iter().map(|d| w(d).powi(2)).sum::<f64>());
            let error = 4.0 * square / (sum * sum);
            let inner = |i: &usize| {
                (REACH..WIDTH - REACH).contains(&(i % WIDTH))
                    && (REACH..HEIGHT - REACH).contains(&(i / WIDTH))
            };
            let inner: Vec<usize> = (0..N).filter(inner).collect();
            let of = |i: &usize| f64::from(values[*i] - at(&found, k, *i)).powi(2);
            let mean = inner.iter().map(of).sum::<f64>() / inner.len() as f64;
            assert!((mean / (4.0 + error) - 1.0).abs() < 0.08, "{mean} against {}", 4.0 + error);
        }
    }
}
