//! Which triangle owns each texel, and where in it the texel's centre lies.

use photofit_scalar::{Vec2, Vec2f, vec2};
use rayon::prelude::*;
use std::ops::Range;

/// Rows that one task rasterises.
const BAND: usize = 32;

/// Owners of the texels of an image, row 0 at the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Coverage {
    /// Width in texels.
    pub width: usize,
    /// Height in texels.
    pub height: usize,
    /// Triangle of each texel, row by row; `u32::MAX` where none.
    pub triangle: Vec<u32>,
    /// Weights of the three corners at the texel's centre, or at the point of the triangle nearest to it; zero
    /// where no triangle owns the texel.
    pub barycentric: Vec<[f32; 3]>,
}

impl Coverage {
    /// True for texels with an owner.
    pub fn mask(&self) -> Vec<bool> {
        self.triangle.iter().map(|&t| t != u32::MAX).collect()
    }
}

/// Rasterises triangles given by their corner uvs (unit square, origin upper left) into `width x height` texels.
///
/// A texel belongs to the triangle that holds its centre; where several do, to the first. With `conservative`, a
/// texel whose centre lies in no triangle but whose square touches one belongs to the triangle nearest to its
/// centre, with the weights of the nearest point. Triangles without area own texels only in that second way. Parts
/// outside the unit square and triangles with uvs that are not finite are left out.
pub fn coverage(corner_uv: &[[Vec2f; 3]], width: usize, height: usize, conservative: bool) -> Coverage {
    let mut out = Coverage {
        width,
        height,
        triangle: vec![u32::MAX; width * height],
        barycentric: vec![[0.0; 3]; width * height],
    };
    if width == 0 || height == 0 {
        return out;
    }
    let bands = height.div_ceil(BAND);
    let mut lists = vec![Vec::new(); bands];
    let texels = |p: Vec2f| vec2(f64::from(p.x) * width as f64, f64::from(p.y) * height as f64);
    for (t, c) in corner_uv.iter().enumerate() {
        if !c.iter().all(|p| p.is_finite()) {
            continue;
        }
        let p = c.map(texels);
        let low = p[0].y.min(p[1].y).min(p[2].y);
        let high = p[0].y.max(p[1].y).max(p[2].y);
        if high < 0.0 || low > height as f64 {
            continue;
        }
        let first = ((low - 1.0).max(0.0) as usize / BAND).min(bands - 1);
        let last = ((high + 1.0) as usize / BAND).min(bands - 1);
        lists[first..=last].iter_mut().for_each(|l| l.push((t as u32, p)));
    }
    out.triangle
        .par_chunks_mut(BAND * width)
        .zip(out.barycentric.par_chunks_mut(BAND * width))
        .zip(&lists)
        .enumerate()
        .for_each(|(band, ((triangle, barycentric), list))| {
            let mut rows = Rows { first: band * BAND, width, triangle, barycentric };
            for (t, p) in list {
                rows.centres(*t, p);
            }
            if conservative {
                let mut distance = vec![f64::INFINITY; rows.triangle.len()];
                for (t, p) in list {
                    rows.touched(*t, p, &mut distance);
                }
            }
        });
    out
}

/// [`coverage`] of an indexed mesh.
///
/// # Panics
/// When an index is outside `uvs`.
pub fn mesh_coverage(
    uvs: &[Vec2f],
    triangles: &[[u32; 3]],
    width: usize,
    height: usize,
    conservative: bool,
) -> Coverage {
    let corners: Vec<[Vec2f; 3]> = triangles.iter().map(|t| t.map(|i| uvs[i as usize])).collect();
    coverage(&corners, width, height, conservative)
}

struct Rows<'a> {
    first: usize,
    width: usize,
    triangle: &'a mut [u32],
    barycentric: &'a mut [[f32; 3]],
}

