//! One strip of tiles: the covered samples, sorted by triangle, through the stages of shading. What is shaded at once is
//! a sample, or all samples of a triangle in a pixel ([`View::shade_per_pixel`]).

use super::pixel::{CornerGradients, Corners, Pixel};
use super::{Geometry, Passes, View};
#[cfg(target_arch = "x86_64")]
use crate::cpu::has_avx2;
use crate::maps::CHANNELS;
use crate::rasterize::{NONE, PixelGrid, TILE, Visibility};
use crate::texture::{Pyramid, ScatterQueue};
use photofit_scalar::{Real, Vec2, Vec4};

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

/// The covered samples of a strip, sorted by triangle tile by tile, as the forward pass left them.
#[derive(Clone, Debug)]
pub(super) struct StripPixels<T> {
    /// `triangle << 32 | place of the sample` (see [`Groups`]).
    keys: Vec<u64>,
    /// One per group of keys where a reverse pass is to follow: it reads them instead of computing them again.
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

/// The samples that are shaded at once: blocks of `side` x `side` samples, in which places are counted block by block.
#[derive(Clone, Copy)]
struct Groups {
    side: usize,
    /// Columns of samples.
    width: usize,
}

impl Groups {
    fn place(self, x: usize, y: usize) -> usize {
        let s = self.side;
        ((y / s) * (self.width / s) + x / s) * s * s + (y % s) * s + x % s
    }

    /// Column and row of a place.
    #[inline(always)]
    fn at(self, place: usize) -> (usize, usize) {
        if self.side == 1 {
            return (place % self.width, place / self.width);
        }
        let (s, area) = (self.side, self.side * self.side);
        let (block, inside) = (place / area, place % area);
        let columns = self.width / s;
        ((block % columns) * s + inside % s, (block / columns) * s + inside / s)
    }

    /// Number of the block of a key.
    #[inline(always)]
    fn block(self, key: u64) -> usize {
        (key & 0xffff_ffff) as usize / (self.side * self.side)
    }

    /// Mean of the samples' places in normalized device coordinates.
    #[inline(always)]
    fn centroid<T: Real>(self, keys: &[u64], grid: &PixelGrid<T>) -> Vec2<T> {
        let sum = keys.iter().fold(Vec2::zero(), |sum, key| {
            let (x, y) = self.at((key & 0xffff_ffff) as usize);
            sum + grid.ndc(x, y)
        });
        if keys.len() == 1 { sum } else { sum * (T::one() / T::of(keys.len() as f64)) }
    }
}

impl<T: Real> Strip<'_, T> {
    fn groups(&self) -> Groups {
        let side = if self.view.shade_per_pixel { self.view.samples.max(1) } else { 1 };
        assert!(TILE.is_multiple_of(side), "pixels of {side} x {side} samples do not fill tiles of {TILE}");
        Groups { side, width: self.view.width }
    }

    /// The grid by whose cells texture footprints are measured.
    fn footprint(&self, groups: Groups) -> PixelGrid<T> {
        PixelGrid::new(self.view.width / groups.side, self.view.height / groups.side)
    }

    fn rows(&self) -> usize {
        TILE.min(self.view.height - self.y)
    }

    /// Collects the covered samples of the strip, each tile's sorted by triangle.
    fn collect(&self, groups: Groups, keys: &mut Vec<u64>) {
        let w = self.view.width;
        keys.clear();
        for x0 in (0..w).step_by(TILE) {
            let first = keys.len();
            for y in self.y..self.y + self.rows() {
                let row = &self.visibility.triangle[y * w..][x0..(x0 + TILE).min(w)];
                for (x, id) in row.iter().enumerate().filter(|(_, id)| **id != NONE) {
                    keys.push(u64::from(*id) << 32 | groups.place(x0 + x, y) as u64);
                }
            }
            keys[first..].sort_unstable();
        }
    }

    /// Writes radiance and alpha of every covered pixel of the strip, and keeps in `kept` what [`Self::shade_vjp`]
    /// needs, if gradients are asked for.
    pub(super) fn shade(&self, kept: &mut StripPixels<T>, out: &mut [[T; 4]]) {
        self.collect(self.groups(), &mut kept.keys);
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
        let groups = self.groups();
        let footprint = self.footprint(groups);
        let keep = self.passes.position_gradients || self.passes.map_gradients;
        let StripPixels { keys, pixels } = kept;
        if keep && !self.view.shade_per_pixel {
            pixels.reserve(keys.len());
        }
        out.fill([T::zero(); 4]);
        for run in keys.chunk_by(|a, b| a >> 32 == b >> 32) {
            let corners = Corners::load(self.geometry, self.clip, (run[0] >> 32) as usize);
            for group in run.chunk_by(|a, b| groups.block(*a) == groups.block(*b)) {
                let f = groups.centroid(group, &grid);
                let p = Pixel::new(&corners, f, &footprint, self.maps, self.view, self.passes);
                let color = p.color(&corners, self.view, self.passes);
                for key in group {
                    let (x, y) = groups.at((key & 0xffff_ffff) as usize);
                    out[y * w + x - first] = color;
                }
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
        let groups = self.groups();
        let StripGradients { corners: out_corners, texels } = out;
        out_corners.clear();
        texels.clear();
        let mut pixels = kept.pixels.iter();
        for run in kept.keys.chunk_by(|a, b| a >> 32 == b >> 32) {
            let triangle = (run[0] >> 32) as u32;
            let corners = Corners::load(self.geometry, self.clip, triangle as usize);
            let mut sum = CornerGradients::default();
            let blocks = run.chunk_by(|a, b| groups.block(*a) == groups.block(*b));
            for (group, p) in blocks.zip(&mut pixels) {
                let mut sum_g = [T::zero(); 4];
                for key in group {
                    let (x, y) = groups.at((key & 0xffff_ffff) as usize);
                    let g = &g[y * w + x - first];
                    (0..4).for_each(|k| sum_g[k] += g[k]);
                }
                let g = &sum_g;
                // A pixel whose colour does not matter costs nothing (equal to the reference, or outside of a mask).
                if g.iter().all(|g| *g == T::zero()) {
                    continue;
                }
                let f = groups.centroid(group, &grid);
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
