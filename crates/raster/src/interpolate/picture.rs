//! Interpolation of vertex attributes over a whole picture.

use crate::rasterize::{NONE, Patch, PatchGradient, PatchValues, PixelGrid, TILE, Visibility};
use photofit_scalar::{Real, Vec4};
use rayon::prelude::*;
use std::ops::Range;

/// Where [`interpolate_picture`] found which triangle, for its adjoint. The memory serves again from picture to picture.
#[derive(Clone, Debug)]
pub struct Pieces<T, const C: usize> {
    strips: Vec<Strip<T, C>>,
}

/// [`TILE`] rows of the picture.
#[derive(Clone, Debug)]
struct Strip<T, const C: usize> {
    runs: Vec<Run>,
    pieces: Vec<Piece<T, C>>,
    /// For each column, the piece that was last seen in it.
    above: Vec<u32>,
    /// One per piece.
    sums: Vec<PatchGradient<T, C>>,
    gradients: Vec<CornerGradients<T, C>>,
}

/// Gradients of the corners of a piece: of clip-space positions and of values.
type CornerGradients<T, const C: usize> = ([Vec4<T>; 3], [[T; C]; 3]);

/// Neighbouring pixels of a row that show one triangle.
#[derive(Clone, Copy, Debug)]
struct Run {
    piece: u32,
    /// Row of the strip.
    row: u32,
    start: u32,
    end: u32,
}

/// A triangle, or a part of it, in a strip.
#[derive(Clone, Copy, Debug)]
struct Piece<T, const C: usize> {
    triangle: u32,
    /// Its first pixel.
    x: u32,
    row: u32,
    patch: Patch<T>,
    values: PatchValues<T, C>,
}

impl<T, const C: usize> Default for Pieces<T, C> {
    fn default() -> Self {
        Self { strips: Vec::new() }
    }
}

impl<T, const C: usize> Default for Strip<T, C> {
    fn default() -> Self {
        Self {
            runs: Vec::new(),
            pieces: Vec::new(),
            above: Vec::new(),
            sums: Vec::new(),
            gradients: Vec::new(),
        }
    }
}

impl<T: Real, const C: usize> Piece<T, C> {
    /// Column of a pixel, counted from the first one.
    #[inline(always)]
    fn column(&self, x: u32) -> T {
        T::of(f64::from(x) - f64::from(self.x))
    }
}

impl Run {
    /// Pixels of a strip of pictures `width` wide.
    #[inline(always)]
    fn pixels(&self, width: usize) -> Range<usize> {
        let row = self.row as usize * width;
        row + self.start as usize..row + self.end as usize
    }
}

/// Writes the values `[V]` of the vertices, interpolated, to every pixel of `out` `[H*W]`; 0 where no triangle is seen.
///
/// `clip` `[V]` are the positions that `visibility` was made from.
///
/// # Panics
/// If sizes differ or an index is out of range.
pub fn interpolate_picture<T: Real, const C: usize>(
    visibility: &Visibility,
    clip: &[Vec4<T>],
    triangles: &[[u32; 3]],
    values: &[[T; C]],
    pieces: &mut Pieces<T, C>,
    out: &mut [[T; C]],
) {
    let (width, height) = (visibility.width, visibility.height);
    assert_eq!(out.len(), width * height, "one output per pixel");
    let (grid, rows) = (PixelGrid::new(width, height), width.max(1) * TILE);
    pieces.strips.resize_with(height.div_ceil(TILE), Strip::default);
    let parts = out.par_chunks_mut(rows).zip(visibility.triangle.par_chunks(rows));
    parts.zip(pieces.strips.par_iter_mut()).enumerate().for_each(|(s, ((out, ids), strip))| {
        strip.runs.clear();
        strip.pieces.clear();
        strip.above.clear();
        strip.above.resize(width, NONE);
        for (row, (out, ids)) in out.chunks_mut(width).zip(ids.chunks(width)).enumerate() {
            for_each_run(ids, |triangle, run| {
                if triangle == NONE {
                    return out[run].fill([T::zero(); C]);
                }
                let known = strip.above[run.clone()]
                    .iter()
                    .copied()
                    .find(|p| strip.pieces.get(*p as usize).is_some_and(|p| p.triangle == triangle));
                let piece = known.unwrap_or_else(|| {
                    let [i, j, k] = triangles[triangle as usize].map(|i| i as usize);
                    let patch = Patch::new(&[clip[i], clip[j], clip[k]], run.start, s * TILE + row, &grid);
                    let values = patch.values([&values[i], &values[j], &values[k]]);
                    let (x, row) = (run.start as u32, row as u32);
                    strip.pieces.push(Piece { triangle, x, row, patch, values });
                    strip.pieces.len() as u32 - 1
                });
                strip.above[run.clone()].fill(piece);
                let run = Run { piece, row: row as u32, start: run.start as u32, end: run.end as u32 };
                strip.runs.push(run);
                let piece = &strip.pieces[piece as usize];
                let span = piece.patch.span(&piece.values, (run.row - piece.row) as usize);
                let mut n = piece.column(run.start);
                for out in &mut out[run.start as usize..run.end as usize] {
                    *out = span.at(n);
                    n += T::one();
                }
            });
        }
    });
}

