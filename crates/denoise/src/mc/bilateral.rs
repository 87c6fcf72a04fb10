//! Means of a residual over the pixels around that look alike: a joint bilateral filter [@eisemann2004; @petschnigg2004]
//! without the pixel itself, at two widths at once.
//!
//! Likeness is judged by six feature planes and by one smoothed plane with a precision of its own at each pixel. A mean does not
//! average the pixel itself; only the likeness knows it, by about a twelfth of it in the smoothed plane. So the noise of a pixel is
//! nearly, not wholly, independent of its mean: their product is, on average, nearly that of the truth and the mean
//! (leave-one-out cross-validation). Comparing smoothed planes without the two pixels of a pair does not lower the error (tried).
//!
//! Pixels are copied with what is around into tiles whose size the compiler knows; pixels outside of the picture and holes
//! look like no other.

use crate::wide::{Kernel, run_widest};

/// Pixels on each side that are averaged at most.
pub(crate) const REACH: usize = 5;
/// Deviations of the two Gaussians of the distance, pixels.
pub(crate) const SIGMAS: [f32; 2] = [1.0, 3.0];
/// Squared distance up to which all pixels count, and those of the narrow mean; beyond it those of one colour of a chessboard, twice.
const NEAR: usize = 8;
/// Rows that are worked on together.
pub(crate) const ROWS: usize = 8;
/// Runs of a row of means: two widths of three channels.
pub(crate) const MEANS: usize = 6;
/// Pixels that are worked on together.
const TILE: usize = 64;
/// Columns of a tile with what is around.
const PAD: usize = 8;
const STRIDE: usize = TILE + 2 * PAD;
/// Planes of a tile: features, the smoothed plane, values.
const PLANES: usize = 10;
const GUIDE: usize = 6;
const VALUE: usize = 7;
const RUN: usize = PLANES * STRIDE;
/// The smoothed plane where there is no pixel.
pub(crate) const NOTHING: f32 = 1e6;
/// Sum of weights below which there is no mean.
const LEAST: f32 = 1e-3;

/// What is averaged, and by what likeness.
pub(crate) struct Bilateral<'a> {
    pub(crate) width: usize,
    /// Planes and the factors of their squared differences in the exponent; at most six.
    pub(crate) features: &'a [(&'a [f32], f32)],
    /// The smoothed plane, [`NOTHING`] at holes.
    pub(crate) guide: &'a [f32],
    /// 3 planes, 0 at holes.
    pub(crate) values: &'a [f32],
}

/// One pixel around: its place in a tile, weights of the narrow and the wide mean.
#[derive(Clone, Copy, Debug)]
struct Tap {
    offset: isize,
    gauss: [f32; 2],
}

/// The taps of every pixel.
pub(crate) struct Taps {
    near: Vec<Tap>,
    far: Vec<Tap>,
}

/// The scratch of one worker.
pub(crate) struct Tile {
    pixels: Vec<f32>,
    sums: Box<Sums>,
}

/// The sums of one run of pixels: weights and values of the narrow and the wide mean.
struct Sums {
    total: [[f32; TILE]; 2],
    sum: [[f32; TILE]; MEANS],
}

impl Default for Tile {
    fn default() -> Self {
        let sums = Sums { total: [[0.0; TILE]; 2], sum: [[0.0; TILE]; MEANS] };
        Self { pixels: vec![0.0; (ROWS + 2 * REACH) * RUN], sums: Box::new(sums) }
    }
}

impl Taps {
    pub(crate) fn new() -> Self {
        let (mut near, mut far) = (Vec::new(), Vec::new());
        let reach = REACH as isize;
        for (y, x) in (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (y, x))) {
            let d2 = (x * x + y * y) as usize;
            let is_near = d2 <= NEAR;
            if d2 == 0 || d2 > REACH * REACH || (!is_near && (x + y) % 2 != 0) {
                continue;
            }
            let doubled = if is_near { 1.0 } else { 2.0 };
            let gauss = SIGMAS.map(|sigma| doubled * (-0.5 * d2 as f32 / (sigma * sigma)).exp());
            let tap = Tap { offset: y * RUN as isize + x, gauss };
            if is_near { near.push(tap) } else { far.push(tap) }
        }
        Self { near, far }
    }
}

