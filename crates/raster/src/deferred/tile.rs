//! One strip of tiles: the covered pixels, sorted by triangle, through the per-pixel stages.

use super::pixel::{CornerGradients, Corners, Pixel};
use super::{Geometry, Passes, View};
use crate::cpu::has_avx2;
use crate::maps::CHANNELS;
use crate::rasterize::{NONE, PixelGrid, TILE, Visibility};
use crate::texture::{Pyramid, ScatterQueue};
use photofit_scalar::{Real, Vec4};

/// Inputs of a strip.
pub(super) struct Strip<'a, T> {
    pub geometry: &'a Geometry<'a, T>,
    pub view: &'a View<'a, T>,
    pub passes: &'a Passes,
    pub maps: &'a Pyramid<T, CHANNELS>,
    pub clip: &'a [Vec4<T>],
    pub visibility: &'a Visibility,
    /// First row.
    pub y: usize,
}

/// The covered pixels of a strip, sorted by triangle tile by tile, as the forward pass left them.
#[derive(Clone, Debug)]
pub(super) struct StripPixels<T> {
    /// `triangle << 32 | index of the pixel in the image`.
    keys: Vec<u64>,
    /// One per key where a reverse pass is to follow: it reads them instead of computing them again.
    pixels: Vec<Pixel<T>>,
}

impl<T> Default for StripPixels<T> {
    fn default() -> Self {
        Self { keys: Vec::new(), pixels: Vec::new() }
    }
}

/// What the reverse pass of a strip collects.
#[derive(Clone, Debug)]
pub(super) struct StripGradients<T> {
    pub corners: Vec<(u32, CornerGradients<T>)>,
    pub texels: ScatterQueue<T, CHANNELS>,
}

impl<T: Real> Default for StripGradients<T> {
    fn default() -> Self {
        Self { corners: Vec::new(), texels: ScatterQueue::default() }
    }
}

impl<T: Real> Strip<'_, T> {
    fn rows(&self) -> usize {
        TILE.min(self.view.height - self.y)
    }

    /// Collects the covered pixels of the strip, each tile's sorted by triangle.
    fn collect(&self, keys: &mut Vec<u64>) {
        let w = self.view.width;
        keys.clear();
        for x0 in (0..w).step_by(TILE) {
            let first = keys.len();
            for y in self.y..self.y + self.rows() {
                let row = &self.visibility.triangle[y * w..][x0..(x0 + TILE).min(w)];
                for (x, id) in row.iter().enumerate().filter(|(_, id)| **id != NONE) {
                    keys.push(u64::from(*id) << 32 | (y * w + x0 + x) as u64);
                }
            }
            keys[first..].sort_unstable();
        }
    }

    /// Writes radiance and alpha of every covered pixel of the strip, and keeps in `kept` what [`Self::shade_vjp`]
    /// needs, if gradients are asked for.
    pub(super) fn shade(&self, kept: &mut StripPixels<T>, out: &mut [[T; 4]]) {
        self.collect(&mut kept.keys);
        kept.pixels.clear();
        #[cfg(target_arch = "x86_64")]
        if has_avx2() {
            #[expect(unsafe_code, reason = "calling a function compiled for AVX2 and FMA")]
            // SAFETY: both features were just detected.
            return unsafe { self.shade_avx2(kept, out) };
        }
        self.shade_any(kept, out);
    }

    /// Adjoint of [`Self::shade`] for the gradients `g` of the strip's rows.
    pub(super) fn shade_vjp(&self, kept: &StripPixels<T>, g: &[[T; 4]], out: &mut StripGradients<T>) {
        #[cfg(target_arch = "x86_64")]
        if has_avx2() {
            #[expect(unsafe_code, reason = "calling a function compiled for AVX2 and FMA")]
            // SAFETY: both features were just detected.
            return unsafe { self.shade_vjp_avx2(kept, g, out) };
        }
        self.shade_vjp_any(kept, g, out);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn shade_avx2(&self, kept: &mut StripPixels<T>, out: &mut [[T; 4]]) {
        self.shade_any(kept, out);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn shade_vjp_avx2(&self, kept: &StripPixels<T>, g: &[[T; 4]], out: &mut StripGradients<T>) {
        self.shade_vjp_any(kept, g, out);
    }

    #[inline(always)]
    fn shade_any(&self, kept: &mut StripPixels<T>, out: &mut [[T; 4]]) {
        let (w, first) = (self.view.width, self.y * self.view.width);
        let grid = PixelGrid::new(w, self.view.height);
        let keep = self.passes.position_gradients || self.passes.map_gradients;
        let StripPixels { keys, pixels } = kept;
        if keep {
            pixels.reserve(keys.len());
        }
        out.fill([T::zero(); 4]);
        for run in keys.chunk_by(|a, b| a >> 32 == b >> 32) {
            let corners = Corners::load(self.geometry, self.clip, (run[0] >> 32) as usize);
            for key in run {
                let i = (key & 0xffff_ffff) as usize;
                let f = grid.ndc(i % w, i / w);
                let p = Pixel::new(&corners, f, &grid, self.maps, self.view, self.passes);
                out[i - first] = p.color(&corners, self.view, self.passes);
                if keep {
                    pixels.push(p);
                }
            }
        }
    }

    #[inline(always)]
    fn shade_vjp_any(&self, kept: &StripPixels<T>, g: &[[T; 4]], out: &mut StripGradients<T>) {
        let (w, first) = (self.view.width, self.y * self.view.width);
        let grid = PixelGrid::new(w, self.view.height);
        let StripGradients { corners: out_corners, texels } = out;
        out_corners.clear();
        texels.clear();
        let mut pixels = kept.pixels.iter();
        for run in kept.keys.chunk_by(|a, b| a >> 32 == b >> 32) {
            let triangle = (run[0] >> 32) as u32;
            let corners = Corners::load(self.geometry, self.clip, triangle as usize);
            let mut sum = CornerGradients::default();
            for (key, p) in run.iter().zip(&mut pixels) {
                let i = (key & 0xffff_ffff) as usize;
                let g = &g[i - first];
                // A pixel whose colour does not matter costs nothing (equal to the reference, or outside of a mask).
                if g.iter().all(|g| *g == T::zero()) {
                    continue;
                }
                let f = grid.ndc(i % w, i / w);
                let (at, g_texel) = p.vjp(&corners, f, self.maps, self.view, self.passes, g, &mut sum);
                if self.passes.map_gradients {
                    texels.push(self.maps, &at, &g_texel);
                }
            }
            if self.passes.position_gradients {
                out_corners.push((triangle, sum));
            }
        }
    }
}
