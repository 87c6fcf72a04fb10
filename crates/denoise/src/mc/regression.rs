//! Local linear regression of the irradiance on the features, on a grid of cells and at several widths, the width
//! chosen in each cell by its estimated error.
//!
//! In the manner of blockwise feature regression [@koskela2019] and first-order collaborative filtering
//! [@bitterli2016], built for one pass over the pixels: each cell of 8 x 8 pixels sums the products of its regressors
//! once; a Gaussian window of any width is then a blur of these sums over the cells; each cell solves its normal
//! equations; coefficients (not colours) are interpolated between cell centres. The cost per pixel does not depend on
//! the width.
//!
//! The width minimises Mallows' criterion [@mallows1973] in each cell, `RSS_k + 2 s^2 S_k` in relative units, with `S_k` the leverage
//! of a sample and `s^2` the residual of a middle width, or the variance if it is known.

use super::basis::{Basis, MAX_REGRESSORS};
use super::peaks::replace_peaks;
use super::window::{blur_columns, blur_rows, gaussian_taps};
use super::{Stage, Stages};
use crate::Shape;
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};

/// Pixels of a cell's side.
pub(crate) const CELL: usize = 8;

/// Widths of the windows: sigma in cells.
const WIDTHS: [f32; 4] = [0.35, 0.6, 1.0, 2.0];

/// The width whose residual stands for the noise and whose estimate scales relative errors.
const MIDDLE: usize = 2;

/// Added to the variance of each standardised regressor within a window.
const RIDGE: f64 = 1e-3;

/// Leverage in units of that of a Gaussian window, `k / (4 pi sigma^2)`.
const LEVERAGE: f32 = 1.0;

/// Added to the estimate in relative errors, in units of exposure.
pub(crate) const RELATIVE_FLOOR: f32 = 0.05;

/// What a regression gave.
#[derive(Clone, Debug)]
pub(crate) struct Regression {
    /// The estimate, 3 planes, not negative.
    pub(crate) estimate: Vec<f32>,
    /// Share of the cells that took each width.
    pub(crate) shares: [f32; WIDTHS.len()],
    /// Cells without noise to remove.
    pub(crate) flat: usize,
    /// All cells.
    pub(crate) cells: usize,
}

/// The solutions of one width.
struct Fit {
    /// `[cell][regressor][channel]`.
    coefficients: Vec<f32>,
    /// Weighted mean of the window, `[cell][channel]`.
    levels: Vec<f32>,
    /// Cells whose window holds no sample.
    empty: Vec<bool>,
}

/// The pixels of one picture as the regression sees them.
pub(crate) struct Samples<'a> {
    pub(crate) shape: Shape,
    planes: Vec<&'a [f32]>,
    pub(crate) irradiance: &'a [f32],
    pub(crate) weight: &'a [f32],
    pub(crate) cells: [usize; 2],
    /// Whether pixels without weight are estimated too.
    pub(crate) fill: bool,
}

/// Pixels `x0..x1` between the centres of the cells `left` and `right`; `first` is the place of the left centre.
struct Interval {
    left: usize,
    right: usize,
    x0: usize,
    x1: usize,
    first: f32,
}

/// Number of products that a cell sums: the upper triangle of the regressors' matrix, then right-hand sides.
const fn moments_of(k: usize) -> usize {
    k * (k + 1) / 2 + 3 * k
}

