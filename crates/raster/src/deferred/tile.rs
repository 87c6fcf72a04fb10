//! One strip of tiles: the covered pixels, sorted by triangle, through the per-pixel stages.

use super::pixel::{CornerGradients, Corners, Pixel};
use super::{Geometry, Passes, View};
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

/// What the reverse pass of a strip collects.
#[derive(Debug)]
pub(super) struct StripGradients<T> {
    pub corners: Vec<(u32, CornerGradients<T>)>,
    pub texels: ScatterQueue<T, CHANNELS>,
    keys: Vec<u64>,
}

impl<T: Real> Default for StripGradients<T> {
    fn default() -> Self {
        Self { corners: Vec::new(), texels: ScatterQueue::default(), keys: Vec::new() }
    }
}

impl<T: Real> Strip<'_, T> {
    fn rows(&self) -> usize {
        TILE.min(self.view.height - self.y)
    }

    /// Calls `run` for each run of pixels of one triangle in one tile; pixels are image indices.
    fn for_each_run(&self, keys: &mut Vec<u64>, mut run: impl FnMut(u32, &[u64])) {
        let w = self.view.width;
        for x0 in (0..w).step_by(TILE) {
            keys.clear();
            for y in self.y..self.y + self.rows() {
                let row = &self.visibility.triangle[y * w..][x0..(x0 + TILE).min(w)];
                for (x, id) in row.iter().enumerate().filter(|(_, id)| **id != NONE) {
                    keys.push(u64::from(*id) << 32 | (y * w + x0 + x) as u64);
                }
            }
            keys.sort_unstable();
            for same in keys.chunk_by(|a, b| a >> 32 == b >> 32) {
                run((same[0] >> 32) as u32, same);
            }
        }
    }

    /// Writes radiance and alpha of every covered pixel of the strip.
    pub(super) fn shade(&self, keys: &mut Vec<u64>, out: &mut [[T; 4]]) {
        let (w, first) = (self.view.width, self.y * self.view.width);
        let grid = PixelGrid::new(w, self.view.height);
        self.for_each_run(keys, |triangle, pixels| {
            let corners = Corners::load(self.geometry, self.clip, triangle as usize);
            for key in pixels {
                let i = (key & 0xffff_ffff) as usize;
                let f = grid.ndc(i % w, i / w);
                let p = Pixel::new(&corners, f, &grid, self.maps, self.view, self.passes);
                out[i - first] = p.color(&corners, self.view, self.passes);
            }
        });
    }

    /// Adjoint of [`Self::shade`] for the gradients `g` of the strip's rows.
    pub(super) fn shade_vjp(&self, g: &[[T; 4]], out: &mut StripGradients<T>) {
        let (w, first) = (self.view.width, self.y * self.view.width);
        let grid = PixelGrid::new(w, self.view.height);
        let StripGradients { corners: out_corners, texels, keys } = out;
        out_corners.clear();
        texels.clear();
        self.for_each_run(keys, |triangle, pixels| {
            let corners = Corners::load(self.geometry, self.clip, triangle as usize);
            let mut sum = CornerGradients::default();
            for key in pixels {
                let i = (key & 0xffff_ffff) as usize;
                let g = &g[i - first];
                // A pixel whose colour does not matter costs nothing (equal to the reference, or outside of a mask).
                if g.iter().all(|g| *g == T::zero()) {
                    continue;
                }
                let f = grid.ndc(i % w, i / w);
                let p = Pixel::new(&corners, f, &grid, self.maps, self.view, self.passes);
                let (at, g_texel) = p.vjp(&corners, f, self.maps, self.view, self.passes, g, &mut sum);
                if self.passes.map_gradients {
                    texels.push(self.maps, &at, &g_texel);
                }
            }
            if self.passes.position_gradients {
                out_corners.push((triangle, sum));
            }
        });
    }
}
