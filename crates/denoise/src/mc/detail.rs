//! Light that the features do not explain, brought back from what the regression left over: shadows, reflections.
//!
//! With `u` the estimate and `y` the noisy irradiance, the residual `r = (y - u) / level` is averaged over the pixels around
//! whose features and whose residual, smoothed by a Gaussian, are alike ([`Bilateral`]): `w` in a wide window, `m` in a narrow one.
//! Neither averages the pixel itself; only the likeness knows it, by about a twelfth of it in the smoothed residual. So the noise of
//! `r` is nearly, not wholly, independent of both. `g w + h (m - w)` is added, with `g` and `h` between 0 and 1 that fit `r` best in
//! the window around: where the means are noise, they explain next to nothing of `r`, and `g` and `h` are near 0; no variance is
//! needed, and none that few samples tell badly is trusted.
//! Of the noise `v` the share `1 - v / e` of the rest is added then, `e` the mean square of that rest around the pixel (Wiener's filter
//! with a local estimate of the signal [@lee1980]). Relative residuals keep what is bright from reaching into what is dark.
//! In a sequence the residual of the history, which has less noise than the last frame and little of the same, tells likeness. What the
//! history explains is there already, and heavy-tailed noise of neighbours agrees by chance: of each sum of products `p` only
//! `p (1 - s / p^2)` counts, `s` its squared standard error (positive-part shrinkage). In a picture by itself the same lowers PSNR by
//! .02 to .08 dB on the scenes that constants are chosen on: its gains stay as they are.
//! Where the noise is not known pixel by pixel, Gaussian means take the place of the bilateral ones ([`significant`]).

use super::bilateral::{Bilateral, MEANS, NOTHING, ROWS, Taps, Tile};
use super::gaussian::significant;
use super::pooled::{Pooled, SIDE, Scratch, add_row};
use super::regression::RELATIVE_FLOOR;
use super::window::gaussian_taps;
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};

/// Largest residual, in levels and in means of the residuals around (within a window of the deviation `USUAL`, pixels): what is
/// beyond is a rare sample.
const MOST: [f32; 2] = [4.0, 3.0];
const USUAL: f32 = 4.0;
/// Variance over the squared value above which it may be one.
const SINGLE: f32 = 0.25;
/// Deviation of the window that pools the noise of pixels.
const POOL: f32 = 2.0;
/// Deviation of the Gaussian that smooths the residual for the likeness.
const GUIDE: f32 = 1.4;
/// Least and largest variance of a residual.
const VARIANCE: [f32; 2] = [1e-4, 1e3];
/// Deviation of the window in which the means have to explain the residual.
const EXPLAINED: f32 = 3.6;
/// Deviation of the window in which a pixel's own noise is judged; the larger of that and of [`POOL`] counts.
const OWN: f32 = 1.0;
/// The squared standard error of a windowed sum of products `r m` over the windowed sum of their squares. Were they independent, it would be
/// the share of the squared weights in the weights, .51 of this window of blocks. But `m_i` holds `r_j` as `m_j` holds `r_i`: each pair counts
/// in both products, which doubles it but for the fall of the window between the two (to .83 to .96, `detail/tests.rs`).
const CHANCE: f32 = 0.9;

/// What is known of the picture.
#[derive(Clone, Copy)]
pub(crate) struct Detail<'a> {
    pub(crate) width: usize,
    /// 3 planes.
    pub(crate) irradiance: &'a [f32],
    /// 0 at pixels without a sample, which stay.
    pub(crate) weight: &'a [f32],
    /// Of the irradiance, mean over the channels; `None` where it is not known pixel by pixel.
    pub(crate) variance: Option<&'a [f32]>,
    /// Pixels are samples of their own. Those of a history that was moved between pixels hang together, and of two halves too
    /// little is known of each.
    pub(crate) independent: bool,
    /// Planes and the factors of their squared differences in the exponent of a likeness.
    pub(crate) features: &'a [(&'a [f32], f32)],
    /// Above 0 in pixels that are like no other pixels; empty if there are none.
    pub(crate) apart: &'a [f32],
    /// The history of which `irradiance` is the last frame.
    pub(crate) history: Option<History<'a>>,
}

