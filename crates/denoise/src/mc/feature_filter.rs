//! Noise of the features, smoothed out of them: depth of field, media.
//!
//! Where [`noise_share`] finds noise, and the variance of the radiance says that it is none of a fine texture, each feature is averaged over
//! the pixels around, by a bilateral filter whose likeness compares not the features but their Gaussian means: these are nearly equal
//! where the features are noise, and differ across edges, along which they are averaged. The range follows from the variance that the
//! noise around leaves in such a mean. Tiles without noise are not looked at.

use super::RUN;
use super::demodulate::ALBEDO_FLOOR;
use super::feature_noise::noise_share;
use super::frame::Features;
use super::pooled::{Pooled, SIDE, Scratch, add_row};
use crate::Shape;
use crate::wide::{Kernel, run_widest};
use rayon::prelude::{IndexedParallelIterator, IntoParallelRefIterator, ParallelIterator, ParallelSliceMut};
use std::borrow::Cow;

/// Deviation in pixels of the Gaussian whose means are compared, and of the average; pixels on each side of both.
const GUIDE: f32 = 1.5;
const GUIDE_REACH: usize = 4;
const SIGMA: f32 = 2.0;
const REACH: usize = 5;
/// Squared distance up to which all pixels count; beyond it those of one colour of a chessboard, twice.
const NEAR: f32 = 5.0;
/// Least range.
const LEAST: f32 = 0.01;
/// Normals count half: they are up to 2 apart, reflectances up to 1.
const NORMAL: f32 = 0.5;
/// Variance over half the squared difference of neighbours from which on the radiance begins to be noise, and wholly is; deviations of
/// the windows in which both are compared, and of the level that they are relative to.
const EXPLAINED: [f32; 2] = [0.85, 1.0];
const NOISE: f32 = 2.5;
const LEVEL: f32 = 4.0;
/// Where black and other pixels are mixed: the share of the variance around the mean in all at which the mixture begins to be
/// noise, and wholly is.
const RANGE: [f32; 2] = [0.5, 0.8];
/// Weight of a block beside another in the window of that: a deviation of 3 pixels with the block itself.
const BESIDE: f32 = 0.35;
/// Least share of noise in a tile that is worked on.
const NOTICED: f32 = 0.02;

/// The share of noise in albedo and normal, between 0 and 1 in each block; `None` without noise.
pub(crate) fn share_of_noise(features: &Features<'_>, shape: Shape) -> Option<Pooled<1>> {
    let judged = [features.albedo.as_deref(), features.normal.as_deref()];
    let shares = judged.into_iter().flatten().filter_map(|f| noise_share(f, shape.pixels(), shape.width));
    shares.reduce(|mut a, b| {
        a.sums.iter_mut().zip(b.sums).for_each(|(a, b)| *a = a.max(b));
        a
    })
}