impl Rows<'_> {
    /// Rows of the band, relative to its first, that the triangle meets.
    fn rows(&self, p: &[Vec2<f64>; 3]) -> Range<usize> {
        let rows = self.triangle.len() / self.width;
        let (lo, hi) = (p[0].y.min(p[1].y).min(p[2].y), p[0].y.max(p[1].y).max(p[2].y));
        let clip = |y: f64| ((y.floor() - self.first as f64).max(0.0) as usize).min(rows);
        clip(lo)..clip(hi + 1.0)
    }

    /// Columns where the triangle meets row `y` of the band.
    fn columns(&self, p: &[Vec2<f64>; 3], y: usize) -> Range<usize> {
        let low = (self.first + y) as f64;
        let (mut from, mut to) = (f64::INFINITY, f64::NEG_INFINITY);
        for k in 0..3 {
            let (a, b) = (p[k], p[(k + 1) % 3]);
            let (a, b) = if a.y <= b.y { (a, b) } else { (b, a) };
            if b.y < low || a.y > low + 1.0 {
                continue;
            }
            let slope = (b.x - a.x) / (b.y - a.y);
            let x0 = if a.y < low { a.x + slope * (low - a.y) } else { a.x };
            let x1 = if b.y > low + 1.0 { a.x + slope * (low + 1.0 - a.y) } else { b.x };
            from = from.min(x0).min(x1);
            to = to.max(x0).max(x1);
        }
        // A little wider, for rounding.
        let clip = |x: f64| (x.floor().max(0.0) as usize).min(self.width);
        clip(from - 1e-6)..clip(to + 1.0 + 1e-6)
    }

    fn centres(&mut self, t: u32, p: &[Vec2<f64>; 3]) {
        let area = cross(p[0], p[1], p[2]);
        if area == 0.0 {
            return;
        }
        let r = 1.0 / area;
        for y in self.rows(p) {
            for x in self.columns(p, y) {
                let c = vec2(x as f64 + 0.5, (self.first + y) as f64 + 0.5);
                let b0 = cross(c, p[1], p[2]) * r;
                let b1 = cross(p[0], c, p[2]) * r;
                let b2 = cross(p[0], p[1], c) * r;
                let at = y * self.width + x;
                if b0 >= 0.0 && b1 >= 0.0 && b2 >= 0.0 && self.triangle[at] == u32::MAX {
                    self.triangle[at] = t;
                    self.barycentric[at] = [b0 as f32, b1 as f32, b2 as f32];
                }
            }
        }
    }

    fn touched(&mut self, t: u32, p: &[Vec2<f64>; 3], distance: &mut [f64]) {
        for y in self.rows(p) {
            for x in self.columns(p, y) {
                let at = y * self.width + x;
                if self.triangle[at] != u32::MAX && distance[at] == f64::INFINITY {
                    continue;
                }
                let c = vec2(x as f64 + 0.5, (self.first + y) as f64 + 0.5);
                let (q, b) = nearest(p, c);
                let d = (q - c).length_squared();
                if d < distance[at] && touches_square(p, c) {
                    distance[at] = d;
                    self.triangle[at] = t;
                    self.barycentric[at] = b.map(|x| x as f32);
                }
            }
        }
    }
}

#[inline]
fn cross(a: Vec2<f64>, b: Vec2<f64>, c: Vec2<f64>) -> f64 {
    (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)
}

/// True when the triangle meets the unit square around `c` (separating axes: its box and the edge normals).
fn touches_square(p: &[Vec2<f64>; 3], c: Vec2<f64>) -> bool {
    let (lo, hi) = (p[0].min(p[1]).min(p[2]), p[0].max(p[1]).max(p[2]));
    if lo.x > c.x + 0.5 || hi.x < c.x - 0.5 || lo.y > c.y + 0.5 || hi.y < c.y - 0.5 {
        return false;
    }
    (0..3).all(|k| {
        let (a, b, o) = (p[k], p[(k + 1) % 3], p[(k + 2) % 3]);
        let n = vec2(a.y - b.y, b.x - a.x);
        let reach = 0.5 * (n.x.abs() + n.y.abs());
        let (s, other) = (n.dot(c - a), n.dot(o - a));
        s + reach >= other.min(0.0) && s - reach <= other.max(0.0)
    })
}

