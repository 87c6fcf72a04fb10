//! The four taps of a bilinear lookup on one level.

use super::{Filter, Sampler, Texture, Wrap};
use photofit_scalar::{Real, Vec2, halved_sum, vec2};

/// Index of texel `i` (any integer) on an axis of `n` texels.
#[inline(always)]
pub fn wrap(i: i64, n: usize, mode: Wrap) -> usize {
    let n = n as i64;
    let r = match mode {
        Wrap::ClampToEdge => i.clamp(0, n - 1),
        Wrap::Repeat => {
            if (0..n).contains(&i) {
                i
            } else {
                i.rem_euclid(n)
            }
        }
        Wrap::MirroredRepeat => {
            let m = i.rem_euclid(2 * n);
            if m < n { m } else { 2 * n - 1 - m }
        }
    };
    r as usize
}

/// Texel indices (upper left, upper right, lower left, lower right) and the fractions between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taps<T> {
    /// Texel indices.
    pub index: [u32; 4],
    /// Share of the right column.
    pub fx: T,
    /// Share of the lower row.
    pub fy: T,
}

/// Taps at `uv` on a level of `width` x `height` texels; a nearest filter has four equal taps.
///
/// A uv that is not finite or beyond 2^31 texels reads texel 0.
#[inline(always)]
pub fn taps<T: Real>(uv: Vec2<T>, width: usize, height: usize, sampler: &Sampler) -> Taps<T> {
    let (x, y) = (uv.x * T::of(width as f64), uv.y * T::of(height as f64));
    let limit = T::of(2_147_483_648.0);
    if !(x.abs() < limit && y.abs() < limit) {
        return Taps { index: [0; 4], fx: T::zero(), fy: T::zero() };
    }
    let at = |i: usize, j: usize| (j * width + i) as u32;
    if sampler.filter == Filter::Nearest {
        let i = wrap(floor(x), width, sampler.wrap_u);
        let j = wrap(floor(y), height, sampler.wrap_v);
        return Taps { index: [at(i, j); 4], fx: T::zero(), fy: T::zero() };
    }
    let half = T::of(0.5);
    let (x, y) = (x - half, y - half);
    let (i, j) = (floor(x), floor(y));
    let (i0, i1) = (wrap(i, width, sampler.wrap_u), wrap(i + 1, width, sampler.wrap_u));
    let (j0, j1) = (wrap(j, height, sampler.wrap_v), wrap(j + 1, height, sampler.wrap_v));
    Taps {
        index: [at(i0, j0), at(i1, j0), at(i0, j1), at(i1, j1)],
        fx: x - T::of(i as f64),
        fy: y - T::of(j as f64),
    }
}

/// `floor` as an integer, without the library call that the baseline target would make.
#[inline(always)]
fn floor<T: Real>(x: T) -> i64 {
    let i = x.f64() as i64;
    if (i as f64) > x.f64() { i - 1 } else { i }
}

impl<T: Real> Taps<T> {
    /// Weights of the four taps.
    #[inline(always)]
    pub fn weights(&self) -> [T; 4] {
        let (gx, gy) = (T::one() - self.fx, T::one() - self.fy);
        [gx * gy, self.fx * gy, gx * self.fy, self.fx * self.fy]
    }

    /// Bilinear value.
    #[inline(always)]
    pub fn read<const C: usize>(&self, t: &Texture<T, C>) -> [T; C] {
        let w = self.weights();
        let q = self.index.map(|i| &t.texels[i as usize]);
        let mut out = [T::zero(); C];
        for c in 0..C {
            out[c] = (q[0][c] * w[0] + q[1][c] * w[1]) + (q[2][c] * w[2] + q[3][c] * w[3]);
        }
        out
    }

    /// Adjoint with respect to uv.
    #[inline(always)]
    pub fn uv_vjp<const C: usize>(&self, t: &Texture<T, C>, g: &[T; C]) -> Vec2<T> {
        let q = self.index.map(|i| &t.texels[i as usize]);
        let (gx, gy) = (T::one() - self.fx, T::one() - self.fy);
        // Channel by channel, then summed by halves: both vectorise, a running sum would not.
        let (mut x, mut y) = ([T::zero(); C], [T::zero(); C]);
        for c in 0..C {
            x[c] = g[c] * ((q[1][c] - q[0][c]) * gy + (q[3][c] - q[2][c]) * self.fy);
            y[c] = g[c] * ((q[2][c] - q[0][c]) * gx + (q[3][c] - q[1][c]) * self.fx);
        }
        let (x, y) = (halved_sum(x), halved_sum(y));
        vec2(x * T::of(t.width as f64), y * T::of(t.height as f64))
    }
}