/// Whether the radiance around differs from pixel to pixel as its variance says (1), or more, as textures and edges do (0).
pub(crate) fn share_of_variance(color: &[f32], variance: &[f32], width: usize) -> Pooled<1> {
    let n = color.len() / 3;
    let height = n / width;
    let finite = |v: f32| if v.is_finite() { v } else { 0.0 };
    let mut usual = Pooled::<2>::of(width, height, |y, row| {
        row.fill(0.0);
        let (level, ones) = row.split_at_mut(width);
        ones.fill(1.0);
        for c in 0..3 {
            for (o, v) in level.iter_mut().zip(&color[c * n + y * width..]) {
                *o += finite(*v).abs() * (1.0 / 3.0);
            }
        }
    });
    usual.smooth(LEVEL);
    let mean = |b: usize| usual.at(0, b) / usual.at(1, b);
    let least = 1e-3 * (0..usual.blocks()).map(mean).sum::<f32>() / usual.blocks() as f32 + f32::MIN_POSITIVE;
    // Half the squared differences of neighbours and the variance, in units of the level around, so that bright pixels do not stand
    // for dark ones. A difference to a hole, or across the border, is NaN: neither it nor its share of the variance counts.
    let mut sums = Pooled::<2>::new(width, height);
    let scratch = || (vec![0.0; 3 * width], vec![0.0; width], Scratch::default());
    sums.rows().enumerate().for_each_init(scratch, |(row, scale, scratch), (block, sums)| {
        for y in SIDE * block..(SIDE * (block + 1)).min(height) {
            row.fill(0.0);
            let (right, rest) = row.split_at_mut(width);
            let (below, own) = rest.split_at_mut(width);
            right[width - 1] = f32::NAN;
            if y + 1 == height {
                below.fill(f32::NAN);
            }
            for c in 0..3 {
                let plane = &color[c * n..][..n];
                let here = &plane[y * width..][..width];
                for ((o, a), b) in below.iter_mut().zip(here).zip(&plane[((y + 1) * width).min(n)..]) {
                    *o += 0.5 * (a - b) * (a - b);
                }
                for ((o, a), b) in right.iter_mut().zip(here).zip(&here[1..]) {
                    *o += 0.5 * (a - b) * (a - b);
                }
                for (o, v) in own.iter_mut().zip(&variance[c * n + y * width..]) {
                    *o += v;
                }
            }
            usual.mean_row(0, 1, y, scratch, scale);
            for (((right, below), own), level) in right.iter_mut().zip(below).zip(own).zip(&*scale) {
                let weight = 1.0 / ((level + least) * (level + least));
                let variance = weight * *own;
                let (mut apart, mut explained) = (0.0, 0.0);
                for difference in [weight * *right, weight * *below] {
                    let valid = difference.is_finite() && variance.is_finite();
                    apart += if valid { difference } else { 0.0 };
                    explained += if valid { variance } else { 0.0 };
                }
                (*right, *below) = (apart, explained);
            }
            add_row(sums, &row[..2 * width], width);
        }
    });
    sums.smooth_blocks(NOISE);
    let [low, high] = EXPLAINED;
    sums.map(|[apart, own]| [((own / apart.max(1e-12) - low) / (high - low)).clamp(0.0, 1.0)])
}

/// Smooths the noise out of the features in place, by the `share` of it in each block. Returns the share of the pixels that changed.
pub(crate) fn smooth_features(features: &mut Features<'_>, shape: Shape, share: &Pooled<1>) -> f32 {
    let (width, height) = (shape.width, shape.height);
    let (across, down) = (width.div_ceil(TILE[0]), height.div_ceil(TILE[1]));
    let tiles: Vec<[usize; 2]> = (0..across * down)
        .map(|k| [k % across * TILE[0], k / across * TILE[1]])
        .filter(|origin| noticed(share, *origin, shape))
        .collect();
    if tiles.is_empty() {
        return 0.0;
    }
    let taps = Taps::new();
    let given = &*features;
    let smoothed: Vec<(Vec<f32>, f32)> = tiles
        .par_iter()
        .map_init(Tile::default, |tile, origin| tile.smooth(given, share, *origin, shape, &taps))
        .collect();
    let slots = [&mut features.albedo, &mut features.normal, &mut features.position];
    let write = |p: usize, plane: &mut [f32]| {
        for ([x, y], (values, _)) in tiles.iter().zip(&smoothed) {
            let count = TILE[0].min(width - x);
            for (r, run) in values[p * TILE[0] * TILE[1]..].chunks(TILE[0]).enumerate() {
                if r < TILE[1].min(height - y) {
                    plane[(y + r) * width + x..][..count].copy_from_slice(&run[..count]);
                }
            }
        }
    };
    for (k, feature) in slots.into_iter().enumerate() {
        let Some(feature) = feature else { continue };
        if let Cow::Borrowed(given) = feature {
            *feature = Cow::Owned(given.par_iter().with_min_len(RUN).copied().collect());
        }
        let planes = Cow::to_mut(feature).par_chunks_mut(shape.pixels());
        planes.enumerate().for_each(|(c, plane)| write(3 * k + c, plane));
    }
    smoothed.iter().map(|(_, changed)| changed).sum::<f32>() / shape.pixels() as f32
}