/// Regresses `irradiance` (3 planes) with a weight per pixel (0: hole). `variance`, per pixel and of the mean over the
/// channels, replaces the residual as the estimate of the noise. Widths and highlights can be left out. Without `fill` the estimate is only
/// made where there is weight.
pub(crate) fn regress(
    shape: Shape,
    basis: &Basis,
    irradiance: &[f32],
    weight: &[f32],
    variance: Option<&[f32]>,
    without: Stages,
    fill: bool,
) -> Regression {
    let cells = [shape.height.div_ceil(CELL), shape.width.div_ceil(CELL)];
    let planes = basis.planes.iter().map(Vec::as_slice).collect();
    let samples = Samples { shape, planes, irradiance, weight, cells, fill };
    let (moments, flat) = samples.moments();
    let k = samples.planes.len() + 1;
    let used: Vec<bool> = {
        let row = moments_of(k) * cells[1];
        moments.chunks(row).flat_map(|row| row[..cells[1]].iter().map(|w| *w > 0.0)).collect()
    };
    let solved = if fill { vec![true; used.len()] } else { around(cells, &used) };
    let fits: Vec<Fit> = WIDTHS
        .iter()
        .map(|width| {
            let taps = gaussian_taps(*width);
            let blurred =
                blur_columns(&blur_rows(&moments, cells[1], &taps), moments_of(k) * cells[1], &taps);
            samples.solve(&blurred, &flat, &solved)
        })
        .collect();
    let choice = match without.has(Stage::Bandwidth) {
        true => vec![MIDDLE; flat.len()],
        false => samples.choose(&fits, variance, &used),
    };
    let mean = samples.mean();
    let per_cell = 3 * k;
    let mut chosen = vec![0.0; cells[0] * cells[1] * per_cell];
    let mut shares = [0.0; WIDTHS.len()];
    for (cell, (out, width)) in chosen.chunks_mut(per_cell).zip(&choice).enumerate() {
        match fits[*width].empty[cell] {
            true => out[..3].copy_from_slice(&mean),
            false => out.copy_from_slice(&fits[*width].coefficients[cell * per_cell..][..per_cell]),
        }
        shares[*width] += 1.0 / choice.len() as f32;
    }
    let needed = if fill { &solved } else { &used };
    let mut estimate = samples.evaluate(&chosen, needed);
    if !without.has(Stage::Highlights) {
        replace_peaks(&samples, basis, &samples.contrast(&fits), &mut estimate);
    }
    Regression { estimate, shares, flat: flat.iter().filter(|f| **f).count(), cells: flat.len() }
}

/// Which cells are set or have a neighbour that is.
fn around([ch, cw]: [usize; 2], set: &[bool]) -> Vec<bool> {
    let near = |c: usize, n: usize| c.saturating_sub(1)..(c + 2).min(n);
    (0..ch * cw)
        .map(|cell| near(cell / cw, ch).any(|y| set[y * cw..][near(cell % cw, cw)].contains(&true)))
        .collect()
}

