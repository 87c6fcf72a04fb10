//! Mip levels with texels of their own: how they start, and which of their texels keep their alpha.

use super::{Candidate, SurfaceClass, hold_alpha, mip_rule, texels_of};
use photofit_raster::deferred::Masks;
use photofit_raster::loss::LossScalar;
use photofit_raster::texture::{MipRule, Pyramid};
use photofit_raster::{CHANNELS, Maps, channel};
use photofit_scalar::vec3;

/// Texels of a level whose alpha is no parameter: those of opaque triangles and of glass, and those of masked ones, which have none where
/// masks are cut.
#[derive(Clone, Debug, Default)]
pub(crate) struct Held {
    pub(crate) solid: Vec<bool>,
    pub(crate) masked: Vec<bool>,
}

impl<T: LossScalar> Candidate<T> {
    /// Makes the texels of all mip levels parameters. A lookup then has its gradient in the levels that it reads, and no level
    /// follows from another; they start as [`Self::levels_of`] says.
    pub fn free_mips(&mut self) {
        self.maps.rule = MipRule::Free;
        let uvs: Vec<_> = self.uvs.iter().map(|uv| uv.cast()).collect();
        let held = |size: (usize, usize)| {
            let of = |which| texels_of((&uvs, &self.triangles), &self.class, &self.classes, size, which);
            Held { solid: of(|class| !class.has_alpha()), masked: of(SurfaceClass::is_masked) }
        };
        if self.is_transparent() {
            self.held_coarse = self.maps.levels[1..].iter().map(|l| held((l.width, l.height))).collect();
        }
        self.maps = self.levels_of(self.maps.levels[0].clone());
    }

    /// Levels whose texels are parameters: the base, or all.
    pub fn fitted_levels(&self) -> usize {
        if self.maps.rule == MipRule::Free { self.maps.levels.len() } else { 1 }
    }

    /// Maps with the mip levels that they start with: the chain by which renderers average them, by coverage where alpha is;
    /// normals of free levels have unit length.
    pub fn levels_of(&self, base: Maps<T>) -> Pyramid<T, CHANNELS> {
        let mut levels = Pyramid::with_rule(base, mip_rule(self.is_transparent()));
        if self.maps.rule == MipRule::Free {
            levels.rule = MipRule::Free;
            for texel in levels.levels[1..].iter_mut().flat_map(|l| &mut l.texels) {
                let n = &mut texel[channel::NORMAL..channel::NORMAL + 3];
                let unit = vec3(n[0], n[1], n[2]).normalize_or_zero();
                if unit.length_squared() > T::zero() {
                    n.copy_from_slice(&unit.to_array());
                }
            }
        }
        levels
    }

    /// The texels of a level whose alpha is no parameter.
    pub(crate) fn held(&self, level: usize) -> [&[bool]; 2] {
        match level.checked_sub(1) {
            None => [&self.solid, &self.masked],
            Some(k) => self.held_coarse.get(k).map_or([&[], &[]], |h| [&h.solid, &h.masked]),
        }
    }

    /// Takes the gradient of alpha from texels where it is no parameter. The outline of a mask that is cut has no gradient;
    /// what weighs colours must not move it.
    pub(super) fn hold_alpha(&self, gradient: &mut Pyramid<T, CHANNELS>, masks: Masks) {
        for (k, level) in gradient.levels.iter_mut().take(self.fitted_levels()).enumerate() {
            let [solid, masked] = self.held(k);
            hold_alpha(&mut level.texels, solid);
            if masks == Masks::Cut {
                hold_alpha(&mut level.texels, masked);
            }
        }
    }
}
