//! Where a texture is read: level of detail, wrap modes, bilinear weights.

use super::mip::{Level, Levels};
use crate::{Filter, Sampler, Wrap};
use photofit_scalar::{Vec2f, vec2};

/// Up to eight texels and their weights; the same for all textures of one size, sampler and transform.
#[derive(Clone, Copy, Debug)]
pub(super) struct Taps {
    pub(super) index: [u32; 8],
    pub(super) weight: [f32; 8],
    pub(super) count: usize,
}

/// How one or more textures of a material are addressed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Address {
    pub(super) set: usize,
    /// `None`: the identity.
    pub(super) transform: Option<[[f32; 3]; 2]>,
    pub(super) sampler: Sampler,
    pub(super) levels: Levels,
}

impl Address {
    /// Taps at texture coordinates with derivatives along x and y of the image (or none: the base level).
    #[inline]
    pub(super) fn taps(&self, uv: [Vec2f; 2], footprint: Option<&super::UvDerivatives>) -> Taps {
        let set = self.set;
        let uv = match &self.transform {
            None => uv[set],
            Some(m) => affine(m, uv[set]),
        };
        let base = self.levels.0[0];
        let mut taps = Taps { index: [0; 8], weight: [0.0; 8], count: 0 };
        if self.sampler.filter == Filter::Nearest {
            let x = nearest(uv.x, base.width, self.sampler.wrap_u);
            let y = nearest(uv.y, base.height, self.sampler.wrap_v);
            taps.index[0] = base.offset + y * base.width + x;
            taps.weight[0] = 1.0;
            taps.count = 1;
            return taps;
        }
        let level = match footprint {
            Some(f) if self.levels.0.len() > 1 => self.level(f),
            _ => 0.0,
        };
        let below = level as usize;
        let t = level - below as f32;
        self.bilinear(&self.levels.0[below], uv, 1.0 - t, &mut taps, 0);
        taps.count = 4;
        if t > 0.0 {
            self.bilinear(&self.levels.0[below + 1], uv, t, &mut taps, 4);
            taps.count = 8;
        }
        taps
    }

    /// Level from the longer axis of the footprint's ellipse in texels, clamped to the chain.
    #[inline]
    fn level(&self, footprint: &super::UvDerivatives) -> f32 {
        let base = self.levels.0[0];
        let (w, h) = (base.width as f32, base.height as f32);
        let (mut dx, mut dy) = (footprint.dx[self.set], footprint.dy[self.set]);
        if let Some(m) = &self.transform {
            dx = linear(m, dx);
            dy = linear(m, dy);
        }
        let (sx, tx, sy, ty) = (dx.x * w, dx.y * h, dy.x * w, dy.y * h);
        let (a, b, c) = (sx * sx + tx * tx, sy * sy + ty * ty, sx * sy + tx * ty);
        let half = 0.5 * (a - b);
        let longest = 0.5 * (a + b) + (half * half + c * c).sqrt();
        // Not above one, or not a number: the base level alone.
        if longest > 1.0 { (0.5 * longest.log2()).min((self.levels.0.len() - 1) as f32) } else { 0.0 }
    }

    #[inline(always)]
    fn bilinear(&self, level: &Level, uv: Vec2f, share: f32, taps: &mut Taps, at: usize) {
        let (x0, x1, fx) = axis(uv.x, level.width, self.sampler.wrap_u);
        let (y0, y1, fy) = axis(uv.y, level.height, self.sampler.wrap_v);
        let (upper, lower) = (level.offset + y0 * level.width, level.offset + y1 * level.width);
        taps.index[at..at + 4].copy_from_slice(&[upper + x0, upper + x1, lower + x0, lower + x1]);
        let (gx, gy) = (1.0 - fx, (1.0 - fy) * share);
        let fy = fy * share;
        taps.weight[at..at + 4].copy_from_slice(&[gx * gy, fx * gy, gx * fy, fx * fy]);
    }
}

#[inline(always)]
fn affine(m: &[[f32; 3]; 2], uv: Vec2f) -> Vec2f {
    let d = linear(m, uv);
    vec2(d.x + m[0][2], d.y + m[1][2])
}

#[inline(always)]
fn linear(m: &[[f32; 3]; 2], uv: Vec2f) -> Vec2f {
    vec2(m[0][0] * uv.x + m[0][1] * uv.y, m[1][0] * uv.x + m[1][1] * uv.y)
}

/// `floor`, without the library call that the baseline target would make; saturates.
#[inline(always)]
fn floor(x: f32) -> f32 {
    let i = x as i32 as f32;
    if i > x { i - 1.0 } else { i }
}

/// The coordinate inside of [0, 1]; what is not a number is 0.
#[inline(always)]
#[expect(clippy::manual_clamp, reason = "`max` turns what is not a number into 0, `clamp` does not")]
fn fold(u: f32, wrap: Wrap) -> f32 {
    let folded = match wrap {
        Wrap::Repeat => u - floor(u),
        Wrap::ClampToEdge => u,
        Wrap::MirroredRepeat => {
            let m = u - 2.0 * floor(0.5 * u);
            if m > 1.0 { 2.0 - m } else { m }
        }
    };
    folded.max(0.0).min(1.0)
}

#[inline(always)]
fn nearest(u: f32, n: u32, wrap: Wrap) -> u32 {
    ((fold(u, wrap) * n as f32) as u32).min(n - 1)
}

/// The two texels of an axis and the share of the second.
#[inline(always)]
fn axis(u: f32, n: u32, wrap: Wrap) -> (u32, u32, f32) {
    let x = fold(u, wrap) * n as f32 - 0.5;
    // At least -0.5, at most n - 0.5.
    let i = floor(x);
    let f = x - i;
    let i = i as i32;
    let last = n as i32 - 1;
    let (lo, hi) = match wrap {
        Wrap::Repeat => (if i < 0 { last } else { i }, if i >= last { 0 } else { i + 1 }),
        // A mirrored neighbour across the border is the border texel itself.
        _ => (i.max(0), (i + 1).min(last)),
    };
    (lo as u32, hi as u32, f)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_wrap() {
        assert_eq!(axis(0.0, 4, Wrap::Repeat), (3, 0, 0.5));
        assert_eq!(axis(1.0, 4, Wrap::ClampToEdge), (3, 3, 0.5));
        assert_eq!(axis(-0.125, 4, Wrap::Repeat), (3, 0, 0.0));
        assert_eq!(axis(-0.125, 4, Wrap::MirroredRepeat), (0, 1, 0.0));
        assert_eq!(axis(1.375, 4, Wrap::MirroredRepeat), (2, 3, 0.0));
        assert_eq!(axis(7.0, 1, Wrap::Repeat).0, 0);
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