/// What the frames of a sequence tell, the last one among them.
#[derive(Clone, Copy)]
pub(crate) struct History<'a> {
    /// 3 planes.
    pub(crate) irradiance: &'a [f32],
    /// Of the irradiance, mean over the channels.
    pub(crate) variance: &'a [f32],
    /// Effective number of frames: 1 where only the last one shows a surface.
    pub(crate) frames: &'a [f32],
}

/// What was added.
pub(crate) enum Shares {
    /// Where the noise is not known: the mean share of the narrowest Gaussian mean.
    Gaussian(f32),
    /// The mean shares of the wide mean, of what the narrow one has more, and of a pixel's own residual.
    Bilateral { means: [f32; 2], own: f32 },
}

/// Adds to `estimate` (3 planes) what is significant in `irradiance - estimate`.
pub(crate) fn restore_detail(detail: &Detail<'_>, estimate: &mut [f32]) -> Shares {
    match detail.variance.filter(|_| detail.independent) {
        Some(variance) => Residual::of(detail, estimate, variance).restore(detail, estimate),
        None => restore_gaussian(detail, estimate),
    }
}

/// By Gaussian means alone.
fn restore_gaussian(detail: &Detail<'_>, estimate: &mut [f32]) -> Shares {
    let (n, width) = (detail.weight.len(), detail.width);
    let level: Vec<f32> = (0..n).map(|i| mean(estimate, i) + RELATIVE_FLOOR).collect();
    let known: Vec<f32> = detail.weight.iter().map(|w| if *w > 0.0 { 1.0 } else { 0.0 }).collect();
    let residual: Vec<f32> =
        (0..3 * n).map(|i| known[i % n] * (detail.irradiance[i] - estimate[i]) / level[i % n]).collect();
    let relative = |v: &[f32]| (0..n).map(|i| v[i] / (level[i] * level[i])).collect::<Vec<f32>>();
    let noise = detail.variance.map(relative);
    let (added, share) = significant(residual, &known, noise.as_deref(), width);
    for (i, (u, r)) in estimate.iter_mut().zip(&added).enumerate() {
        let i = i % n;
        *u = (*u + known[i] * r * level[i]).max(0.0);
    }
    Shares::Gaussian(share)
}

/// Mean over the channels.
fn mean(planes: &[f32], i: usize) -> f32 {
    let n = planes.len() / 3;
    (planes[i] + planes[n + i] + planes[2 * n + i]) * (1.0 / 3.0)
}

/// The relative residual of a picture.
struct Residual {
    width: usize,
    height: usize,
    /// 3 planes, 0 at holes.
    values: Vec<f32>,
    /// The relative variance of each pixel, 0 at holes.
    noise: Vec<f32>,
    /// Of blocks: the relative variance, and 1 at samples, in the window [`POOL`].
    pooled: Pooled<2>,
}

/// Row `y` of each of three planes.
fn row_of(planes: &[f32], y: usize, width: usize) -> [&[f32]; 3] {
    let n = planes.len() / 3;
    std::array::from_fn(|c| &planes[c * n + y * width..][..width])
}

/// Three planes by runs of `rows` rows.
fn thirds(planes: &mut [f32], run: usize) -> impl IndexedParallelIterator<Item = [&mut [f32]; 3]> {
    let n = planes.len() / 3;
    let (r, rest) = planes.split_at_mut(n);
    let (g, b) = rest.split_at_mut(n);
    r.par_chunks_mut(run).zip(g.par_chunks_mut(run)).zip(b.par_chunks_mut(run)).map(|((r, g), b)| [r, g, b])
}

