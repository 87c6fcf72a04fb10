//! Mip chains: an automatic box-filtered chain with its adjoints, or independent levels.

use super::Texture;
use photofit_scalar::Real;
use rayon::prelude::*;

/// How gradients of coarse levels return to the base of an automatic chain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MipAdjoint {
    /// Bilinear upsampling: the same sum as the exact adjoint, without its blocks. A descent direction of the same
    /// loss seen through a smoothing prior, not the exact gradient.
    #[default]
    Smooth,
    /// The exact transpose of the box filter.
    Exact,
}

/// Levels of a texture, finest first.
#[derive(Clone, Debug, PartialEq)]
pub struct Pyramid<T, const C: usize> {
    /// The levels; never empty.
    pub levels: Vec<Texture<T, C>>,
}

/// Inputs of output `i` when `n` samples are averaged to `m`: first index and weights (exact areas; at most 4).
#[inline]
fn box_weights(i: usize, n: usize, m: usize) -> (usize, [f64; 4], usize) {
    let (lo, hi) = (i * n, (i + 1) * n);
    let first = lo / m;
    let mut w = [0.0; 4];
    let mut count = 0;
    for (k, w) in w.iter_mut().enumerate() {
        let (a, b) = ((first + k) * m, (first + k + 1) * m);
        let overlap = hi.min(b).saturating_sub(lo.max(a));
        if overlap == 0 {
            break;
        }
        *w = overlap as f64 / n as f64;
        count = k + 1;
    }
    (first, w, count)
}

impl<T: Real, const C: usize> Pyramid<T, C> {
    /// The automatic chain of a base level, down to 1 x 1: sizes are halved and rounded down, every texel is the exact
    /// area average of the level above, odd sizes included.
    ///
    /// # Panics
    /// If the texture has no texels.
    pub fn new(base: Texture<T, C>) -> Self {
        assert!(!base.texels.is_empty(), "a texture has at least one texel");
        assert_eq!(base.texels.len(), base.width * base.height, "one texel per row and column");
        let mut levels = vec![base];
        while let Some(l) = levels.last().filter(|l| l.width > 1 || l.height > 1) {
            let next = Texture::filled((l.width / 2).max(1), (l.height / 2).max(1), [T::zero(); C]);
            levels.push(next);
        }
        let mut out = Self { levels };
        out.rebuild();
        out
    }

    /// A chain of zeros with the sizes of `like` (for gradients).
    pub fn zeros_like(like: &Self) -> Self {
        let levels = like.levels.iter().map(|l| Texture::filled(l.width, l.height, [T::zero(); C])).collect();
        Self { levels }
    }

    /// Sets all texels to zero.
    pub fn clear(&mut self) {
        for l in &mut self.levels {
            l.texels.par_chunks_mut(1 << 14).for_each(|c| c.fill([T::zero(); C]));
        }
    }

    /// Recomputes all levels from the base.
    pub fn rebuild(&mut self) {
        for k in 1..self.levels.len() {
            let (fine, coarse) = self.levels.split_at_mut(k);
            downsample(&fine[k - 1], &mut coarse[0]);
        }
    }

    /// For a pyramid of gradients: moves the gradients of the coarse levels into the base level (the adjoint of
    /// [`Self::rebuild`]); coarse levels keep their partial sums.
    pub fn collapse_vjp(&mut self, adjoint: MipAdjoint) {
        for k in (1..self.levels.len()).rev() {
            let (fine, coarse) = self.levels.split_at_mut(k);
            match adjoint {
                MipAdjoint::Exact => downsample_vjp(&coarse[0], &mut fine[k - 1]),
                MipAdjoint::Smooth => upsample_add(&coarse[0], &mut fine[k - 1]),
            }
        }
    }
}

fn downsample<T: Real, const C: usize>(fine: &Texture<T, C>, out: &mut Texture<T, C>) {
    let (fw, fh, w, h) = (fine.width, fine.height, out.width, out.height);
    out.texels.par_chunks_mut(w).enumerate().for_each(|(y, row)| {
        let (y0, wy, ny) = box_weights(y, fh, h);
        for (x, t) in row.iter_mut().enumerate() {
            let (x0, wx, nx) = box_weights(x, fw, w);
            let mut s = [T::zero(); C];
            for j in 0..ny {
                for i in 0..nx {
                    let k = T::of(wx[i] * wy[j]);
                    let q = &fine.texels[(y0 + j) * fw + x0 + i];
                    for c in 0..C {
                        s[c] += k * q[c];
                    }
                }
            }
            *t = s;
        }
    });
}

fn downsample_vjp<T: Real, const C: usize>(g: &Texture<T, C>, g_fine: &mut Texture<T, C>) {
    let (fw, fh, w, h) = (g_fine.width, g_fine.height, g.width, g.height);
    // Gather form: each fine texel lies in at most two coarse ones per axis.
    let share = |i: usize, n: usize, m: usize| {
        let first = i * m / n;
        let mut s = [(0, 0.0); 2];
        for (k, s) in s.iter_mut().enumerate() {
            let o = first + k;
            if o < m {
                let (a, b) = ((i * m).max(o * n), ((i + 1) * m).min((o + 1) * n));
                *s = (o, b.saturating_sub(a) as f64 / n as f64);
            }
        }
        s
    };
    g_fine.texels.par_chunks_mut(fw).enumerate().for_each(|(y, row)| {
        let sy = share(y, fh, h);
        for (x, t) in row.iter_mut().enumerate() {
            let sx = share(x, fw, w);
            for (j, wy) in sy {
                for (i, wx) in sx {
                    add_scaled(t, &g.texels[j * w + i], T::of(wx * wy));
                }
            }
        }
    });
}

fn upsample_add<T: Real, const C: usize>(g: &Texture<T, C>, g_fine: &mut Texture<T, C>) {
    let (fw, fh, w, h) = (g_fine.width, g_fine.height, g.width, g.height);
    let area = T::of((w * h) as f64 / (fw * fh) as f64);
    let tap = |i: usize, n: usize, m: usize| {
        let x = (i as f64 + 0.5) * m as f64 / n as f64 - 0.5;
        let f = x.floor();
        let a = (f.max(0.0) as usize).min(m - 1);
        let b = ((f + 1.0).max(0.0) as usize).min(m - 1);
        (a, b, T::of(x - f))
    };
    g_fine.texels.par_chunks_mut(fw).enumerate().for_each(|(y, row)| {
        let (j0, j1, fy) = tap(y, fh, h);
        for (x, t) in row.iter_mut().enumerate() {
            let (i0, i1, fx) = tap(x, fw, w);
            let (gx, gy) = (T::one() - fx, T::one() - fy);
            add_scaled(t, &g.texels[j0 * w + i0], gx * gy * area);
            add_scaled(t, &g.texels[j0 * w + i1], fx * gy * area);
            add_scaled(t, &g.texels[j1 * w + i0], gx * fy * area);
            add_scaled(t, &g.texels[j1 * w + i1], fx * fy * area);
        }
    });
}

/// `t += k q`.
#[inline(always)]
pub(super) fn add_scaled<T: Real, const C: usize>(t: &mut [T; C], q: &[T; C], k: T) {
    for c in 0..C {
        t[c] += k * q[c];
    }
}
