//! Depth-guided interpolation: attributes of pixels without a sample from the samples of the same surface around.

use rayon::prelude::*;

/// Which neighbours count, and how much.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InterpolateOptions {
    /// Side of the window, pixels, odd.
    pub window: usize,
    /// Largest difference of the guide.
    pub threshold: f32,
    /// Added to the difference of the guide in the weight `1 / (|dD| + epsilon)`.
    pub epsilon: f32,
    /// Standard deviation of a Gaussian over the window that multiplies the weight, pixels; infinity for the
    /// thesis' weight, which ignores distance.
    pub sigma: f32,
}

impl Default for InterpolateOptions {
    /// Windows of 7 pixels, 5% of depth, weights `1 / (|dD| + 0.001)`, Gaussian of 2 pixels.
    fn default() -> Self {
        Self { window: 7, threshold: 0.05, epsilon: 1e-3, sigma: 2.0 }
    }
}

/// Fills pixels that are not `valid` from valid pixels of a window whose `guide` (ln z) is within the threshold, with
/// weights `G(distance) / (|dD| + epsilon)`; returns the filled values and which pixels have one now.
///
/// `values` holds `C` channels per pixel. The neighbour's own validity is tested: without that test holes, which hold
/// zeros, darken what they surround. Pixels without a single such neighbour are left to [`fill_channels`].
///
/// # Panics
/// If the window is even or a slice has not `width * height` entries.
pub fn interpolate<const C: usize>(
    values: &[[f32; C]],
    valid: &[bool],
    guide: &[f32],
    width: usize,
    height: usize,
    options: &InterpolateOptions,
) -> (Vec<[f32; C]>, Vec<bool>) {
    let n = width * height;
    assert!(options.window % 2 == 1, "an odd window");
    assert!(values.len() == n && valid.len() == n && guide.len() == n, "one entry per pixel");
    let r = options.window / 2;
    let (mut out, mut filled) = (values.to_vec(), valid.to_vec());
    if n == 0 {
        return (out, filled);
    }
    let known = Known::new(valid, width);
    let gauss: Vec<f32> = (0..=r).map(|d| (-0.5 * (d as f32 / options.sigma).powi(2)).exp()).collect();
    out.par_chunks_mut(width).zip(filled.par_chunks_mut(width)).enumerate().for_each(|(y, (out, filled))| {
        let rows = y.saturating_sub(r)..(y + r + 1).min(height);
        for x in 0..width {
            if filled[x] {
                continue;
            }
            let here = guide[y * width + x];
            let (lo, hi) = (x.saturating_sub(r), (x + r + 1).min(width));
            let (mut sum, mut total) = ([0.0_f32; C], 0.0_f32);
            for v in rows.clone() {
                let gy = gauss[v.abs_diff(y)];
                for &u in known.between(v, lo, hi) {
                    let u = u as usize;
                    let i = v * width + u;
                    let difference = (guide[i] - here).abs();
                    if difference < options.threshold {
                        let weight = gy * gauss[u.abs_diff(x)] / (difference + options.epsilon);
                        total += weight;
                        sum.iter_mut().zip(&values[i]).for_each(|(s, c)| *s += weight * c);
                    }
                }
            }
            if total > 0.0 {
                out[x] = sum.map(|s| s / total);
                filled[x] = true;
            }
        }
    });
    (out, filled)
}

/// Columns of the valid pixels, row by row: windows with few of them cost little, however large.
struct Known {
    width: usize,
    columns: Vec<u32>,
    /// Valid pixels before each pixel, and before the end of the picture.
    before: Vec<u32>,
}

impl Known {
    fn new(valid: &[bool], width: usize) -> Self {
        let mut known = Self { width, columns: Vec::new(), before: Vec::with_capacity(valid.len() + 1) };
        for row in valid.chunks(width) {
            for (x, valid) in row.iter().enumerate() {
                known.before.push(known.columns.len() as u32);
                if *valid {
                    known.columns.push(x as u32);
                }
            }
        }
        known.before.push(known.columns.len() as u32);
        known
    }

    /// Columns in `lo..hi` of row `y`.
    #[inline]
    fn between(&self, y: usize, lo: usize, hi: usize) -> &[u32] {
        let at = y * self.width;
        &self.columns[self.before[at + lo] as usize..self.before[at + hi] as usize]
    }
}

/// Fills what is left by pull-push without a depth test: means over coarser and coarser cells. Without valid pixels
/// the result is zero.
///
/// # Panics
/// If a slice has not `width * height` entries.
pub fn fill_channels<const C: usize>(
    values: &[[f32; C]],
    valid: &[bool],
    width: usize,
    height: usize,
) -> Vec<[f32; C]> {
    assert!(values.len() == width * height && valid.len() == values.len(), "one entry per pixel");
    let base: Vec<([f32; C], f32)> =
        values.par_iter().zip(valid).map(|(v, ok)| if *ok { (*v, 1.0) } else { ([0.0; C], 0.0) }).collect();
    if valid.iter().all(|v| *v) {
        return values.to_vec();
    }
    let mut levels = vec![(width, height, base)];
    while let Some((w, h, fine)) = levels.last().filter(|l| l.0 > 1 || l.1 > 1) {
        let next = halve(*w, *h, fine);
        levels.push(next);
    }
    while levels.len() > 1 {
        let Some((cw, _, coarse)) = levels.pop() else { break };
        let last = levels.len() - 1;
        let (w, _, fine) = &mut levels[last];
        let w = *w;
        let ch = coarse.len() / cw;
        fine.par_chunks_mut(w).enumerate().for_each(|(y, row)| {
            for (x, cell) in row.iter_mut().enumerate().filter(|(_, c)| c.1 <= 0.0) {
                cell.0 = bilinear(&coarse, cw, ch, x, y);
            }
        });
    }
    levels.swap_remove(0).2.into_par_iter().map(|c| c.0).collect()
}