impl Residual {
    fn of(detail: &Detail<'_>, estimate: &[f32], variance: &[f32]) -> Self {
        let (n, width) = (detail.weight.len(), detail.width);
        let height = n / width;
        let (mut values, mut noise) = (vec![0.0; 3 * n], vec![0.0; n]);
        let mut usual = Pooled::<2>::new(width, height);
        let mut pooled = Pooled::<2>::new(width, height);
        let run = SIDE * width;
        let targets = thirds(&mut values, run).zip(noise.par_chunks_mut(run));
        let scratch = || vec![0.0; 4 * width];
        targets.zip(usual.rows().zip(pooled.rows())).enumerate().for_each_init(
            scratch,
            |scratch, (block, ((mut out, noise), (usual, pooled)))| {
                for (k, noise) in noise.chunks_mut(width).enumerate() {
                    let y = SIDE * block + k;
                    let (u, v) = (row_of(estimate, y, width), row_of(detail.irradiance, y, width));
                    let weight = &detail.weight[y * width..][..width];
                    let [r, g, b] = out.each_mut().map(|p| &mut p[k * width..][..width]);
                    let (size, rest) = scratch.split_at_mut(width);
                    let (known, own) = rest.split_at_mut(width);
                    let (own, known_again) = own.split_at_mut(width);
                    for x in 0..width {
                        let is_known = if weight[x] > 0.0 { 1.0 } else { 0.0 };
                        let scale = 1.0 / ((u[0][x] + u[1][x] + u[2][x]) * (1.0 / 3.0) + RELATIVE_FLOOR);
                        let factor = is_known * scale;
                        r[x] = factor * (v[0][x] - u[0][x]);
                        g[x] = factor * (v[1][x] - u[1][x]);
                        b[x] = factor * (v[2][x] - u[2][x]);
                        size[x] = ((r[x].abs() + g[x].abs() + b[x].abs()) * (1.0 / 3.0)).min(MOST[0]);
                        known[x] = is_known;
                        known_again[x] = is_known;
                        noise[x] = factor * scale * variance[y * width + x];
                        own[x] = noise[x];
                    }
                    add_row(usual, &scratch[..2 * width], width);
                    add_row(pooled, &scratch[2 * width..], width);
                }
            },
        );
        usual.smooth(USUAL);
        pooled.smooth(POOL);
        let mut residual = Self { width, height, values, noise, pooled };
        residual.bound(detail, variance, &usual);
        residual
    }

    /// Cuts residuals that stand out, where the noise says that a pixel has most of its light from one sample.
    fn bound(&mut self, detail: &Detail<'_>, variance: &[f32], usual: &Pooled<2>) {
        let width = self.width;
        let scratch = || (Scratch::default(), vec![0.0; width]);
        thirds(&mut self.values, width).enumerate().with_min_len(8).for_each_init(
            scratch,
            |(scratch, line), (y, [r, g, b])| {
                usual.mean_row(0, 1, y, scratch, line);
                let v = row_of(detail.irradiance, y, width);
                let variance = &variance[y * width..][..width];
                for x in 0..width {
                    let level = (v[0][x] + v[1][x] + v[2][x]) * (1.0 / 3.0);
                    let rare = variance[x] > SINGLE * level * level;
                    let limit = if rare { MOST[0].min(MOST[1] * line[x]) } else { f32::MAX };
                    r[x] = r[x].clamp(-limit, limit);
                    g[x] = g[x].clamp(-limit, limit);
                    b[x] = b[x].clamp(-limit, limit);
                }
            },
        );
    }

    /// The Gaussian mean of the mean of `values` (3 planes) over the channels; [`NOTHING`] at holes, [`APART`] more where pixels are apart.
    fn guide(&self, detail: &Detail<'_>, values: &[f32]) -> Vec<f32> {
        let taps = &gaussian_taps(GUIDE)[..];
        let (width, n) = (self.width, self.noise.len());
        let (mut along, mut count) = (vec![0.0; n], vec![0.0; n]);
        let rows = along.par_chunks_mut(width).zip(count.par_chunks_mut(width));
        let scratch = || (vec![0.0; width], vec![0.0; width]);
        rows.enumerate().with_min_len(8).for_each_init(scratch, |(part, known), (y, (along, count))| {
            let [r, g, b] = row_of(values, y, width);
            for x in 0..width {
                part[x] = (r[x] + g[x] + b[x]) * (1.0 / 3.0);
                known[x] = if detail.weight[y * width + x] > 0.0 { 1.0 } else { 0.0 };
            }
            blur_row(part, taps, along);
            blur_row(known, taps, count);
        });
        let mut guide = vec![0.0; n];
        let scratch = || vec![0.0; width];
        guide.par_chunks_mut(width).enumerate().with_min_len(8).for_each_init(
            scratch,
            |total, (y, guide)| {
                blur_column(&along, taps, y, width, guide);
                blur_column(&count, taps, y, width, total);
                let at = y * width;
                for (x, g) in guide.iter_mut().enumerate() {
                    *g = if detail.weight[at + x] > 0.0 { *g / total[x] } else { NOTHING };
                }
                if let Some(apart) = detail.apart.get(at..at + width) {
                    guide.iter_mut().zip(apart).filter(|(_, a)| **a > 0.0).for_each(|(g, _)| *g += APART);
                }
            },
        );
        guide
    }

