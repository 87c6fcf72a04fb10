//! Which edges are silhouettes in a view: the surface ends there or folds over.

use super::Topology;
use crate::rasterize::NONE;
use photofit_scalar::{Real, Vec4};
use rayon::prelude::*;

/// Triangles handled by one task.
const CHUNK: usize = 1 << 12;

/// For each triangle, a bit for each of its edges that is a silhouette.
pub(super) struct Folds(Vec<u8>);

impl Folds {
    /// Judges all edges of a view.
    pub(super) fn new<T: Real>(clip: &[Vec4<T>], topology: &Topology<'_>) -> Self {
        let mut masks = vec![0; topology.triangles.len()];
        let tasks = masks.par_chunks_mut(CHUNK).enumerate();
        tasks.for_each(|(task, masks)| {
            for (i, mask) in masks.iter_mut().enumerate() {
                *mask = silhouette_mask(clip, topology, task * CHUNK + i);
            }
        });
        Self(masks)
    }

    /// Whether edge `k` of a triangle is a silhouette.
    #[inline(always)]
    pub(super) fn is_silhouette(&self, triangle: usize, k: usize) -> bool {
        self.0[triangle] >> k & 1 == 1
    }

    /// Whether two triangles are neighbours on a piece of surface that neither ends nor folds over at either of them,
    /// so that nothing between them can be a silhouette.
    #[inline(always)]
    pub(super) fn continuous(&self, topology: &Topology<'_>, a: usize, b: u32) -> bool {
        let n = topology.neighbour[a];
        ((n[0] == b) | (n[1] == b) | (n[2] == b)) && (self.0[a] | self.0[b as usize]) == 0
    }
}

#[inline(always)]
fn silhouette_mask<T: Real>(clip: &[Vec4<T>], topology: &Topology<'_>, triangle: usize) -> u8 {
    let [i, j, k] = topology.triangles[triangle].map(|i| clip[i as usize]);
    let opposite = topology.opposite[triangle];
    let lines = [line(i, j), line(j, k), line(k, i)];
    let own = side(&lines[0], k) < T::zero();
    let mut mask = 0;
    for e in 0..3 {
        let fold = opposite[e] == NONE || {
            let o = clip[opposite[e] as usize];
            o.w > T::zero() && (side(&lines[e], o) < T::zero()) == own
        };
        mask |= u8::from(fold) << e;
    }
    mask
}

/// The line through two points in the image plane, homogeneous.
#[inline(always)]
fn line<T: Real>(a: Vec4<T>, b: Vec4<T>) -> [T; 3] {
    [a.y * b.w - a.w * b.y, a.w * b.x - a.x * b.w, a.x * b.y - a.y * b.x]
}

/// On which side of a line a point with positive w lies.
#[inline(always)]
fn side<T: Real>(l: &[T; 3], p: Vec4<T>) -> T {
    l[0] * p.x + l[1] * p.y + l[2] * p.w
}