/// Adjoint of [`interpolate_picture`] for the gradients `g` `[H*W]` of its output: accumulates those of the clip-space
/// positions (z has none) and of the values.
///
/// `pieces` is what the forward pass left, the other arguments are those it had.
///
/// # Panics
/// If sizes differ or an index is out of range.
pub fn interpolate_picture_vjp<T: Real, const C: usize>(
    visibility: &Visibility,
    clip: &[Vec4<T>],
    triangles: &[[u32; 3]],
    values: &[[T; C]],
    pieces: &mut Pieces<T, C>,
    g: &[[T; C]],
    g_clip: &mut [Vec4<T>],
    g_values: &mut [[T; C]],
) {
    let (width, height) = (visibility.width, visibility.height);
    assert_eq!(g.len(), width * height, "one gradient per pixel");
    assert_eq!(pieces.strips.len(), height.div_ceil(TILE), "the pieces are those of this picture");
    let rows = width.max(1) * TILE;
    g.par_chunks(rows).zip(pieces.strips.par_iter_mut()).for_each(|(g, strip)| {
        let Strip { runs, pieces, sums, gradients, .. } = strip;
        sums.clear();
        sums.resize(pieces.len(), PatchGradient::default());
        for run in &*runs {
            let piece = &pieces[run.piece as usize];
            let row = (run.row - piece.row) as usize;
            let span = piece.patch.span(&piece.values, row);
            span.vjp(piece.column(run.start), row, &g[run.pixels(width)], &mut sums[run.piece as usize]);
        }
        let corners = pieces.iter().zip(&*sums).map(|(piece, sum)| {
            let [i, j, k] = triangles[piece.triangle as usize].map(|i| i as usize);
            let values = [&values[i], &values[j], &values[k]];
            piece.patch.corners_vjp(&[clip[i], clip[j], clip[k]], values, sum)
        });
        gradients.clear();
        gradients.extend(corners);
    });
    for strip in &pieces.strips {
        for (piece, (clip, values)) in strip.pieces.iter().zip(&strip.gradients) {
            for (n, i) in triangles[piece.triangle as usize].into_iter().enumerate() {
                g_clip[i as usize] += clip[n];
                let sum = &mut g_values[i as usize];
                (0..C).for_each(|c| sum[c] += values[n][c]);
            }
        }
    }
}

