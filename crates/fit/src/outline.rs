//! How much outline each triangle of an asset shows, from all around.
//!
//! Seen from a direction `v`, an edge between triangles of normals `n` and `m` lies on a contour where `v` faces one of them
//! alone, that is, where `v` is perpendicular to some normal between the two. Over all directions the edge, of length `l`
//! and turning by the angle `a`, adds `l a / 4` to the mean length of projected contours (Cauchy: over a convex body they sum to
//! its mean perimeter); an open border turns by half a turn. Rays from the edge towards the viewer and away from it tell how
//! much of that is hidden, how much lies before the asset itself, and how much before the background. No pictures are
//! drawn: the figure has no size of pixels in it, and every edge counts (one of three triangles or more by the first two of them).
//!
//! Pictures miss what decimation does to a contour and no map mends it, so these lengths say where triangles are worth most.

use crate::bake::ReferenceSurface;
use crate::bake::reference::SurfacePoint;
use crate::visibility::{is_occluded, sequence};
use photofit_geometry::{Edges, weld::weld_exact};
use photofit_rays::Ray;
use photofit_sampling::SplitMix64;
use photofit_scalar::Vec3f;
use photofit_shading::Sides;
use rayon::prelude::*;
use std::f32::consts::{PI, TAU};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Edges between two reports.
const CHUNK: usize = 256;
/// Edges that turn by less, radians, show no contour to speak of.
const FLAT: f32 = 1e-4;

/// How many rays [`outline`] spends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutlineSettings {
    /// Directions of all edges together.
    pub directions: usize,
    /// Most directions of an edge; it has one at least.
    pub most: usize,
    /// What a contour before the asset itself counts, relative to one before the background.
    pub inner: f32,
}

impl Default for OutlineSettings {
    fn default() -> Self {
        Self { directions: 2_000_000, most: 32, inner: 0.25 }
    }
}

/// Mean length of the contours on each triangle, over all directions to the viewer.
///
/// Deterministic for any number of threads.
pub fn outline(reference: &ReferenceSurface<'_>, settings: &OutlineSettings) -> Vec<f32> {
    outline_reporting(reference, settings, &|_| ControlFlow::Continue(())).unwrap_or_default()
}

/// As [`outline`]; `report` hears the finished share in `[0, 1]` from several threads, in no particular order, and may end
/// the work: then there is no result.
pub fn outline_reporting(
    reference: &ReferenceSurface<'_>,
    settings: &OutlineSettings,
    report: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
) -> Option<Vec<f32>> {
    let mesh = reference.mesh();
    let weld = weld_exact(&mesh.positions);
    let edges = Edges::new(&mesh.triangles, &weld);
    let each = (settings.directions / edges.len().max(1)).clamp(1, settings.most.max(1));
    let (done, stopped) = (AtomicUsize::new(0), AtomicBool::new(false));
    let mut lengths = vec![0.0_f32; edges.len()];
    lengths.par_chunks_mut(CHUNK).enumerate().for_each(|(c, lengths)| {
        let share = (done.fetch_add(1, Ordering::Relaxed) * CHUNK) as f32 / edges.len() as f32;
        if stopped.load(Ordering::Relaxed) || report(share.min(1.0)).is_break() {
            stopped.store(true, Ordering::Relaxed);
            return;
        }
        for (i, length) in lengths.iter_mut().enumerate() {
            let e = c * CHUNK + i;
            let Some(fold) = Fold::new(reference, &edges, e) else { continue };
            let mut random = SplitMix64::new(1, e as u64);
            let offset = [(); 4].map(|()| random.next_f64());
            let sum: f32 = (0..each).map(|k| fold.seen(sequence(offset, k), settings.inner)).sum();
            *length = fold.length * fold.turn * 0.25 * sum / each as f32;
        }
    });
    let mut of = vec![0.0; mesh.triangles.len()];
    for (e, length) in lengths.iter().enumerate() {
        let on = edges.triangles(e).into_iter().flatten();
        let share = length / on.clone().count() as f32;
        on.for_each(|t| of[t as usize] += share);
    }
    (!stopped.into_inner()).then_some(of)
}

/// An edge that some directions see as a contour.
struct Fold<'a> {
    reference: &'a ReferenceSurface<'a>,
    edges: &'a Edges,
    /// Its number.
    edge: u32,
    /// One of the triangles on it.
    triangle: u32,
    /// Place of the first end among the corners of the first triangle.
    corner: usize,
    ends: [Vec3f; 2],
    length: f32,
    /// Unit vectors: along the edge, the normal that turns about it, and the one that it turns towards.
    axes: [Vec3f; 3],
    /// By how much it turns, radians.
    turn: f32,
    /// Direction from which the first triangle is seen, where its back is not drawn.
    front: Option<Vec3f>,
    lift: f32,
}

