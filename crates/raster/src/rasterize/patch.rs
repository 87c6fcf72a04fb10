//! Values on the pixels of one triangle, and the adjoint of all of them at once.

use super::PixelGrid;
use super::barycentric::{area, guarded};
use photofit_scalar::{Real, Vec2, Vec4, vec2, vec4};

/// Pixels of one triangle, counted from one of them.
///
/// The unnormalized weights `a_i` of [`barycentrics`](super::barycentrics) are linear in the pixel, and so is every sum
/// of corner values that they weigh: of the interpolation, a ratio of two linear functions is left. They are expanded
/// around a pixel of the triangle, where the same differences are taken as for that pixel alone, so that small
/// triangles far from the picture's centre lose no digits.
#[derive(Clone, Copy, Debug)]
pub struct Patch<T> {
    f: Vec2<T>,
    /// Growth of the normalized device coordinates, per column and per row.
    s: Vec2<T>,
    weights: Linear<T, 3>,
    total: Linear<T, 1>,
}

/// `C` functions that are linear in the pixel: at the first one, and their growth per column and per row.
#[derive(Clone, Copy, Debug)]
struct Linear<T, const C: usize> {
    first: [T; C],
    column: [T; C],
    row: [T; C],
}

impl<T: Real, const C: usize> Default for Linear<T, C> {
    fn default() -> Self {
        let zero = [T::zero(); C];
        Self { first: zero, column: zero, row: zero }
    }
}

/// `C` values of the corners on a patch, before their division by the sum of the weights.
#[derive(Clone, Copy, Debug)]
pub struct PatchValues<T, const C: usize>(Linear<T, C>);

/// Sums of the adjoint of a patch: gradients divided by the sum of the weights, plain and times the pixel's place, and
/// the same times the values.
#[derive(Clone, Copy, Debug)]
pub struct PatchGradient<T, const C: usize> {
    plain: Linear<T, C>,
    valued: Linear<T, C>,
}

impl<T: Real, const C: usize> Default for PatchGradient<T, C> {
    fn default() -> Self {
        Self { plain: Linear::default(), valued: Linear::default() }
    }
}

/// One row of pixels of a patch: numerators and divisor, at column 0 and their growth.
#[derive(Clone, Copy, Debug)]
pub struct Span<T, const C: usize> {
    first: [T; C],
    column: [T; C],
    total: [T; 2],
}

/// The two other corners of corner `k`, in turning order.
const fn others(k: usize) -> (usize, usize) {
    ((k + 1) % 3, (k + 2) % 3)
}

impl<T: Real> Patch<T> {
    /// The patch around pixel (x, y) of a triangle with these clip-space corners.
    #[inline(always)]
    pub fn new(corners: &[Vec4<T>; 3], x: usize, y: usize, grid: &PixelGrid<T>) -> Self {
        let (f, s) = (grid.ndc(x, y), vec2(grid.sx, -grid.sy));
        let q = corners.map(|v| vec2(v.x - f.x * v.w, v.y - f.y * v.w));
        let mut weights = Linear::default();
        for k in 0..3 {
            let (i, j) = others(k);
            weights.first[k] = area(q[i], q[j]);
            weights.column[k] = (corners[i].y * corners[j].w - corners[j].y * corners[i].w) * s.x;
            weights.row[k] = (corners[j].x * corners[i].w - corners[i].x * corners[j].w) * s.y;
        }
        let sum = |a: &[T; 3]| [a[0] + a[1] + a[2]];
        let total =
            Linear { first: sum(&weights.first), column: sum(&weights.column), row: sum(&weights.row) };
        Self { f, s, weights, total }
    }

    /// Prepares the interpolation of the values of the corners.
    #[inline(always)]
    pub fn values<const C: usize>(&self, corners: [&[T; C]; 3]) -> PatchValues<T, C> {
        let weigh = |w: &[T; 3]| {
            std::array::from_fn(|c| w[0] * corners[0][c] + w[1] * corners[1][c] + w[2] * corners[2][c])
        };
        let Linear { first, column, row } = &self.weights;
        PatchValues(Linear { first: weigh(first), column: weigh(column), row: weigh(row) })
    }

    /// The pixels `row` rows below the first one, from its column on.
    #[inline(always)]
    pub fn span<const C: usize>(&self, PatchValues(v): &PatchValues<T, C>, row: usize) -> Span<T, C> {
        let n = T::of(row as f64);
        Span {
            first: std::array::from_fn(|c| v.first[c] + v.row[c] * n),
            column: v.column,
            total: [self.total.first[0] + self.total.row[0] * n, self.total.column[0]],
        }
    }