impl Bilateral<'_> {
    /// The means of at most `ROWS` rows from `y` on: for each row [`MEANS`] runs, 3 channels of each width. 0 where nothing around is like
    /// the pixel; where nothing in reach of the narrow mean is, it equals the wide one. `precision` is the factor of the squared difference of the smoothed plane, row by row.
    pub(crate) fn rows(&self, y: usize, taps: &Taps, precision: &[f32], tile: &mut Tile, out: &mut [f32]) {
        let width = self.width;
        for x in (0..width).step_by(TILE) {
            self.load(y, x, &mut tile.pixels);
            let count = TILE.min(width - x);
            let mut p = [0.0; TILE];
            for (r, (out, precision)) in
                out.chunks_mut(MEANS * width).zip(precision.chunks(width)).enumerate()
            {
                p[..count].iter_mut().zip(&precision[x..]).for_each(|(p, v)| *p = 0.125 * v);
                let own = (r + REACH) * RUN + PAD;
                run_widest(Row { pixels: &tile.pixels, own, taps, precision: &p, sums: &mut tile.sums });
                let Sums { total, sum } = &*tile.sums;
                let mean = |k: usize, t: usize, otherwise: f32| {
                    let weight = total[k / 3][t];
                    if weight > LEAST { sum[k][t] / weight } else { otherwise }
                };
                for c in 0..3 {
                    for t in 0..count {
                        let wide = mean(3 + c, t, 0.0);
                        out[(3 + c) * width + x + t] = wide;
                        out[c * width + x + t] = mean(c, t, wide);
                    }
                }
            }
        }
    }

    /// Copies the pixels from `(x, y)` on, and what is around.
    fn load(&self, y: usize, x: usize, pixels: &mut [f32]) {
        let (n, width) = (self.guide.len(), self.width);
        let height = n / width;
        let (from, to) = (x.saturating_sub(PAD), (x + TILE + PAD).min(width));
        let left = from + PAD - x;
        for (r, run) in pixels.chunks_mut(RUN).enumerate() {
            let inside = (r + y).checked_sub(REACH).filter(|v| *v < height);
            if inside.is_none() || to - from < STRIDE {
                run.fill(0.0);
                run[GUIDE * STRIDE..][..STRIDE].fill(NOTHING);
            }
            let Some(v) = inside else { continue };
            let mut copy = |p: usize, plane: &[f32], scale: f32| {
                let target = &mut run[p * STRIDE + left..][..to - from];
                for (t, v) in target.iter_mut().zip(&plane[v * width + from..]) {
                    *t = scale * v;
                }
            };
            for (p, (plane, scale)) in self.features.iter().enumerate().take(GUIDE) {
                copy(p, plane, (0.125 * scale).sqrt());
            }
            copy(GUIDE, self.guide, 1.0);
            self.values.chunks(n).enumerate().for_each(|(c, plane)| copy(VALUE + c, plane, 1.0));
        }
    }
}

/// All taps of one run of pixels from `own` on.
struct Row<'a> {
    pixels: &'a [f32],
    own: usize,
    taps: &'a Taps,
    precision: &'a [f32; TILE],
    sums: &'a mut Sums,
}

impl Kernel for Row<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { pixels, own, taps, precision, sums } = self;
        sums.total.as_flattened_mut().fill(0.0);
        sums.sum.as_flattened_mut().fill(0.0);
        // As many at once as the compiler still turns into vectors.
        let (groups, rest) = taps.near.as_chunks::<2>();
        for taps in groups {
            add::<2, true>(pixels, own, taps, precision, sums);
        }
        for tap in rest {
            add::<1, true>(pixels, own, &[*tap], precision, sums);
        }
        let (groups, rest) = taps.far.as_chunks::<4>();
        for taps in groups {
            add::<4, false>(pixels, own, taps, precision, sums);
        }
        for tap in rest {
            add::<1, false>(pixels, own, &[*tap], precision, sums);
        }
    }
}

