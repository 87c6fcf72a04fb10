//! Where a silhouette edge crosses the line between two pixel centres.

use super::fold::Folds;
use super::{Topology, pixel_to_clip_vjp};
use crate::rasterize::NONE;
use photofit_scalar::{Real, Vec2, Vec4, vec2};

/// How far outside of the segment between the centres a crossing still counts.
const MARGIN: f64 = 1.0 / 16.0;
/// Triangles that are walked through between two pixel centres.
const WALK: usize = 16;

/// The closer pixel and the direction of the pair.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    pub width: usize,
    pub height: usize,
    pub x: usize,
    pub y: usize,
    pub vertical: bool,
}

/// The crossing that a pair blends at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Crossing<T> {
    /// Distance from the closer pixel's centre towards the other, clamped to [0, 1].
    pub t: T,
    /// The edge's vertices.
    pub vertices: [u32; 2],
    /// Their positions along and across the pair, in pixels from the closer pixel's centre.
    a: Vec2<T>,
    b: Vec2<T>,
    vertical: bool,
}

/// Position of a vertex in pixels from the closer pixel's centre: x along the pair, y across it.
#[inline(always)]
fn place<T: Real>(c: Vec4<T>, v: &View) -> Vec2<T> {
    let r = T::of(0.5) / c.w;
    let x = (c.x + c.w) * r * T::of(v.width as f64) - T::of(v.x as f64 + 0.5);
    let y = (c.w - c.y) * r * T::of(v.height as f64) - T::of(v.y as f64 + 0.5);
    if v.vertical { vec2(y, x) } else { vec2(x, y) }
}

/// Where the surface that starts at the closer pixel ends on the way to the other one (`sign` = direction along the
/// pair): walks from triangle to triangle across inner edges until a silhouette is met.
pub(super) fn find_crossing<T: Real>(
    clip: &[Vec4<T>],
    topology: &Topology<'_>,
    folds: &Folds,
    triangle: usize,
    sign: T,
    view: &View,
) -> Option<Crossing<T>> {
    let (mut current, mut from) = (triangle, NONE);
    for _ in 0..WALK {
        let corners = topology.triangles[current];
        let c = corners.map(|i| clip[i as usize]);
        if c.iter().any(|c| c.w <= T::zero()) {
            return None;
        }
        let q = c.map(|c| place(c, view));
        let (k, t) = exit(&q, sign, |k| from != NONE && topology.neighbour[current][k] == from)?;
        if t.is_nan() || t <= T::of(-MARGIN) || t >= T::of(1.0 + MARGIN) {
            return None;
        }
        if folds.is_silhouette(current, k) {
            let (a, b) = (q[k], q[(k + 1) % 3]);
            if (b.y - a.y).abs() < (b.x - a.x).abs() {
                return None;
            }
            let vertices = [corners[k], corners[(k + 1) % 3]];
            return Some(Crossing {
                t: t.clamp_to(T::zero(), T::one()),
                vertices,
                a,
                b,
                vertical: view.vertical,
            });
        }
        from = current as u32;
        current = match topology.neighbour[current][k] {
            NONE => return None,
            next => next as usize,
        };
    }
    None
}

/// The edge through which the line between the centres leaves a triangle, and where.
#[inline(always)]
fn exit<T: Real>(q: &[Vec2<T>; 3], sign: T, is_entry: impl Fn(usize) -> bool) -> Option<(usize, T)> {
    let mut best = None;
    for k in 0..3 {
        let (a, b) = (q[k], q[(k + 1) % 3]);
        if (a.y < T::zero()) == (b.y < T::zero()) || is_entry(k) {
            continue;
        }
        let t = sign * (a.x - a.y * (b.x - a.x) / (b.y - a.y));
        if best.is_none_or(|(_, o)| t > o) {
            best = Some((k, t));
        }
    }
    best
}

impl<T: Real> Crossing<T> {
    /// Adjoint of the crossing's signed position `X = x1 - y1 (x2-x1)/(y2-y1)`.
    pub(super) fn vjp(&self, g: T, clip: &[Vec4<T>], width: usize, height: usize, g_clip: &mut [Vec4<T>]) {
        let (a, b) = (self.a, self.b);
        let d = b.y - a.y;
        let r = T::one() / d;
        let x = a.x - a.y * (b.x - a.x) * r;
        let (ga, gb) = (vec2(b.y * r * g, (x - b.x) * r * g), vec2(-a.y * r * g, -(x - a.x) * r * g));
        for (i, gp) in self.vertices.into_iter().zip([ga, gb]) {
            let (gx, gy) = if self.vertical { (gp.y, gp.x) } else { (gp.x, gp.y) };
            pixel_to_clip_vjp(clip[i as usize], gx, gy, width, height, &mut g_clip[i as usize]);
        }
    }
}
