//! Antialiasing of silhouettes: blends pixels across visibility edges by their coverage, which makes visibility
//! differentiable (Laine et al. 2020, section 3.5).
//!
//! For each pixel and its right and lower neighbour with another triangle: the closer surface is followed along the
//! line between the two pixel centres, from triangle to triangle, to the silhouette edge where it ends, at distance
//! `t` from the closer pixel's centre. (Laine et al. look at the pixel's own triangle alone, which misses silhouettes
//! of triangles smaller than a pixel.) The blend factor is `alpha = s (1/2 - t)`, `s = +1` if the closer pixel is the first one. A positive alpha blends
//! the second colour into the first pixel, a negative one the first colour into the second pixel.
//!
//! Limits: one edge per pixel pair; surfaces that cover no pixel centre are not seen; intersections have no gradient.
//! A silhouette is judged by welded topology, so duplicated vertices do not matter.

mod edge;
mod fold;
#[cfg(feature = "gpu")]
pub mod gpu;
mod topology;

pub use topology::MeshTopology;

use crate::rasterize::{NONE, TILE, Visibility};
use edge::{Crossing, find_crossing};
use fold::Folds;
use photofit_scalar::{Real, Vec4, vec4};
use rayon::prelude::*;

/// Triangles with the opposite vertices of their neighbours; [`MeshTopology`] makes it of a mesh.
#[derive(Clone, Copy, Debug)]
pub struct Topology<'a> {
    /// Vertex indices.
    pub triangles: &'a [[u32; 3]],
    /// For edge k (from corner k to corner k+1) the vertex opposite to it in the triangle across, or [`NONE`].
    pub opposite: &'a [[u32; 3]],
    /// For edge k the triangle across, or [`NONE`].
    pub neighbour: &'a [[u32; 3]],
}

/// Two neighbouring pixels with a silhouette between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair<T> {
    /// Index of the left or upper pixel.
    pub first: u32,
    /// Index of the right or lower pixel.
    pub second: u32,
    /// Blend factor; its sign chooses the pixel that is written.
    pub alpha: T,
    crossing: Crossing<T>,
}

/// Finds all silhouettes between neighbouring pixels, in a fixed order.
///
/// `clip` `[V]` are the positions that `visibility` was made from.
///
/// # Panics
/// If sizes differ or an index is out of range.
pub fn silhouettes<T: Real>(
    visibility: &Visibility,
    clip: &[Vec4<T>],
    topology: &Topology<'_>,
) -> Vec<Pair<T>> {
    let (w, h) = (visibility.width, visibility.height);
    let folds = Folds::new(clip, topology);
    let strips: Vec<Vec<Pair<T>>> = (0..h.div_ceil(TILE))
        .into_par_iter()
        .map(|s| {
            let (mut pairs, mut borders) = (Vec::new(), vec![0; 2 * w]);
            for y in s * TILE..((s + 1) * TILE).min(h) {
                row_pairs(visibility, clip, topology, &folds, y, &mut borders, &mut pairs);
            }
            pairs
        })
        .collect();
    debug_assert!(w * h <= u32::MAX as usize, "pixel indices fit 32 bits");
    strips.concat()
}

fn row_pairs<T: Real>(
    v: &Visibility,
    clip: &[Vec4<T>],
    topology: &Topology<'_>,
    folds: &Folds,
    y: usize,
    borders: &mut [u32],
    pairs: &mut Vec<Pair<T>>,
) {
    let w = v.width;
    let row = &v.triangle[y * w..][..w];
    let below = if y + 1 < v.height { &v.triangle[(y + 1) * w..][..w] } else { row };
    for border in find_borders(row, below, borders) {
        let (i, vertical) = (y * w + (border / 2) as usize, border % 2 == 1);
        let j = i + if vertical { w } else { 1 };
        let (a, b) = (v.triangle[i], v.triangle[j]);
        if a == NONE || b == NONE || !folds.continuous(topology, a as usize, b) {
            pairs.extend(pair(v, clip, topology, folds, i, j, vertical));
        }
    }
}

