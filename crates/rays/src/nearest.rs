//! The closest point of a mesh.

use super::Accel;
use super::stack::{Stack, entry, parts};
use super::wide::{LEAF, Lanes};
use glam::{Vec3, Vec4};
use photofit_scalar::Vec3f;

/// The closest point of a mesh to a query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearestPoint {
    /// Distance to the query, in the asset's units.
    pub distance: f32,
    /// Index of the triangle.
    pub triangle: u32,
    /// Barycentric weight of the second vertex.
    pub u: f32,
    /// Barycentric weight of the third vertex.
    pub v: f32,
}

impl Accel {
    /// The closest point within `max_distance` (inclusive; may be infinite) of `p`.
    ///
    /// Two triangles at the same distance: the one with the lower index.
    pub fn closest_point(&self, p: Vec3f, max_distance: f32) -> Option<NearestPoint> {
        self.closest_point_where(p, max_distance, |_| true)
    }

    /// The closest point whose triangle (and place on it) `accept` lets pass.
    ///
    /// `accept` sees candidates in no particular order, and some of them only.
    #[inline]
    pub fn closest_point_where(
        &self,
        p: Vec3f,
        max_distance: f32,
        mut accept: impl FnMut(&NearestPoint) -> bool,
    ) -> Option<NearestPoint> {
        let q = self.local(p);
        // Squares must not overflow; farther queries are answered as if nothing were near.
        if self.nodes.is_empty() || !q.is_finite() || q.abs().max_element() > 1e18 || max_distance.is_nan() {
            return None;
        }
        let back = self.back;
        let reach = (max_distance * self.scale as f32).clamp(-1.0, 1e19);
        if reach < 0.0 {
            return None;
        }
        let mut limit = reach * reach;
        let mut best: Option<(f32, NearestPoint)> = None;
        let lanes = [Vec4::splat(q.x), Vec4::splat(q.y), Vec4::splat(q.z)];
        let mut stack = Stack::new();
        stack.set(0, entry(0, 0.0));
        let mut len = 1;
        while let Some((top, below)) = stack.pop(len) {
            len = below;
            let (at, lower) = parts(top);
            // Rounding of the two ways to compute a distance.
            let reachable = limit * (1.0 + 8.0 * f32::EPSILON);
            if lower > reachable {
                continue;
            }
            if at & LEAF == 0 {
                let node = &self.nodes[at as usize];
                let mut squares = [Vec4::ZERO; 2];
                let mut mask = 0;
                for half in 0..2 {
                    for k in 0..3 {
                        let [lo, hi] = node.planes[k].map(|p| p.0[half]);
                        let d = (lo - lanes[k]).max(lanes[k] - hi).max(Vec4::ZERO);
                        squares[half] += d * d;
                    }
                    mask |= squares[half].cmple(Vec4::splat(reachable)).bitmask() << (4 * half);
                }
                let squares = Lanes(squares).to_array();
                let bottom = stack.reserve(len);
                len = bottom;
                while mask != 0 {
                    let lane = mask.trailing_zeros() as usize;
                    mask &= mask - 1;
                    stack.insert(bottom, len, entry(node.child[lane], squares[lane]));
                    len += 1;
                }
                continue;
            }
            let packet = &self.packets[(at & !LEAF) as usize];
            for lane in 0..packet.count() {
                let (square, u, v) = on_triangle(q, packet.triangle(lane));
                let triangle = packet.ids[lane];
                let nearer =
                    square < limit || (square <= limit && best.is_none_or(|(_, b)| triangle < b.triangle));
                let candidate = NearestPoint { distance: square.sqrt() * back, triangle, u, v };
                if nearer && accept(&candidate) {
                    limit = square;
                    best = Some((square, candidate));
                }
            }
        }
        best.map(|(_, nearest)| nearest)
    }
}

/// Squared distance and barycentric weights `(u, v)` of the point of a triangle closest to `p`.
///
/// Regions after Ericson 2005, "Real-Time Collision Detection", 5.1.5, with every quotient guarded, so that triangles
/// without area answer as the segments or points that they are.
fn on_triangle(p: Vec3, [a, b, c]: [Vec3; 3]) -> (f32, f32, f32) {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    let at = |u: f32, v: f32| ((ap - ab * u - ac * v).length_squared(), u, v);
    if d1 <= 0.0 && d2 <= 0.0 {
        return at(0.0, 0.0);
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return at(1.0, 0.0);
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return at(0.0, 1.0);
    }
    let (va, vb, vc) = (d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
    let inside = va > 0.0 && vb > 0.0 && vc > 0.0;
    // Squared double area. For slivers the three signs are noise, the edges below are not.
    let area = va + vb + vc;
    if inside && area > 1e-6 * ab.length_squared() * ac.length_squared() {
        return at(vb / area, vc / area);
    }
    let along = |num: f32, den: f32| if den > 0.0 { (num / den).clamp(0.0, 1.0) } else { 0.0 };
    let s = along(d1, ab.length_squared());
    let t = along(d2, ac.length_squared());
    let bc = c - b;
    let r = along(bc.dot(bp), bc.length_squared());
    let mut best = at(s, 0.0);
    for other in [at(0.0, t), at(1.0 - r, r)] {
        if other.0 < best.0 {
            best = other;
        }
    }
    best
}
