//! Perspective-correct barycentrics at a pixel centre, their screen derivatives, and the adjoint.

use photofit_scalar::{Real, Vec2, Vec4, vec2, vec4};

/// Maps pixels to normalized device coordinates.
#[derive(Clone, Copy, Debug)]
pub struct PixelGrid<T> {
    /// `2 / width`.
    pub sx: T,
    /// `2 / height`.
    pub sy: T,
}

impl<T: Real> PixelGrid<T> {
    /// The grid of an image.
    pub fn new(width: usize, height: usize) -> Self {
        Self { sx: T::of(2.0 / width as f64), sy: T::of(2.0 / height as f64) }
    }

    /// Normalized device coordinates of the centre of pixel (x, y); y grows downwards in the image, upwards here.
    #[inline(always)]
    pub fn ndc(&self, x: usize, y: usize) -> Vec2<T> {
        let half = T::of(0.5);
        vec2((T::of(x as f64) + half) * self.sx - T::one(), T::one() - (T::of(y as f64) + half) * self.sy)
    }
}

/// Barycentric coordinates and their derivatives per pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Barycentrics<T> {
    /// Weight of vertex 0.
    pub u: T,
    /// Weight of vertex 1; that of vertex 2 is `1 - u - v`.
    pub v: T,
    /// d(u)/d(X, Y), per pixel, Y downwards.
    pub du: Vec2<T>,
    /// d(v)/d(X, Y).
    pub dv: Vec2<T>,
}

/// Twice the signed area of (a, b) as vectors.
#[inline(always)]
fn area<T: Real>(a: Vec2<T>, b: Vec2<T>) -> T {
    a.x * b.y - b.x * a.y
}

/// Barycentrics of the pixel whose centre has the normalized device coordinates `f`.
///
/// With `P_i = (x_i - f_x w_i, y_i - f_y w_i)` and `a_i` the cross product of the two other `P`:
/// `u = a_0 / sum a`, `v = a_1 / sum a` (Olano and Greer 1997; Laine et al. 2020).
#[inline(always)]
pub fn barycentrics<T: Real>(p: &[Vec4<T>; 3], f: Vec2<T>, grid: &PixelGrid<T>) -> Barycentrics<T> {
    let q = p.map(|v| vec2(v.x - f.x * v.w, v.y - f.y * v.w));
    let a = [area(q[1], q[2]), area(q[2], q[0]), area(q[0], q[1])];
    let r = T::one() / guarded(a[0] + a[1] + a[2]);
    let (u, v) = (a[0] * r, a[1] * r);
    let ax = |i: usize, j: usize| p[i].y * p[j].w - p[j].y * p[i].w;
    let ay = |i: usize, j: usize| p[j].x * p[i].w - p[i].x * p[j].w;
    let (x0, x1, x2) = (ax(1, 2), ax(2, 0), ax(0, 1));
    let (y0, y1, y2) = (ay(1, 2), ay(2, 0), ay(0, 1));
    let (sx, sy) = (x0 + x1 + x2, y0 + y1 + y2);
    let (kx, ky) = (grid.sx * r, -grid.sy * r);
    Barycentrics {
        u,
        v,
        du: vec2((x0 - u * sx) * kx, (y0 - u * sy) * ky),
        dv: vec2((x1 - v * sx) * kx, (y1 - v * sy) * ky),
    }
}

/// Keeps a divisor away from zero.
#[inline(always)]
fn guarded<T: Real>(a: T) -> T {
    let tiny = T::of(1e-30);
    if a.abs() > tiny { a } else { tiny.copysign(a) }
}

/// Adjoint of the `u` and `v` of [`barycentrics`]: gradients of the three clip-space positions (z has none; the
/// derivatives `du`, `dv`, which only choose the mip level, pass none on).
#[inline(always)]
pub fn barycentrics_vjp<T: Real>(p: &[Vec4<T>; 3], f: Vec2<T>, gu: T, gv: T) -> [Vec4<T>; 3] {
    let q = p.map(|v| vec2(v.x - f.x * v.w, v.y - f.y * v.w));
    let a = [area(q[1], q[2]), area(q[2], q[0]), area(q[0], q[1])];
    let r = T::one() / guarded(a[0] + a[1] + a[2]);
    let s = (gu * a[0] + gv * a[1]) * r;
    let g = [(gu - s) * r, (gv - s) * r, -s * r];
    let mut gq = [Vec2::zero(); 3];
    for (k, g) in g.into_iter().enumerate() {
        // a_k = area(q_i, q_j)
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        gq[i] += vec2(q[j].y, -q[j].x) * g;
        gq[j] += vec2(-q[i].y, q[i].x) * g;
    }
    gq.map(|g| vec4(g.x, g.y, T::zero(), -(f.x * g.x + f.y * g.y)))
}