impl<'a> Fold<'a> {
    fn new(reference: &'a ReferenceSurface<'a>, edges: &'a Edges, e: usize) -> Option<Self> {
        let mesh = reference.mesh();
        let triangles = edges.triangles(e);
        let t = triangles[0]?;
        let corner = (edges.half_edges.row(e)[0] % 3) as usize;
        let corners = mesh.corners(t as usize);
        let [a, b, c] = [0, 1, 2].map(|k| corners[(corner + k) % 3]);
        let along = (b - a).normalize_or_zero();
        let normal = (b - a).cross(c - a).normalize_or_zero();
        // Within the plane of the triangle, out of it.
        let out = along.cross(normal);
        let double = |t: u32| Sides::of(reference.material(t).double_sided).shows(false);
        let (mut axes, mut turn, mut front) = ([along, normal, out], PI, None);
        if let Some(other) = triangles[1] {
            let half = edges.half_edges.row(e)[1] as usize % 3;
            let o = mesh.corners(other as usize);
            let m = (o[1] - o[0]).cross(o[2] - o[0]).normalize_or_zero();
            // Neighbours that agree about their sides pass the edge in opposite directions.
            let agree = (o[(half + 1) % 3] - o[half]).dot(along) < 0.0;
            let m = if agree { m } else { -m };
            let (sin, cos) = (m.dot(out), m.dot(normal));
            turn = sin.abs().atan2(cos);
            // A half turn is a border, whatever rounding makes of its sign.
            if sin < 0.0 && turn < PI - FLAT {
                // A valley is no contour, but from behind.
                if !double(t) {
                    return None;
                }
                axes = [along, -normal, out];
            }
        } else if !double(t) {
            front = Some(normal);
        }
        let length = (b - a).length();
        if length <= 0.0 || turn < FLAT || !normal.is_finite() || normal.length() < 0.5 {
            return None;
        }
        let size = a.to_array().into_iter().fold(0.0, |m: f32, x| m.max(x.abs()));
        let lift = (1e-5 * reference.diagonal()).max(4.0 * f32::EPSILON * size);
        let edge = e as u32;
        Some(Self {
            reference,
            edges,
            edge,
            triangle: t,
            corner,
            ends: [a, b],
            length,
            axes,
            turn,
            front,
            lift,
        })
    }

    /// What the contour counts from one direction: 0 where it is hidden, 1 before the background.
    fn seen(&self, [x0, x1, x2, x3]: [f32; 4], inner: f32) -> f32 {
        let [along, from, towards] = self.axes;
        let (sin, cos) = (self.turn * x2).sin_cos();
        let normal = from * cos + towards * sin;
        // Directions perpendicular to the normal, as densely as the edge looks long: the abscissa of a point of the disk.
        let (y, x) = (TAU * x1).sin_cos();
        let x = x0.sqrt() * x;
        let across = (1.0 - x * x).max(0.0).sqrt().copysign(y);
        let v = along * x + normal.cross(along) * across;
        if self.front.is_some_and(|n| n.dot(v) <= 0.0) {
            return 0.0;
        }
        let [a, b] = self.ends;
        // Corners of the triangle have the weights 1 - u - v, u, v.
        let mut weights = [0.0; 3];
        (weights[self.corner], weights[(self.corner + 1) % 3]) = (1.0 - x3, x3);
        let place = SurfacePoint { triangle: self.triangle, u: weights[1], v: weights[2] };
        if self.reference.is_cut(&place) {
            return 0.0;
        }
        let origin = a + (b - a) * x3 + normal * self.lift;
        let own = |t: u32| self.edges.of_triangle[t as usize].contains(&self.edge);
        if is_occluded(self.reference, &Ray::new(origin, v), own, |front| !front, true) {
            return 0.0;
        }
        if is_occluded(self.reference, &Ray::new(origin, -v), own, |front| front, true) { inner } else { 1.0 }
    }
}

/// Lengths per area, smoothed over `rounds` rings of neighbours: triangles that one of a coarser mesh stands for count alike.
pub fn smoothed(reference: &ReferenceSurface<'_>, lengths: &[f32], rounds: usize) -> Vec<f32> {
    let mesh = reference.mesh();
    let weld = weld_exact(&mesh.positions);
    let triangles = weld.triangles(&mesh.triangles);
    let area = |t: usize| 0.5 * f64::from(reference.area_normal(t as u32).length());
    let mut of: Vec<[f64; 2]> = lengths.iter().enumerate().map(|(t, l)| [f64::from(*l), area(t)]).collect();
    for _ in 0..rounds {
        let mut at = vec![([0.0; 2], 0.0); weld.count()];
        for (t, [l, a]) in triangles.iter().zip(&of) {
            for v in t {
                let (sum, count) = &mut at[*v as usize];
                (sum[0], sum[1], *count) = (sum[0] + l, sum[1] + a, *count + 1.0);
            }
        }
        let mean = |t: &[u32; 3]| {
            [0, 1].map(|k| t.iter().map(|v| at[*v as usize].0[k] / at[*v as usize].1).sum::<f64>() / 3.0)
        };
        of = triangles.iter().map(mean).collect();
    }
    of.iter().map(|[l, a]| if *a > 0.0 { (l / a) as f32 } else { 0.0 }).collect()
}

#[cfg(test)]
mod tests;
