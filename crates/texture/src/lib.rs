//! Texture lookup: nearest, bilinear and trilinear over a mip chain, glTF wrap modes, and the adjoints.
//!
//! Texel centres lie at `wrap(u) * width - 0.5`. The level is the logarithm of the longer axis of the pixel's
//! footprint ellipse (Laine et al. 2020; Williams 1983): with the uv derivatives scaled by the base size,
//! `a = sx^2+tx^2, b = sy^2+ty^2, c = sx sy + tx ty, L = (a+b)/2 + sqrt((a-b)^2/4 + c^2), level = log2(L)/2 + bias`.

mod level;
mod pyramid;
mod sampler;
mod scatter;
mod taps;

pub use level::{LevelOfDetail, level_of_detail, level_of_detail_vjp};
pub use pyramid::{MipAdjoint, Pyramid};
pub use sampler::{AlphaMode, Filter, Sampler, Wrap};
pub use scatter::{Scatter, ScatterQueue};
pub use taps::{Taps, taps, wrap};

use photofit_scalar::{Real, Vec2};

/// A texture of `C` samples a texel, row-major, row 0 at v = 0.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Texture<T, const C: usize> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height * width` texels.
    pub texels: Vec<[T; C]>,
}

impl<T: Real, const C: usize> Texture<T, C> {
    /// A texture with all texels equal.
    pub fn filled(width: usize, height: usize, texel: [T; C]) -> Self {
        Self { width, height, texels: vec![texel; width * height] }
    }
}

/// Where and how much a lookup reads: bilinear taps on one or two levels.
#[derive(Clone, Copy, Debug)]
pub struct Lookup<T> {
    /// Finer level.
    pub level: usize,
    /// Taps on the finer level.
    pub fine: Taps<T>,
    /// Taps on the next level, and its share in (0, 1].
    pub coarse: Option<(Taps<T>, T)>,
}

/// Plans the lookup at `uv` with the footprint `lod` (`None`: base level only).
#[inline(always)]
pub fn lookup<T: Real, const C: usize>(
    texture: &Pyramid<T, C>,
    uv: Vec2<T>,
    lod: Option<&LevelOfDetail<T>>,
    sampler: &Sampler,
) -> Lookup<T> {
    let Some(d) = lod.filter(|d| d.level > T::zero()) else {
        return Lookup { level: 0, fine: level_taps(texture, uv, 0, sampler), coarse: None };
    };
    let level = d.level.floor().to_usize().unwrap_or(0).min(texture.levels.len() - 1);
    let share = d.level - T::of(level as f64);
    let fine = level_taps(texture, uv, level, sampler);
    if share > T::zero() && level + 1 < texture.levels.len() {
        Lookup { level, fine, coarse: Some((level_taps(texture, uv, level + 1, sampler), share)) }
    } else {
        Lookup { level, fine, coarse: None }
    }
}

#[inline(always)]
fn level_taps<T: Real, const C: usize>(
    texture: &Pyramid<T, C>,
    uv: Vec2<T>,
    level: usize,
    sampler: &Sampler,
) -> Taps<T> {
    let t = &texture.levels[level];
    taps(uv, t.width, t.height, sampler)
}

/// Reads the texture.
#[inline(always)]
pub fn sample<T: Real, const C: usize>(texture: &Pyramid<T, C>, at: &Lookup<T>) -> [T; C] {
    let mut out = at.fine.read(&texture.levels[at.level]);
    if let Some((taps, share)) = &at.coarse {
        let far = taps.read(&texture.levels[at.level + 1]);
        for c in 0..C {
            out[c] += *share * (far[c] - out[c]);
        }
    }
    out
}

/// Adjoint of [`sample`] with respect to uv and the level: returns `(dL/duv, dL/dlevel)`.
///
/// The uv gradient is the bilinear derivative times the level's size, weighted by the level's share;
/// `dL/dlevel = sum g (coarse - fine)`. The texel gradients go through [`ScatterQueue`].
#[inline(always)]
pub fn sample_vjp<T: Real, const C: usize>(
    texture: &Pyramid<T, C>,
    at: &Lookup<T>,
    g: &[T; C],
) -> (Vec2<T>, T) {
    let fine = &texture.levels[at.level];
    match &at.coarse {
        None => (at.fine.uv_vjp(fine, g), T::zero()),
        Some((taps, share)) => {
            let coarse = &texture.levels[at.level + 1];
            let (a, b) = (at.fine.read(fine), taps.read(coarse));
            let mut level = T::zero();
            for c in 0..C {
                level += g[c] * (b[c] - a[c]);
            }
            let uv = at.fine.uv_vjp(fine, g) * (T::one() - *share) + taps.uv_vjp(coarse, g) * *share;
            (uv, level)
        }
    }
}

#[cfg(test)]
mod tests;
