//! Blending two reconstructions by the local variance of one of them.
//!
//! Where depth varies much within a window (silhouettes, clutter) the squared data term, which fills faster, takes
//! over from the absolute one, which keeps details.

use rayon::prelude::*;

/// What decides where which reconstruction is used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlendOptions {
    /// Side of the window, pixels, odd.
    pub window: usize,
    /// Normalised variance at which both count equally.
    pub threshold: f32,
    /// Steepness of the transition.
    pub sharpness: f32,
    /// Exponent of the weight.
    pub power: f32,
    /// Regularisation of the guided filter, in squared units of the guide.
    pub epsilon: f32,
}

impl Default for BlendOptions {
    /// Windows of 7 pixels, threshold 0.2, sharpness 20, power 1.
    fn default() -> Self {
        Self { window: 7, threshold: 0.2, sharpness: 20.0, power: 1.0, epsilon: 1e-4 }
    }
}

/// Means over odd windows that end at the border; every mean is over the pixels inside.
///
/// Sums run along rows and then down columns in double precision, so that constants stay constants.
///
/// # Panics
/// If `window` is even or `values` has not `width * height` entries.
pub fn box_mean(values: &[f32], width: usize, height: usize, window: usize) -> Vec<f32> {
    assert!(window % 2 == 1, "an odd window");
    assert_eq!(values.len(), width * height, "one value per pixel");
    if values.is_empty() {
        return Vec::new();
    }
    let r = window / 2;
    let mut across = vec![0.0_f32; values.len()];
    across.par_chunks_mut(width).zip(values.par_chunks(width)).for_each(|(out, row)| {
        let mut sum: f64 = row[..r.min(width)].iter().map(|v| f64::from(*v)).sum();
        for x in 0..width {
            if x + r < width {
                sum += f64::from(row[x + r]);
            }
            if x > r {
                sum -= f64::from(row[x - r - 1]);
            }
            let count = (x + r).min(width - 1) - x.saturating_sub(r) + 1;
            out[x] = (sum / count as f64) as f32;
        }
    });
    // Blocks of rows run their own sums down the columns.
    let block = height.div_ceil(16).max(1);
    let mut out = vec![0.0; values.len()];
    out.par_chunks_mut(width * block).enumerate().for_each(|(b, rows)| {
        let first = b * block;
        let mut sums = vec![0.0_f64; width];
        let add = |sums: &mut [f64], y: usize, sign: f64| {
            let row = &across[y * width..(y + 1) * width];
            sums.iter_mut().zip(row).for_each(|(s, v)| *s += sign * f64::from(*v));
        };
        for y in first.saturating_sub(r)..(first + r).min(height) {
            add(&mut sums, y, 1.0);
        }
        for (k, row) in rows.chunks_mut(width).enumerate() {
            let y = first + k;
            if y + r < height {
                add(&mut sums, y + r, 1.0);
            }
            if y > r && k > 0 {
                add(&mut sums, y - r - 1, -1.0);
            }
            let count = ((y + r).min(height - 1) - y.saturating_sub(r) + 1) as f64;
            row.iter_mut().zip(&sums).for_each(|(o, s)| *o = (s / count) as f32);
        }
    });
    out
}

/// Variance of `values` in odd windows, at least 0; exactly 0 where they are constant.
///
/// # Panics
/// As [`box_mean`].
pub fn local_variance(values: &[f32], width: usize, height: usize, window: usize) -> Vec<f32> {
    Moments::new(values, width, height, window).variance
}

/// Mean and variance in windows, around one of the values: squares of large offsets would cancel.
struct Moments {
    width: usize,
    height: usize,
    window: usize,
    centered: Vec<f32>,
    mean: Vec<f32>,
    variance: Vec<f32>,
}

impl Moments {
    fn new(values: &[f32], width: usize, height: usize, window: usize) -> Self {
        let pivot = values.first().copied().unwrap_or(0.0);
        let centered: Vec<f32> = values.par_iter().map(|v| v - pivot).collect();
        let squared: Vec<f32> = centered.par_iter().map(|v| v * v).collect();
        let mean = box_mean(&centered, width, height, window);
        let mut variance = box_mean(&squared, width, height, window);
        variance.par_iter_mut().zip(&mean).for_each(|(v, m)| *v = (*v - m * m).max(0.0));
        Self { width, height, window, centered, mean, variance }
    }

    /// Smooths `values` with these values as the guide.
    fn guided_filter(&self, values: &[f32], epsilon: f32) -> Vec<f32> {
        let mean = |v: &[f32]| box_mean(v, self.width, self.height, self.window);
        let product: Vec<f32> = self.centered.par_iter().zip(values).map(|(i, v)| i * v).collect();
        let (mean_v, mut a) = (mean(values), mean(&product));
        let mut b = mean_v;
        a.par_iter_mut().zip(&mut b).enumerate().for_each(|(k, (a, b))| {
            *a = (*a - self.mean[k] * *b) / (self.variance[k] + epsilon);
            *b -= *a * self.mean[k];
        });
        let (a, b) = (mean(&a), mean(&b));
        a.par_iter().zip(&b).zip(&self.centered).map(|((a, b), i)| a * i + b).collect()
    }
}

/// The guided filter (He et al. 2013): smooths `values` along the edges of `guide`.
///
/// # Panics
/// As [`box_mean`], or if the guide has another size.
pub fn guided_filter(
    guide: &[f32],
    values: &[f32],
    width: usize,
    height: usize,
    window: usize,
    epsilon: f32,
) -> Vec<f32> {
    assert_eq!(guide.len(), values.len(), "one guide per value");
    Moments::new(guide, width, height, window).guided_filter(values, epsilon)
}