    fn restore(self, detail: &Detail<'_>, estimate: &mut [f32]) -> Shares {
        let history = detail.history.map(|History { irradiance, variance, .. }| {
            Self::of(&Detail { irradiance, ..*detail }, estimate, variance)
        });
        let (mut means, products) = self.explained(detail, history.as_ref().unwrap_or(&self));
        let gains = products.map(|[ww, rw, dd, rd, wd, rw2, rd2]| {
            let beyond = |sum: f32, squares: f32| match sum * sum > CHANCE * squares {
                true => sum - CHANCE * squares / sum,
                false => 0.0,
            };
            gains([ww, beyond(rw, rw2), dd, beyond(rd, rd2), wd])
        });
        self.mix(&gains, &mut means);
        let shares = [0, 1].map(|k| {
            let all = (0..gains.blocks()).map(|b| f64::from(gains.at(k, b))).sum::<f64>();
            (all / gains.blocks() as f64) as f32
        });
        let own = self.add_own(detail, &means, estimate);
        Shares::Bilateral { means: shares, own }
    }

    /// The narrow and the wide mean of each row, by what is alike in `alike`, and of blocks, in the window [`EXPLAINED`], what
    /// [`Self::products`] says.
    fn explained(&self, detail: &Detail<'_>, alike: &Self) -> (Vec<f32>, Pooled<7>) {
        let (width, height) = (self.width, self.height);
        let guide = self.guide(detail, &alike.values);
        let bilateral = Bilateral { width, features: detail.features, guide: &guide, values: &self.values };
        // Half the squared difference over twice the variance of the smoothed residual.
        let pixels = std::f32::consts::PI * GUIDE * GUIDE;
        let taps = Taps::new();
        let mut means = vec![0.0; MEANS * self.noise.len()];
        let mut products = Pooled::<7>::new(width, height);
        let per_run = 7 * products.columns * (ROWS / SIDE);
        let scratch = || (Tile::default(), Scratch::default(), vec![0.0; ROWS * width], vec![0.0; 7 * width]);
        means
            .par_chunks_mut(MEANS * ROWS * width)
            .zip(products.sums.par_chunks_mut(per_run))
            .enumerate()
            .for_each_init(scratch, |(tile, scratch, precision, line), (k, (means, products))| {
                let y = k * ROWS;
                let rows = means.len() / (MEANS * width);
                for (r, precision) in precision.chunks_mut(width).enumerate().take(rows) {
                    alike.pooled.mean_row(0, 1, y + r, scratch, precision);
                    precision.iter_mut().for_each(|v| *v = pixels / v.clamp(VARIANCE[0], VARIANCE[1]));
                }
                bilateral.rows(y, &taps, precision, tile, means);
                for (r, means) in means.chunks(MEANS * width).enumerate() {
                    let from = r / SIDE * (products.len() / rows.div_ceil(SIDE));
                    self.products(y + r, detail, means, line);
                    add_row(
                        &mut products[from..][..line.len().div_ceil(width) * width.div_ceil(SIDE)],
                        line,
                        width,
                    );
                }
            });
        products.smooth(EXPLAINED);
        (means, products)
    }

