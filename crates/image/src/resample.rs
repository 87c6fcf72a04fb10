//! Resampling: box reduction by an integer factor with its adjoint, and bilinear resizing.

use crate::Image;
use rayon::prelude::*;

/// Averages blocks of `factor x factor` pixels. Where a side is no multiple of `factor`, its last blocks average the
/// pixels that they hold.
///
/// # Panics
/// If `factor` is 0.
pub fn downsample(image: &Image, factor: usize) -> Image {
    assert!(factor > 0, "a positive factor");
    let channels = image.channels;
    let mut out = Image::new(image.width.div_ceil(factor), image.height.div_ceil(factor), channels);
    let row_len = (out.width * channels).max(1);
    out.data.par_chunks_mut(row_len).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.chunks_exact_mut(channels).enumerate() {
            let count = block(image, x, y, factor, |i| {
                for (p, s) in pixel.iter_mut().zip(&image.data[i..i + channels]) {
                    *p += s;
                }
            });
            for p in pixel {
                *p /= count;
            }
        }
    });
    out
}

/// Adjoint of [`downsample`]: the gradient of an image of `width x height` pixels from the one of its reduction.
///
/// # Panics
/// If `factor` is 0 or `grad_small` has another size than the reduction.
pub fn downsample_vjp(grad_small: &Image, factor: usize, width: usize, height: usize) -> Image {
    assert!(factor > 0, "a positive factor");
    let expected = (width.div_ceil(factor), height.div_ceil(factor));
    assert_eq!((grad_small.width, grad_small.height), expected, "the size of the reduction");
    let channels = grad_small.channels;
    let mut out = Image::new(width, height, channels);
    let row_len = (width * channels).max(1);
    out.data.par_chunks_mut(row_len).enumerate().for_each(|(y, row)| {
        let rows = factor.min(height - y / factor * factor);
        for (x, pixel) in row.chunks_exact_mut(channels).enumerate() {
            let columns = factor.min(width - x / factor * factor);
            let weight = 1.0 / (rows * columns) as f32;
            for (p, g) in pixel.iter_mut().zip(grad_small.pixel(x / factor, y / factor)) {
                *p = g * weight;
            }
        }
    });
    out
}

/// Visits the first sample of each pixel of a block and returns their number.
fn block(image: &Image, x: usize, y: usize, factor: usize, mut visit: impl FnMut(usize)) -> f32 {
    let (x1, y1) = (image.width.min((x + 1) * factor), image.height.min((y + 1) * factor));
    for v in y * factor..y1 {
        for u in x * factor..x1 {
            visit((v * image.width + u) * image.channels);
        }
    }
    ((x1 - x * factor) * (y1 - y * factor)) as f32
}

/// Bilinear interpolation at the pixel centres of an image of another size; edges are clamped. For reductions beyond
/// one half reduce first ([`downsample`]), since this filter reads 2 x 2 pixels alone.
///
/// # Panics
/// If the image has no pixels while the result has.
pub fn resize_bilinear(image: &Image, width: usize, height: usize) -> Image {
    let mut out = Image::new(width, height, image.channels);
    if out.data.is_empty() {
        return out;
    }
    assert!(!image.data.is_empty(), "an image with pixels");
    let columns: Vec<_> = (0..width).map(|x| tap(x, width, image.width)).collect();
    out.data.par_chunks_mut(width * image.channels).enumerate().for_each(|(y, row)| {
        let (y0, y1, fy) = tap(y, height, image.height);
        for (pixel, (x0, x1, fx)) in row.chunks_exact_mut(image.channels).zip(&columns) {
            let (a, b) = (image.pixel(*x0, y0), image.pixel(*x1, y0));
            let (c, d) = (image.pixel(*x0, y1), image.pixel(*x1, y1));
            for (k, p) in pixel.iter_mut().enumerate() {
                let top = a[k] + (b[k] - a[k]) * fx;
                let bottom = c[k] + (d[k] - c[k]) * fx;
                *p = top + (bottom - top) * fy;
            }
        }
    });
    out
}

/// The two source pixels and the weight of the second for pixel `i` of `n` over `source` pixels.
fn tap(i: usize, n: usize, source: usize) -> (usize, usize, f32) {
    let at = ((i as f64 + 0.5) * source as f64 / n as f64 - 0.5).clamp(0.0, (source - 1) as f64);
    let low = at as usize;
    (low, (low + 1).min(source - 1), (at - low as f64) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random(width: usize, height: usize, channels: usize, seed: u64) -> Image {
        let mut random = photofit_gradcheck::Uniform::new(seed);
        Image::from_fn(width, height, channels, |_, _, _| random.range(-1.0, 1.0) as f32)
    }

    #[test]
    fn downsample_averages_blocks_and_partial_blocks() {
        let image = Image::from_fn(5, 3, 1, |x, y, _| (10 * y + x) as f32);
        assert_eq!(downsample(&image, 2).data, [5.5, 7.5, 9.0, 20.5, 22.5, 24.0]);
        assert_eq!(downsample(&image, 1), image);
        assert_eq!(downsample(&image, 7).data, [12.0]);
    }

    #[test]
    fn downsample_vjp_is_the_adjoint() {
        for (w, h, f) in [(8, 8, 2), (7, 5, 3), (4, 9, 4), (1, 1, 5)] {
            let x = random(w, h, 3, 1);
            let small = downsample(&x, f);
            let seed = random(small.width, small.height, 3, 2);
            let back = downsample_vjp(&seed, f, w, h);
            let dot = |a: &Image, b: &Image| -> f64 {
                a.data.iter().zip(&b.data).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
            };
            let (forward, adjoint) = (dot(&small, &seed), dot(&x, &back));
            assert!((forward - adjoint).abs() < 1e-5, "{w}x{h}/{f}: {forward} {adjoint}");
            assert!(forward.abs() > 1e-3, "{w}x{h}/{f}: the check is not empty");
        }
    }

    #[test]
    fn bilinear_keeps_ramps_and_identity() {
        let image = random(6, 5, 2, 3);
        assert_eq!(resize_bilinear(&image, 6, 5), image);
        let ramp = Image::from_fn(8, 4, 1, |x, y, _| 2.0 * (x as f32 + 0.5) + 3.0 * (y as f32 + 0.5));
        let large = resize_bilinear(&ramp, 24, 8);
        for y in 1..7 {
            for x in 2..22 {
                let expected = 2.0 * (x as f32 + 0.5) / 3.0 + 3.0 * (y as f32 + 0.5) / 2.0;
                assert!((large.pixel(x, y)[0] - expected).abs() < 1e-4, "{x},{y}");
            }
        }
        assert_eq!(resize_bilinear(&image, 0, 4).data.len(), 0);
    }
}