type Cells<const C: usize> = Vec<([f32; C], f32)>;

fn halve<const C: usize>(w: usize, h: usize, fine: &Cells<C>) -> (usize, usize, Cells<C>) {
    let (cw, ch) = (w.div_ceil(2), h.div_ceil(2));
    let mut coarse = vec![([0.0; C], 0.0); cw * ch];
    coarse.par_chunks_mut(cw).enumerate().for_each(|(y, row)| {
        for (x, out) in row.iter_mut().enumerate() {
            let (mut sum, mut total) = ([0.0_f32; C], 0.0_f32);
            for k in 0..4 {
                let (u, v) = (2 * x + (k & 1), 2 * y + (k >> 1));
                if u < w && v < h {
                    let (c, weight) = &fine[v * w + u];
                    total += weight;
                    sum.iter_mut().zip(c).for_each(|(s, c)| *s += weight * c);
                }
            }
            if total > 0.0 {
                *out = (sum.map(|s| s / total), total.min(1.0));
            }
        }
    });
    (cw, ch, coarse)
}

/// The bilinear value of a filled coarse level at a fine cell.
fn bilinear<const C: usize>(coarse: &Cells<C>, w: usize, h: usize, x: usize, y: usize) -> [f32; C] {
    let neighbor =
        |c: usize, odd: bool, end: usize| if odd { (c + 1).min(end - 1) } else { c.saturating_sub(1) };
    let (cx, cy) = (x / 2, y / 2);
    let (nx, ny) = (neighbor(cx, x & 1 == 1, w), neighbor(cy, y & 1 == 1, h));
    let mut sum = [0.0; C];
    for (u, v, weight) in [(cx, cy, 9.0), (nx, cy, 3.0), (cx, ny, 3.0), (nx, ny, 1.0)] {
        let cell = &coarse[v * w + u].0;
        sum.iter_mut().zip(cell).for_each(|(s, c)| *s += weight / 16.0 * c);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::Rng;

    const W: usize = 60;
    const H: usize = 50;

    type Rgb = Vec<[f32; 3]>;

    /// Two surfaces, each of one colour; a share of the pixels is known.
    fn piecewise(share: f32) -> (Rgb, Vec<f32>, Rgb, Vec<bool>) {
        let mut rng = Rng::new(9, 0);
        let front = |i: usize| (i % W).pow(2) + (i / W).pow(2) < 1500;
        let guide: Vec<f32> = (0..W * H).map(|i| if front(i) { 0.0 } else { 1.0 }).collect();
        let exact: Vec<[f32; 3]> =
            (0..W * H).map(|i| if front(i) { [0.9, 0.2, 0.5] } else { [0.1, 0.7, 0.3] }).collect();
        let valid: Vec<bool> = (0..W * H).map(|_| rng.next_f32() < share).collect();
        let holes = exact.iter().zip(&valid).map(|(c, v)| if *v { *c } else { [0.0; 3] }).collect();
        (exact, guide, holes, valid)
    }

    fn worst(a: &[[f32; 3]], b: &[[f32; 3]], at: impl Fn(usize) -> bool) -> f32 {
        let differences = (0..a.len()).filter(|i| at(*i)).flat_map(|i| (0..3).map(move |c| (i, c)));
        differences.map(|(i, c)| (a[i][c] - b[i][c]).abs()).fold(0.0, f32::max)
    }

    #[test]
    fn piecewise_maps_are_restored() {
        let (exact, guide, holes, valid) = piecewise(0.2);
        for sigma in [2.0, f32::INFINITY] {
            let options = InterpolateOptions { window: 9, sigma, ..Default::default() };
            let (out, filled) = interpolate(&holes, &valid, &guide, W, H, &options);
            let share = filled.iter().filter(|f| **f).count() as f32 / filled.len() as f32;
            assert!(share > 0.999, "{share}");
            assert!(worst(&out, &exact, |i| filled[i]) <= 1e-6);
            assert!(worst(&holes, &exact, |i| filled[i]) > 0.8, "the holes hurt without");
        }
    }

    #[test]
    fn other_surfaces_are_not_taken() {
        let (_, guide, mut holes, _) = piecewise(1.0);
        // Only the far surface is known.
        let valid: Vec<bool> = guide.iter().map(|g| *g > 0.5).collect();
        holes.iter_mut().zip(&valid).filter(|(_, v)| !**v).for_each(|(h, _)| *h = [0.0; 3]);
        let (out, filled) = interpolate(&holes, &valid, &guide, W, H, &InterpolateOptions::default());
        assert_eq!(filled, valid);
        assert_eq!(out, holes);
    }

    #[test]
    fn everything_is_filled_in_the_end() {
        for (w, h) in [(1, 1), (7, 1), (1, 5), (33, 17)] {
            let mut values = vec![[0.0; 2]; w * h];
            let mut valid = vec![false; w * h];
            assert_eq!(fill_channels(&values, &valid, w, h), values, "nothing to fill from");
            values[w * h / 2] = [0.5, -2.0];
            valid[w * h / 2] = true;
            let out = fill_channels(&values, &valid, w, h);
            assert!(out.iter().flatten().zip([0.5, -2.0].iter().cycle()).all(|(a, b)| (a - b).abs() < 1e-6));
        }
        let (exact, _, holes, valid) = piecewise(0.3);
        let out = fill_channels(&holes, &valid, W, H);
        assert_eq!(worst(&out, &exact, |i| valid[i]), 0.0, "known pixels stay");
        assert!(out.iter().flatten().all(|v| (0.09..=0.91).contains(v)));
    }
}
