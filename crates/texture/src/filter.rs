//! The box filter from one level to the next: exact areas for every size, plain or by coverage, and its adjoints.
//!
//! A level of width `n` has a next level of width `m = max(n / 2, 1)`, rounded down as graphics interfaces do. Texel `i`
//! of it is the area average over `[i n/m, (i+1) n/m)`: two texels of weight 1/2 for even `n`, and for odd `n = 2m+1` the
//! three texels `2i, 2i+1, 2i+2` with weights `(m-i)/n, m/n, (i+1)/n` (Guthe and Heckbert 2005). The mean over the texture
//! is the same on every level.
//!
//! Where alpha is coverage, the colours of texels count by their alpha: with area weights `w`, `A = sum w a` and
//! `C = sum w a c / A`. Its adjoint for the gradients `G_C` and `G_A` is
//! `g_c += w a / A G_C` and `g_a += w (G_A + sum_c G_C (c - C) / A)`.

use super::{MipAdjoint, MipRule, Texture, mip_size};
use photofit_scalar::Real;
use rayon::prelude::*;
use std::borrow::Borrow;

/// Mean alpha up to which colours count by area alone: what lies below is less than one step of 8 bits, and the
/// derivative of the division stays bounded.
const LEAST_COVERAGE: f64 = 1.0 / 4096.0;

/// `t += k q`.
#[inline(always)]
pub(crate) fn add_scaled<T: Real, const C: usize>(t: &mut [T; C], q: &[T; C], k: T) {
    for c in 0..C {
        t[c] += k * q[c];
    }
}

/// First input, number of inputs and weights of output `i` of an axis of `n` texels.
#[inline(always)]
fn children(i: usize, n: usize) -> (usize, usize, [f64; 3]) {
    if n == 1 {
        return (0, 1, [1.0, 0.0, 0.0]);
    }
    if n.is_multiple_of(2) {
        return (2 * i, 2, [0.5, 0.5, 0.0]);
    }
    let (m, size, at) = ((n / 2) as f64, n as f64, i as f64);
    (2 * i, 3, [(m - at) / size, m / size, (at + 1.0) / size])
}

/// The one or two outputs (of `m`) that input `i` (of `n`) gives its gradient to, and their weights: those of the filter,
/// or those of a bilinear enlargement with the same sum.
#[inline(always)]
fn parents(i: usize, n: usize, m: usize, adjoint: MipAdjoint) -> [(usize, f64); 2] {
    match adjoint {
        MipAdjoint::Exact => {
            let first = i * m / n;
            [first, first + 1].map(|o| {
                let (from, to) = ((i * m).max(o * n), ((i + 1) * m).min((o + 1) * n));
                let weight = to.saturating_sub(from) as f64 / n as f64;
                // An output past the end has no overlap.
                (o.min(m - 1), weight)
            })
        }
        MipAdjoint::Smooth => {
            let scale = m as f64 / n as f64;
            let x = (i as f64 + 0.5) * scale - 0.5;
            let f = x.floor();
            let texel = |x: f64| (x.max(0.0) as usize).min(m - 1);
            [(texel(f), (1.0 - (x - f)) * scale), (texel(f + 1.0), (x - f) * scale)]
        }
    }
}

/// Writes the next smaller level of a level of `width` x `height` texels, of which `fetch` gives one by its index.
pub(crate) fn downsample<T: Real, const C: usize, R: Borrow<[T; C]>>(
    fetch: impl Fn(usize) -> R + Sync,
    (width, height): (usize, usize),
    rule: MipRule,
    out: &mut [[T; C]],
) {
    let (w, _) = mip_size(width, height);
    let columns: Vec<_> = (0..w).map(|x| children(x, width)).collect();
    out.par_chunks_mut(w).enumerate().for_each(|(y, row)| {
        let (y0, ny, wy) = children(y, height);
        for (t, (x0, nx, wx)) in row.iter_mut().zip(&columns) {
            let mut sum = [T::zero(); C];
            for j in 0..ny {
                for i in 0..*nx {
                    let texel = fetch((y0 + j) * width + x0 + i);
                    add_scaled(&mut sum, texel.borrow(), T::of(wx[i] * wy[j]));
                }
            }
            *t = sum;
        }
        let MipRule::Coverage { colors, alpha } = rule else { return };
        for (t, (x0, nx, wx)) in row.iter_mut().zip(&columns) {
            if t[alpha] <= T::of(LEAST_COVERAGE) {
                continue;
            }
            t[..colors].fill(T::zero());
            let share = T::one() / t[alpha];
            for (j, i) in (0..ny).flat_map(|j| (0..*nx).map(move |i| (j, i))) {
                let texel = fetch((y0 + j) * width + x0 + i);
                let k = T::of(wx[i] * wy[j]) * texel.borrow()[alpha] * share;
                (0..colors).for_each(|c| t[c] += k * texel.borrow()[c]);
            }
        }
    });
}

