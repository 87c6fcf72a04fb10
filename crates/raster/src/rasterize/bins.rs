//! Binning: which triangles may touch which tile.

use super::tile::{TILE, Tile};
use photofit_scalar::Vec4f;
use photofit_shading::Sides;
use rayon::prelude::*;

/// Triangles handled by one task.
const CHUNK: usize = 16 * 1024;
/// Slack of the bounding boxes in pixels: keeps a pixel centre that lies exactly on an edge inside of the box.
const SLACK: f64 = 1e-3;

/// Triangles of a fixed range sorted by tile.
#[derive(Debug)]
struct Chunk {
    /// Start of each tile's triangles in `ids`, and the end.
    start: Vec<u32>,
    ids: Vec<u32>,
}

/// Triangles by tile, in ascending order of their index.
#[derive(Debug)]
pub struct Bins {
    width: usize,
    height: usize,
    columns: usize,
    chunks: Vec<Chunk>,
}

impl Bins {
    /// Sorts the triangles of a view into tiles; those that cover no pixel centre's surroundings and those that turn a
    /// side to the viewer that is not drawn are dropped. `sides` `[T]` says what is drawn; empty: both sides of all.
    ///
    /// # Panics
    /// If an index is out of range, or `sides` is neither empty nor of one entry per triangle.
    pub fn new(clip: &[Vec4f], triangles: &[[u32; 3]], sides: &[Sides], width: usize, height: usize) -> Self {
        assert!(sides.is_empty() || sides.len() == triangles.len(), "one entry of sides per triangle");
        let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let chunks = triangles
            .par_chunks(CHUNK)
            .enumerate()
            .map(|(c, tris)| {
                let sides = sides.get(c * CHUNK..).unwrap_or_default();
                bin_chunk(clip, tris, sides, (c * CHUNK) as u32, [width, height], [columns, rows])
            })
            .collect();
        Self { width, height, columns, chunks }
    }

    /// Tiles in a row.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// One tile.
    pub fn tile(&self, column: usize, row: usize) -> Tile<'_> {
        Tile {
            x: column * TILE,
            y: row * TILE,
            width: TILE.min(self.width - column * TILE),
            height: TILE.min(self.height - row * TILE),
            image: (self.width, self.height),
            bins: self,
        }
    }

    /// Indices of the triangles that may touch a tile, ascending.
    pub(super) fn triangles(&self, x: usize, y: usize) -> impl Iterator<Item = u32> + '_ {
        let tile = (y / TILE) * self.columns + x / TILE;
        self.chunks
            .iter()
            .flat_map(move |c| &c.ids[c.start[tile] as usize..c.start[tile + 1] as usize])
            .copied()
    }
}

fn bin_chunk(
    clip: &[Vec4f],
    tris: &[[u32; 3]],
    sides: &[Sides],
    first: u32,
    [width, height]: [usize; 2],
    [columns, rows]: [usize; 2],
) -> Chunk {
    let mut start = vec![0u32; columns * rows + 1];
    let boxes: Vec<Option<[u16; 4]>> = tris
        .iter()
        .enumerate()
        .map(|(i, t)| {
            let corners = t.map(|i| clip[i as usize]);
            if sides.get(i).is_some_and(|s| *s == Sides::Front) && turns_away(&corners) {
                return None;
            }
            let b = tile_box(corners, width, height)?;
            for r in b[1]..=b[3] {
                for c in b[0]..=b[2] {
                    start[r as usize * columns + c as usize + 1] += 1;
                }
            }
            Some(b)
        })
        .collect();
    for i in 0..columns * rows {
        start[i + 1] += start[i];
    }
    let mut next = start.clone();
    let mut ids = vec![0u32; start[columns * rows] as usize];
    for (i, b) in boxes.iter().enumerate() {
        let Some(b) = b else { continue };
        for r in b[1]..=b[3] {
            for c in b[0]..=b[2] {
                let at = &mut next[r as usize * columns + c as usize];
                ids[*at as usize] = first + i as u32;
                *at += 1;
            }
        }
    }
    Chunk { start, ids }
}

/// Whether the viewer sees the corners turn clockwise; the homogeneous determinant decides on both sides of w = 0.
fn turns_away(p: &[Vec4f; 3]) -> bool {
    let [a, b, c] = p.map(|v| [f64::from(v.x), f64::from(v.y), f64::from(v.w)]);
    let minor = |i: usize, j: usize| b[i] * c[j] - b[j] * c[i];
    a[0] * minor(1, 2) - a[1] * minor(0, 2) + a[2] * minor(0, 1) < 0.0
}

/// Range of tiles (x0, y0, x1, y1, inclusive) that hold a pixel centre inside the box around a triangle.
fn tile_box(p: [Vec4f; 3], width: usize, height: usize) -> Option<[u16; 4]> {
    if !p.iter().all(|v| v.is_finite()) || width == 0 || height == 0 {
        return None;
    }
    if p.iter().all(|v| v.w <= 0.0) || p.iter().all(|v| v.z < 0.0) || p.iter().all(|v| v.z > v.w) {
        return None;
    }
    let (w, h) = (width as f64, height as f64);
    // A triangle that crosses w = 0 has no bounded box; its edge functions decide.
    let mut lo = [0.0f64, 0.0];
    let mut hi = [w - 1.0, h - 1.0];
    if p.iter().all(|v| v.w > 0.0) {
        let mut min = [f64::INFINITY; 2];
        let mut max = [f64::NEG_INFINITY; 2];
        for v in p {
            let r = 1.0 / f64::from(v.w);
            let q = [(f64::from(v.x) * r + 1.0) * 0.5 * w, (1.0 - f64::from(v.y) * r) * 0.5 * h];
            for k in 0..2 {
                min[k] = min[k].min(q[k]);
                max[k] = max[k].max(q[k]);
            }
        }
        for k in 0..2 {
            let (first, last) = (min[k] - 0.5 - SLACK, max[k] - 0.5 + SLACK);
            if !(first <= hi[k] && last >= 0.0) {
                return None;
            }
            // Whole pixels inside of both, without the library calls that `ceil` and `floor` are on old machines.
            let (first, last) = (first.max(0.0), last.min(hi[k]));
            let low = first as u32;
            lo[k] = f64::from(low + u32::from(f64::from(low) < first));
            hi[k] = f64::from(last as u32);
        }
    }
    if !(lo[0] <= hi[0] && lo[1] <= hi[1]) {
        return None;
    }
    let tile = |x: f64| (x as usize / TILE) as u16;
    Some([tile(lo[0]), tile(lo[1]), tile(hi[0]), tile(hi[1])])
}