/// Whether a tile holds noise.
fn noticed(share: &Pooled<1>, [x, y]: [usize; 2], shape: Shape) -> bool {
    let columns = x / SIDE..(x + TILE[0]).min(shape.width).div_ceil(SIDE);
    let mut rows = y / SIDE..(y + TILE[1]).min(shape.height).div_ceil(SIDE);
    rows.any(|r| share.sums[r * share.columns..][columns.clone()].iter().any(|s| *s > NOTICED))
}

/// Width and height of a tile in pixels.
const TILE: [usize; 2] = [64, 32];
/// Pixels around it whose means are needed, and whose features are.
const HALO: usize = 8;
const OUTER: usize = HALO + GUIDE_REACH;
const STRIDE: usize = TILE[0] + 2 * OUTER;
const LINES: usize = TILE[1] + 2 * OUTER;
const AREA: usize = STRIDE * LINES;
/// Blocks of a tile with the halo.
const BLOCKS: [usize; 2] = [(TILE[0] + 2 * HALO) / SIDE, (TILE[1] + 2 * HALO) / SIDE];
const CELLS: usize = BLOCKS[0] * BLOCKS[1];
/// Planes of features, albedo, normal and position, and of means: albedo, normal, "is black".
const FEATURES: usize = 9;
const MEANS: usize = 7;
const BLACK: usize = 6;

/// The pixels around one: offset in a tile, weight of the distance.
struct Taps {
    all: Vec<(isize, f32)>,
    guide: [f32; GUIDE_REACH + 1],
}

impl Taps {
    fn new() -> Self {
        let reach = REACH as isize;
        let mut all = vec![(0, 1.0)];
        for (y, x) in (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (y, x))) {
            let d2 = (x * x + y * y) as f32;
            if d2 == 0.0 || d2 > (REACH * REACH) as f32 || (d2 > NEAR && (x + y) % 2 != 0) {
                continue;
            }
            let doubled = if d2 > NEAR { 2.0 } else { 1.0 };
            all.push((y * STRIDE as isize + x, doubled * (-0.5 * d2 / (SIGMA * SIGMA)).exp()));
        }
        let mut guide: [f32; GUIDE_REACH + 1] =
            std::array::from_fn(|k| (-0.5 * (k as f32 / GUIDE).powi(2)).exp());
        let total = guide[0] + 2.0 * guide[1..].iter().sum::<f32>();
        guide.iter_mut().for_each(|g| *g /= total);
        Self { all, guide }
    }
}

/// What one worker needs for a tile.
struct Tile {
    /// Features as they are, with [`OUTER`] pixels around; outside of the picture the border repeats.
    features: Vec<f32>,
    /// Their Gaussian means, normals times [`NORMAL`], and the squared range.
    means: Vec<f32>,
    scratch: Vec<f32>,
    /// Of blocks: means, their squares, the rest around them, then the last smoothed with the blocks beside.
    blocks: Vec<f32>,
    share: [f32; CELLS],
    range: [f32; CELLS],
}

impl Default for Tile {
    fn default() -> Self {
        Self {
            features: vec![0.0; FEATURES * AREA],
            means: vec![0.0; (MEANS + 1) * AREA],
            scratch: vec![0.0; 2 * AREA],
            blocks: vec![0.0; (MEANS + 3) * CELLS],
            share: [0.0; CELLS],
            range: [0.0; CELLS],
        }
    }
}

