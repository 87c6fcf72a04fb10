//! Structural similarity of the tone-mapped images, with the exact gradient.
//!
//! `SSIM = (2 ma mb + C1)(2 sab + C2) / ((ma^2 + mb^2 + C1)(saa + sbb + C2))` with means, variances and covariance
//! under a Gaussian window `F`: `ma = F a`, `saa = F a^2 - ma^2`, `sab = F ab - ma mb`. The window is cut and
//! renormalised at the borders, `F = N^-1 W` with the zero-padded symmetric filter W, so that its adjoint is
//! `W N^-1`. With `p, q, r` the derivatives by `F a`, `F a^2` and `F ab`, the gradient is `F'p + 2 a F'q + b F'r`.
//!
//! Bands of rows are worked on independently, each with the rows around it that its windows reach.

use super::PictureLayout;
use super::curve::{LossScalar, tone};
use rayon::prelude::{IndexedParallelIterator, IntoParallelIterator, ParallelIterator, ParallelSliceMut};
use std::ops::Range;

/// Reach of the window.
pub(super) const RADIUS: usize = 5;
pub(super) const TAPS: usize = 2 * RADIUS + 1;
/// Standard deviation of the window.
const SIGMA: f64 = 1.5;
/// Stabilising constants for a range of one.
const C1: f64 = 1e-4;
const C2: f64 = 9e-4;
/// Samples filtered at a time.
const LANES: usize = 32;
/// Rows of a band.
const BAND: usize = 64;

/// The taps of the window, which add up to one.
pub(super) fn taps() -> [f64; TAPS] {
    let raw: [f64; TAPS] =
        std::array::from_fn(|k| (-0.5 * ((k as f64 - RADIUS as f64) / SIGMA).powi(2)).exp());
    let total: f64 = raw.iter().sum();
    raw.map(|v| v / total)
}

/// Filter taps, and for every position along a side the reciprocal of the taps' sum inside of the image.
struct Window<T> {
    taps: [T; TAPS],
    columns: Vec<T>,
    rows: Vec<T>,
}

impl<T: LossScalar> Window<T> {
    fn new(width: usize, height: usize) -> Self {
        let taps = taps();
        let norms = |n: usize| {
            let inside = |i: usize| (0..TAPS).filter(move |k| (RADIUS..n + RADIUS).contains(&(i + k)));
            (0..n).map(|i| T::of(1.0 / inside(i).map(|k| taps[k]).sum::<f64>())).collect()
        };
        Self { taps: taps.map(T::of), columns: norms(width), rows: norms(height) }
    }

    /// Norm and weight of every sample of a row.
    fn row_norms(&self, layout: &PictureLayout<'_, T>, row: usize) -> Vec<[T; 2]> {
        let pixel = |column: usize| {
            let weight = layout.weights.map_or(T::one(), |w| w[row * layout.width + column]);
            [self.columns[column] * self.rows[row], weight]
        };
        (0..layout.width).flat_map(|column| layout.read.clone().map(move |_| pixel(column))).collect()
    }

    /// Zero-padded filter along a row; `padded` has [`RADIUS`] pixels of zeros on both sides.
    #[inline(always)]
    fn along_row(&self, padded: &[T], channels: usize, out: &mut [T]) {
        let n = out.len();
        let shifted: [&[T]; TAPS] = std::array::from_fn(|k| &padded[k * channels..k * channels + n]);
        weighted_sum(n, TAPS, |k| (self.taps[k], shifted[k]), out);
    }

    /// Zero-padded filter across rows: row `at` of the filtered image, from `rows` of the image.
    #[inline(always)]
    fn across(&self, plane: &[T], rows: &Range<usize>, at: usize, out: &mut [T]) {
        let n = out.len();
        let from = at.saturating_sub(RADIUS).max(rows.start);
        let to = (at + RADIUS + 1).min(rows.end);
        let tapped =
            |k: usize| (self.taps[from + k + RADIUS - at], &plane[(from + k - rows.start) * n..][..n]);
        weighted_sum(n, to - from, tapped, out);
    }
}

/// `out[i] = sum of w_k s_k[i]` for `count` pairs `(w_k, s_k)`, in registers for some samples at a time.
#[inline(always)]
fn weighted_sum<'a, T: LossScalar>(
    n: usize,
    count: usize,
    pair: impl Fn(usize) -> (T, &'a [T]),
    out: &mut [T],
) {
    let whole = n - n % LANES;
    for i in (0..whole).step_by(LANES) {
        let mut sums = [T::zero(); LANES];
        for k in 0..count {
            let (w, s) = pair(k);
            let s = &s[i..i + LANES];
            for l in 0..LANES {
                sums[l] += w * s[l];
            }
        }
        out[i..i + LANES].copy_from_slice(&sums);
    }
    for i in whole..n {
        out[i] = (0..count).fold(T::zero(), |sum, k| sum + pair(k).0 * pair(k).1[i]);
    }
}