    /// Gradients of the clip-space corners (z has none) and of their values, for the sums of a patch.
    #[inline(always)]
    pub fn corners_vjp<const C: usize>(
        &self,
        corners: &[Vec4<T>; 3],
        values: [&[T; C]; 3],
        sum: &PatchGradient<T, C>,
    ) -> ([Vec4<T>; 3], [[T; C]; 3]) {
        let f = self.f;
        let q = corners.map(|v| vec2(v.x - f.x * v.w, v.y - f.y * v.w));
        let (w, plain, valued) = (&self.weights, &sum.plain, &sum.valued);
        let mut gq = [Vec2::zero(); 3];
        let mut out = [Vec4::zero(); 3];
        let mut g_values = [[T::zero(); C]; 3];
        for k in 0..3 {
            let (mut first, mut column, mut row) = (T::zero(), T::zero(), T::zero());
            for c in 0..C {
                first += values[k][c] * plain.first[c] - valued.first[c];
                column += values[k][c] * plain.column[c] - valued.column[c];
                row += values[k][c] * plain.row[c] - valued.row[c];
                g_values[k][c] =
                    w.first[k] * plain.first[c] + w.column[k] * plain.column[c] + w.row[k] * plain.row[c];
            }
            let (i, j) = others(k);
            gq[i] += vec2(q[j].y, -q[j].x) * first;
            gq[j] += vec2(-q[i].y, q[i].x) * first;
            let (column, row, zero) = (column * self.s.x, row * self.s.y, T::zero());
            let (a, b) = (corners[i], corners[j]);
            out[i] += vec4(-b.w * row, b.w * column, zero, b.x * row - b.y * column);
            out[j] += vec4(a.w * row, -a.w * column, zero, a.y * column - a.x * row);
        }
        for (o, g) in out.iter_mut().zip(gq) {
            *o += vec4(g.x, g.y, T::zero(), -(f.x * g.x + f.y * g.y));
        }
        (out, g_values)
    }
}

impl<T: Real, const C: usize> Span<T, C> {
    /// Values at column `n`, which may lie before the patch's first pixel.
    #[inline(always)]
    pub fn at(&self, n: T) -> [T; C] {
        let r = self.factor(n);
        std::array::from_fn(|c| (self.first[c] + self.column[c] * n) * r)
    }

    /// The factor that normalizes the weights.
    #[inline(always)]
    fn factor(&self, n: T) -> T {
        T::one() / guarded(self.total[0] + self.total[1] * n)
    }

