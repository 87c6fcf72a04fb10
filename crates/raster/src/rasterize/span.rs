//! Barycentrics along a row of pixels of one triangle, and the adjoint of the whole row at once.

use super::PixelGrid;
use super::barycentric::{area, guarded};
use photofit_scalar::{Real, Vec2, Vec4, vec2, vec4};

/// Neighbouring pixels of a row that show one triangle.
///
/// The unnormalized weights `a_i` of [`barycentrics`](super::barycentrics) are linear along the row: one addition and
/// one multiplication a pixel are left of them. They are expanded around the first pixel of the span, where the same
/// differences are taken as for a single pixel, so that small triangles far from the picture's centre lose no digits.
#[derive(Clone, Copy, Debug)]
pub struct Span<T> {
    f: Vec2<T>,
    sx: T,
    first: [T; 3],
    step: [T; 3],
}

/// Sums of a span's adjoint: gradients of the weights at its first pixel and of their growth per pixel.
#[derive(Clone, Copy, Debug, Default)]
pub struct SpanGradient<T> {
    first: [T; 3],
    step: [T; 3],
}

/// The two other corners of corner `k`, in turning order.
const fn others(k: usize) -> (usize, usize) {
    ((k + 1) % 3, (k + 2) % 3)
}

impl<T: Real> Span<T> {
    /// The span from pixel (x, y) on of a triangle with these clip-space corners.
    #[inline(always)]
    pub fn new(corners: &[Vec4<T>; 3], x: usize, y: usize, grid: &PixelGrid<T>) -> Self {
        let f = grid.ndc(x, y);
        let q = corners.map(|v| vec2(v.x - f.x * v.w, v.y - f.y * v.w));
        let (mut first, mut step) = ([T::zero(); 3], [T::zero(); 3]);
        for k in 0..3 {
            let (i, j) = others(k);
            first[k] = area(q[i], q[j]);
            step[k] = (corners[i].y * corners[j].w - corners[j].y * corners[i].w) * grid.sx;
        }
        Self { f, sx: grid.sx, first, step }
    }

    /// Weights of the corners at pixel `n` of the span; their sum is 1.
    #[inline(always)]
    pub fn weights(&self, n: usize) -> [T; 3] {
        let (a, r) = self.at(T::of(n as f64));
        [a[0] * r, a[1] * r, a[2] * r]
    }

    /// Unnormalized weights and the factor that normalizes them.
    #[inline(always)]
    fn at(&self, n: T) -> ([T; 3], T) {
        let a = [0, 1, 2].map(|k| self.first[k] + self.step[k] * n);
        (a, T::one() / guarded(a[0] + a[1] + a[2]))
    }

    /// Adds the gradient `g` of the three [`weights`](Self::weights) at pixel `n`.
    #[inline(always)]
    pub fn weights_vjp(&self, n: usize, g: [T; 3], sum: &mut SpanGradient<T>) {
        let n = T::of(n as f64);
        let (a, r) = self.at(n);
        let mean = (g[0] * a[0] + g[1] * a[1] + g[2] * a[2]) * r;
        for k in 0..3 {
            let g = (g[k] - mean) * r;
            sum.first[k] += g;
            sum.step[k] += g * n;
        }
    }

    /// Gradients of the clip-space corners for the sums of a span; z has none.
    #[inline(always)]
    pub fn corners_vjp(&self, corners: &[Vec4<T>; 3], sum: &SpanGradient<T>) -> [Vec4<T>; 3] {
        let f = self.f;
        let q = corners.map(|v| vec2(v.x - f.x * v.w, v.y - f.y * v.w));
        let mut gq = [Vec2::zero(); 3];
        let mut out = [Vec4::zero(); 3];
        for k in 0..3 {
            let (i, j) = others(k);
            gq[i] += vec2(q[j].y, -q[j].x) * sum.first[k];
            gq[j] += vec2(-q[i].y, q[i].x) * sum.first[k];
            let g = sum.step[k] * self.sx;
            out[i] += vec4(T::zero(), corners[j].w * g, T::zero(), -corners[j].y * g);
            out[j] += vec4(T::zero(), -corners[i].w * g, T::zero(), corners[i].y * g);
        }
        for (o, g) in out.iter_mut().zip(gq) {
            *o += vec4(g.x, g.y, T::zero(), -(f.x * g.x + f.y * g.y));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rasterize::{barycentrics, barycentrics_vjp};
    use photofit_gradcheck::{Uniform, check};

    const PIXELS: usize = 5;

    fn corners(x: &[f64]) -> [Vec4<f64>; 3] {
        [0, 1, 2].map(|k| vec4(x[4 * k], x[4 * k + 1], x[4 * k + 2], 1.5 + 0.3 * x[4 * k + 3]))
    }

    #[test]
    fn a_span_gives_the_barycentrics_of_its_pixels() {
        let grid = PixelGrid::<f32>::new(640, 480);
        // A sliver far from the centre of the picture, where the constant terms of the edges cancel.
        let p = [vec4(2.7_f32, -1.9, 0.1, 3.0), vec4(2.73, -1.905, 0.2, 3.1), vec4(2.71, -1.87, 0.1, 2.9)];
        let exact = p.map(|v| vec4(f64::from(v.x), f64::from(v.y), f64::from(v.z), f64::from(v.w)));
        let (x, y) = (603, 389);
        let span = Span::new(&p, x, y, &grid);
        for n in 0..6 {
            let fine = PixelGrid::<f64>::new(640, 480);
            let b = barycentrics(&exact, fine.ndc(x + n, y), &fine);
            let w = span.weights(n);
            for (w, b) in w.into_iter().zip([b.u, b.v, 1.0 - b.u - b.v]) {
                assert!((f64::from(w) - b).abs() < 2e-3 * (1.0 + b.abs()), "pixel {n}: {w} for {b}");
            }
        }
    }

    #[test]
    fn gradients_of_a_span_are_those_of_its_pixels() {
        let mut rng = Uniform::new(23);
        let grid = PixelGrid::<f64>::new(16, 12);
        for _ in 0..4 {
            let x = rng.vec(12, -1.0, 1.0);
            let g = rng.vec(3 * PIXELS, -1.0, 1.0);
            let seed = |n: usize| [g[3 * n], g[3 * n + 1], g[3 * n + 2]];
            let p = corners(&x);
            let span = Span::new(&p, 4, 7, &grid);
            let mut sum = SpanGradient::default();
            (0..PIXELS).for_each(|n| span.weights_vjp(n, seed(n), &mut sum));
            let out = span.corners_vjp(&p, &sum);
            let mut single = [Vec4::zero(); 3];
            for n in 0..PIXELS {
                let s = seed(n);
                let one = barycentrics_vjp(&p, grid.ndc(4 + n, 7), s[0] - s[2], s[1] - s[2]);
                (0..3).for_each(|k| single[k] += one[k]);
            }
            for (a, b) in out.iter().zip(&single) {
                assert!(
                    (*a - *b).to_array().iter().all(|d| d.abs() < 1e-9 * (1.0 + b.w.abs())),
                    "{a:?} {b:?}"
                );
            }
            let flat: Vec<f64> = out.iter().flat_map(|v| [v.x, v.y, v.z, 0.3 * v.w]).collect();
            check("span", &x, &flat, 1e-6, 1e-5, |x| {
                let span = Span::new(&corners(x), 4, 7, &grid);
                let dot = |n: usize| span.weights(n).iter().zip(seed(n)).map(|(w, g)| w * g).sum::<f64>();
                (0..PIXELS).map(dot).sum()
            });
        }
    }
}