/// Adds `N` taps to the sums of a run of pixels; of taps that are not near, to those of the wide mean.
#[inline(always)]
#[expect(clippy::needless_range_loop, reason = "loops over constant ranges become vectors, iterators do not")]
fn add<const N: usize, const NEAR: bool>(
    pixels: &[f32],
    own: usize,
    taps: &[Tap; N],
    precision: &[f32; TILE],
    sums: &mut Sums,
) {
    const SPAN: usize = (PLANES - 1) * STRIDE + TILE;
    let a = &pixels[own..][..SPAN];
    let b: [&[f32]; N] = std::array::from_fn(|k| &pixels[own.wrapping_add_signed(taps[k].offset)..][..SPAN]);
    // The wide, then the narrow weight and its three values.
    let mut added = [[0.0_f32; TILE]; 8];
    for t in 0..TILE {
        let mut sum = [0.0_f32; 8];
        for k in 0..N {
            let b = b[k];
            let guide = a[GUIDE * STRIDE + t] - b[GUIDE * STRIDE + t];
            let mut apart = precision[t] * (guide * guide);
            for p in 0..GUIDE {
                let d = a[p * STRIDE + t] - b[p * STRIDE + t];
                apart += d * d;
            }
            // (1 - t / 8)^8 in place of exp(-t): 0 from t = 8 on.
            let mut w = (1.0 - apart).max(0.0);
            w *= w;
            w *= w;
            w *= w;
            let wide = taps[k].gauss[1] * w;
            sum[0] += wide;
            for c in 0..3 {
                sum[1 + c] += wide * b[(VALUE + c) * STRIDE + t];
            }
            if NEAR {
                let narrow = taps[k].gauss[0] * w;
                sum[4] += narrow;
                for c in 0..3 {
                    sum[5 + c] += narrow * b[(VALUE + c) * STRIDE + t];
                }
            }
        }
        for j in 0..8 {
            added[j][t] = sum[j];
        }
    }
    let [narrow, wide] = &mut sums.total;
    for t in 0..TILE {
        wide[t] += added[0][t];
        narrow[t] += added[4][t];
    }
    for c in 0..3 {
        for t in 0..TILE {
            sums.sum[c][t] += added[5 + c][t];
            sums.sum[3 + c][t] += added[1 + c][t];
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
        let values: Vec<f32> = (0..3 * N).map(|i| known[i % N] * values[i % N]).collect();
        let guide: Vec<f32> = known.iter().map(|k| if *k > 0.0 { 0.0 } else { NOTHING }).collect();
        let bilateral =
            Bilateral { width: WIDTH, features: &[(feature, 10.0)], guide: &guide, values: &values };
        let (taps, mut tile, mut out) = (Taps::new(), Tile::default(), vec![0.0; MEANS * N]);
        for (k, out) in out.chunks_mut(MEANS * ROWS * WIDTH).enumerate() {
            bilateral.rows(k * ROWS, &taps, &vec![1.0; ROWS * WIDTH], &mut tile, out);
        }
        out
    }

    fn at(means: &[f32], k: usize, i: usize) -> f32 {
        means[(i / WIDTH * MEANS + 3 * k) * WIDTH + i % WIDTH]
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
            // A hole is like nothing around.
            let wanted = if i == hole { 0.0 } else { 2.0 + 5.0 * side(i) };
            assert!((at(&found, k, i) - wanted).abs() < 1e-4, "{k}, {i}: {}", at(&found, k, i));
        }
        values[own] = 1e6;
        let changed = means(&values, &feature, &known);
        for k in 0..2 {
            assert_eq!(at(&changed, k, own), at(&found, k, own), "its own value has no part in it");
            assert!(at(&changed, k, own + 1) > 1e3, "but in the mean beside");
        }
    }

    #[test]
    fn the_narrow_mean_is_the_wide_one_where_only_far_pixels_are_alike() {
        // A pixel whose likes begin three pixels away.
        let own = 20 * WIDTH + 40;
        let distance = |i: usize| (i % WIDTH).abs_diff(40).pow(2) + (i / WIDTH).abs_diff(20).pow(2);
        let feature: Vec<f32> =
            (0..N).map(|i| if i == own || distance(i) > NEAR { 0.0 } else { 100.0 }).collect();
        let values: Vec<f32> = (0..N).map(|i| (i % 7) as f32 + 1.0).collect();
        let found = means(&values, &feature, &vec![1.0; N]);
        assert!(at(&found, 1, own) > 1.0, "{}", at(&found, 1, own));
        assert_eq!(at(&found, 0, own), at(&found, 1, own));
    }

    #[test]
    fn tiles_give_the_means_of_a_plain_loop() {
        let height = 11;
        for width in [1, 63, 64, 65, 135, 136, 200] {
            let (n, mut rng) = (width * height, Rng::new(9, 0));
            let mut plane = |count: usize| (0..count).map(|_| rng.normal()).collect::<Vec<f32>>();
            let planes: Vec<(Vec<f32>, f32)> =
                (0..GUIDE).map(|k| (plane(n), 0.1 + 0.05 * k as f32)).collect();
            let features: Vec<(&[f32], f32)> = planes.iter().map(|(p, scale)| (&p[..], *scale)).collect();
            let (mut guide, values) = (plane(n), plane(3 * n));
            (0..n).filter(|i| i % 13 == 5).for_each(|i| guide[i] = NOTHING);
            let precision: Vec<f32> = plane(n).iter().map(|v| 0.2 + v * v).collect();
            let bilateral = Bilateral { width, features: &features, guide: &guide, values: &values };
            let (taps, mut tile, mut found) = (Taps::new(), Tile::default(), vec![0.0; MEANS * n]);
            for (k, out) in found.chunks_mut(MEANS * ROWS * width).enumerate() {
                let y = k * ROWS;
                bilateral.rows(y, &taps, &precision[y * width..], &mut tile, out);
            }
            for i in (0..n).filter(|i| guide[*i] < NOTHING) {
                let (x, y) = (i % width, i / width);
                let (mut sums, mut totals) = ([0.0_f64; MEANS], [0.0_f64; 2]);
                for j in (0..n).filter(|j| *j != i) {
                    let (dx, dy) = ((j % width).abs_diff(x), (j / width).abs_diff(y));
                    let d2 = dx * dx + dy * dy;
                    if d2 > REACH * REACH || d2 > NEAR && (dx + dy) % 2 != 0 {
                        continue;
                    }
                    let of = |p: &[f32]| f64::from(p[i] - p[j]).powi(2);
                    let apart = features.iter().map(|(p, scale)| f64::from(*scale) * of(p)).sum::<f64>()
                        + f64::from(precision[i]) * of(&guide);
                    let alike = (1.0 - apart / 8.0).max(0.0).powi(8);
                    for (k, sigma) in SIGMAS.into_iter().enumerate() {
                        let share = if d2 <= NEAR { 1.0 } else { 2.0 * k as f64 };
                        let weight = share * alike * (-0.5 * d2 as f64 / f64::from(sigma * sigma)).exp();
                        totals[k] += weight;
                        (0..3).for_each(|c| sums[3 * k + c] += weight * f64::from(values[c * n + j]));
                    }
                }
                // At the least sum of weights rounding decides.
                if totals.iter().any(|t| (t / f64::from(LEAST) - 1.0).abs() < 0.01) {
                    continue;
                }
                for c in 0..3 {
                    let mean = |k: usize, otherwise: f64| match totals[k] > f64::from(LEAST) {
                        true => sums[3 * k + c] / totals[k],
                        false => otherwise,
                    };
                    let wide = mean(1, 0.0);
                    for (k, wanted) in [mean(0, wide), wide].into_iter().enumerate() {
                        let got = f64::from(found[(y * MEANS + 3 * k + c) * width + x]);
                        assert!((got - wanted).abs() < 1e-3, "{width}: {got}, not {wanted} at {x}, {y}, {k}");
                    }
                }
            }
        }
    }

    #[test]
    fn the_squared_difference_is_the_error_plus_the_noise() {
        // White noise of variance 4 around 0: the narrow mean has the variance 4 sum w^2 / (sum w)^2.
        let mut rng = Rng::new(7, 0);
        let values: Vec<f32> = (0..N).map(|_| 2.0 * rng.normal()).collect();
        let found = means(&values, &vec![0.0; N], &vec![1.0; N]);
        let reach = REACH as i32;
        let far = |d: i32| d > NEAR as i32;
        let offsets = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (y, x)));
        let counted =
            offsets.filter(|(y, x)| !far(x * x + y * y) || (x + y) % 2 == 0).map(|(y, x)| x * x + y * y);
        let offsets: Vec<i32> = counted.filter(|d| *d > 0 && *d <= reach * reach).collect();
        for (k, sigma) in SIGMAS.into_iter().enumerate() {
            let doubled = |d: i32| if far(d) { 2.0 } else { 1.0 };
            // Beyond its pixels the narrow mean has no weight.
            let share = |d: i32| if k == 0 && far(d) { 0.0 } else { doubled(d) };
            let w = |d: &i32| share(*d) * f64::from(-0.5 * *d as f32 / (sigma * sigma)).exp();
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