/// The weight of the squared data term's result, from the local variance of `u`.
///
/// Variance is normalised by its minimum and 99th percentile, clipped to `[0, 1]`, smoothed by the guided filter with
/// guide `u`, and put through a sigmoid: `W = (1 / (1 + exp(-s (V - tau))))^p`.
///
/// # Panics
/// If the window is even or `u` has not `width * height` entries.
pub fn blend_weight(u: &[f32], width: usize, height: usize, options: &BlendOptions) -> Vec<f32> {
    let moments = Moments::new(u, width, height, options.window);
    let low = moments.variance.iter().copied().fold(f32::INFINITY, f32::min);
    let high = percentile(&moments.variance, 0.99);
    let scale = if high > low { 1.0 / (high - low) } else { 0.0 };
    let v: Vec<f32> = moments.variance.par_iter().map(|v| ((v - low) * scale).clamp(0.0, 1.0)).collect();
    let mut w = moments.guided_filter(&v, options.epsilon);
    w.par_iter_mut().for_each(|w| {
        *w = (1.0 / (1.0 + (-options.sharpness * (*w - options.threshold)).exp())).powf(options.power);
    });
    w
}

/// `(1 - w) a + w b`, pixel by pixel.
///
/// # Panics
/// If the slices differ in length.
pub fn blend(a: &[f32], b: &[f32], weight: &[f32]) -> Vec<f32> {
    assert!(a.len() == b.len() && a.len() == weight.len(), "one weight per pixel");
    a.par_iter().zip(b).zip(weight).map(|((a, b), w)| a + w * (b - a)).collect()
}

/// The value below which the share `q` lies; of large arrays from every n-th value.
fn percentile(values: &[f32], q: f64) -> f32 {
    let step = (values.len() >> 17).max(1);
    let mut some: Vec<f32> = values.iter().copied().step_by(step).collect();
    if some.is_empty() {
        return 0.0;
    }
    let at = ((some.len() - 1) as f64 * q).round() as usize;
    *some.select_nth_unstable_by(at, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::Rng;

    fn noise(n: usize) -> Vec<f32> {
        let mut rng = Rng::new(4, 0);
        (0..n).map(|_| rng.next_f32()).collect()
    }

    /// Mean over the window around each pixel, term by term.
    fn naive(values: &[f32], w: usize, h: usize, window: usize, f: impl Fn(f64) -> f64) -> Vec<f64> {
        let r = window as isize / 2;
        let mut out = Vec::new();
        for y in 0..h as isize {
            for x in 0..w as isize {
                let (mut sum, mut count) = (0.0, 0.0);
                for v in (y - r).max(0)..=(y + r).min(h as isize - 1) {
                    for u in (x - r).max(0)..=(x + r).min(w as isize - 1) {
                        sum += f(f64::from(values[v as usize * w + u as usize]));
                        count += 1.0;
                    }
                }
                out.push(sum / count);
            }
        }
        out
    }

    #[test]
    fn means_and_variances_are_those_of_the_windows() {
        for (w, h) in [(1, 1), (1, 9), (13, 1), (5, 4), (40, 37)] {
            let values = noise(w * h);
            for window in [1, 3, 7, 15] {
                let mean = naive(&values, w, h, window, |v| v);
                let square = naive(&values, w, h, window, |v| v * v);
                let (m, v) = (box_mean(&values, w, h, window), local_variance(&values, w, h, window));
                for i in 0..w * h {
                    assert!((f64::from(m[i]) - mean[i]).abs() < 1e-6, "{w} x {h}, {window}");
                    let exact = square[i] - mean[i] * mean[i];
                    assert!((f64::from(v[i]) - exact).abs() < 2e-6, "{w} x {h}, {window}");
                }
            }
        }
    }

    #[test]
    fn constants_have_no_variance_and_no_weight() {
        for c in [0.1_f32, 1e4 + 0.3] {
            let u = vec![c; 30 * 20];
            assert!(local_variance(&u, 30, 20, 7).iter().all(|v| *v == 0.0));
            let w = blend_weight(&u, 30, 20, &BlendOptions::default());
            assert!(w.iter().all(|w| (*w - 1.0 / (1.0 + 4.0_f32.exp())).abs() < 1e-6));
        }
    }

    #[test]
    fn steps_are_given_to_the_squared_term() {
        let u: Vec<f32> = (0..64 * 64).map(|i| if i % 64 < 32 { 0.0 } else { 1.0 }).collect();
        let w = blend_weight(&u, 64, 64, &BlendOptions::default());
        let row = &w[32 * 64..33 * 64];
        assert!(row[31] > 0.9 && row[32] > 0.9, "{} {}", row[31], row[32]);
        assert!(row[4] < 0.05 && row[60] < 0.05);
        let mixed = blend(&vec![1.0; 64 * 64], &vec![3.0; 64 * 64], &w);
        assert!(mixed[32 * 64 + 31] > 2.8 && mixed[32 * 64 + 4] < 1.1);
    }

    #[test]
    fn the_guided_filter_keeps_edges_of_its_guide() {
        let (w, h) = (40, 40);
        let guide: Vec<f32> = (0..w * h).map(|i| if i % w < 20 { 0.0 } else { 1.0 }).collect();
        let noisy: Vec<f32> = guide.iter().zip(noise(w * h)).map(|(g, n)| g + 0.4 * (n - 0.5)).collect();
        let out = guided_filter(&guide, &noisy, w, h, 7, 1e-4);
        let error = |v: &[f32]| v.iter().zip(&guide).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(error(&noisy) > 0.19 && error(&out) < 0.1, "{}", error(&out));
    }
}
