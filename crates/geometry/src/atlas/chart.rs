//! One chart: triangles sewn along chosen edges, its local vertices, and the measures of its plane map.

use super::topology::{NONE, Topology, cross2, positive};
use photofit_scalar::{Vec2, vec2};

/// A directed boundary edge of a chart.
#[derive(Clone, Copy, Debug)]
pub(super) struct Border {
    /// The half-edge.
    pub(super) half_edge: u32,
    /// Local vertex at its start.
    pub(super) from: u32,
    /// Local vertex at its end.
    pub(super) to: u32,
}

/// A set of triangles with one plane position per local vertex.
#[derive(Clone, Debug, Default)]
pub(super) struct Chart {
    pub(super) triangles: Vec<u32>,
    /// Local vertices of each triangle.
    pub(super) corners: Vec<[u32; 3]>,
    pub(super) uv: Vec<Vec2<f64>>,
    pub(super) border: Vec<Border>,
    /// Surface area.
    pub(super) area: f64,
    /// Area times importance.
    pub(super) weighted: f64,
}

/// How much of its surroundings a chart fills.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fill {
    /// Part of the least rectangle.
    pub(super) rectangle: f64,
    /// Part of the convex hull.
    pub(super) hull: f64,
    /// Longer side of the least rectangle.
    pub(super) long: f64,
}

impl Fill {
    /// Largest useful length, against the root of the area of all charts.
    pub(super) fn max_length(&self) -> f64 {
        if self.rectangle >= 0.9 { 1.25 } else { 0.75 }
    }
}

/// Reusable map from triangles to places in a chart.
pub(super) struct Places(Vec<u32>);

impl Places {
    pub(super) fn new(triangles: usize) -> Self {
        Self(vec![NONE; triangles])
    }
}

impl Chart {
    /// Builds the local vertices of `triangles`, which hang together across the half-edges marked in `sewn`.
    /// The plane positions are zero.
    pub(super) fn build(topo: &Topology, triangles: Vec<u32>, sewn: &[bool], places: &mut Places) -> Self {
        for (i, &t) in triangles.iter().enumerate() {
            places.0[t as usize] = i as u32;
        }
        let mut corners = vec![[NONE; 3]; triangles.len()];
        let mut count = 0;
        let partner = |h: u32| if sewn[h as usize] { topo.opposite[h as usize] } else { NONE };
        for i in 0..triangles.len() {
            for k in 0..3 {
                if corners[i][k] != NONE {
                    continue;
                }
                let start = 3 * triangles[i] + k as u32;
                let (mut at, mut open) = (start, false);
                // Turn one way until the fan closes or ends, then the other way from the start.
                loop {
                    corners[places.0[(at / 3) as usize] as usize][(at % 3) as usize] = count;
                    let o = partner(3 * (at / 3) + (at % 3 + 2) % 3);
                    if o == NONE {
                        open = true;
                        break;
                    }
                    at = o;
                    if at == start {
                        break;
                    }
                }
                at = start;
                while open {
                    let o = partner(at);
                    open = o != NONE;
                    if !open {
                        break;
                    }
                    at = 3 * (o / 3) + (o % 3 + 1) % 3;
                    corners[places.0[(at / 3) as usize] as usize][(at % 3) as usize] = count;
                }
                count += 1;
            }
        }
        let mut border = Vec::new();
        for (i, &t) in triangles.iter().enumerate() {
            places.0[t as usize] = NONE;
            for e in 0..3 {
                let h = 3 * t + e as u32;
                if !sewn[h as usize] {
                    border.push(Border { half_edge: h, from: corners[i][e], to: corners[i][(e + 1) % 3] });
                }
            }
        }
        let area = triangles.iter().map(|&t| topo.area(t)).sum();
        let weighted = triangles.iter().map(|&t| topo.area(t) * topo.weight[t as usize]).sum();
        Self { corners, uv: vec![Vec2::zero(); count as usize], border, area, weighted, triangles }
    }