impl Tile {
    /// The features of a tile with their noise averaged out, and how many pixels that changes.
    fn smooth(
        &mut self,
        features: &Features<'_>,
        share: &Pooled<1>,
        origin: [usize; 2],
        shape: Shape,
        taps: &Taps,
    ) -> (Vec<f32>, f32) {
        self.load(features, origin, shape);
        run_widest(Blur { tile: self, albedo: features.albedo.is_some(), taps: &taps.guide });
        self.judge(share, origin);
        for r in 0..TILE[1] + 2 * REACH {
            let at = MEANS * AREA + (OUTER - REACH + r) * STRIDE + OUTER - REACH;
            interpolate(&self.range, -(REACH as isize), r, &mut self.means[at..][..TILE[0] + 2 * REACH]);
        }
        let mut out = vec![0.0; FEATURES * TILE[0] * TILE[1]];
        let mut changed = 0.0;
        let count = [TILE[0].min(shape.width - origin[0]), TILE[1].min(shape.height - origin[1])];
        for r in 0..count[1] {
            let mut share = [0.0; TILE[0]];
            interpolate(&self.share, 0, r, &mut share);
            changed += share[..count[0]].iter().sum::<f32>();
            let own = (OUTER + r) * STRIDE + OUTER;
            let mut sums = [[0.0; TILE[0]]; FEATURES + 1];
            if share.iter().any(|s| *s > 0.0) {
                let (features, means) = (&self.features[..], &self.means[..]);
                run_widest(Row { features, means, own, taps: &taps.all, sums: &mut sums });
            }
            let [sums @ .., total] = &sums;
            for (p, sum) in sums.iter().enumerate() {
                let given = &self.features[p * AREA + own..][..TILE[0]];
                let out = &mut out[(p * TILE[1] + r) * TILE[0]..][..TILE[0]];
                for (x, o) in out.iter_mut().enumerate() {
                    let mean = if share[x] > 0.0 { sum[x] / total[x] } else { given[x] };
                    *o = given[x] + share[x] * (mean - given[x]);
                }
            }
        }
        (out, changed)
    }

    /// Copies the features of a tile and of what is around.
    fn load(&mut self, features: &Features<'_>, [x, y]: [usize; 2], shape: Shape) {
        let (n, width) = (shape.pixels(), shape.width);
        let place = |at: usize, from: usize, size: usize| (at + from).saturating_sub(OUTER).min(size - 1);
        let slots = [&features.albedo, &features.normal, &features.position];
        for (k, feature) in slots.into_iter().enumerate() {
            let Some(feature) = feature else { continue };
            for (c, plane) in feature.chunks(n).enumerate() {
                let target = &mut self.features[(3 * k + c) * AREA..][..AREA];
                for (r, run) in target.chunks_mut(STRIDE).enumerate() {
                    let row = &plane[place(r, y, shape.height) * width..][..width];
                    let inside = x >= OUTER && x + STRIDE <= width + OUTER;
                    match inside {
                        true => run.copy_from_slice(&row[x - OUTER..][..STRIDE]),
                        false => run.iter_mut().enumerate().for_each(|(t, v)| *v = row[place(t, x, width)]),
                    }
                }
            }
        }
    }

    /// The Gaussian means.
    #[inline(always)]
    fn blur(&mut self, albedo: bool, taps: &[f32; GUIDE_REACH + 1]) {
        let (black, along) = self.scratch.split_at_mut(AREA);
        let floor = ALBEDO_FLOOR;
        for (i, b) in black.iter_mut().enumerate() {
            let [r, g, b_] = [self.features[i], self.features[AREA + i], self.features[2 * AREA + i]];
            *b = if albedo && r <= floor && g <= floor && b_ <= floor { 1.0 } else { 0.0 };
        }
        for p in 0..MEANS {
            let (source, scale) = match p {
                BLACK => (&*black, 1.0),
                0..3 => (&self.features[p * AREA..][..AREA], 1.0),
                _ => (&self.features[p * AREA..][..AREA], NORMAL),
            };
            for r in 0..LINES {
                let (row, out) = (&source[r * STRIDE..][..STRIDE], &mut along[r * STRIDE..][..STRIDE]);
                for x in GUIDE_REACH..STRIDE - GUIDE_REACH {
                    let mut sum = taps[0] * row[x];
                    for k in 1..=GUIDE_REACH {
                        sum += taps[k] * (row[x - k] + row[x + k]);
                    }
                    out[x] = scale * sum;
                }
            }
            let means = &mut self.means[p * AREA..][..AREA];
            for r in GUIDE_REACH..LINES - GUIDE_REACH {
                let out = &mut means[r * STRIDE..][..STRIDE];
                let row = |r: usize| &along[r * STRIDE..][..STRIDE];
                for (o, v) in out.iter_mut().zip(row(r)) {
                    *o = taps[0] * v;
                }
                for k in 1..=GUIDE_REACH {
                    for ((o, a), b) in out.iter_mut().zip(row(r - k)).zip(row(r + k)) {
                        *o += taps[k] * (a + b);
                    }
                }
            }
        }
    }

