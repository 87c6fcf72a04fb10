//! Rare samples of huge value, pulled down to what their neighbourhood makes plausible.
//!
//! The neighbourhood is judged by a mean without its own fireflies: the mean of blocks and their neighbours, taken three
//! times, each time with values cut at four times the mean before. A median would be 0 where most samples are black, as
//! they are in indirect light, and would darken all that is left.

use super::window::{blur_sums, gaussian_taps};
use rayon::prelude::{IndexedParallelIterator, IntoParallelIterator, ParallelIterator, ParallelSliceMut};

/// Largest value over the local mean for the regression: where one sample in thirty is lit, each of them is thirty times the
/// mean, and a lower bound takes their light.
pub(crate) const REGRESSION: f32 = 32.0;
/// And for the other models, which keep single bright pixels.
pub(crate) const OTHERS: f32 = 8.0;
/// Values above this many means do not count in the next mean.
const CUT: f32 = 4.0;
/// A rare sample has this many times the mean around, and this many times the second brightest pixel beside it.
const RARE: f32 = 4.0;
const BESIDE: f32 = 1.5;
/// Variance over the squared value from which on a pixel has most of its light from one sample.
const SINGLE: f32 = 0.5;
/// Deviation, in blocks, of the Gaussian that spreads its light.
const SPREAD: f32 = 2.0;
/// Means.
const PASSES: usize = 3;
/// Pixels of a block's side.
const BLOCK: usize = 4;

/// How many pixels were spread, and how many cut.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Fireflies {
    pub(crate) spread: usize,
    pub(crate) cut: usize,
}

/// Spreads rare samples where the `variance` (mean over the channels) tells them ([`spread`]), then scales pixels whose mean over the
/// channels exceeds `over mean + 0.5`, with the local mean of the blocks around, down to it; the hue stays. Both the pixel and the local
/// mean are judged without the light that was just spread onto them, so that no pixel is cut for what others gave it; with that
/// light a pixel may end above the limit. Units: exposure. Pixels of `weight` 0 stay and do not count.
pub(crate) fn tame_fireflies(
    irradiance: &mut [f32],
    weight: &[f32],
    variance: Option<&[f32]>,
    width: usize,
    over: f32,
) -> Fireflies {
    let n = irradiance.len() / 3;
    // Only the rows that hold pixels.
    let rows: Vec<bool> = weight.chunks(width).map(|row| row.iter().any(|w| *w > 0.0)).collect();
    let (Some(first), Some(last)) = (rows.iter().position(|r| *r), rows.iter().rposition(|r| *r)) else {
        return Fireflies::default();
    };
    let range = first / BLOCK * BLOCK * width..((last / BLOCK + 1) * BLOCK * width).min(n);
    let weight = &weight[range.clone()];
    let (r, rest) = irradiance.split_at_mut(n);
    let (g, b) = rest.split_at_mut(n);
    let mut planes = [&mut r[range.clone()], &mut g[range.clone()], &mut b[range.clone()]];
    let mut mean = vec![0.0; weight.len()];
    mean.par_chunks_mut(width).enumerate().with_min_len(16).for_each(|(y, mean)| {
        let [r, g, b] = planes.each_ref().map(|p| &p[y * width..][..width]);
        for (x, m) in mean.iter_mut().enumerate() {
            *m = (r[x] + g[x] + b[x]) * (1.0 / 3.0);
        }
    });
    let local = local_means(&mean, weight, width);
    let spread = match variance {
        Some(variance) => spread(&mut planes, &mut mean, weight, &variance[range], width, &local),
        None => 0,
    };
    Fireflies { spread, cut: cut(planes, &mean, weight, width, over, &local) }
}

/// Scales pixels whose `mean`, without light that was spread onto them, is beyond the limit by what that is above it; how many.
fn cut(
    planes: [&mut [f32]; 3],
    mean: &[f32],
    weight: &[f32],
    width: usize,
    over: f32,
    local: &[f32],
) -> usize {
    let blocks = width.div_ceil(BLOCK);
    let [r, g, b] = planes;
    let mut changed = vec![0_usize; mean.len().div_ceil(width)];
    let rows = r.par_chunks_mut(width).zip(g.par_chunks_mut(width)).zip(b.par_chunks_mut(width));
    rows.zip(&mut changed).enumerate().with_min_len(16).for_each(|(y, (((r, g), b), changed))| {
        let local = &local[y / BLOCK * blocks..];
        for (x, mean) in mean[y * width..].iter().take(r.len()).enumerate() {
            let limit = over * local[x / BLOCK] + 0.5;
            if *mean > limit && weight[y * width + x] > 0.0 {
                let scale = limit / mean;
                r[x] *= scale;
                g[x] *= scale;
                b[x] *= scale;
                *changed += 1;
            }
        }
    });
    changed.iter().sum()
}