/// Grows a range of rows by the reach of the window, inside of the image.
fn grown(rows: &Range<usize>, height: usize) -> Range<usize> {
    rows.start.saturating_sub(RADIUS)..(rows.end + RADIUS).min(height)
}

/// Tone-mapped samples of the channels that are read, row by row: candidate, its slope, reference.
struct Band<T> {
    rows: Range<usize>,
    a: Vec<T>,
    slope: Vec<T>,
    b: Vec<T>,
}

impl<T: LossScalar> Band<T> {
    #[inline(always)]
    fn new<const FMA: bool>(x: &[T], y: &[T], layout: &PictureLayout<'_, T>, rows: Range<usize>) -> Self {
        let gather = |image: &[T]| -> Vec<T> {
            let pixels =
                image[rows.start * layout.pitch()..rows.end * layout.pitch()].chunks(layout.channels);
            pixels.flat_map(|p| &p[layout.read.clone()]).copied().collect()
        };
        let (mut a, mut b) = (gather(x), gather(y));
        let mut slope = vec![T::zero(); a.len()];
        for (a, slope) in a.iter_mut().zip(&mut slope) {
            (*a, *slope) = tone::<T, FMA>(*a);
        }
        for b in &mut b {
            *b = tone::<T, FMA>(*b).0;
        }
        Self { rows, a, slope, b }
    }
}

/// SSIM of one sample, and its derivatives by the filtered `a`, `a^2` and `ab`.
#[inline(always)]
fn ssim<T: LossScalar>([ma, mb, eaa, ebb, eab]: [T; 5]) -> (T, [T; 3]) {
    let (two, c1, c2) = (T::of(2.0), T::of(C1), T::of(C2));
    let a1 = two * ma * mb + c1;
    let a2 = two * (eab - ma * mb) + c2;
    let inv_b1 = T::one() / (ma * ma + mb * mb + c1);
    let inv_b2 = T::one() / ((eaa - ma * ma) + (ebb - mb * mb) + c2);
    let inv = inv_b1 * inv_b2;
    let s = a1 * a2 * inv;
    let d_ma = two * (mb * (a2 - a1) * inv + ma * s * (inv_b2 - inv_b1));
    (s, [d_ma, -s * inv_b2, two * a1 * inv])
}

/// Sum of `weight (1 - SSIM)` over the rows of a band; adds `scale` times its gradient.
#[inline(always)]
fn band<T: LossScalar, const FMA: bool>(
    x: &[T],
    y: &[T],
    layout: &PictureLayout<'_, T>,
    window: &Window<T>,
    own: &Range<usize>,
    scale: T,
    gradient: Option<&mut [T]>,
) -> f64 {
    let channels = layout.read.len();
    let n = layout.width * channels;
    // Rows whose SSIM depends on the own rows, and rows that those windows reach.
    let wide = if gradient.is_some() { grown(own, layout.height) } else { own.clone() };
    let input = Band::new::<FMA>(x, y, layout, grown(&wide, layout.height));

    // a, b, a^2, b^2, ab filtered along the rows.
    let mut padded = vec![T::zero(); n + 2 * RADIUS * channels];
    let centre = RADIUS * channels..RADIUS * channels + n;
    let mut filtered: [Vec<T>; 5] = std::array::from_fn(|_| vec![T::zero(); input.rows.len() * n]);
    for row in 0..input.rows.len() {
        let (a, b) = (&input.a[row * n..][..n], &input.b[row * n..][..n]);
        for (plane, (u, v)) in
            filtered.iter_mut().zip([(a, None), (b, None), (a, Some(a)), (b, Some(b)), (a, Some(b))])
        {
            let p = &mut padded[centre.clone()];
            match v {
                None => p.copy_from_slice(u),
                Some(v) => (0..n).for_each(|i| p[i] = u[i] * v[i]),
            }
            window.along_row(&padded, channels, &mut plane[row * n..][..n]);
        }
    }

    // Across the rows, SSIM, and the derivatives divided by the norm for the adjoint filter.
    let mut derivatives: [Vec<T>; 3] = std::array::from_fn(|_| vec![T::zero(); wide.len() * n]);
    let mut moments: [Vec<T>; 5] = std::array::from_fn(|_| vec![T::zero(); n]);
    let mut sum = 0.0;
    for at in wide.clone() {
        for (plane, out) in filtered.iter().zip(&mut moments) {
            window.across(plane, &input.rows, at, out);
        }
        let terms = window.row_norms(layout, at);
        let d = derivatives.each_mut().map(|plane| &mut plane[(at - wide.start) * n..][..n]);
        let row_sum = ssim_row(&moments, &terms, d);
        sum += if own.contains(&at) { row_sum } else { 0.0 };
    }

    if let Some(gradient) = gradient {
        let mut adjoint: [Vec<T>; 3] = std::array::from_fn(|_| vec![T::zero(); n]);
        for at in own.clone() {
            for (plane, out) in derivatives.iter().zip(&mut adjoint) {
                window.across(plane, &wide, at, &mut padded[centre.clone()]);
                window.along_row(&padded, channels, out);
            }
            let from = (at - input.rows.start) * n;
            let (a, slope, b) = (&input.a[from..][..n], &input.slope[from..][..n], &input.b[from..][..n]);
            let g = &mut gradient[(at - own.start) * layout.pitch()..][..layout.pitch()];
            for (pixel, g) in g.chunks_mut(layout.channels).enumerate() {
                for (c, g) in g[layout.read.clone()].iter_mut().enumerate() {
                    let i = pixel * channels + c;
                    let d = adjoint[0][i] + (a[i] + a[i]) * adjoint[1][i] + b[i] * adjoint[2][i];
                    *g += d * slope[i] * scale;
                }
            }
        }
    }
    sum
}