    /// Jacobian rows of triangle `i`: the map from its rest shape to the plane, columns `d/dx` and `d/dy`.
    #[inline]
    pub(super) fn jacobian(&self, topo: &Topology, i: usize) -> (Vec2<f64>, Vec2<f64>) {
        let g = topo.rest[self.triangles[i] as usize].gradients();
        let u = self.corners[i].map(|v| self.uv[v as usize]);
        (u[0] * g[0].x + u[1] * g[1].x + u[2] * g[2].x, u[0] * g[0].y + u[1] * g[1].y + u[2] * g[2].y)
    }

    /// Plane area of the chart.
    pub(super) fn uv_area(&self) -> f64 {
        self.corners.iter().map(|c| 0.5 * cross2(self.at(c[0]), self.at(c[1]), self.at(c[2]))).sum()
    }

    #[inline]
    fn at(&self, v: u32) -> Vec2<f64> {
        self.uv[v as usize]
    }

    /// Scales the plane map so that its area equals the surface area.
    pub(super) fn rescale(&mut self) {
        let area = self.uv_area();
        if area > 0.0 && self.area > 0.0 {
            let s = (self.area / area).sqrt();
            self.uv.iter_mut().for_each(|p| *p *= s);
        }
    }

    /// Largest `max(s1, 1/s2)` over the triangles, `s1 >= s2` the singular values of the map; infinite where a
    /// triangle is flipped or collapsed.
    pub(super) fn worst_stretch(&self, topo: &Topology) -> f64 {
        let mut worst: f64 = 1.0;
        for i in 0..self.triangles.len() {
            let (s1, s2) = singular(self.jacobian(topo, i));
            if !positive(s2) {
                return f64::INFINITY;
            }
            worst = worst.max(s1).max(1.0 / s2);
        }
        worst
    }

    /// Number of triangles whose plane area is not positive.
    pub(super) fn flips(&self) -> usize {
        self.corners.iter().filter(|c| !positive(cross2(self.at(c[0]), self.at(c[1]), self.at(c[2])))).count()
    }

    /// Perimeter on the surface.
    pub(super) fn perimeter(&self, topo: &Topology) -> f64 {
        self.border.iter().map(|b| topo.length(b.half_edge)).sum()
    }

    /// How much of its surroundings the plane map fills.
    pub(super) fn fill(&self) -> Fill {
        let hull = hull(&self.uv);
        let area = self.uv_area();
        let hull_area: f64 =
            (1..hull.len().max(1) - 1).map(|i| 0.5 * cross2(hull[0], hull[i], hull[i + 1])).sum();
        let size = Self { uv: hull, ..Self::default() }.align();
        Fill {
            rectangle: area / (size.x * size.y).max(1e-300),
            hull: area / hull_area.max(1e-300),
            long: size.x,
        }
    }

    /// Turns the map so that the rectangle of least area around it lies along the axes, longer side along x, its
    /// lower corner at the origin. Returns the sides.
    pub(super) fn align(&mut self) -> Vec2<f64> {
        let (c, s) = least_rectangle(&self.uv);
        for p in &mut self.uv {
            *p = vec2(p.x * c + p.y * s, p.y * c - p.x * s);
        }
        let (mut lo, mut hi) = bounds(&self.uv);
        if hi.y - lo.y > hi.x - lo.x {
            for p in &mut self.uv {
                *p = vec2(p.y, -p.x);
            }
            (lo, hi) = bounds(&self.uv);
        }
        for p in &mut self.uv {
            *p -= lo;
        }
        hi - lo
    }
}

/// Singular values, larger first; the smaller one is negative for a reflection.
#[inline]
pub(super) fn singular((a, b): (Vec2<f64>, Vec2<f64>)) -> (f64, f64) {
    let f = a.length_squared() + b.length_squared();
    let d = a.x * b.y - a.y * b.x;
    let (p, q) = ((f + 2.0 * d).max(0.0).sqrt(), (f - 2.0 * d).max(0.0).sqrt());
    (0.5 * (p + q), 0.5 * (p - q))
}