/// Point of the triangle nearest to `c`, with its weights.
fn nearest(p: &[Vec2<f64>; 3], c: Vec2<f64>) -> (Vec2<f64>, [f64; 3]) {
    let mut best = (p[0], [1.0, 0.0, 0.0]);
    let mut distance = f64::INFINITY;
    for k in 0..3 {
        let (a, b) = (p[k], p[(k + 1) % 3]);
        let d = b - a;
        let length = d.length_squared();
        let s = if length > 0.0 { ((c - a).dot(d) / length).clamp(0.0, 1.0) } else { 0.0 };
        let q = a + d * s;
        let l = (q - c).length_squared();
        if l < distance {
            distance = l;
            let mut w = [0.0; 3];
            w[k] = 1.0 - s;
            w[(k + 1) % 3] = s;
            best = (q, w);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centre_weights_reproduce_the_centre() {
        let tri = [[vec2(0.1, 0.05), vec2(0.9, 0.3), vec2(0.2, 0.95)]];
        let c = coverage(&tri, 37, 41, false);
        let mut owned = 0;
        for (i, b) in c.barycentric.iter().enumerate().filter(|x| c.triangle[x.0] == 0) {
            let p = tri[0][0] * b[0] + tri[0][1] * b[1] + tri[0][2] * b[2];
            let want = vec2(((i % 37) as f32 + 0.5) / 37.0, ((i / 37) as f32 + 0.5) / 41.0);
            assert!((p - want).length() < 1e-6, "texel {i}: {p:?} for {want:?}");
            owned += 1;
        }
        // Area of the triangle times the texels.
        let area = 0.5 * (0.8 * 0.9 - 0.25 * 0.1) * 37.0 * 41.0;
        assert!((f64::from(owned) - area).abs() < 20.0, "{owned} texels for an area of {area}");
    }

    #[test]
    fn conservative_adds_touched_texels_with_the_nearest_point() {
        let tri = [[vec2(0.31, 0.31), vec2(0.34, 0.31), vec2(0.31, 0.34)]];
        assert!(coverage(&tri, 10, 10, false).triangle.iter().all(|&t| t == u32::MAX), "no centre inside");
        let c = coverage(&tri, 10, 10, true);
        let owned: Vec<usize> = (0..100).filter(|&i| c.triangle[i] == 0).collect();
        assert_eq!(owned, [33]);
        let b = c.barycentric[33];
        assert!(
            (b[0] + b[1] + b[2] - 1.0).abs() < 1e-6 && b[0].abs() < 1e-6,
            "nearest is on the long side: {b:?}"
        );
    }

    #[test]
    fn shared_edges_are_owned_once_and_without_holes() {
        let (a, b, c, d) = (vec2(0.0, 0.0), vec2(1.0, 0.0), vec2(1.0, 1.0), vec2(0.0, 1.0));
        let cover = coverage(&[[a, b, c], [a, c, d]], 16, 16, false);
        assert!(cover.mask().iter().all(|&m| m), "the square is covered");
        assert_eq!(cover.triangle.iter().filter(|&&t| t == 0).count(), 16 * 17 / 2);
    }

    #[test]
    fn bad_input_owns_nothing() {
        let nan = [[vec2(f32::NAN, 0.0), vec2(1.0, 0.0), vec2(0.0, 1.0)]];
        assert!(coverage(&nan, 4, 4, true).triangle.iter().all(|&t| t == u32::MAX));
        let far = [
            [vec2(5.0, 5.0), vec2(6.0, 5.0), vec2(5.0, 6.0)],
            [vec2(-3.0, -3.0), vec2(-2.0, -3.0), vec2(-3.0, -2.0)],
        ];
        assert!(coverage(&far, 4, 4, true).triangle.iter().all(|&t| t == u32::MAX));
        assert!(coverage(&far, 0, 4, true).triangle.is_empty());
    }
}