/// Pixels that hardly any path has lit, and so brightly that no filter could smooth them: what they have above
/// [`RARE`] times the mean around, if not two pixels beside them are nearly as bright, is spread over the blocks around, in
/// proportion to their means. The light stays the same on the whole (after the reweighting of [@zirr2018]).
///
/// The `variance` (mean over the channels) has to say that one sample is nearly all of the pixel: outlines of lamps are as bright,
/// but seen by many. Returns how many pixels were cut.
fn spread(
    planes: &mut [&mut [f32]; 3],
    mean: &mut [f32],
    weight: &[f32],
    variance: &[f32],
    width: usize,
    local: &[f32],
) -> usize {
    let height = mean.len().div_ceil(width);
    let cw = width.div_ceil(BLOCK);
    let block = |i: usize| i / width / BLOCK * cw + i % width / BLOCK;
    // The pixels and what they keep.
    let of_row = |y: usize| {
        let local = &local[y / BLOCK * cw..][..cw];
        let row = mean[y * width..][..width].chunks(BLOCK).zip(local).enumerate();
        let mut found = Vec::new();
        for (bx, (means, local)) in row {
            let usual = RARE * local + 0.5;
            if means.iter().all(|m| *m <= usual) {
                continue;
            }
            for i in (0..means.len()).map(|t| y * width + bx * BLOCK + t) {
                let own = mean[i];
                if weight[i] > 0.0 && own > usual && variance[i] >= SINGLE * own * own {
                    let limit = usual.max(BESIDE * second_around(mean, weight, i, width, height));
                    if own > limit {
                        found.push((i, limit / own));
                    }
                }
            }
        }
        found
    };
    let found: Vec<Vec<(usize, f32)>> = (0..height).into_par_iter().with_min_len(16).map(of_row).collect();
    let count = found.iter().map(Vec::len).sum();
    // Per block: the light that is spread, the mean that attracts it.
    let mut sums = vec![vec![0.0_f32; local.len()]; 4];
    for (i, kept) in found.into_iter().flatten() {
        mean[i] *= kept;
        for (plane, sum) in planes.iter_mut().zip(&mut sums) {
            sum[block(i)] += plane[i] * (1.0 - kept);
            plane[i] *= kept;
        }
    }
    if count == 0 {
        return 0;
    }
    for (y, weight) in weight.chunks(width).enumerate() {
        let attracted = &mut sums[3][y / BLOCK * cw..][..cw];
        for ((a, weight), local) in
            attracted.iter_mut().zip(weight.chunks(BLOCK)).zip(&local[y / BLOCK * cw..])
        {
            *a += local * weight.iter().map(|w| f32::from(*w > 0.0)).sum::<f32>();
        }
    }
    let taps = gaussian_taps(SPREAD);
    // What a block gives is divided by all that attracts it there, so that no light is lost next to dark blocks.
    let attracting = blur_sums(&sums[3], cw, &taps);
    for channel in &mut sums[..3] {
        channel.iter_mut().zip(&attracting).filter(|(_, a)| **a > 0.0).for_each(|(s, a)| *s /= a);
    }
    for (plane, sums) in planes.iter_mut().zip(&sums) {
        let sums = blur_sums(sums, cw, &taps);
        plane.par_chunks_mut(width).enumerate().with_min_len(16).for_each(|(y, row)| {
            let at = y / BLOCK * cw;
            let weight = &weight[y * width..][..width];
            for (x, v) in row.iter_mut().enumerate() {
                let light = local[at + x / BLOCK] * sums[at + x / BLOCK];
                *v += if weight[x] > 0.0 { light } else { 0.0 };
            }
        });
    }
    count
}

/// The second largest of the values around a pixel.
fn second_around(mean: &[f32], weight: &[f32], i: usize, width: usize, height: usize) -> f32 {
    let (x, y) = (i % width, i / width);
    let mut most = [0.0_f32; 2];
    for v in y.saturating_sub(1)..(y + 2).min(height) {
        for k in (x.saturating_sub(1)..(x + 2).min(width)).map(|u| v * width + u) {
            if k != i && weight[k] > 0.0 {
                let low = mean[k].min(most[0]);
                most = [mean[k].max(most[0]), low.max(most[1])];
            }
        }
    }
    most[1]
}