    /// Adjoint of [`at`](Self::at) for the columns `n, n + 1, ...` of row `row` with the gradients `g` of their values.
    #[inline(always)]
    pub fn vjp(&self, mut n: T, row: usize, g: &[[T; C]], sum: &mut PatchGradient<T, C>) {
        let zero = [T::zero(); C];
        let (mut first, mut column, mut first_values, mut column_values) = (zero, zero, zero, zero);
        for g in g {
            let r = self.factor(n);
            for c in 0..C {
                let g = g[c] * r;
                let gv = g * (self.first[c] + self.column[c] * n) * r;
                first[c] += g;
                column[c] += g * n;
                first_values[c] += gv;
                column_values[c] += gv * n;
            }
            n += T::one();
        }
        let row = T::of(row as f64);
        for (sum, first, column) in
            [(&mut sum.plain, first, column), (&mut sum.valued, first_values, column_values)]
        {
            for c in 0..C {
                sum.first[c] += first[c];
                sum.column[c] += column[c];
                sum.row[c] += first[c] * row;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interpolate::{interpolate, interpolate_vjp};
    use crate::rasterize::{barycentrics, barycentrics_vjp};
    use photofit_gradcheck::{Uniform, check};
    use std::ops::Range;

    /// Columns, before the first pixel too, of each row.
    const ROWS: [Range<i32>; 3] = [0..3, -2..2, -1..1];
    const PIXELS: usize = 9;

    /// The span of each row, its place, and the range of its pixels among all.
    fn for_each_row(
        patch: &Patch<f64>,
        values: &PatchValues<f64, 2>,
        mut f: impl FnMut(Span<f64, 2>, usize, i32, Range<usize>),
    ) {
        let mut first = 0;
        for (row, columns) in ROWS.into_iter().enumerate() {
            let end = first + columns.len();
            f(patch.span(values, row), row, columns.start, first..end);
            first = end;
        }
    }

    fn corners(x: &[f64]) -> [Vec4<f64>; 3] {
        [0, 1, 2].map(|k| vec4(x[4 * k], x[4 * k + 1], x[4 * k + 2], 1.5 + 0.3 * x[4 * k + 3]))
    }

    fn values(x: &[f64]) -> [[f64; 2]; 3] {
        [0, 1, 2].map(|k| [x[12 + 2 * k], x[13 + 2 * k]])
    }

    #[test]
    fn a_patch_gives_the_values_of_its_pixels() {
        let grid = PixelGrid::<f32>::new(640, 480);
        // A sliver far from the centre of the picture, where the constant terms of the edges cancel.
        let p = [vec4(2.7_f32, -1.9, 0.1, 3.0), vec4(2.73, -1.905, 0.2, 3.1), vec4(2.71, -1.87, 0.1, 2.9)];
        let exact = p.map(|v| vec4(f64::from(v.x), f64::from(v.y), f64::from(v.z), f64::from(v.w)));
        let (x, y) = (603, 389);
        let patch = Patch::new(&p, x, y, &grid);
        let unit = patch.values([&[1.0, 0.0, 0.0], &[0.0, 1.0, 0.0], &[0.0, 0.0, 1.0]]);
        for n in 0..6 {
            let fine = PixelGrid::<f64>::new(640, 480);
            let b = barycentrics(&exact, fine.ndc(x + n, y + n / 2), &fine);
            let w = patch.span(&unit, n / 2).at(n as f32);
            for (w, b) in w.into_iter().zip([b.u, b.v, 1.0 - b.u - b.v]) {
                assert!((f64::from(w) - b).abs() < 2e-3 * (1.0 + b.abs()), "pixel {n}: {w} for {b}");
            }
        }
    }

    #[test]
    fn gradients_of_a_patch_are_those_of_its_pixels() {
        let mut rng = Uniform::new(23);
        let grid = PixelGrid::<f64>::new(16, 12);
        for _ in 0..4 {
            let x = rng.vec(18, -1.0, 1.0);
            let g = rng.vec(2 * PIXELS, -1.0, 1.0);
            let seeds = g.as_chunks::<2>().0;
            let (p, v) = (corners(&x), values(&x));
            let v = [&v[0], &v[1], &v[2]];
            let patch = Patch::new(&p, 4, 7, &grid);
            let along = patch.values(v);
            let mut sum = PatchGradient::default();
            for_each_row(&patch, &along, |span, row, n, at| {
                span.vjp(f64::from(n), row, &seeds[at], &mut sum);
            });
            let (out, g_values) = patch.corners_vjp(&p, v, &sum);
            let (mut single, mut single_values) = ([Vec4::zero(); 3], [[0.0; 2]; 3]);
            for_each_row(&patch, &along, |span, row, n, at| {
                for (n, seed) in (n..).zip(&seeds[at]) {
                    let f = grid.ndc((4 + n) as usize, 7 + row);
                    let b = barycentrics(&p, f, &grid);
                    let (one, exact) = (span.at(f64::from(n)), interpolate(v, &b));
                    assert!((0..2).all(|c| (one[c] - exact[c]).abs() < 1e-12 * (1.0 + exact[c].abs())));
                    let [v0, v1, v2] = &mut single_values;
                    let uvw = interpolate_vjp(v, &b, seed, [v0, v1, v2]);
                    let one = barycentrics_vjp(&p, f, uvw.x, uvw.y);
                    (0..3).for_each(|k| single[k] += one[k]);
                }
            });
            for (a, b) in out.iter().zip(&single) {
                assert!(
                    (*a - *b).to_array().iter().all(|d| d.abs() < 1e-9 * (1.0 + b.w.abs())),
                    "{a:?} {b:?}"
                );
            }
            for (a, b) in g_values.as_flattened().iter().zip(single_values.as_flattened()) {
                assert!((a - b).abs() < 1e-11 * (1.0 + b.abs()), "{a} {b}");
            }
            let clip = out.iter().flat_map(|v| [v.x, v.y, v.z, 0.3 * v.w]);
            let flat: Vec<f64> = clip.chain(g_values.as_flattened().iter().copied()).collect();
            check("patch", &x, &flat, 1e-6, 1e-5, |x| {
                let patch = Patch::new(&corners(x), 4, 7, &grid);
                let v = values(x);
                let mut sum = 0.0;
                for_each_row(&patch, &patch.values([&v[0], &v[1], &v[2]]), |span, _, n, at| {
                    for (n, seed) in (n..).zip(&seeds[at]) {
                        let value = span.at(f64::from(n));
                        sum += value[0] * seed[0] + value[1] * seed[1];
                    }
                });
                sum
            });
        }
    }
}