/// The places where a row of triangle ids changes: twice the column where it does to the right, one more than that where
/// it does to the row below. Collected without branches, which nothing could predict.
fn find_borders<'a>(row: &[u32], below: &[u32], out: &'a mut [u32]) -> &'a [u32] {
    let mut n = 0;
    for (x, ((id, right), below)) in row.iter().zip(&row[1.min(row.len())..]).zip(below).enumerate() {
        out[n] = 2 * x as u32;
        n += usize::from(id != right);
        out[n] = 2 * x as u32 + 1;
        n += usize::from(id != below);
    }
    if let (Some(x), true) = (row.len().checked_sub(1), row.last() != below.last()) {
        out[n] = 2 * x as u32 + 1;
        n += 1;
    }
    &out[..n]
}

fn pair<T: Real>(
    v: &Visibility,
    clip: &[Vec4<T>],
    topology: &Topology<'_>,
    folds: &Folds,
    first: usize,
    second: usize,
    vertical: bool,
) -> Option<Pair<T>> {
    let (a, b) = (v.triangle[first], v.triangle[second]);
    let first_is_closer = b == NONE || (a != NONE && v.depth[first] <= v.depth[second]);
    let (triangle, pixel) = if first_is_closer { (a, first) } else { (b, second) };
    let sign = if first_is_closer { T::one() } else { -T::one() };
    let grid =
        edge::View { width: v.width, height: v.height, x: pixel % v.width, y: pixel / v.width, vertical };
    let crossing = find_crossing(clip, topology, folds, triangle as usize, sign, &grid)?;
    let alpha = sign * (T::of(0.5) - crossing.t);
    (alpha != T::zero()).then_some(Pair { first: first as u32, second: second as u32, alpha, crossing })
}

impl<T: Real> Pair<T> {
    /// The pixel that this pair changes.
    #[inline(always)]
    pub fn written(&self) -> usize {
        (if self.alpha > T::zero() { self.first } else { self.second }) as usize
    }
}

/// Blends `color` `[H*W]` across the silhouettes into `out`, which must hold a copy of `color`.
///
/// All pairs read the original colours.
///
/// # Panics
/// If the slices differ in length or a pair is out of range.
pub fn antialias<T: Real, const C: usize>(pairs: &[Pair<T>], color: &[[T; C]], out: &mut [[T; C]]) {
    assert_eq!(color.len(), out.len(), "one output per pixel");
    for p in pairs {
        let (c0, c1) = (&color[p.first as usize], &color[p.second as usize]);
        let o = &mut out[p.written()];
        for c in 0..C {
            o[c] += p.alpha * (c1[c] - c0[c]);
        }
    }
}

/// Adjoint of [`antialias`]: turns `g`, the gradient of its output, into that of its input colours, and accumulates
/// the gradients of the clip-space positions, where they are asked for.
///
/// # Panics
/// If the slices differ in length or a pair is out of range.
pub fn antialias_vjp<T: Real, const C: usize>(
    pairs: &[Pair<T>],
    clip: &[Vec4<T>],
    (width, height): (usize, usize),
    color: &[[T; C]],
    g: &mut [[T; C]],
    mut g_clip: Option<&mut [Vec4<T>]>,
) {
    assert_eq!(color.len(), g.len(), "one gradient per pixel");
    // All pairs read the gradient of the output, also where others have changed it.
    let g_out: Vec<[T; C]> = pairs.iter().map(|p| g[p.written()]).collect();
    for (p, g_out) in pairs.iter().zip(&g_out) {
        let (i0, i1) = (p.first as usize, p.second as usize);
        for c in 0..C {
            g[i1][c] += p.alpha * g_out[c];
            g[i0][c] -= p.alpha * g_out[c];
        }
        if let Some(g_clip) = g_clip.as_deref_mut().filter(|_| p.alpha.abs() < T::of(0.5)) {
            let d = (0..C).fold(T::zero(), |d, c| d + g_out[c] * (color[i1][c] - color[i0][c]));
            p.crossing.vjp(-d, clip, width, height, g_clip);
        }
    }
}

/// Adds `(gx, gy)`, a gradient of a vertex' pixel position (y downwards), to its clip-space gradient.
#[inline(always)]
fn pixel_to_clip_vjp<T: Real>(c: Vec4<T>, gx: T, gy: T, width: usize, height: usize, g: &mut Vec4<T>) {
    let r = T::of(0.5) / c.w;
    let (gcx, gcy) = (gx * T::of(width as f64) * r, -gy * T::of(height as f64) * r);
    *g += vec4(gcx, gcy, T::zero(), -(c.x * gcx + c.y * gcy) / c.w);
}

#[cfg(test)]
mod tests;