    /// The share of each block without the outlines of lamps and mirrors, where black and other pixels stay apart unless they are
    /// mixed all around; and the squared range.
    fn judge(&mut self, share: &Pooled<1>, [x, y]: [usize; 2]) {
        let (black, _) = self.scratch.split_at(AREA);
        self.blocks.fill(0.0);
        // For each block: the means, their squares, the squares of what is around them, "is black".
        let mut row = vec![0.0; (MEANS + 3) * SIDE * BLOCKS[0]];
        let run = SIDE * BLOCKS[0];
        for r in 0..SIDE * BLOCKS[1] {
            let at = (GUIDE_REACH + r) * STRIDE + GUIDE_REACH;
            row.fill(0.0);
            let (means, rest) = row.split_at_mut(MEANS * run);
            let (square, rest) = rest.split_at_mut(run);
            let (noise, dark) = rest.split_at_mut(run);
            for (p, out) in means.chunks_mut(run).enumerate() {
                let mean = &self.means[p * AREA + at..][..run];
                let (source, scale) = match p {
                    BLACK => (&black[at..][..run], 1.0),
                    0..3 => (&self.features[p * AREA + at..][..run], 1.0),
                    _ => (&self.features[p * AREA + at..][..run], NORMAL),
                };
                out.copy_from_slice(mean);
                for (((s, n), m), v) in square.iter_mut().zip(&mut *noise).zip(mean).zip(source) {
                    *s += m * m;
                    *n += (scale * v - m) * (scale * v - m);
                }
            }
            dark.copy_from_slice(&black[at..][..run]);
            let sums = &mut self.blocks[r / SIDE * (MEANS + 3) * BLOCKS[0]..][..(MEANS + 3) * BLOCKS[0]];
            add_row(sums, &row, run);
        }
        let area = (SIDE * SIDE) as f32;
        let at = |p: usize, bx: usize, by: usize| self.blocks[(by * (MEANS + 3) + p) * BLOCKS[0] + bx] / area;
        let around = |p: usize, bx: usize, by: usize| {
            let near = |b: usize, n: usize| [b.saturating_sub(1), b, (b + 1).min(n - 1)];
            let (mut sum, mut total) = (0.0, 0.0);
            for (v, wv) in near(by, BLOCKS[1]).into_iter().zip([BESIDE, 1.0, BESIDE]) {
                for (u, wu) in near(bx, BLOCKS[0]).into_iter().zip([BESIDE, 1.0, BESIDE]) {
                    sum += wu * wv * at(p, u, v);
                    total += wu * wv;
                }
            }
            sum / total
        };
        let pixels = 4.0 * std::f32::consts::PI * GUIDE * GUIDE;
        let [low, high] = RANGE;
        let rows = share.blocks() / share.columns;
        let clamp = |at: usize, b: usize, n: usize| (at / SIDE + b).saturating_sub(HALO / SIDE).min(n - 1);
        for (cell, (s, range)) in self.share.iter_mut().zip(&mut self.range).enumerate() {
            let (bx, by) = (cell % BLOCKS[0], cell / BLOCKS[0]);
            *range = at(MEANS + 1, bx, by) / pixels + LEAST * LEAST;
            *s = share.at(0, clamp(y, by, rows) * share.columns + clamp(x, bx, share.columns));
            let dark = around(MEANS + 2, bx, by);
            let mixed = (100.0 * dark * (1.0 - dark)).clamp(0.0, 1.0);
            if *s > 0.0 && mixed > 0.0 {
                let squares = (0..MEANS).map(|p| around(p, bx, by).powi(2)).sum::<f32>();
                let between = (around(MEANS, bx, by) - squares).max(0.0);
                let rest = around(MEANS + 1, bx, by);
                let noise = ((rest / (rest + between + 1e-9) - low) / (high - low)).clamp(0.0, 1.0);
                *s *= 1.0 - mixed * (1.0 - noise);
            }
        }
    }
}

