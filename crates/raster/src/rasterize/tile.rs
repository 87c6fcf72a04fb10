//! One tile: edge functions over the pixel centres of a small block.

use super::NONE;
use super::bins::Bins;
use photofit_scalar::Vec4f;

/// Width and height of a tile in pixels.
pub const TILE: usize = 32;
const AREA: usize = TILE * TILE;

/// A block of at most [`TILE`] x [`TILE`] pixels with the triangles that may touch it.
#[derive(Clone, Copy, Debug)]
pub struct Tile<'a> {
    /// First column.
    pub x: usize,
    /// First row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    pub(super) image: (usize, usize),
    pub(super) bins: &'a Bins,
}

/// Ids and depths of one tile, [`TILE`] to a row.
#[derive(Clone, Debug)]
pub struct Layer {
    /// Triangle index or [`NONE`].
    pub triangle: [u32; AREA],
    /// z/w in [0, 1].
    pub depth: [f32; AREA],
}

impl Default for Layer {
    fn default() -> Self {
        Self { triangle: [NONE; AREA], depth: [1.0; AREA] }
    }
}

impl Layer {
    /// Copies a tile out of rows of an image that start at the tile's first row.
    pub fn load(&mut self, tile: &Tile<'_>, triangle: &[u32], depth: &[f32], stride: usize) {
        for y in 0..tile.height {
            let at = y * stride + tile.x;
            self.triangle[y * TILE..][..tile.width].copy_from_slice(&triangle[at..at + tile.width]);
            self.depth[y * TILE..][..tile.width].copy_from_slice(&depth[at..at + tile.width]);
        }
    }

    /// Copies a tile into rows of an image that start at the tile's first row.
    pub fn store(&self, tile: &Tile<'_>, triangle: &mut [u32], depth: &mut [f32], stride: usize) {
        for y in 0..tile.height {
            let at = y * stride + tile.x;
            triangle[at..at + tile.width].copy_from_slice(&self.triangle[y * TILE..][..tile.width]);
            depth[at..at + tile.width].copy_from_slice(&self.depth[y * TILE..][..tile.width]);
        }
    }
}

/// Edge and depth functions of a triangle relative to the centre of a tile's first pixel.
struct Setup {
    /// `a*x + b*y + c >= 0` inside, one per edge.
    edge: [[f32; 3]; 3],
    /// Whether a zero of the edge function belongs to this triangle.
    owns: [bool; 3],
    /// z/w as a function of x and y.
    depth: [f32; 3],
    /// Inclusive pixel range within the tile.
    range: [usize; 4],
}

impl Tile<'_> {
    /// Whether no triangle may touch this tile.
    pub fn is_empty(&self) -> bool {
        self.bins.triangles(self.x, self.y).next().is_none()
    }

    /// Fills `out` with the nearest triangles (strictly behind `front` if given).
    ///
    /// # Panics
    /// If an index is out of range.
    pub fn rasterize(&self, clip: &[Vec4f], triangles: &[[u32; 3]], front: Option<&Layer>, out: &mut Layer) {
        out.triangle.fill(NONE);
        out.depth.fill(1.0);
        for id in self.bins.triangles(self.x, self.y) {
            let p = triangles[id as usize].map(|i| clip[i as usize]);
            let Some(s) = self.setup(p) else { continue };
            match front {
                None => s.draw(id, out, |_, _| true),
                Some(f) => s.draw(id, out, |i, z| {
                    f.triangle[i] != NONE && (z > f.depth[i] || (z == f.depth[i] && id > f.triangle[i]))
                }),
            }
        }
    }

    fn setup(&self, p: [Vec4f; 3]) -> Option<Setup> {
        let (w, h) = (self.image.0 as f64, self.image.1 as f64);
        // Homogeneous pixel coordinates, as seen from the centre of the tile's first pixel.
        let (ox, oy) = (self.x as f64 + 0.5, self.y as f64 + 0.5);
        let q = p.map(|v| {
            let (x, y, vw) = (f64::from(v.x), f64::from(v.y), f64::from(v.w));
            [(x + vw) * 0.5 * w, (vw - y) * 0.5 * h, vw]
        });
        let line = |i: usize, j: usize| {
            let (s, t) = (q[i], q[j]);
            let a = t[2] * s[1] - s[2] * t[1];
            let b = t[0] * s[2] - s[0] * t[2];
            let c = s[0] * t[1] - t[0] * s[1];
            [a, b, (a * ox + b * oy) + c]
        };
        let mut e = [line(1, 2), line(2, 0), line(0, 1)];
        let det = e[0][2] * q[0][2] + e[1][2] * q[1][2] + e[2][2] * q[2][2];
        if det == 0.0 || !det.is_finite() {
            return None;
        }
        if det < 0.0 {
            e.iter_mut().flatten().for_each(|x| *x = -*x);
        }
        let r = 1.0 / det.abs();
        let depth = [0, 1, 2].map(|k| ((0..3).map(|i| e[i][k] * f64::from(p[i].z)).sum::<f64>() * r) as f32);
        Some(Setup {
            edge: e.map(|l| l.map(|x| x as f32)),
            owns: e.map(|l| l[0] > 0.0 || (l[0] == 0.0 && l[1] > 0.0)),
            depth,
            range: self.range(&q)?,
        })
    }

    /// Pixels of the tile inside the box around a triangle, inclusive.
    fn range(&self, q: &[[f64; 3]; 3]) -> Option<[usize; 4]> {
        let mut r = [0, 0, self.width - 1, self.height - 1];
        if q.iter().all(|v| v[2] > 0.0) {
            let first = [self.x as f64, self.y as f64];
            for k in 0..2 {
                let v = q.map(|v| v[k] / v[2]);
                let lo = (v[0].min(v[1]).min(v[2]) - 0.501 - first[k]).ceil();
                let hi = (v[0].max(v[1]).max(v[2]) - 0.499 - first[k]).floor();
                if !(lo <= r[k + 2] as f64 && hi >= 0.0 && lo <= hi) {
                    return None;
                }
                r[k] = lo.max(0.0) as usize;
                r[k + 2] = hi.min(r[k + 2] as f64) as usize;
            }
        }
        Some(r)
    }
}

impl Setup {
    #[inline(always)]
    fn draw(&self, id: u32, out: &mut Layer, accept: impl Fn(usize, f32) -> bool) {
        let [e0, e1, e2] = self.edge;
        for y in self.range[1]..=self.range[3] {
            let fy = y as f32;
            // Products before sums, in the same order for every triangle: a shared edge stays exactly antisymmetric.
            let row = [e0[1] * fy, e1[1] * fy, e2[1] * fy, self.depth[1] * fy];
            for x in self.range[0]..=self.range[2] {
                let fx = x as f32;
                let a = (e0[0] * fx + row[0]) + e0[2];
                let b = (e1[0] * fx + row[1]) + e1[2];
                let c = (e2[0] * fx + row[2]) + e2[2];
                let inside = (a > 0.0 || (a == 0.0 && self.owns[0]))
                    && (b > 0.0 || (b == 0.0 && self.owns[1]))
                    && (c > 0.0 || (c == 0.0 && self.owns[2]));
                if !inside {
                    continue;
                }
                let z = (self.depth[0] * fx + row[3]) + self.depth[2];
                let i = y * TILE + x;
                if (0.0..=1.0).contains(&z) && (z < out.depth[i] || out.triangle[i] == NONE) && accept(i, z) {
                    out.depth[i] = z;
                    out.triangle[i] = id;
                }
            }
        }
    }
}
