//! One tile: edge functions over the pixel centres of a small block.

use super::NONE;
use super::bins::Bins;
use photofit_scalar::Vec4f;

/// Width and height of a tile in pixels.
pub const TILE: usize = 32;
const AREA: usize = TILE * TILE;
/// The smallest positive number: `x > 0` is `x >= SMALLEST`.
const SMALLEST: f32 = f32::from_bits(1);

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
pub(super) struct Setup {
    /// `a*x + b*y + c >= 0` inside, one per edge.
    pub(super) edge: [[f32; 3]; 3],
    /// Smallest value of the edge function that belongs to this triangle: zero for one of the two triangles at an edge.
    pub(super) limit: [f32; 3],
    /// z/w as a function of x and y.
    pub(super) depth: [f32; 3],
    /// Inclusive pixel range within the tile.
    pub(super) range: [usize; 4],
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
        // An infinite depth stands for "no triangle" while drawing.
        out.depth.fill(f32::INFINITY);
        #[cfg(target_arch = "x86_64")]
        if crate::cpu::has_avx2() {
            #[expect(unsafe_code, reason = "calling a function compiled for AVX2")]
            // SAFETY: the feature was just detected.
            unsafe {
                self.rasterize_avx2(clip, triangles, front, out);
            }
            return out.depth.iter_mut().for_each(|d| *d = d.min(1.0));
        }
        self.for_each_setup(clip, triangles, |id, s| s.draw(id, front, out));
        out.depth.iter_mut().for_each(|d| *d = d.min(1.0));
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn rasterize_avx2(&self, clip: &[Vec4f], triangles: &[[u32; 3]], front: Option<&Layer>, out: &mut Layer) {
        self.for_each_setup(clip, triangles, |id, s| s.draw_avx2(id, front, out));
    }

    #[inline(always)]
    pub(super) fn for_each_setup(
        &self,
        clip: &[Vec4f],
        triangles: &[[u32; 3]],
        mut draw: impl FnMut(u32, &Setup),
    ) {
        for id in self.bins.triangles(self.x, self.y) {
            let [i, j, k] = triangles[id as usize];
            let corners = [clip[i as usize], clip[j as usize], clip[k as usize]];
            if let Some(s) = self.setup(&corners) {
                draw(id, &s);
            }
        }
    }

    #[inline(always)]
    fn setup(&self, p: &[Vec4f; 3]) -> Option<Setup> {
        let (w, h) = (self.image.0 as f64 * 0.5, self.image.1 as f64 * 0.5);
        // Homogeneous pixel coordinates, as seen from the centre of the tile's first pixel.
        let (ox, oy) = (self.x as f64 + 0.5, self.y as f64 + 0.5);
        let mut q = [[0.0f64; 3]; 3];
        for k in 0..3 {
            let (x, y, vw) = (f64::from(p[k].x), f64::from(p[k].y), f64::from(p[k].w));
            q[k] = [(x + vw) * w, (vw - y) * h, vw];
        }
        let range = self.range(&q)?;
        let mut e = [[0.0f64; 3]; 3];
        for k in 0..3 {
            let (s, t) = (&q[(k + 1) % 3], &q[(k + 2) % 3]);
            let a = t[2] * s[1] - s[2] * t[1];
            let b = t[0] * s[2] - s[0] * t[2];
            let c = s[0] * t[1] - t[0] * s[1];
            e[k] = [a, b, (a * ox + b * oy) + c];
        }
        let det = e[0][2] * q[0][2] + e[1][2] * q[1][2] + e[2][2] * q[2][2];
        if det == 0.0 || !det.is_finite() {
            return None;
        }
        let (sign, r) = (if det < 0.0 { -1.0 } else { 1.0 }, 1.0 / det.abs());
        let mut out = Setup { edge: [[0.0; 3]; 3], limit: [0.0; 3], depth: [0.0; 3], range };
        let mut depth = [0.0f64; 3];
        for k in 0..3 {
            for i in 0..3 {
                let x = sign * e[k][i];
                out.edge[k][i] = x as f32;
                depth[i] += x * f64::from(p[k].z);
            }
            let l = [sign * e[k][0], sign * e[k][1]];
            out.limit[k] = if l[0] > 0.0 || (l[0] == 0.0 && l[1] > 0.0) { 0.0 } else { SMALLEST };
        }
        for i in 0..3 {
            out.depth[i] = (depth[i] * r) as f32;
        }
        Some(out)
    }

    /// Pixels of the tile inside the box around a triangle, inclusive.
    #[inline(always)]
    fn range(&self, q: &[[f64; 3]; 3]) -> Option<[usize; 4]> {
        let mut r = [0, 0, self.width - 1, self.height - 1];
        if q[0][2] > 0.0 && q[1][2] > 0.0 && q[2][2] > 0.0 {
            let inverse = [1.0 / q[0][2], 1.0 / q[1][2], 1.0 / q[2][2]];
            let first = [self.x as f64, self.y as f64];
            for k in 0..2 {
                let v = [q[0][k] * inverse[0], q[1][k] * inverse[1], q[2][k] * inverse[2]];
                // Pixels x with lo <= x <= hi: rounded outwards by a hair, clamped before the integer conversion.
                let lo = v[0].min(v[1]).min(v[2]) - 0.501 - first[k];
                let hi = v[0].max(v[1]).max(v[2]) - 0.499 - first[k];
                let end = r[k + 2] as f64;
                if !(lo <= end && hi >= 0.0) {
                    return None;
                }
                let (lo, hi) = (lo.max(0.0), hi.min(end));
                let low = lo as usize;
                r[k] = low + usize::from((low as f64) < lo);
                r[k + 2] = hi as usize;
                if r[k] > r[k + 2] {
                    return None;
                }
            }
        }
        Some(r)
    }
}

impl Setup {
    /// Draws pixel by pixel.
    #[inline(always)]
    pub(super) fn draw(&self, id: u32, front: Option<&Layer>, out: &mut Layer) {
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
                if !(a >= self.limit[0] && b >= self.limit[1] && c >= self.limit[2]) {
                    continue;
                }
                let z = (self.depth[0] * fx + row[3]) + self.depth[2];
                let i = y * TILE + x;
                let behind = front.is_none_or(|f| {
                    let (t, d) = (f.triangle[i], f.depth[i]);
                    t != NONE && (z > d || (z == d && id > t))
                });
                if (0.0..=1.0).contains(&z) && z < out.depth[i] && behind {
                    out.depth[i] = z;
                    out.triangle[i] = id;
                }
            }
        }
    }
}
