//! Triangles joined across welded, manifold, consistently oriented edges, with their flat rest shapes.

use super::AtlasError;
use photofit_scalar::{Vec2, Vec3, Vec3f, vec2, vec3};
use std::collections::HashMap;

pub(super) use crate::NONE;

/// A triangle whose height is below this fraction of its longest edge counts as degenerate.
const DEGENERATE_HEIGHT: f64 = 1e-6;

/// A triangle laid into the plane: corners `(0, 0)`, `(x1, 0)`, `(x2, y2)` with `x1, y2 > 0`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rest {
    pub(super) x1: f64,
    pub(super) x2: f64,
    pub(super) y2: f64,
}

impl Rest {
    #[inline]
    pub(super) fn area(self) -> f64 {
        0.5 * self.x1 * self.y2
    }

    /// Gradients of the three hat functions.
    #[inline]
    pub(super) fn gradients(self) -> [Vec2<f64>; 3] {
        let r = 1.0 / (self.x1 * self.y2);
        [vec2(-self.y2 * r, (self.x2 - self.x1) * r), vec2(self.y2 * r, -self.x2 * r), vec2(0.0, self.x1 * r)]
    }

    fn new(p: [Vec3<f64>; 3]) -> Option<Self> {
        let (a, b) = (p[1] - p[0], p[2] - p[0]);
        let longest = a.length().max(b.length()).max((b - a).length());
        let cross = a.cross(b).length();
        let x1 = a.length();
        if longest < 1e-9 || cross < DEGENERATE_HEIGHT * longest * longest || x1 < 1e-12 {
            return None;
        }
        Some(Self { x1, x2: a.dot(b) / x1, y2: cross / x1 })
    }
}

/// The mesh as the chart maker sees it, in a box of longest side 1 around the origin.
pub(super) struct Topology {
    /// Welded vertices of each triangle.
    pub(super) vertex: Vec<[u32; 3]>,
    /// Half-edge `3 t + e` (corner `e` to corner `e + 1`) to its partner, or [`NONE`].
    pub(super) opposite: Vec<u32>,
    /// Rest shape of each triangle (zero where degenerate).
    pub(super) rest: Vec<Rest>,
    /// Unit normal of each triangle (zero where degenerate).
    pub(super) normal: Vec<Vec3<f64>>,
    /// Triangles without a usable area.
    pub(super) degenerate: Vec<bool>,
    /// Position of each welded vertex.
    pub(super) position: Vec<Vec3<f64>>,
    /// Units of this frame per unit of the asset.
    pub(super) scale: f64,
    /// Area weight of each triangle: importance, clamped.
    pub(super) weight: Vec<f64>,
}

impl Topology {
    pub(super) fn new(
        positions: &[Vec3f],
        triangles: &[[u32; 3]],
        group: &[u32],
        weight: Vec<f64>,
    ) -> Result<Self, AtlasError> {
        let (vertex, mut position) = weld(positions, triangles)?;
        let scale = normalise(&mut position);
        let count = triangles.len();
        let mut rest = vec![Rest::default(); count];
        let mut normal = vec![Vec3::zero(); count];
        let mut degenerate = vec![true; count];
        for (t, v) in vertex.iter().enumerate() {
            let p = v.map(|i| position[i as usize]);
            if let Some(r) = Rest::new(p) {
                rest[t] = r;
                normal[t] = (p[1] - p[0]).cross(p[2] - p[0]).normalize_or_zero();
                degenerate[t] = false;
            }
        }
        let opposite = pair_edges(&vertex, group, &normal, &degenerate);
        Ok(Self { vertex, opposite, rest, normal, degenerate, position, scale, weight })
    }

    #[inline]
    pub(super) fn corner(&self, t: u32, k: usize) -> Vec3<f64> {
        self.position[self.vertex[t as usize][k] as usize]
    }

    #[inline]
    pub(super) fn area(&self, t: u32) -> f64 {
        self.rest[t as usize].area()
    }

    pub(super) fn centroid(&self, t: u32) -> Vec3<f64> {
        (self.corner(t, 0) + self.corner(t, 1) + self.corner(t, 2)) * (1.0 / 3.0)
    }

    /// Length of half-edge `h`.
    #[inline]
    pub(super) fn length(&self, h: u32) -> f64 {
        let (t, e) = (h / 3, (h % 3) as usize);
        (self.corner(t, (e + 1) % 3) - self.corner(t, e)).length()
    }

    /// Cosine of the angle between the normals on both sides of half-edge `h` (which has a partner).
    #[inline]
    pub(super) fn crease(&self, h: u32) -> f64 {
        let o = self.opposite[h as usize];
        self.normal[(h / 3) as usize].dot(self.normal[(o / 3) as usize])
    }
}