    /// The products of the residual `r`, the wide mean `w` and `d`, what the narrow one has more: `ww, rw, dd, rd, wd` of a row,
    /// summed over the channels, and the squares of `rw` and `rd` as far as there is a history (0 without one).
    fn products(&self, y: usize, detail: &Detail<'_>, means: &[f32], out: &mut [f32]) {
        let width = self.width;
        out.fill(0.0);
        let [ww, rw, dd, rd, wd, rw2, rd2] = cut::<7>(out, width);
        let weight = &detail.weight[y * width..][..width];
        for (c, r) in row_of(&self.values, y, width).into_iter().enumerate() {
            let (narrow, wide) = (&means[c * width..][..width], &means[(3 + c) * width..][..width]);
            for x in 0..width {
                let known = if weight[x] > 0.0 { 1.0 } else { 0.0 };
                let (w, d) = (known * wide[x], known * (narrow[x] - wide[x]));
                ww[x] += w * w;
                rw[x] += r[x] * w;
                dd[x] += d * d;
                rd[x] += r[x] * d;
                wd[x] += w * d;
            }
        }
        let Some(History { frames, .. }) = detail.history else { return };
        let frames = &frames[y * width..][..width];
        for x in 0..width {
            let earlier = 1.0 - 1.0 / frames[x].max(1.0);
            rw2[x] = earlier * rw[x] * rw[x];
            rd2[x] = earlier * rd[x] * rd[x];
        }
    }

    /// Writes the mixture of both means over the first three runs of each row of `means`.
    fn mix(&self, gains: &Pooled<2>, means: &mut [f32]) {
        let width = self.width;
        let scratch = || (Scratch::default(), vec![0.0; width], vec![0.0; width]);
        means.par_chunks_mut(MEANS * width).enumerate().with_min_len(8).for_each_init(
            scratch,
            |(scratch, g, h), (y, means)| {
                gains.row(0, y, &mut scratch.line, g);
                gains.row(1, y, &mut scratch.line, h);
                let (narrow, wide) = means.split_at_mut(3 * width);
                for (narrow, wide) in narrow.chunks_mut(width).zip(wide.chunks(width)) {
                    for x in 0..width {
                        narrow[x] = g[x] * wide[x] + h[x] * (narrow[x] - wide[x]);
                    }
                }
            },
        );
    }

    /// Adds to the estimate the mixture of the means and, of each pixel's own residual, what its noise does not explain; the mean share.
    fn add_own(&self, detail: &Detail<'_>, means: &[f32], estimate: &mut [f32]) -> f32 {
        let (width, n) = (self.width, self.noise.len());
        let taps = gaussian_taps(OWN);
        let mut blurred = [(); 3].map(|()| vec![0.0; n]);
        let [left, noise, count] = &mut blurred;
        let rows =
            left.par_chunks_mut(width).zip(noise.par_chunks_mut(width)).zip(count.par_chunks_mut(width));
        let scratch = || (vec![0.0; width], vec![0.0; width]);
        rows.enumerate().with_min_len(8).for_each_init(
            scratch,
            |(square, known), (y, ((left, noise), count))| {
                let [r, g, b] = row_of(&self.values, y, width);
                let means = &means[MEANS * y * width..][..3 * width];
                let weight = &detail.weight[y * width..][..width];
                for x in 0..width {
                    let d = [r[x] - means[x], g[x] - means[width + x], b[x] - means[2 * width + x]];
                    known[x] = if weight[x] > 0.0 { 1.0 } else { 0.0 };
                    square[x] = known[x] * (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) * (1.0 / 3.0);
                }
                blur_row(square, &taps, left);
                blur_row(&self.noise[y * width..][..width], &taps, noise);
                blur_row(known, &taps, count);
            },
        );
        let [left, noise, count] = &blurred;
        let mut gains = vec![0.0_f32; self.height];
        let scratch = || (Scratch::default(), [(); 4].map(|()| vec![0.0; width]));
        thirds(estimate, width).zip(&mut gains).enumerate().with_min_len(8).for_each_init(
            scratch,
            |(scratch, [e, near, total, far]), (y, (out, gains))| {
                blur_column(left, &taps, y, width, e);
                blur_column(noise, &taps, y, width, near);
                blur_column(count, &taps, y, width, total);
                self.pooled.mean_row(0, 1, y, scratch, far);
                let weight = &detail.weight[y * width..][..width];
                // A few samples that agree by chance look as if they had no noise.
                for x in 0..width {
                    let noise = near[x].max(far[x] * total[x]);
                    let known = weight[x] > 0.0 && e[x] > 0.0;
                    e[x] = if known { (1.0 - noise / e[x]).max(0.0) } else { 0.0 };
                }
                *gains = e.iter().sum();
                let [r, g, b] = out;
                for x in 0..width {
                    near[x] = (r[x] + g[x] + b[x]) * (1.0 / 3.0) + RELATIVE_FLOOR;
                    near[x] *= if weight[x] > 0.0 { 1.0 } else { 0.0 };
                }
                let means = &means[MEANS * y * width..][..3 * width];
                let residual = row_of(&self.values, y, width);
                for ((out, m), r) in [r, g, b].into_iter().zip(means.chunks(width)).zip(residual) {
                    for x in 0..width {
                        let added = m[x] + e[x] * (r[x] - m[x]);
                        out[x] = (out[x] + near[x] * added).max(0.0);
                    }
                }
            },
        );
        (gains.iter().map(|g| f64::from(*g)).sum::<f64>() / n as f64) as f32
    }
}