/// A row of a tile, or of what is around, between the values of its blocks: columns from `first` on, row `r` counted from `first` too.
fn interpolate(blocks: &[f32; CELLS], first: isize, r: usize, out: &mut [f32]) {
    let place = |t: usize| {
        let at = ((t as isize + first) as f32 + 0.5) / SIDE as f32 - 0.5 + (HALO / SIDE) as f32;
        (at as usize, at.fract())
    };
    let (v, f) = place(r);
    for (x, o) in out.iter_mut().enumerate() {
        let (u, g) = place(x);
        let along = |v: usize| {
            let (a, b) = (blocks[v * BLOCKS[0] + u], blocks[v * BLOCKS[0] + u + 1]);
            a + g * (b - a)
        };
        let (a, b) = (along(v), along(v + 1));
        *o = a + f * (b - a);
    }
}

/// The Gaussian means of a tile.
struct Blur<'a> {
    tile: &'a mut Tile,
    albedo: bool,
    taps: &'a [f32; GUIDE_REACH + 1],
}

impl Kernel for Blur<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.tile.blur(self.albedo, self.taps);
    }
}

/// All taps of one row of a tile.
struct Row<'a> {
    features: &'a [f32],
    means: &'a [f32],
    own: usize,
    taps: &'a [(isize, f32)],
    /// Of the features, and of the weights.
    sums: &'a mut [[f32; TILE[0]]; FEATURES + 1],
}

impl Kernel for Row<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for tap in self.taps {
            add(self.features, self.means, self.own, *tap, self.sums);
        }
    }
}