impl Samples<'_> {
    /// The sums of each cell as `[cell row][moment][cell column]`, and the cells that lie inside a region of one
    /// colour.
    fn moments(&self) -> (Vec<f32>, Vec<bool>) {
        let k = self.planes.len() + 1;
        let (m, cw) = (moments_of(k), self.cells[1]);
        let mut out = vec![0.0; self.cells[0] * m * cw];
        let mut constant: Vec<Option<[u32; 3]>> = vec![None; self.cells[0] * cw];
        out.par_chunks_mut(m * cw).zip(constant.par_chunks_mut(cw)).enumerate().for_each(
            |(cy, (out, constant))| {
                // Regressors times weight, regressors, colours of one cell.
                let mut weighted = [[0.0_f32; CELL * CELL]; MAX_REGRESSORS + 1];
                let mut plain = [[0.0_f32; CELL * CELL]; MAX_REGRESSORS + 4];
                for cx in 0..cw {
                    if self.is_empty(cy, cx) {
                        continue;
                    }
                    constant[cx] = self.gather(cy, cx, &mut weighted, &mut plain);
                    let mut at = cx;
                    for i in 0..k {
                        for j in (i..k).chain(MAX_REGRESSORS + 1..MAX_REGRESSORS + 4) {
                            out[at] = dot(&weighted[i], &plain[j]);
                            at += cw;
                        }
                    }
                }
            },
        );
        (out, self.inner(&constant))
    }

    /// Whether no pixel of a cell has weight.
    fn is_empty(&self, cy: usize, cx: usize) -> bool {
        let width = self.shape.width;
        let columns = cx * CELL..(cx * CELL + CELL).min(width);
        let mut rows = cy * CELL..(cy * CELL + CELL).min(self.shape.height);
        rows.all(|y| self.weight[y * width..][columns.clone()].iter().all(|w| *w == 0.0))
    }

    /// Copies a cell; returns its colour if it has only one, and no hole.
    fn gather(
        &self,
        cy: usize,
        cx: usize,
        weighted: &mut [[f32; CELL * CELL]],
        plain: &mut [[f32; CELL * CELL]],
    ) -> Option<[u32; 3]> {
        let (width, n) = (self.shape.width, self.shape.pixels());
        let (x0, x1) = (cx * CELL, (cx * CELL + CELL).min(width));
        let first = cy * CELL * width + x0;
        let color = |i: usize| [0, 1, 2].map(|c| self.irradiance[c * n + i].to_bits());
        let mut constant = Some(color(first));
        if (x1 - x0) < CELL || (cy + 1) * CELL > self.shape.height {
            weighted.iter_mut().chain(plain.iter_mut()).for_each(|p| p.fill(0.0));
        }
        for (r, y) in (cy * CELL..(cy * CELL + CELL).min(self.shape.height)).enumerate() {
            let (from, to) = (y * width + x0..y * width + x1, r * CELL..r * CELL + (x1 - x0));
            let weight = &self.weight[from.clone()];
            weighted[0][to.clone()].copy_from_slice(weight);
            plain[0][to.clone()].fill(1.0);
            for (k, plane) in self.planes.iter().enumerate() {
                let source = &plane[from.clone()];
                plain[k + 1][to.clone()].copy_from_slice(source);
                for ((o, v), w) in weighted[k + 1][to.clone()].iter_mut().zip(source).zip(weight) {
                    *o = v * w;
                }
            }
            for c in 0..3 {
                let source = &self.irradiance[c * n + from.start..c * n + from.end];
                plain[MAX_REGRESSORS + 1 + c][to.clone()].copy_from_slice(source);
            }
            if constant.is_some_and(|k| from.clone().any(|i| color(i) != k || self.weight[i] == 0.0)) {
                constant = None;
            }
        }
        constant
    }

    /// Cells whose eight neighbours (as far as they exist) have the same single colour.
    fn inner(&self, constant: &[Option<[u32; 3]>]) -> Vec<bool> {
        let [ch, cw] = self.cells;
        let around = |c: usize, n: usize| c.saturating_sub(1)..(c + 2).min(n);
        (0..ch * cw)
            .map(|cell| {
                let own = constant[cell];
                own.is_some()
                    && around(cell / cw, ch)
                        .all(|y| around(cell % cw, cw).all(|x| constant[y * cw + x] == own))
            })
            .collect()
    }

    /// Mean colour over the samples.
    fn mean(&self) -> [f32; 3] {
        let total: f64 = self.weight.iter().map(|w| f64::from(*w)).sum();
        std::array::from_fn(|c| {
            let plane = &self.irradiance[c * self.shape.pixels()..][..self.shape.pixels()];
            let sum: f64 = plane.iter().zip(self.weight).map(|(v, w)| f64::from(*v) * f64::from(*w)).sum();
            if total > 0.0 { (sum / total) as f32 } else { 0.0 }
        })
    }

    /// The coefficients of each cell that is to be `solved`.
    fn solve(&self, moments: &[f32], flat: &[bool], solved: &[bool]) -> Fit {
        let k = self.planes.len() + 1;
        let (m, cw, n) = (moments_of(k), self.cells[1], self.shape.pixels());
        let mut coefficients = vec![0.0; flat.len() * 3 * k];
        let (mut empty, mut levels) = (vec![false; flat.len()], vec![0.0; 3 * flat.len()]);
        let rows = coefficients.par_chunks_mut(cw * 3 * k).zip(levels.par_chunks_mut(3 * cw));
        rows.zip(empty.par_chunks_mut(cw)).enumerate().for_each(|(cy, ((out, levels), empty))| {
            let mut system = [0.0_f64; moments_of(MAX_REGRESSORS + 1)];
            let cells = out.chunks_mut(3 * k).zip(levels.chunks_mut(3)).zip(empty);
            for (cx, ((out, level), empty)) in cells.enumerate() {
                if !solved[cy * cw + cx] {
                    *empty = true;
                    continue;
                }
                if flat[cy * cw + cx] {
                    let pixel = cy * CELL * self.shape.width + cx * CELL;
                    (0..3).for_each(|c| out[c] = self.irradiance[c * n + pixel]);
                    level.copy_from_slice(&out[..3]);
                    continue;
                }
                for (i, s) in system[..m].iter_mut().enumerate() {
                    *s = f64::from(moments[(cy * m + i) * cw + cx]);
                }
                *empty = !solve_cell(k, &system[..m], out);
                // The products of the constant with the colours, over that with itself.
                let count = system[0].max(1e-30);
                level.iter_mut().zip(&system[k..]).for_each(|(l, s)| *l = (s / count) as f32);
            }
        });
        Fit { coefficients, levels, empty }
    }

    /// The brightest over the darkest mean of the narrowest window in the cells around each cell.
    fn contrast(&self, fits: &[Fit]) -> Vec<f32> {
        let [ch, cw] = self.cells;
        let around = |c: usize, n: usize| c.saturating_sub(1)..(c + 2).min(n);
        let of = |cell: usize| {
            let (mut least, mut most) = ([f32::INFINITY; 3], [0.0_f32; 3]);
            for y in around(cell / cw, ch) {
                for k in around(cell % cw, cw).map(|x| y * cw + x) {
                    // Of the narrowest window that holds samples.
                    let Some(fit) = fits.iter().find(|fit| !fit.empty[k]) else { return 1.0 };
                    for c in 0..3 {
                        least[c] = least[c].min(fit.levels[3 * k + c]);
                        most[c] = most[c].max(fit.levels[3 * k + c]);
                    }
                }
            }
            let sum = |v: [f32; 3]| v[0] + v[1] + v[2] + 3.0 * RELATIVE_FLOOR;
            sum(most) / sum(least)
        };
        (0..ch * cw).map(of).collect()
    }

    /// The width of each cell.
    fn choose(&self, fits: &[Fit], variance: Option<&[f32]>, used: &[bool]) -> Vec<usize> {
        let (k, [ch, cw], width) = (self.planes.len() + 1, self.cells, self.shape.width);
        // Per cell: the weight, the known noise, the residual of each width.
        const PLANES: usize = 2 + WIDTHS.len();
        let mut sums = vec![0.0; ch * cw * PLANES];
        sums.par_chunks_mut(cw * PLANES).enumerate().for_each(|(cy, sums)| {
            let mut rows = vec![vec![0.0; 3 * width]; WIDTHS.len()];
            let mut line = Vec::new();
            for y in cy * CELL..(cy * CELL + CELL).min(self.shape.height) {
                for (row, fit) in rows.iter_mut().zip(fits) {
                    self.evaluate_row(&fit.coefficients, y, &used[cy * cw..][..cw], &mut line, row);
                }
                self.add_residuals(y, &rows, variance, sums);
            }
        });
        let planes: Vec<Vec<f32>> = {
            let taps = gaussian_taps(0.6);
            let blurred = blur_columns(&blur_rows(&sums, cw, &taps), PLANES * cw, &taps);
            let plane = |p: usize| {
                blurred.chunks(PLANES * cw).flat_map(|row| row[p * cw..(p + 1) * cw].to_vec()).collect()
            };
            (0..PLANES).map(plane).collect()
        };
        (0..ch * cw)
            .map(|cell| {
                let noise = if variance.is_some() { planes[1][cell] } else { planes[2 + MIDDLE][cell] };
                let score = |w: usize| {
                    let area = 4.0 * std::f32::consts::PI * (WIDTHS[w].powi(2) + 0.08) * (CELL * CELL) as f32;
                    planes[2 + w][cell] + 2.0 * noise * LEVERAGE * k as f32 / area
                };
                let mut usable = (0..WIDTHS.len()).filter(|w| !fits[*w].empty[cell]);
                // Around holes too few samples judge the widths.
                let best = match planes[0][cell] < 1.0 {
                    true => usable.next(),
                    false => usable.min_by(|a, b| score(*a).total_cmp(&score(*b))),
                };
                best.unwrap_or(WIDTHS.len() - 1)
            })
            .collect()
    }

    /// Adds the squared relative residuals of row `y` to the sums of its cells.
    fn add_residuals(&self, y: usize, rows: &[Vec<f32>], variance: Option<&[f32]>, sums: &mut [f32]) {
        let (width, n, cw) = (self.shape.width, self.shape.pixels(), self.cells[1]);
        let colors: [&[f32]; 3] = std::array::from_fn(|c| &self.irradiance[c * n + y * width..][..width]);
        let weight = &self.weight[y * width..][..width];
        for cx in 0..cw {
            let mut acc = [[0.0_f32; CELL]; 2 + WIDTHS.len()];
            for (t, x) in (cx * CELL..(cx * CELL + CELL).min(width)).enumerate() {
                let middle = &rows[MIDDLE];
                let pilot = (middle[x] + middle[width + x] + middle[2 * width + x]) * (1.0 / 3.0);
                let w = weight[x] / (pilot + RELATIVE_FLOOR).powi(2);
                acc[0][t] = weight[x];
                acc[1][t] = variance.map_or(0.0, |v| v[y * width + x]) * w;
                for (a, row) in acc[2..].iter_mut().zip(rows) {
                    let d = [0, 1, 2].map(|c| colors[c][x] - row[c * width + x]);
                    a[t] = w * (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) * (1.0 / 3.0);
                }
            }
            for (p, a) in acc.iter().enumerate() {
                sums[p * cw + cx] += a.iter().sum::<f32>();
            }
        }
    }

    /// The estimate, 0 between cells that are not `needed`.
    fn evaluate(&self, coefficients: &[f32], needed: &[bool]) -> Vec<f32> {
        let (width, n) = (self.shape.width, self.shape.pixels());
        let mut out = vec![0.0; 3 * n];
        let (r, rest) = out.split_at_mut(n);
        let (g, b) = rest.split_at_mut(n);
        let rows = r.par_chunks_mut(width).zip(g.par_chunks_mut(width)).zip(b.par_chunks_mut(width));
        let scratch = || (Vec::new(), vec![0.0; 3 * width]);
        rows.enumerate().with_min_len(8).for_each_init(scratch, |(line, row), (y, ((r, g), b))| {
            let cw = self.cells[1];
            self.evaluate_row(coefficients, y, &needed[y / CELL * cw..][..cw], line, row);
            [r, g, b].into_iter().zip(row.chunks(width)).for_each(|(out, row)| out.copy_from_slice(row));
        });
        out
    }

    /// Values of the cells, `per_cell` each, at the height of row `y`.
    pub(crate) fn between(&self, values: &[f32], per_cell: usize, y: usize, line: &mut Vec<f32>) {
        let [ch, cw] = self.cells;
        let (c0, f) = cell_before(y, ch);
        let upper = &values[c0 * cw * per_cell..][..cw * per_cell];
        let lower = &values[(c0 + 1).min(ch - 1) * cw * per_cell..][..cw * per_cell];
        line.clear();
        line.extend(upper.iter().zip(lower).map(|(a, b)| a + f * (b - a)));
    }

    /// The pixels between the centres of cells `i - 1` and `i`.
    fn interval(&self, i: usize) -> Option<Interval> {
        let (cw, width) = (self.cells[1], self.shape.width);
        let x0 = (i * CELL).saturating_sub(CELL / 2).min(width);
        let x1 = (i * CELL + CELL / 2).min(width);
        let first = i as f32 * CELL as f32 - (CELL / 2) as f32 - 0.5;
        (x0 < x1).then_some(Interval { left: i.saturating_sub(1), right: i.min(cw - 1), x0, x1, first })
    }

    /// One row of the estimate, 3 runs of `width` values, 0 between cells that are not `needed`; `line` is scratch.
    fn evaluate_row(
        &self,
        coefficients: &[f32],
        y: usize,
        needed: &[bool],
        line: &mut Vec<f32>,
        out: &mut [f32],
    ) {
        let (k, width) = (self.planes.len() + 1, self.shape.width);
        self.between(coefficients, 3 * k, y, line);
        for i in 0..=self.cells[1] {
            let Some(Interval { left, right, x0, x1, first }) = self.interval(i) else { continue };
            if !needed[left] && !needed[right] {
                out.chunks_mut(width).for_each(|run| run[x0..x1].fill(0.0));
                continue;
            }
            let mut part = [[0.0_f32; CELL]; 3];
            let mut features = [0.0_f32; CELL];
            let fraction: [f32; CELL] = std::array::from_fn(|t| (x0 as f32 + t as f32 - first) / CELL as f32);
            for j in 0..k {
                match j {
                    0 => features.fill(1.0),
                    _ => features[..x1 - x0]
                        .copy_from_slice(&self.planes[j - 1][y * width + x0..y * width + x1]),
                }
                for (c, part) in part.iter_mut().enumerate() {
                    let a = line[(left * k + j) * 3 + c];
                    let d = line[(right * k + j) * 3 + c] - a;
                    for t in 0..CELL {
                        part[t] += (a + fraction[t] * d) * features[t];
                    }
                }
            }
            for (c, part) in part.iter().enumerate() {
                for (o, v) in out[c * width + x0..c * width + x1].iter_mut().zip(part) {
                    *o = v.max(0.0);
                }
            }
        }
    }
}

