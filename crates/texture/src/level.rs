//! Level of detail from the screen derivatives of uv.

use photofit_scalar::{Real, Vec2, vec2};

/// The mip level of a lookup.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelOfDetail<T> {
    /// Level, clamped to `[0, max]`.
    pub level: T,
}

struct Ellipse<T> {
    sx: T,
    sy: T,
    tx: T,
    ty: T,
    half_difference: T,
    c: T,
    r: T,
    axis: T,
}

#[inline(always)]
fn ellipse<T: Real>(duv: &[Vec2<T>; 2], width: usize, height: usize) -> Ellipse<T> {
    let (w, h) = (T::of(width as f64), T::of(height as f64));
    let (sx, sy) = (duv[0].x * w, duv[0].y * w);
    let (tx, ty) = (duv[1].x * h, duv[1].y * h);
    let (a, b, c) = (sx * sx + tx * tx, sy * sy + ty * ty, sx * sy + tx * ty);
    let half = T::of(0.5);
    let half_difference = (a - b) * half;
    let r = (half_difference * half_difference + c * c).sqrt();
    Ellipse { sx, sy, tx, ty, half_difference, c, r, axis: (a + b) * half + r }
}

/// Level for the footprint `duv = [d(u)/d(X,Y), d(v)/d(X,Y)]` on a base level of `width` x `height` texels, with the
/// coarsest level `max`. A footprint of no extent, or that is not a number, has the base level.
#[inline(always)]
pub fn level_of_detail<T: Real>(
    duv: &[Vec2<T>; 2],
    width: usize,
    height: usize,
    bias: T,
    max: usize,
) -> LevelOfDetail<T> {
    let axis = ellipse(duv, width, height).axis;
    let level = if axis > T::zero() { axis.log2_fast() * T::of(0.5) + bias } else { T::zero() };
    LevelOfDetail { level: level.clamp_to(T::zero(), T::of(max as f64)) }
}

/// Adjoint of [`level_of_detail`] with respect to `duv`; zero where the level is clamped or not finite.
#[inline(always)]
pub fn level_of_detail_vjp<T: Real>(
    duv: &[Vec2<T>; 2],
    width: usize,
    height: usize,
    lod: &LevelOfDetail<T>,
    max: usize,
    g_level: T,
) -> [Vec2<T>; 2] {
    let e = ellipse(duv, width, height);
    let k = g_level / (T::of(2.0) * T::of(std::f64::consts::LN_2) * e.axis * e.r);
    if lod.level <= T::zero() || lod.level >= T::of(max as f64) || !k.is_finite() {
        return [Vec2::zero(); 2];
    }
    let (w, h) = (T::of(width as f64), T::of(height as f64));
    let (p, m) = (e.r + e.half_difference, e.r - e.half_difference);
    [
        vec2((e.sx * p + e.c * e.sy) * k * w, (e.sy * m + e.c * e.sx) * k * w),
        vec2((e.tx * p + e.c * e.ty) * k * h, (e.ty * m + e.c * e.tx) * k * h),
    ]
}