/// Adds one tap to the sums of a row of a tile: features, weight.
#[inline(always)]
fn add(
    features: &[f32],
    means: &[f32],
    own: usize,
    (offset, gauss): (isize, f32),
    sums: &mut [[f32; TILE[0]]; FEATURES + 1],
) {
    const SPAN: usize = MEANS * AREA + TILE[0];
    let other = own.wrapping_add_signed(offset);
    let (a, b) = (&means[own..][..SPAN], &means[other..][..SPAN]);
    let values = &features[other..][..(FEATURES - 1) * AREA + TILE[0]];
    let mut weight = [0.0_f32; TILE[0]];
    for t in 0..TILE[0] {
        let mut apart = 0.0;
        for p in 0..MEANS {
            let d = a[p * AREA + t] - b[p * AREA + t];
            apart += d * d;
        }
        // (1 - t / 8)^8 in place of exp(-t): 0 from t = 8 on.
        let mut w = (1.0 - 0.125 * apart / (a[MEANS * AREA + t] + b[MEANS * AREA + t])).max(0.0);
        w *= w;
        w *= w;
        weight[t] = gauss * (w * w);
    }
    for t in 0..TILE[0] {
        sums[FEATURES][t] += weight[t];
    }
    for p in 0..FEATURES {
        for t in 0..TILE[0] {
            sums[p][t] += weight[t] * values[p * AREA + t];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::Rng;

    #[test]
    fn the_variance_is_compared_alike_at_borders_and_holes() {
        // All neighbours differ by .2; the variance is .925 of half the square of it, in the middle of what is noise in part.
        for (width, height) in [(1, 9), (9, 1), (16, 16), (13, 17), (33, 9)] {
            let n = width * height;
            let mut color: Vec<f32> =
                (0..3 * n).map(|i| 1.0 + 0.1 * ((i % n % width + i % n / width) % 2) as f32 * 2.0).collect();
            let variance = vec![0.925 * 0.5 * 0.2 * 0.2; 3 * n];
            for holes in [false, true] {
                if holes {
                    (0..3 * n).filter(|i| i % n % 7 == 3).for_each(|i| color[i] = f32::NAN);
                }
                let found = share_of_variance(&color, &variance, width).sums;
                let right = found.iter().all(|share| (share - 0.5).abs() < 1e-3);
                assert!(right, "{width} x {height}, holes {holes}: {found:?}");
            }
        }
    }

    #[test]
    fn tiles_hold_the_picture_and_repeat_its_border() {
        let height = 37;
        for width in [1, 63, 64, 65, 135, 139, 140, 200] {
            let (n, mut rng) = (width * height, Rng::new(3, 0));
            let mut plane = || (0..3 * n).map(|_| rng.normal()).collect::<Vec<f32>>();
            let given = [plane(), plane(), plane()];
            let [albedo, normal, position] = given.each_ref().map(|f| Some(f.into()));
            let features = Features { albedo, normal, position, ..Features::default() };
            let mut tile = Tile::default();
            for (y, x) in
                (0..height).step_by(TILE[1]).flat_map(|y| (0..width).step_by(TILE[0]).map(move |x| (y, x)))
            {
                tile.load(&features, [x, y], Shape::new(width, height, 3));
                for (k, found) in tile.features.iter().enumerate() {
                    let (plane, row, column) = (k / AREA, k % AREA / STRIDE, k % STRIDE);
                    let v = (y + row).saturating_sub(OUTER).min(height - 1);
                    let u = (x + column).saturating_sub(OUTER).min(width - 1);
                    let wanted = given[plane / 3][plane % 3 * n + v * width + u];
                    assert_eq!(
                        *found, wanted,
                        "width {width}, tile {x}, {y}: plane {plane}, {column}, {row}"
                    );
                }
            }
        }
    }

    #[test]
    fn noise_goes_and_the_edge_between_two_mixtures_stays() {
        // A reflectance that is .8 in a third of the pixels on the left and in all of those on the right.
        let (width, height) = (96, 72);
        let (n, mut rng) = (width * height, Rng::new(1, 0));
        let truth = |i: usize| if i % width < 48 { 0.4 } else { 0.8 };
        let plane: Vec<f32> = (0..n)
            .map(|i| if i % width >= 48 || rng.uniform(0.0, 1.0) < 1.0 / 3.0 { 0.8 } else { 0.2 })
            .collect();
        let albedo = plane.repeat(3);
        let shape = Shape::new(width, height, 3);
        let smoothed = |albedo: &[f32], variance: f32| {
            let mut features = Features { albedo: Some(albedo.to_vec().into()), ..Features::default() };
            let Some(mut share) = share_of_noise(&features, shape) else { return (albedo.to_vec(), 0.0) };
            let noise = share_of_variance(albedo, &vec![variance; 3 * n], width);
            share.sums.iter_mut().zip(noise.sums).for_each(|(s, n)| *s *= n);
            let changed = smooth_features(&mut features, shape, &share);
            (features.albedo.expect("an albedo").into_owned(), changed)
        };
        // White light: the radiance is the reflectance, and has its variance.
        let (found, changed) = smoothed(&albedo, 0.12);
        assert!((0.4..0.6).contains(&changed), "{changed}");
        let rms = |u: &[f32], from: usize, to: usize| {
            let squares = (0..n).filter(|i| (from..to).contains(&(i % width)));
            let squares: Vec<f32> = squares.map(|i| (u[i] - truth(i)).powi(2)).collect();
            (squares.iter().sum::<f32>() / squares.len() as f32).sqrt()
        };
        assert!(rms(&found, 4, 44) < 0.3 * rms(&albedo, 4, 44), "{}", rms(&found, 4, 44));
        assert!(rms(&found, 52, 96) < 0.02, "{}", rms(&found, 52, 96));
        // The same as a texture: pixels do not vary within.
        assert_eq!(smoothed(&albedo, 0.001), (albedo, 0.0));
        // Features of many samples stay to the bit.
        let smooth: Vec<f32> = (0..3 * n).map(|i| 0.5 + 0.3 * ((i % width) as f32 * 0.2).sin()).collect();
        assert_eq!(smoothed(&smooth, 0.1), (smooth, 0.0));
    }
}