/// The last of `cells` whose centre is not behind a pixel, and how far the pixel lies between it and the next one.
#[inline(always)]
pub(crate) fn cell_before(pixel: usize, cells: usize) -> (usize, f32) {
    let at = ((pixel as f32 + 0.5) / CELL as f32 - 0.5).clamp(0.0, (cells - 1) as f32);
    (at as usize, at.fract())
}

/// Dot product in eight lanes.
#[inline]
fn dot(a: &[f32; CELL * CELL], b: &[f32; CELL * CELL]) -> f32 {
    let mut lanes = [0.0_f32; CELL];
    for (a, b) in a.chunks_exact(CELL).zip(b.chunks_exact(CELL)) {
        for t in 0..CELL {
            lanes[t] += a[t] * b[t];
        }
    }
    (lanes[0] + lanes[4]) + (lanes[1] + lanes[5]) + ((lanes[2] + lanes[6]) + (lanes[3] + lanes[7]))
}

/// Solves the ridge regression of one window for `[regressor][channel]`; false and zeros without samples.
fn solve_cell(k: usize, moments: &[f64], out: &mut [f32]) -> bool {
    // Row i of the sums: products with regressors i.., then with the three colours.
    let row = |i: usize| (0..i).map(|r| k - r + 3).sum::<usize>();
    let pair = |i: usize, j: usize| moments[row(i) + j - i];
    let side = |i: usize, c: usize| moments[row(i) + k - i + c];
    let count = pair(0, 0);
    out.fill(0.0);
    if count.is_nan() || count <= 1e-6 {
        return false;
    }
    let f = k - 1;
    let mut mean = [0.0; MAX_REGRESSORS];
    let mut a = [[0.0; MAX_REGRESSORS]; MAX_REGRESSORS];
    for i in 0..f {
        mean[i] = pair(0, i + 1) / count;
    }
    for i in 0..f {
        for j in i..f {
            a[j][i] = pair(i + 1, j + 1) / count - mean[i] * mean[j];
        }
        a[i][i] = a[i][i].max(0.0) + RIDGE;
    }
    // Cholesky factor in the lower triangle; the ridge keeps the pivots away from zero.
    for j in 0..f {
        for i in j..f {
            let s = a[i][j] - (0..j).map(|t| a[i][t] * a[j][t]).sum::<f64>();
            a[i][j] = if i == j { s.max(0.1 * RIDGE).sqrt() } else { s / a[j][j] };
        }
    }
    for c in 0..3 {
        let level = side(0, c) / count;
        let mut x = [0.0; MAX_REGRESSORS];
        for i in 0..f {
            let b = side(i + 1, c) / count - mean[i] * level;
            x[i] = (b - (0..i).map(|t| a[i][t] * x[t]).sum::<f64>()) / a[i][i];
        }
        for i in (0..f).rev() {
            x[i] = (x[i] - (i + 1..f).map(|t| a[t][i] * x[t]).sum::<f64>()) / a[i][i];
        }
        out[c] = (level - (0..f).map(|i| x[i] * mean[i]).sum::<f64>()) as f32;
        for i in 0..f {
            out[(i + 1) * 3 + c] = x[i] as f32;
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mc::frame::Features;
    use photofit_sampling::Rng;

    #[test]
    fn the_estimate_of_a_part_is_the_same_for_any_number_of_threads_and_0_elsewhere() {
        let shape = Shape::new(64, 96, 3);
        let n = shape.pixels();
        let mut rng = Rng::new(2, 0);
        let irradiance: Vec<f32> = (0..3 * n).map(|_| rng.uniform(0.5, 1.5)).collect();
        // Two corners hold samples; the rows of cells between them none.
        let weight: Vec<f32> = (0..n)
            .map(|i| {
                let (x, y) = (i % 64, i / 64);
                if (x < 24 && y < 24) || (x >= 40 && y >= 72) { 1.0 } else { 0.0 }
            })
            .collect();
        let basis = Basis::of(&Features::default(), shape);
        let estimates = [1, 4].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| {
                regress(shape, &basis, &irradiance, &weight, None, Stages::default(), false).estimate
            })
        });
        assert!(estimates[0] == estimates[1]);
        for i in 0..n {
            let y = i / 64;
            if weight[i] > 0.0 {
                assert!((0.5..1.5).contains(&estimates[0][i]), "{} at {i}", estimates[0][i]);
            } else if (24..72).contains(&y) {
                assert_eq!(estimates[0][i], 0.0, "at {}, {y}", i % 64);
            }
        }
    }
}
