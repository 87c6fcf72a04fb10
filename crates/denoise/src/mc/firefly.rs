//! Rare samples of huge value, pulled down to what their neighbourhood makes plausible.
//!
//! The neighbourhood is judged by a mean without its own fireflies: the mean of blocks and their neighbours, taken three
//! times, each time with values cut at four times the mean before. A median would be 0 where most samples are black, as
//! they are in indirect light, and would darken all that is left.

use super::window::{blur_sums, gaussian_taps};
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};

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

/// Scales pixels whose mean over the channels exceeds `over mean + 0.5`, with the local mean of the blocks around, down to it;
/// the hue stays. Units: exposure. Pixels of `weight` 0 stay and do not count. Returns how many were scaled.
pub(crate) fn clamp_fireflies(irradiance: &mut [f32], weight: &[f32], width: usize, over: f32) -> usize {
    let n = irradiance.len() / 3;
    let (r, rest) = irradiance.split_at_mut(n);
    let (g, b) = rest.split_at_mut(n);
    let mean: Vec<f32> = r.iter().zip(&*g).zip(&*b).map(|((r, g), b)| (r + g + b) * (1.0 / 3.0)).collect();
    let local = local_means(&mean, weight, width);
    let blocks = width.div_ceil(BLOCK);
    let mut changed = vec![0_usize; n.div_ceil(width)];
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
pub(crate) fn spread_fireflies(
    irradiance: &mut [f32],
    weight: &[f32],
    variance: &[f32],
    width: usize,
) -> usize {
    let n = weight.len();
    let (height, cw) = (n.div_ceil(width), width.div_ceil(BLOCK));
    let mean: Vec<f32> =
        (0..n).map(|i| (irradiance[i] + irradiance[n + i] + irradiance[2 * n + i]) * (1.0 / 3.0)).collect();
    let local = local_means(&mean, weight, width);
    let block = |i: usize| i / width / BLOCK * cw + i % width / BLOCK;
    // Per block: the light that is spread, the mean that attracts it.
    let mut sums = vec![vec![0.0_f32; local.len()]; 4];
    let mut count = 0;
    for i in (0..n).filter(|i| weight[*i] > 0.0) {
        let (k, own) = (block(i), mean[i]);
        sums[3][k] += local[k];
        let usual = RARE * local[k] + 0.5;
        if own <= usual || variance[i] < SINGLE * own * own {
            continue;
        }
        let limit = usual.max(BESIDE * second_around(&mean, weight, i, width, height));
        if own > limit {
            count += 1;
            for c in 0..3 {
                let v = &mut irradiance[c * n + i];
                sums[c][k] += *v * (1.0 - limit / own);
                *v *= limit / own;
            }
        }
    }
    if count == 0 {
        return 0;
    }
    let taps = gaussian_taps(SPREAD);
    // What a block gives is divided by all that attracts it there, so that no light is lost next to dark blocks.
    let attracting = blur_sums(&sums[3], cw, &taps);
    for channel in &mut sums[..3] {
        channel.iter_mut().zip(&attracting).filter(|(_, a)| **a > 0.0).for_each(|(s, a)| *s /= a);
    }
    let sums: Vec<Vec<f32>> = sums[..3].iter().map(|s| blur_sums(s, cw, &taps)).collect();
    for i in (0..n).filter(|i| weight[*i] > 0.0) {
        let k = block(i);
        (0..3).for_each(|c| irradiance[c * n + i] += local[k] * sums[c][k]);
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
        assert_eq!(clamp_fireflies(&mut plane, &weight, width, OTHERS), 0);
        assert_eq!(plane, sparse);
        for value in [40.0, 1e4] {
            let mut plane = sparse.clone();
            (0..3).for_each(|c| plane[c * height * width + 20 * width + 31] = value);
            assert_eq!(clamp_fireflies(&mut plane, &weight, width, OTHERS), 1);
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
        assert_eq!(spread_fireflies(&mut spread, &weight, &single_sample, width), 1);
        assert!((0..n).all(|i| !lamp(i) || spread[i] >= 60.0) && spread[single] < 4.0, "{}", spread[single]);
        assert!((total(&spread) / total(&plane) - 1.0).abs() < 1e-3, "{} {}", total(&spread), total(&plane));
        // What many samples have seen is no rare sample.
        let mut kept = plane.clone();
        assert_eq!(spread_fireflies(&mut kept, &weight, &vec![1.0; n], width), 0);
        assert_eq!(kept, plane);
    }
}