/// The mean around each block, without the values that stand out.
fn local_means(mean: &[f32], weight: &[f32], width: usize) -> Vec<f32> {
    let height = mean.len().div_ceil(width);
    let (ch, cw) = (height.div_ceil(BLOCK), width.div_ceil(BLOCK));
    let mut local = vec![f32::INFINITY; ch * cw];
    for _ in 0..PASSES {
        let mut sums = vec![[0.0_f32; 2]; ch * cw];
        sums.par_chunks_mut(cw).enumerate().for_each(|(cy, sums)| {
            let local = &local[cy * cw..][..cw];
            for y in cy * BLOCK..(cy * BLOCK + BLOCK).min(height) {
                let (mean, weight) = (&mean[y * width..][..width], &weight[y * width..][..width]);
                let blocks = mean.chunks(BLOCK).zip(weight.chunks(BLOCK)).zip(local).zip(sums.iter_mut());
                for (((mean, weight), local), sum) in blocks {
                    for (m, w) in mean.iter().zip(weight) {
                        let known = if *w > 0.0 { 1.0 } else { 0.0 };
                        sum[0] += known * m.min(CUT * local);
                        sum[1] += known;
                    }
                }
            }
        });
        let around = |c: usize, n: usize| c.saturating_sub(1)..(c + 2).min(n);
        local = (0..ch * cw)
            .map(|k| {
                let mut total = [0.0_f32; 2];
                for y in around(k / cw, ch) {
                    for [sum, count] in &sums[y * cw..][around(k % cw, cw)] {
                        total[0] += sum;
                        total[1] += count;
                    }
                }
                if total[1] > 0.0 { total[0] / total[1] } else { 0.0 }
            })
            .collect();
    }
    local
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outliers_go_and_sparse_light_stays() {
        let (width, height) = (64, 48);
        // Six of ten samples are black, the others 1: nothing stands out.
        let sparse: Vec<f32> = (0..3 * height * width)
            .map(|i| if (i % (height * width)) * 7919 % 10 < 6 { 0.0 } else { 1.0 })
            .collect();
        let weight = vec![1.0; height * width];
        let mut plane = sparse.clone();
        assert_eq!(tame_fireflies(&mut plane, &weight, None, width, OTHERS), Fireflies::default());
        assert_eq!(plane, sparse);
        for value in [40.0, 1e4] {
            let mut plane = sparse.clone();
            (0..3).for_each(|c| plane[c * height * width + 20 * width + 31] = value);
            assert_eq!(tame_fireflies(&mut plane, &weight, None, width, OTHERS).cut, 1);
            assert!((2.0..8.0).contains(&plane[20 * width + 31]), "{}", plane[20 * width + 31]);
        }
    }

    #[test]
    fn the_light_of_a_rare_sample_is_spread_and_that_of_lamps_stays() {
        let (width, height) = (64, 48);
        let n = width * height;
        let mut plane = vec![0.3; 3 * n];
        let single = 20 * width + 31;
        let lamp = |i: usize| (8..12).contains(&(i % width)) && (8..12).contains(&(i / width));
        for i in (0..3 * n).filter(|i| i % n == single || lamp(i % n)) {
            plane[i] = 60.0;
        }
        let weight = vec![1.0; n];
        let total = |plane: &[f32]| plane.iter().map(|v| f64::from(*v)).sum::<f64>();
        let single_sample: Vec<f32> = plane[..n].iter().map(|v| v * v).collect();
        let mut spread = plane.clone();
        let tame =
            |plane: &mut [f32], variance: &[f32]| tame_fireflies(plane, &weight, Some(variance), width, 1e6);
        assert_eq!(tame(&mut spread, &single_sample), Fireflies { spread: 1, cut: 0 });
        assert!((0..n).all(|i| !lamp(i) || spread[i] >= 60.0) && spread[single] < 4.0, "{}", spread[single]);
        assert!((total(&spread) / total(&plane) - 1.0).abs() < 1e-3, "{} {}", total(&spread), total(&plane));
        // What many samples have seen is no rare sample.
        let mut kept = plane.clone();
        assert_eq!(tame(&mut kept, &vec![1.0; n]), Fireflies::default());
        assert_eq!(kept, plane);
    }
}
