//! Edges of features that were sampled at pixel centres: smoothed, or taken from the noisy picture, as far as the noise
//! allows.
//!
//! A renderer averages colours over a pixel, but features often hold the pixel's centre alone; the product with such an
//! albedo has jagged edges that no number of samples removes. With `u` the estimate, `y` the noisy picture, `d = blur(u) - u`
//! for the 3 x 3 binomial blur and `r = y - u`, the result is `u + a d + b r`. The noise of a pixel is independent of
//! the truth and nearly so of `u`, so the expected squared error is a quadratic form in `a`, `b` that sums over the
//! picture tell (Stein's unbiased estimate [@stein1981]):
//!
//! ```text
//! [ sum d d   sum d r ] [a]   [ sum d r         ]
//! [ sum d r   sum r r ] [b] = [ sum r r - sum n ]      n: variance of the noise
//! ```
//!
//! Pixels are sorted by the strength of their edge, `|d|` over the level, and each class has its own `a` and `b`:
//! antialiased features give `a = b = 0`, many samples `b -> 1` on the edges. Where the variance is not known `b` is 0.

use super::pooled::Pooled;
use super::regression::RELATIVE_FLOOR;
use crate::Shape;
use rayon::prelude::{
    IndexedParallelIterator, IntoParallelIterator, ParallelIterator, ParallelSlice, ParallelSliceMut,
};

/// Upper bounds of the classes but the last in `|d|` over the level; pixels of the first are smooth.
const BOUNDS: [f32; 5] = [0.02, 0.05, 0.1, 0.2, 0.4];
const CLASSES: usize = BOUNDS.len() + 1;
/// Standard errors that a correction must exceed.
const ERRORS: f64 = 2.0;

/// What was mixed in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct EdgeShares {
    /// Share of the blur in each class of edges.
    pub(crate) blur: [f32; CLASSES],
    /// Share of the noisy picture.
    pub(crate) noisy: [f32; CLASSES],
    /// Share of the pixels that lie on edges.
    pub(crate) edges: f32,
}

/// Sums of one class: `d d`, `d r`, `r r`, noise, and the squares of the products' terms.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    dd: f64,
    dr: f64,
    rr: f64,
    noise: f64,
    dr2: f64,
    rr2: f64,
    pixels: f64,
}

/// Corrects the edges of `color` (3 planes) by `noisy`; pixels of weight 0 have no sample. `variance` is that of `noisy`,
/// mean over the channels.
pub(crate) fn correct_edges(
    shape: Shape,
    color: &mut [f32],
    noisy: &[f32],
    weight: &[f32],
    variance: Option<&[f32]>,
) -> EdgeShares {
    let (n, width) = (shape.pixels(), shape.width);
    let change = blurred_difference(shape, color);
    let picture = Picture { shape, color, noisy, weight, change: &change, variance };
    let mut class = vec![0_u8; n];
    class.par_chunks_mut(width).enumerate().for_each(|(y, row)| picture.classify(y, row));
    let rows: Vec<[Sums; CLASSES]> =
        (0..shape.height).into_par_iter().map(|y| picture.sums(y, &class)).collect();
    let mut total = [Sums::default(); CLASSES];
    for row in &rows {
        total.iter_mut().zip(row).for_each(|(t, s)| t.add(s));
    }
    let solved = total.map(|s| s.solve());
    let shares = EdgeShares {
        blur: solved.map(|s| s[0]),
        noisy: solved.map(|s| s[1]),
        edges: (total[1..].iter().map(|s| s.pixels).sum::<f64>() / n as f64) as f32,
    };
    if solved.iter().all(|s| *s == [0.0; 2]) {
        return shares;
    }
    for (c, u) in color.chunks_mut(n).enumerate() {
        let (d, y) = (&change[c * n..][..n], &noisy[c * n..][..n]);
        let chunks = u.par_chunks_mut(width).zip(d.par_chunks(width)).zip(y.par_chunks(width));
        let masks = class.par_chunks(width).zip(weight.par_chunks(width));
        chunks.zip(masks).with_min_len(16).for_each(|(((u, d), y), (class, weight))| {
            for x in 0..u.len() {
                let [a, b] = solved[usize::from(class[x])];
                let b = if weight[x] > 0.0 { b } else { 0.0 };
                u[x] += a * d[x] + b * (y[x] - u[x]);
            }
        });
    }
    shares
}

/// Smooths edges of `color` (3 planes) with a 3 x 3 blur of the given share in each block.
pub(crate) fn soften(shape: Shape, color: &mut [f32], share: &Pooled<1>) {
    let change = blurred_difference(shape, color);
    let width = shape.width;
    let scratch = || (Vec::new(), vec![0.0; width]);
    let rows = color.par_chunks_mut(width).zip(change.par_chunks(width)).enumerate().with_min_len(8);
    rows.for_each_init(scratch, |(line, share_of), (row, (u, d))| {
        share.row(0, row % shape.height, line, share_of);
        for ((u, d), s) in u.iter_mut().zip(d).zip(&*share_of) {
            *u += s * d;
        }
    });
}