/// Adjoint of [`downsample`]: adds to `g_fine` what the gradient `g_coarse` of the next level passes to each texel.
/// `fine` and `coarse` are the values; they are read where the rule is [`MipRule::Coverage`].
///
/// A gather over the finer level: no two tasks write one texel.
pub(crate) fn downsample_vjp<T: Real, const C: usize>(
    fine: &Texture<T, C>,
    coarse: &Texture<T, C>,
    g_coarse: &Texture<T, C>,
    g_fine: &mut Texture<T, C>,
    rule: MipRule,
    adjoint: MipAdjoint,
) {
    let (fw, fh, w, h) = (g_fine.width, g_fine.height, g_coarse.width, g_coarse.height);
    let share = |(i, weight): (usize, f64)| (i, T::of(weight));
    let columns: Vec<_> = (0..fw).map(|x| parents(x, fw, w, adjoint).map(share)).collect();
    g_fine.texels.par_chunks_mut(fw).enumerate().for_each_init(Vec::new, |blended, (y, row)| {
        let rows = parents(y, fh, h, adjoint).map(share);
        let MipRule::Coverage { colors, alpha } = rule else {
            // Both rows once for each column, then the columns.
            let [a, b] = rows.map(|(j, wy)| (&g_coarse.texels[j * w..(j + 1) * w], wy));
            blended.clear();
            blended.extend(a.0.iter().zip(b.0).map(|(p, q)| {
                let mut sum = [T::zero(); C];
                add_scaled(&mut sum, p, a.1);
                add_scaled(&mut sum, q, b.1);
                sum
            }));
            for (g, columns) in row.iter_mut().zip(&columns) {
                columns.iter().for_each(|(i, wx)| add_scaled(g, &blended[*i], *wx));
            }
            return;
        };
        let values = &fine.texels[y * fw..];
        for ((g, columns), value) in row.iter_mut().zip(&columns).zip(values) {
            for (p, k) in rows.iter().flat_map(|(j, wy)| columns.map(|(i, wx)| (j * w + i, wx * *wy))) {
                let (mean, g_mean) = (&coarse.texels[p], &g_coarse.texels[p]);
                if mean[alpha] > T::of(LEAST_COVERAGE) {
                    coverage_vjp((value, mean), g_mean, k, (colors, alpha), g);
                } else {
                    add_scaled(g, g_mean, k);
                }
            }
        }
    });
}

/// The share of one texel in the gradient of an average by coverage.
#[inline(always)]
fn coverage_vjp<T: Real, const C: usize>(
    (fine, coarse): (&[T; C], &[T; C]),
    g: &[T; C],
    k: T,
    (colors, alpha): (usize, usize),
    out: &mut [T; C],
) {
    let share = T::one() / coarse[alpha];
    let mut moved = T::zero();
    let mut scaled = *g;
    for c in 0..colors {
        scaled[c] *= fine[alpha] * share;
        moved += g[c] * (fine[c] - coarse[c]);
    }
    scaled[alpha] += share * moved;
    add_scaled(out, &scaled, k);
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZES: [(usize, usize); 8] = [(1, 1), (2, 2), (3, 3), (5, 4), (7, 1), (1, 6), (9, 5), (8, 13)];

    /// Area average by brute force: the integral of the piecewise constant source.
    fn area_average(source: &[[f64; 1]], (width, height): (usize, usize), x: usize, y: usize) -> f64 {
        let (w, h) = mip_size(width, height);
        let overlap = |cell: usize, i: usize, n: usize, m: usize| {
            let (a, b) = ((i * n) as f64 / m as f64, ((i + 1) * n) as f64 / m as f64);
            (b.min(cell as f64 + 1.0) - a.max(cell as f64)).max(0.0) * m as f64 / n as f64
        };
        let mut sum = 0.0;
        for v in 0..height {
            for u in 0..width {
                sum += source[v * width + u][0] * overlap(u, x, width, w) * overlap(v, y, height, h);
            }
        }
        sum
    }

    #[test]
    fn every_texel_is_the_area_average() {
        let mut random = photofit_gradcheck::Uniform::new(3);
        for size in SIZES {
            let source: Vec<[f64; 1]> = (0..size.0 * size.1).map(|_| [random.range(-1.0, 1.0)]).collect();
            let (w, h) = mip_size(size.0, size.1);
            let mut out = vec![[0.0]; w * h];
            downsample(|i| source[i], size, MipRule::Area, &mut out);
            for (i, t) in out.iter().enumerate() {
                let expected = area_average(&source, size, i % w, i / w);
                assert!((t[0] - expected).abs() < 1e-14, "{size:?} at {i}: {} {expected}", t[0]);
            }
        }
    }

    #[test]
    fn gradients_keep_their_sum_in_both_modes() {
        let mut random = photofit_gradcheck::Uniform::new(4);
        for (width, height) in SIZES {
            let (w, h) = mip_size(width, height);
            let texels = (0..w * h).map(|_| [random.range(-1.0, 1.0)]).collect();
            let g = Texture { width: w, height: h, texels };
            let empty = Texture::filled(width, height, [0.0]);
            for adjoint in [MipAdjoint::Exact, MipAdjoint::Smooth] {
                let mut out = empty.clone();
                downsample_vjp(&empty, &g, &g, &mut out, MipRule::Area, adjoint);
                let sum = |t: &Texture<f64, 1>| t.texels.iter().map(|t| t[0]).sum::<f64>();
                // A bilinear enlargement of an odd size moves part of the sum at the border.
                let even = width.is_multiple_of(2) && height.is_multiple_of(2);
                if adjoint == MipAdjoint::Exact || even {
                    assert!((sum(&out) - sum(&g)).abs() < 1e-12, "{width}x{height} {adjoint:?}");
                }
            }
        }
    }
}