/// Smallest axis-aligned box of the points; zero without points.
pub(super) fn bounds(points: &[Vec2<f64>]) -> (Vec2<f64>, Vec2<f64>) {
    let first = points.first().copied().unwrap_or_default();
    points.iter().fold((first, first), |(lo, hi), &p| (lo.min(p), hi.max(p)))
}

/// Convex hull, counter-clockwise (Andrew's monotone chain).
fn hull(points: &[Vec2<f64>]) -> Vec<Vec2<f64>> {
    let mut p = points.to_vec();
    p.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    p.dedup();
    if p.len() < 3 {
        return p;
    }
    let mut out: Vec<Vec2<f64>> = Vec::with_capacity(p.len());
    for pass in 0..2 {
        let floor = out.len() + 1;
        let next = |out: &mut Vec<Vec2<f64>>, q: Vec2<f64>| {
            while out.len() > floor && cross2(out[out.len() - 2], out[out.len() - 1], q) <= 0.0 {
                out.pop();
            }
            out.push(q);
        };
        if pass == 0 {
            p.iter().for_each(|&q| next(&mut out, q));
        } else {
            p.iter().rev().for_each(|&q| next(&mut out, q));
        }
        out.pop();
    }
    out
}

/// Direction (cosine, sine) of one side of the least-area rectangle around the points.
fn least_rectangle(points: &[Vec2<f64>]) -> (f64, f64) {
    let hull = hull(points);
    let n = hull.len();
    let mut best = (f64::INFINITY, (1.0, 0.0));
    if n < 3 {
        if n == 2 {
            let d = (hull[1] - hull[0]).normalize_or_zero();
            return (d.x, d.y);
        }
        return best.1;
    }
    // Rotating calipers: the extreme points only move forward.
    let (mut right, mut top, mut left) = (1, 1, 1);
    for i in 0..n {
        let d = (hull[(i + 1) % n] - hull[i]).normalize_or_zero();
        if d == Vec2::zero() {
            continue;
        }
        let along = |k: usize| d.dot(hull[k % n]);
        let up = |k: usize| d.x * hull[k % n].y - d.y * hull[k % n].x;
        let limit = i + 2 * n;
        right = right.max(i + 1);
        while right < limit && along(right + 1) > along(right) {
            right += 1;
        }
        top = top.max(right);
        while top < limit && up(top + 1) > up(top) {
            top += 1;
        }
        left = left.max(top);
        while left < limit && along(left + 1) < along(left) {
            left += 1;
        }
        let area = (along(right) - along(left)) * (up(top) - up(i));
        if area < best.0 {
            best = (area, (d.x, d.y));
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn least_rectangle_of_a_turned_box_is_the_box() {
        for angle in [0.0, 0.3, 1.2, 2.9, -2.0_f64] {
            let (s, c) = angle.sin_cos();
            let points = [(0.0, 0.0), (3.0, 0.0), (3.0, 1.0), (0.0, 1.0), (1.5, 0.4), (1.5, 1.0)];
            let uv = points.map(|(x, y): (f64, f64)| vec2(x * c - y * s + 5.0, x * s + y * c - 2.0)).to_vec();
            let size = Chart { uv, ..Chart::default() }.align();
            assert!((size - vec2(3.0, 1.0)).length() < 1e-9, "{angle}: {size:?}");
        }
    }

    #[test]
    fn singular_values_of_a_known_map() {
        let (s1, s2) = singular((vec2(0.0, 3.0), vec2(-2.0, 0.0)));
        assert!((s1 - 3.0).abs() < 1e-12 && (s2 - 2.0).abs() < 1e-12, "{s1} {s2}");
        assert!(singular((vec2(1.0, 0.0), vec2(0.0, -1.0))).1 < 0.0, "a reflection has a negative value");
    }
}