/// `blur(u) - u` for the 3 x 3 binomial blur of each plane; borders repeat.
fn blurred_difference(shape: Shape, color: &[f32]) -> Vec<f32> {
    let (n, width, height) = (shape.pixels(), shape.width, shape.height);
    let mut out = vec![0.0; color.len()];
    let scratch = || vec![0.0; width + 2];
    out.par_chunks_mut(width).enumerate().with_min_len(8).for_each_init(scratch, |sum, (row, out)| {
        let (c, y) = (row / height, row % height);
        let plane = &color[c * n..][..n];
        let at = |y: usize| &plane[y * width..][..width];
        let (a, b, d) = (at(y.saturating_sub(1)), at(y), at((y + 1).min(height - 1)));
        for (((s, a), b), d) in sum[1..=width].iter_mut().zip(a).zip(b).zip(d) {
            *s = a + 2.0 * b + d;
        }
        (sum[0], sum[width + 1]) = (sum[1], sum[width]);
        for (x, (o, u)) in out.iter_mut().zip(b).enumerate() {
            *o = (sum[x] + 2.0 * sum[x + 1] + sum[x + 2]) * (1.0 / 16.0) - u;
        }
    });
    out
}

struct Picture<'a> {
    shape: Shape,
    color: &'a [f32],
    noisy: &'a [f32],
    weight: &'a [f32],
    change: &'a [f32],
    variance: Option<&'a [f32]>,
}

impl Picture<'_> {
    /// The three planes of row `y`.
    fn row<'b>(&self, planes: &'b [f32], y: usize) -> [&'b [f32]; 3] {
        let (n, width) = (self.shape.pixels(), self.shape.width);
        std::array::from_fn(|c| &planes[c * n + y * width..][..width])
    }

    /// The class of each pixel, 0 for smooth ones.
    fn classify(&self, y: usize, out: &mut [u8]) {
        let (u, d) = (self.row(self.color, y), self.row(self.change, y));
        for (x, o) in out.iter_mut().enumerate() {
            let level = u[0][x] + u[1][x] + u[2][x] + 3.0 * RELATIVE_FLOOR;
            let edge = d[0][x].abs() + d[1][x].abs() + d[2][x].abs();
            *o = BOUNDS.iter().map(|b| u8::from(edge > b * level)).sum();
        }
    }

    /// The sums of row `y` for each class.
    fn sums(&self, y: usize, class: &[u8]) -> [Sums; CLASSES] {
        let width = self.shape.width;
        let (u, v, d) = (self.row(self.color, y), self.row(self.noisy, y), self.row(self.change, y));
        let noise = self.variance.map(|v| &v[y * width..][..width]);
        let mut out = [Sums::default(); CLASSES];
        for x in 0..width {
            let (class, weight) = (class[y * width + x], self.weight[y * width + x]);
            if weight == 0.0 {
                continue;
            }
            let (mut level, mut blurred) = (0.0_f32, 0.0_f32);
            let (mut dd, mut dr, mut rr) = (0.0_f32, 0.0_f32, 0.0_f32);
            for c in 0..3 {
                let (u, d) = (u[c][x], d[c][x]);
                let r = v[c][x] - u;
                level += u;
                blurred += u + d;
                dd += d * d;
                dr += d * r;
                rr += r * r;
            }
            // The larger level, or dark pixels of jagged edges would outweigh all others.
            let w = (level.max(blurred) * (1.0 / 3.0) + RELATIVE_FLOOR).powi(-2);
            // Without a known variance all of the residual counts as noise.
            let noise = noise.map_or(rr, |v| 3.0 * v[x]);
            let [dd, dr, rr, n] = [dd, dr, rr, noise].map(|v| f64::from(v * w));
            out[class as usize].add(&Sums { dd, dr, rr, noise: n, dr2: dr * dr, rr2: rr * rr, pixels: 1.0 });
        }
        out
    }
}

impl Sums {
    fn add(&mut self, other: &Self) {
        self.dd += other.dd;
        self.dr += other.dr;
        self.rr += other.rr;
        self.noise += other.noise;
        self.dr2 += other.dr2;
        self.rr2 += other.rr2;
        self.pixels += other.pixels;
    }

    /// `[a, b]`, each between 0 and 1; what is not significant counts as 0.
    fn solve(&self) -> [f32; 2] {
        let significant = |value: f64, squares: f64| (value - ERRORS * squares.sqrt()).max(0.0) > 0.0;
        if self.dd <= 0.0 || self.rr <= 0.0 {
            return [0.0; 2];
        }
        let dr = if significant(self.dr, self.dr2) { self.dr } else { 0.0 };
        let gain = self.rr - self.noise;
        let gain = if significant(gain, self.rr2) { gain } else { 0.0 };
        let determinant = self.dd * self.rr - dr * dr;
        let (mut a, mut b) = (dr / self.dd, 0.0);
        if gain > 0.0 && determinant > 1e-9 * self.dd * self.rr {
            (a, b) = (dr * (self.rr - gain) / determinant, (self.dd * gain - dr * dr) / determinant);
            if b <= 0.0 {
                (a, b) = (dr / self.dd, 0.0);
            }
        }
        [a.clamp(0.0, 1.0) as f32, b.clamp(0.0, 1.0) as f32]
    }
}