/// Welded vertices of each triangle, and their positions.
type Welded = (Vec<[u32; 3]>, Vec<Vec3<f64>>);

/// Joins vertices of equal position; returns the welded corners and the welded positions.
fn weld(positions: &[Vec3f], triangles: &[[u32; 3]]) -> Result<Welded, AtlasError> {
    let mut welded = vec![NONE; positions.len()];
    let mut known: HashMap<[u32; 3], u32> = HashMap::with_capacity(positions.len());
    let mut out = Vec::new();
    let mut corners = Vec::with_capacity(triangles.len());
    for (t, tri) in triangles.iter().enumerate() {
        let mut c = [0; 3];
        for k in 0..3 {
            let i = tri[k] as usize;
            let p = *positions.get(i).ok_or(AtlasError::Index { triangle: t, vertex: tri[k] })?;
            if welded[i] == NONE {
                if !p.is_finite() {
                    return Err(AtlasError::Position { vertex: i });
                }
                // Adding zero turns -0 into +0.
                let key = (p + Vec3f::zero()).to_array().map(f32::to_bits);
                welded[i] = *known.entry(key).or_insert_with(|| {
                    out.push(p.cast());
                    out.len() as u32 - 1
                });
            }
            c[k] = welded[i];
        }
        corners.push(c);
    }
    Ok((corners, out))
}

/// Moves the points into a box of longest side 1 around the origin; returns the factor.
fn normalise(points: &mut [Vec3<f64>]) -> f64 {
    let Some(&first) = points.first() else { return 1.0 };
    let (lo, hi) = points.iter().fold((first, first), |(lo, hi), &p| (lo.min(p), hi.max(p)));
    let size = hi - lo;
    let longest = size.x.max(size.y).max(size.z);
    let scale = if longest > 0.0 { 1.0 / longest } else { 1.0 };
    let middle = (lo + hi) * 0.5;
    for p in points.iter_mut() {
        *p = (*p - middle) * scale;
    }
    scale
}

/// Finds the partner of every half-edge. An edge with more than two sides is paired by the smallest fold.
fn pair_edges(vertex: &[[u32; 3]], group: &[u32], normal: &[Vec3<f64>], degenerate: &[bool]) -> Vec<u32> {
    let mut edges: Vec<(u32, u32, u32, bool, u32)> = Vec::with_capacity(vertex.len() * 3);
    for (t, v) in vertex.iter().enumerate() {
        if degenerate[t] {
            continue;
        }
        for e in 0..3 {
            let (a, b) = (v[e], v[(e + 1) % 3]);
            edges.push((a.min(b), a.max(b), group[t], a > b, (3 * t + e) as u32));
        }
    }
    edges.sort_unstable();
    let mut opposite = vec![NONE; vertex.len() * 3];
    for run in edges.chunk_by(|x, y| (x.0, x.1, x.2) == (y.0, y.1, y.2)) {
        let split = run.partition_point(|x| !x.3);
        let (forward, backward) = run.split_at(split);
        if forward.len() == 1 && backward.len() == 1 {
            join(&mut opposite, forward[0].4, backward[0].4);
        } else if run.len() <= 32 {
            pair_smallest_fold(&mut opposite, forward, backward, normal);
        }
    }
    opposite
}

fn join(opposite: &mut [u32], a: u32, b: u32) {
    opposite[a as usize] = b;
    opposite[b as usize] = a;
}

fn pair_smallest_fold(
    opposite: &mut [u32],
    forward: &[(u32, u32, u32, bool, u32)],
    backward: &[(u32, u32, u32, bool, u32)],
    normal: &[Vec3<f64>],
) {
    let side = |h: u32| normal[(h / 3) as usize];
    let mut pairs: Vec<(f64, u32, u32)> =
        forward.iter().flat_map(|f| backward.iter().map(|b| (-side(f.4).dot(side(b.4)), f.4, b.4))).collect();
    pairs.sort_unstable_by(|x, y| x.0.total_cmp(&y.0).then((x.1, x.2).cmp(&(y.1, y.2))));
    for (_, f, b) in pairs {
        if opposite[f as usize] == NONE && opposite[b as usize] == NONE {
            join(opposite, f, b);
        }
    }
}

/// True for numbers above zero, false for NaN.
#[inline]
pub(super) fn positive(x: f64) -> bool {
    x > 0.0
}

/// Twice the signed area of a plane triangle.
#[inline]
pub(super) fn cross2(a: Vec2<f64>, b: Vec2<f64>, c: Vec2<f64>) -> f64 {
    (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)
}

/// An orthonormal right-handed frame around `n`; `n` may be zero.
pub(super) fn frame(n: Vec3<f64>) -> (Vec3<f64>, Vec3<f64>) {
    let n = n.normalize_or_zero();
    if n == Vec3::zero() { (vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0)) } else { n.orthonormal_pair() }
}