/// Added to the smoothed residual of pixels apart: no other is as large.
const APART: f32 = 256.0;

/// The shares `g`, `h` in 0..=1 of the wide mean `w` and of what the narrow one has more, `d`, that fit the residual `r` best:
/// the least squares of `r - g w - h d`, inside of the square or on one of its edges.
fn gains(products: [f32; 5]) -> [f32; 2] {
    let [ww, rw, dd, rd, wd] = products.map(f64::from);
    let ratio = |a: f64, b: f64| if b > 1e-12 { a / b } else { 0.0 };
    let determinant = ww * dd - wd * wd;
    if determinant > 1e-6 * ww * dd {
        let inside = [(rw * dd - rd * wd) / determinant, (rd * ww - rw * wd) / determinant];
        if inside.iter().all(|share| (0.0..=1.0).contains(share)) {
            return inside.map(|share| share as f32);
        }
    }
    let across = |h: f64| [ratio(rw - h * wd, ww).clamp(0.0, 1.0), h];
    let along = |g: f64| [g, ratio(rd - g * wd, dd).clamp(0.0, 1.0)];
    let error = |[g, h]: [f64; 2]| g * (g * ww - 2.0 * rw) + h * (h * dd - 2.0 * rd) + 2.0 * g * h * wd;
    let mut best = across(0.0);
    for edge in [along(0.0), along(1.0), across(1.0)] {
        if error(edge) < error(best) {
            best = edge;
        }
    }
    best.map(|share| share as f32)
}

/// A row as `N` runs.
fn cut<const N: usize>(row: &mut [f32], width: usize) -> [&mut [f32]; N] {
    let mut runs = row.chunks_mut(width);
    std::array::from_fn(|_| runs.next().unwrap_or_default())
}

/// Blurs a row; what lies outside is 0.
fn blur_row(row: &[f32], taps: &[f32], out: &mut [f32]) {
    for (o, v) in out.iter_mut().zip(row) {
        *o = taps[0] * *v;
    }
    for (k, t) in taps.iter().enumerate().skip(1).filter(|(k, _)| *k < row.len()) {
        for (o, v) in out[k..].iter_mut().zip(row) {
            *o += *t * *v;
        }
        for (o, v) in out.iter_mut().zip(&row[k..]) {
            *o += *t * *v;
        }
    }
}

/// Row `y` of a plane blurred down its columns; what lies outside is 0.
fn blur_column(plane: &[f32], taps: &[f32], y: usize, width: usize, out: &mut [f32]) {
    let height = plane.len() / width;
    let row = |y: usize| &plane[y * width..][..width];
    for (o, v) in out.iter_mut().zip(row(y)) {
        *o = taps[0] * *v;
    }
    for (k, t) in taps.iter().enumerate().skip(1) {
        for y in [y.checked_sub(k), Some(y + k).filter(|y| *y < height)].into_iter().flatten() {
            for (o, v) in out.iter_mut().zip(row(y)) {
                *o += *t * *v;
            }
        }
    }
}

#[cfg(test)]
mod tests;
