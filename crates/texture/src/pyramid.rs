//! Mip pyramids of any number of channels: chains that follow from their base, with the adjoint, or free levels.

use super::filter::{downsample, downsample_vjp};
use super::{Level, MipSizes, Texture, mip_size};
use photofit_scalar::Real;
use rayon::prelude::*;

/// How the levels of a pyramid follow from its base.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum MipRule {
    /// Every channel is averaged by area.
    #[default]
    Area,
    /// Alpha is coverage: colours are averaged by area times alpha, so that what cannot be seen does not bleed in.
    Coverage {
        /// The first channels, so many, are straight colour; those after it are averaged by area.
        colors: usize,
        /// The channel of alpha, not a colour.
        alpha: usize,
    },
    /// Levels are independent of each other: parameters of their own.
    Free,
}

/// How gradients of coarse levels return to the base of a chain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MipAdjoint {
    /// Bilinear upsampling: the same sum as the exact adjoint (of even sizes), without its blocks. A descent direction
    /// of the same loss seen through a smoothing prior, not the exact gradient.
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
    /// How they follow from the base.
    pub rule: MipRule,
}

impl<T: Real, const C: usize> Pyramid<T, C> {
    /// The chain of a base level by area, down to 1 x 1: sizes are halved and rounded down, every texel is the exact
    /// area average of the level above, odd sizes included.
    ///
    /// ```
    /// use photofit_texture::{Pyramid, Texture};
    /// let base = Texture { width: 5, height: 1, texels: vec![[0.0], [1.0], [2.0], [3.0], [4.0_f32]] };
    /// let pyramid = Pyramid::new(base);
    /// assert_eq!(pyramid.levels.iter().map(|l| l.width).collect::<Vec<_>>(), [5, 2, 1]);
    /// assert!((pyramid.levels[2].texels[0][0] - 2.0).abs() < 1e-6); // the mean
    /// ```
    ///
    /// # Panics
    /// If the texture has no texels, or their number is not that of its size.
    pub fn new(base: Texture<T, C>) -> Self {
        Self::with_rule(base, MipRule::Area)
    }

    /// As [`Self::new`] by another rule; the coarse levels of [`MipRule::Free`] start as averages by area.
    ///
    /// # Panics
    /// As [`Self::new`]; if the rule names channels that are not there, or an alpha that is a colour.
    pub fn with_rule(base: Texture<T, C>, rule: MipRule) -> Self {
        assert!(!base.texels.is_empty(), "a texture has at least one texel");
        assert_eq!(base.texels.len(), base.width * base.height, "one texel per row and column");
        if let MipRule::Coverage { colors, alpha } = rule {
            assert!(colors <= alpha && alpha < C, "{colors} colours and then alpha, channel {alpha}, of {C}");
        }
        let mut levels = vec![base];
        while let Some(l) = levels.last().filter(|l| l.width > 1 || l.height > 1) {
            let (w, h) = mip_size(l.width, l.height);
            levels.push(Texture::filled(w, h, [T::zero(); C]));
        }
        let start = if rule == MipRule::Free { MipRule::Area } else { rule };
        let mut out = Self { levels, rule: start };
        out.rebuild();
        out.rule = rule;
        out
    }

    /// A pyramid of zeros with the sizes and the rule of `like` (for gradients).
    pub fn zeros_like(like: &Self) -> Self {
        let levels = like.levels.iter().map(|l| Texture::filled(l.width, l.height, [T::zero(); C])).collect();
        Self { levels, rule: like.rule }
    }

    /// Sets all texels to zero.
    pub fn clear(&mut self) {
        for l in &mut self.levels {
            l.texels.par_chunks_mut(1 << 14).for_each(|c| c.fill([T::zero(); C]));
        }
    }

    /// Recomputes all levels from the base; free levels stay.
    pub fn rebuild(&mut self) {
        if self.rule == MipRule::Free {
            return;
        }
        for k in 1..self.levels.len() {
            let (fine, coarse) = self.levels.split_at_mut(k);
            let fine = &fine[k - 1];
            downsample(|i| &fine.texels[i], (fine.width, fine.height), self.rule, &mut coarse[0].texels);
        }
    }

    /// Adjoint of [`Self::rebuild`] at the values `self`: moves the gradients of the coarse levels into the base level of
    /// `gradient`, whose coarse levels keep their partial sums. Gradients of free levels stay where they are.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn collapse_vjp(&self, gradient: &mut Self, adjoint: MipAdjoint) {
        let size = |p: &Self| (p.levels[0].width, p.levels[0].height, p.levels.len());
        assert_eq!(size(self), size(gradient), "gradients have the size of the values");
        if self.rule == MipRule::Free {
            return;
        }
        for k in (1..self.levels.len()).rev() {
            let (g_fine, g_coarse) = gradient.levels.split_at_mut(k);
            let (fine, coarse) = (&self.levels[k - 1], &self.levels[k]);
            downsample_vjp(fine, coarse, &g_coarse[0], &mut g_fine[k - 1], self.rule, adjoint);
        }
    }
}

impl<T, const C: usize> MipSizes for Pyramid<T, C> {
    #[inline(always)]
    fn count(&self) -> usize {
        self.levels.len()
    }
    /// Every level is an array of its own: offsets are 0.
    #[inline(always)]
    fn level(&self, k: usize) -> Level {
        Level { offset: 0, width: self.levels[k].width as u32, height: self.levels[k].height as u32 }
    }
}
