//! The four taps of a bilinear lookup on one level.

use super::{Filter, Level, Sampler, Texture, Wrap};
use photofit_scalar::{Real, Vec2, halved_sum, vec2};
use std::borrow::Borrow;

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

/// Taps at `uv` on a level; a nearest filter has four equal taps. What is not a number is read as 0.
#[inline(always)]
pub fn taps<T: Real>(uv: Vec2<T>, level: Level, sampler: &Sampler) -> Taps<T> {
    let Level { offset, width, height } = level;
    if sampler.filter == Filter::Nearest {
        let (x, y) = (nearest(uv.x, width, sampler.wrap_u), nearest(uv.y, height, sampler.wrap_v));
        return Taps { index: [offset + y * width + x; 4], fx: T::zero(), fy: T::zero() };
    }
    let (x0, x1, fx) = axis(uv.x, width, sampler.wrap_u);
    let (y0, y1, fy) = axis(uv.y, height, sampler.wrap_v);
    let (upper, lower) = (offset + y0 * width, offset + y1 * width);
    Taps { index: [upper + x0, upper + x1, lower + x0, lower + x1], fx, fy }
}

/// `floor`, without the library call that the baseline target would make; saturates, and is 0 of what is not a number.
#[inline(always)]
fn floor<T: Real>(x: T) -> i32 {
    let i = x.as_i32();
    if T::of(f64::from(i)) > x { i.saturating_sub(1) } else { i }
}

/// The coordinate inside of [0, 1], and whether it runs backwards there; what is not a number is 0.
#[inline(always)]
fn fold<T: Real>(u: T, wrap: Wrap) -> (T, bool) {
    let whole = |x: T| T::of(f64::from(floor(x)));
    let (folded, backwards) = match wrap {
        Wrap::Repeat => (u - whole(u), false),
        Wrap::ClampToEdge => (u, false),
        Wrap::MirroredRepeat => {
            let two = T::of(2.0);
            let m = u - two * whole(u * T::of(0.5));
            if m > T::one() { (two - m, true) } else { (m, false) }
        }
    };
    (folded.clamp_to(T::zero(), T::one()), backwards)
}

#[inline(always)]
fn nearest<T: Real>(u: T, n: u32, wrap: Wrap) -> u32 {
    let (u, _) = fold(u, wrap);
    ((u * T::of(f64::from(n))).as_i32() as u32).min(n - 1)
}

/// The two texels of an axis, in the order of growing `u`, and the share of the second. Texel centres lie at
/// `fold(u) n - 1/2`.
#[inline(always)]
fn axis<T: Real>(u: T, n: u32, wrap: Wrap) -> (u32, u32, T) {
    let (u, backwards) = fold(u, wrap);
    let x = u * T::of(f64::from(n)) - T::of(0.5);
    // At least -1/2, at most n - 1/2.
    let i = floor(x);
    let f = x - T::of(f64::from(i));
    let last = n as i32 - 1;
    let (lo, hi) = match wrap {
        Wrap::Repeat => (if i < 0 { last } else { i }, if i >= last { 0 } else { i + 1 }),
        // A mirrored neighbour across the border is the border texel itself.
        _ => (i.max(0), (i + 1).min(last)),
    };
    if backwards { (hi as u32, lo as u32, T::one() - f) } else { (lo as u32, hi as u32, f) }
}

impl<T: Real> Taps<T> {
    /// Weights of the four taps.
    #[inline(always)]
    pub fn weights(&self) -> [T; 4] {
        let (gx, gy) = (T::one() - self.fx, T::one() - self.fy);
        [gx * gy, self.fx * gy, gx * self.fy, self.fx * self.fy]
    }

    /// Bilinear value of the texels that `fetch` gives by their index.
    #[inline(always)]
    pub fn blend<const C: usize, R: Borrow<[T; C]>>(&self, fetch: impl Fn(usize) -> R) -> [T; C] {
        let w = self.weights();
        // Written out: `map` is a call of its own where this is not inlined whole.
        let [a, b, c, d] = self.index;
        let q = [fetch(a as usize), fetch(b as usize), fetch(c as usize), fetch(d as usize)];
        let mut out = [T::zero(); C];
        for c in 0..C {
            let at = |k: usize| q[k].borrow()[c] * w[k];
            out[c] = (at(0) + at(1)) + (at(2) + at(3));
        }
        out
    }

    /// Bilinear value.
    #[inline(always)]
    pub fn read<const C: usize>(&self, t: &Texture<T, C>) -> [T; C] {
        self.blend(|i| &t.texels[i])
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_wrap() {
        assert_eq!(axis(0.0_f32, 4, Wrap::Repeat), (3, 0, 0.5));
        assert_eq!(axis(1.0_f32, 4, Wrap::ClampToEdge), (3, 3, 0.5));
        assert_eq!(axis(-0.125_f32, 4, Wrap::Repeat), (3, 0, 0.0));
        assert_eq!(axis(7.0_f32, 1, Wrap::Repeat).0, 0);
        // A mirrored period runs backwards: the second texel is the one at the larger u.
        assert_eq!(axis(-0.125_f32, 4, Wrap::MirroredRepeat), (1, 0, 1.0));
        assert_eq!(axis(1.375_f32, 4, Wrap::MirroredRepeat), (3, 2, 1.0));
        assert_eq!(axis(0.375_f32, 4, Wrap::MirroredRepeat), (1, 2, 0.0));
    }

    /// Texels under the centres of texels -5 to 7 of an axis of four.
    #[test]
    fn wrap_modes() {
        let all = |wrap| (-5..8).map(|i| nearest((f64::from(i) + 0.5) / 4.0, 4, wrap)).collect::<Vec<_>>();
        assert_eq!(all(Wrap::Repeat), [3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3]);
        assert_eq!(all(Wrap::ClampToEdge), [0, 0, 0, 0, 0, 0, 1, 2, 3, 3, 3, 3, 3]);
        assert_eq!(all(Wrap::MirroredRepeat), [3, 3, 2, 1, 0, 0, 1, 2, 3, 3, 2, 1, 0]);
        for wrap in [Wrap::Repeat, Wrap::ClampToEdge, Wrap::MirroredRepeat] {
            for i in -5..8 {
                let (a, b, f) = axis((f64::from(i) + 0.5) / 4.0, 4, wrap);
                let at = if f < 0.5 { a } else { b };
                assert_eq!(at, nearest((f64::from(i) + 0.5) / 4.0, 4, wrap), "{wrap:?} {i}");
            }
        }
    }

    #[test]
    fn extreme_coordinates_stay_inside() {
        for u in
            [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30, 3e9, -0.0, f32::MIN_POSITIVE, -1e-9]
        {
            for wrap in [Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge] {
                for n in [1, 2, 5, 16384] {
                    let (a, b, f) = axis(u, n, wrap);
                    assert!(a < n && b < n && (0.0..=1.0).contains(&f), "{u} {wrap:?} {n}: {a} {b} {f}");
                    assert!(nearest(u, n, wrap) < n, "{u} {wrap:?} {n}");
                }
            }
        }
    }
}
