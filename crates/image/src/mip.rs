//! Mip pyramids: an exact box filter for every size, and its adjoint.
//!
//! A level of width `n` has the next level of width `m = max(n / 2, 1)` (rounded down, as graphics APIs do). Output
//! texel `i` is the area average of `[i n/m, (i+1) n/m)`: two texels of weight 1/2 for even `n`, and for odd `n = 2m+1`
//! the three texels `2i, 2i+1, 2i+2` with weights `(m-i)/n, m/n, (i+1)/n` (NPOT mip filtering, Guthe and Heckbert
//! 2005). The mean of the image is thereby the same on every level.

use crate::Image;
use photofit_scalar::Real;
use rayon::prelude::*;

/// Width and height of the next smaller level; `1` stays `1`.
#[inline]
pub fn mip_size(width: usize, height: usize) -> (usize, usize) {
    ((width / 2).max(1), (height / 2).max(1))
}

/// Number of levels of a full pyramid, the base included: `floor(log2(max(width, height))) + 1`.
#[inline]
pub fn mip_levels(width: usize, height: usize) -> usize {
    width.max(height).max(1).ilog2() as usize + 1
}

/// First source texel, number of taps and weights of output texel `i` of a row of `n`.
#[inline(always)]
fn taps<T: Real>(i: usize, n: usize) -> (usize, usize, [T; 3]) {
    if n == 1 {
        return (0, 1, [T::one(), T::zero(), T::zero()]);
    }
    let half = T::of(0.5);
    if n.is_multiple_of(2) {
        return (2 * i, 2, [half, half, T::zero()]);
    }
    let (m, n, i_f) = ((n / 2) as f64, n as f64, i as f64);
    (2 * i, 3, [T::of((m - i_f) / n), T::of(m / n), T::of((i_f + 1.0) / n)])
}

/// The transpose of [`taps`]: the output texels that read texel `v` of a row of `n`, and their weights for it.
#[inline(always)]
fn parents<T: Real>(v: usize, n: usize) -> ([usize; 2], usize, [T; 2]) {
    if n == 1 {
        return ([0, 0], 1, [T::one(), T::zero()]);
    }
    if n.is_multiple_of(2) {
        return ([v / 2, 0], 1, [T::of(0.5), T::zero()]);
    }
    let (m, n_f, i) = (n / 2, n as f64, v / 2);
    if !v.is_multiple_of(2) {
        return ([i, 0], 1, [T::of(m as f64 / n_f), T::zero()]);
    }
    // An even texel lies in two outputs, but for the first and the last one.
    let (before, after) = (T::of(i as f64 / n_f), T::of((m - i) as f64 / n_f));
    if i == 0 {
        ([0, 0], 1, [after, T::zero()])
    } else if i == m {
        ([m - 1, 0], 1, [before, T::zero()])
    } else {
        ([i - 1, i], 2, [before, after])
    }
}

fn check_shapes(source: usize, smaller: usize, (width, height): (usize, usize), channels: usize) {
    let (w, h) = mip_size(width, height);
    assert!(width > 0 && height > 0 && channels > 0, "a level has pixels with channels");
    assert_eq!(source, width * height * channels, "one sample per pixel and channel");
    assert_eq!(smaller, w * h * channels, "the next level has the size `mip_size`");
}

/// Rows that one task works on, for rows of `len` samples.
fn rows_per_task(len: usize) -> usize {
    (1_usize << 14).div_ceil(len.max(1))
}

/// `out += weight * row`.
#[inline(always)]
fn add_scaled<T: Real>(out: &mut [T], weight: T, row: &[T]) {
    for (o, r) in out.iter_mut().zip(row) {
        *o += weight * *r;
    }
}

/// Writes the next smaller level of `source` (`height x width x channels`, interleaved) to `smaller`.
///
/// # Panics
/// If a slice has another length than its level, or the source has no samples.
pub fn mip_down<T: Real>(source: &[T], width: usize, height: usize, channels: usize, smaller: &mut [T]) {
    check_shapes(source.len(), smaller.len(), (width, height), channels);
    let (w, _) = mip_size(width, height);
    let (long, short) = ((width * channels).max(1), (w * channels).max(1));
    let rows = smaller.par_chunks_exact_mut(short).enumerate().with_min_len(rows_per_task(long));
    rows.for_each_init(
        || vec![T::zero(); long],
        |column_sums, (y, out)| {
            let (first, n, weights) = taps::<T>(y, height);
            column_sums.fill(T::zero());
            for (j, weight) in weights.iter().enumerate().take(n) {
                add_scaled(column_sums, *weight, &source[(first + j) * long..][..long]);
            }
            for (x, out) in out.chunks_exact_mut(channels).enumerate() {
                let (first, n, weights) = taps::<T>(x, width);
                out.fill(T::zero());
                for (texel, weight) in
                    column_sums[first * channels..].chunks_exact(channels).zip(weights).take(n)
                {
                    add_scaled(out, weight, texel);
                }
            }
        },
    );
}