/// Calls `run` with the id and the columns of each run of equal ids.
#[inline(always)]
fn for_each_run(ids: &[u32], mut run: impl FnMut(u32, Range<usize>)) {
    let mut start = 0;
    while start < ids.len() {
        let id = ids[start];
        let end = start + ids[start..].iter().take_while(|i| **i == id).count();
        run(id, start..end);
        start = end;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interpolate::{interpolate, interpolate_vjp};
    use crate::rasterize::{barycentrics, barycentrics_vjp, rasterize};
    use photofit_geometry::shapes;
    use photofit_gradcheck::Uniform;
    use photofit_scalar::vec4;

    #[test]
    fn a_picture_and_its_adjoint_are_those_of_its_pixels() {
        // More than two strips, a partial one, and widths that no tile divides.
        let (width, height) = (77, 71);
        let mesh = shapes::displaced_sphere(3, 0.2, 3, 5);
        let place = |p: &photofit_scalar::Vec3f| vec4(p.x * 1.7, p.y * 1.6, 1.0 - 0.3 * p.z, 2.0 - 0.4 * p.z);
        let narrow: Vec<Vec4<f32>> = mesh.positions.iter().map(place).collect();
        let visibility = rasterize(&narrow, &mesh.triangles, width, height, None);
        let wide = |v: &Vec4<f32>| vec4(f64::from(v.x), f64::from(v.y), f64::from(v.z), f64::from(v.w));
        let clip: Vec<Vec4<f64>> = narrow.iter().map(wide).collect();
        let mut rng = Uniform::new(5);
        let mut pairs = |n: usize| rng.vec(2 * n, -1.0, 1.0).as_chunks::<2>().0.to_vec();
        let (values, g) = (pairs(clip.len()), pairs(width * height));

        let mut pieces = Pieces::default();
        let mut out = vec![[7.0; 2]; width * height];
        // Twice: the second picture finds the memory of the first.
        for _ in 0..2 {
            interpolate_picture(&visibility, &clip, &mesh.triangles, &values, &mut pieces, &mut out);
        }
        let mut g_clip = vec![Vec4::zero(); clip.len()];
        let mut g_values = vec![[0.0; 2]; clip.len()];
        interpolate_picture_vjp(
            &visibility,
            &clip,
            &mesh.triangles,
            &values,
            &mut pieces,
            &g,
            &mut g_clip,
            &mut g_values,
        );

        let grid = PixelGrid::new(width, height);
        let mut single_clip = vec![Vec4::zero(); clip.len()];
        let mut single_values = vec![[0.0; 2]; clip.len()];
        let mut covered = 0;
        for (i, id) in visibility.triangle.iter().enumerate() {
            if *id == NONE {
                assert_eq!(out[i], [0.0; 2]);
                continue;
            }
            covered += 1;
            let t = mesh.triangles[*id as usize].map(|i| i as usize);
            let (p, f) = (t.map(|i| clip[i]), grid.ndc(i % width, i / width));
            let a = [&values[t[0]], &values[t[1]], &values[t[2]]];
            let b = barycentrics(&p, f, &grid);
            let exact = interpolate(a, &b);
            assert!((0..2).all(|c| (out[i][c] - exact[c]).abs() < 1e-11), "{:?} {exact:?}", out[i]);
            let mut corners = [[0.0; 2]; 3];
            let [v0, v1, v2] = &mut corners;
            let uvw = interpolate_vjp(a, &b, &g[i], [v0, v1, v2]);
            let one = barycentrics_vjp(&p, f, uvw.x, uvw.y);
            for (n, i) in t.into_iter().enumerate() {
                single_clip[i] += one[n];
                (0..2).for_each(|c| single_values[i][c] += corners[n][c]);
            }
        }
        assert!(covered > width * height / 4 && pieces.strips.iter().any(|s| s.runs.len() > s.pieces.len()));
        for (a, b) in g_clip.iter().zip(&single_clip) {
            assert!((*a - *b).to_array().iter().all(|d| d.abs() < 1e-9), "{a:?} {b:?}");
        }
        for (a, b) in g_values.as_flattened().iter().zip(single_values.as_flattened()) {
            assert!((a - b).abs() < 1e-11, "{a} {b}");
        }
    }
}