/// Sum of `weight (1 - SSIM)` over a row, and the derivatives by the unnormalised filter results.
#[inline(always)]
fn ssim_row<T: LossScalar>(moments: &[Vec<T>; 5], terms: &[[T; 2]], out: [&mut [T]; 3]) -> f64 {
    let n = terms.len();
    let m = moments.each_ref().map(|m| &m[..n]);
    let [d0, d1, d2] = out.map(|d| &mut d[..n]);
    let mut total = 0.0;
    for i in 0..n {
        let [norm, weight] = terms[i];
        let (s, d) = ssim(m.map(|m| m[i] * norm));
        total += ((T::one() - s) * weight).f64();
        let scale = -(norm * weight);
        (d0[i], d1[i], d2[i]) = (d[0] * scale, d[1] * scale, d[2] * scale);
    }
    total
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn band_avx2<T: LossScalar>(
    x: &[T],
    y: &[T],
    layout: &PictureLayout<'_, T>,
    window: &Window<T>,
    own: &Range<usize>,
    scale: T,
    gradient: Option<&mut [T]>,
) -> f64 {
    band::<T, true>(x, y, layout, window, own, scale, gradient)
}

/// One band on the widest instructions of this machine.
fn any_band<T: LossScalar>(
    x: &[T],
    y: &[T],
    layout: &PictureLayout<'_, T>,
    window: &Window<T>,
    own: &Range<usize>,
    scale: T,
    gradient: Option<&mut [T]>,
) -> f64 {
    #[cfg(target_arch = "x86_64")]
    if crate::cpu::has_avx2() {
        #[expect(unsafe_code, reason = "calling a function compiled for AVX2 and FMA")]
        // SAFETY: both features were just detected.
        return unsafe { band_avx2(x, y, layout, window, own, scale, gradient) };
    }
    band::<T, false>(x, y, layout, window, own, scale, gradient)
}

/// `factor` times the mean of `1 - SSIM`; adds `factor` times the gradient.
pub(super) fn run<T: LossScalar>(
    x: &[T],
    y: &[T],
    layout: &PictureLayout<'_, T>,
    factor: f64,
    gradient: Option<&mut [T]>,
) -> f64 {
    let window = Window::new(layout.width, layout.height);
    let scale = factor / layout.terms() as f64;
    let part = |k: usize, g: Option<&mut [T]>| {
        let own = k * BAND..((k + 1) * BAND).min(layout.height);
        any_band(x, y, layout, &window, &own, T::of(scale), g)
    };
    let sums: Vec<f64> = match gradient {
        Some(g) => {
            g.par_chunks_mut(BAND * layout.pitch()).enumerate().map(|(k, g)| part(k, Some(g))).collect()
        }
        None => (0..layout.height.div_ceil(BAND)).into_par_iter().map(|k| part(k, None)).collect(),
    };
    sums.iter().sum::<f64>() * scale
}
