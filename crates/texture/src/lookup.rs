//! Lookups: bilinear taps on one or two levels, and the adjoint with respect to uv and level.

use super::{Filter, LevelOfDetail, MipSizes, Pyramid, Sampler, Taps, taps};
use photofit_scalar::{Real, Vec2};
use std::borrow::Borrow;

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

/// Plans the lookup at `uv` with the footprint `lod` (`None`: base level only; filters that are not trilinear read the
/// base level always).
#[inline(always)]
pub fn lookup<T: Real>(
    sizes: &impl MipSizes,
    uv: Vec2<T>,
    lod: Option<&LevelOfDetail<T>>,
    sampler: &Sampler,
) -> Lookup<T> {
    let Some(d) = lod.filter(|d| d.level > T::zero() && sampler.filter == Filter::Trilinear) else {
        return Lookup { level: 0, fine: taps(uv, sizes.level(0), sampler), coarse: None };
    };
    // Positive: the cast rounds down.
    let level = (d.level.as_i32() as usize).min(sizes.count() - 1);
    let share = d.level - T::of(level as f64);
    let fine = taps(uv, sizes.level(level), sampler);
    if share > T::zero() && level + 1 < sizes.count() {
        Lookup { level, fine, coarse: Some((taps(uv, sizes.level(level + 1), sampler), share)) }
    } else {
        Lookup { level, fine, coarse: None }
    }
}

impl<T: Real> Lookup<T> {
    /// Value of the texels that `level` gives: for a level, what fetches its texels by their index.
    #[inline(always)]
    pub fn blend<const C: usize, R: Borrow<[T; C]>, F: Fn(usize) -> R>(
        &self,
        level: impl Fn(usize) -> F,
    ) -> [T; C] {
        let mut out: [T; C] = self.fine.blend(level(self.level));
        if let Some((taps, share)) = &self.coarse {
            let far: [T; C] = taps.blend(level(self.level + 1));
            for c in 0..C {
                out[c] += *share * (far[c] - out[c]);
            }
        }
        out
    }
}

/// Reads the texture.
#[inline(always)]
pub fn sample<T: Real, const C: usize>(texture: &Pyramid<T, C>, at: &Lookup<T>) -> [T; C] {
    at.blend(|level| {
        let texels = &texture.levels[level].texels;
        move |i| &texels[i]
    })
}

/// Adjoint of [`sample`] with respect to uv and the level: returns `(dL/duv, dL/dlevel)`.
///
/// The uv gradient is the bilinear derivative times the level's size, weighted by the level's share;
/// `dL/dlevel = sum g (coarse - fine)`. The texel gradients go through [`super::ScatterQueue`].
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