/// Adjoint of [`mip_down`]: adds to `grad_source` what `grad_smaller` passes down to each texel.
///
/// # Panics
/// If a slice has another length than its level, or the source has no samples.
pub fn mip_down_vjp<T: Real>(
    grad_smaller: &[T],
    width: usize,
    height: usize,
    channels: usize,
    grad_source: &mut [T],
) {
    check_shapes(grad_source.len(), grad_smaller.len(), (width, height), channels);
    let (w, _) = mip_size(width, height);
    let (long, short) = ((width * channels).max(1), (w * channels).max(1));
    // A gather over source rows, so that no two tasks write one texel.
    let rows = grad_source.par_chunks_exact_mut(long).enumerate().with_min_len(rows_per_task(long));
    rows.for_each_init(
        || vec![T::zero(); short],
        |row_sums, (y, grad)| {
            let (from, n, weights) = parents::<T>(y, height);
            row_sums.fill(T::zero());
            for (from, weight) in from.into_iter().zip(weights).take(n) {
                add_scaled(row_sums, weight, &grad_smaller[from * short..][..short]);
            }
            for (x, grad) in grad.chunks_exact_mut(channels).enumerate() {
                let (from, n, weights) = parents::<T>(x, width);
                for (from, weight) in from.into_iter().zip(weights).take(n) {
                    add_scaled(grad, weight, &row_sums[from * channels..][..channels]);
                }
            }
        },
    );
}

/// The full pyramid of an image, the image itself first and one pixel last.
///
/// ```
/// use photofit_image::{Image, pyramid};
/// let levels = pyramid(Image::from_fn(5, 3, 1, |x, _, _| x as f32));
/// assert_eq!(levels.iter().map(|l| (l.width, l.height)).collect::<Vec<_>>(), [(5, 3), (2, 1), (1, 1)]);
/// assert!((levels[2].data[0] - 2.0).abs() < 1e-6); // the mean
/// ```
///
/// # Panics
/// If the image has no samples.
pub fn pyramid(base: Image) -> Vec<Image> {
    let mut levels = vec![base];
    while let Some(last) = levels.last().filter(|l| l.width > 1 || l.height > 1) {
        let (w, h) = mip_size(last.width, last.height);
        let mut next = Image::new(w, h, last.channels);
        mip_down(&last.data, last.width, last.height, last.channels, &mut next.data);
        levels.push(next);
    }
    levels
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_gradcheck::{Uniform, check};

    const SIZES: [(usize, usize); 8] = [(1, 1), (2, 2), (3, 3), (5, 4), (7, 1), (1, 6), (9, 5), (8, 13)];

    /// Area average by brute force: each output texel integrates the piecewise constant source.
    fn area_average(source: &[f64], width: usize, height: usize, x: usize, y: usize) -> f64 {
        let (w, h) = mip_size(width, height);
        let overlap = |cell: usize, i: usize, n: usize, m: usize| {
            let (a, b) = ((i * n) as f64 / m as f64, ((i + 1) * n) as f64 / m as f64);
            (b.min(cell as f64 + 1.0) - a.max(cell as f64)).max(0.0) * m as f64 / n as f64
        };
        let mut sum = 0.0;
        for v in 0..height {
            for u in 0..width {
                sum += source[v * width + u] * overlap(u, x, width, w) * overlap(v, y, height, h);
            }
        }
        sum
    }

    #[test]
    fn every_texel_is_the_area_average() {
        let mut random = Uniform::new(3);
        for (width, height) in SIZES {
            let source = random.vec(width * height, -1.0, 1.0);
            let (w, h) = mip_size(width, height);
            let mut smaller = vec![0.0; w * h];
            mip_down(&source, width, height, 1, &mut smaller);
            for y in 0..h {
                for x in 0..w {
                    let expected = area_average(&source, width, height, x, y);
                    assert!((smaller[y * w + x] - expected).abs() < 1e-14, "{width}x{height} at {x},{y}");
                }
            }
        }
    }

    #[test]
    fn vjp_is_the_adjoint() {
        let mut random = Uniform::new(4);
        for (width, height) in SIZES {
            let channels = 2;
            let (w, h) = mip_size(width, height);
            let source = random.vec(width * height * channels, -1.0, 1.0);
            let seed = random.vec(w * h * channels, -1.0, 1.0);
            let mut gradient = vec![0.0; source.len()];
            mip_down_vjp(&seed, width, height, channels, &mut gradient);
            check(&format!("{width}x{height}"), &source, &gradient, 1e-3, 1e-9, |x| {
                let mut smaller = vec![0.0; seed.len()];
                mip_down(x, width, height, channels, &mut smaller);
                smaller.iter().zip(&seed).map(|(a, b)| a * b).sum()
            });
        }
    }

    #[test]
    fn all_levels_have_the_same_mean() {
        let levels = pyramid(Image::from_fn(37, 22, 1, |x, y, _| ((x * 7 + y * 13) % 17) as f32));
        assert_eq!(levels.len(), mip_levels(37, 22));
        let mean = |i: &Image| i.data.iter().map(|v| f64::from(*v)).sum::<f64>() / i.data.len() as f64;
        for level in &levels {
            assert!((mean(level) - mean(&levels[0])).abs() < 1e-5, "{}x{}", level.width, level.height);
        }
    }
}
