//! Level of detail from the screen derivatives of uv.

use photofit_scalar::{Real, Vec2};

/// The mip level of a lookup.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelOfDetail<T> {
    /// Level, clamped to `[0, max]`.
    pub level: T,
}

/// Level for the footprint `duv = [d(u)/d(X,Y), d(v)/d(X,Y)]` on a base level of `width` x `height` texels, with the
/// coarsest level `max`. A footprint of no extent, or that is not a number, has the base level. It has no adjoint: footprints
/// pass nothing to positions.
#[inline(always)]
pub fn level_of_detail<T: Real>(
    duv: &[Vec2<T>; 2],
    width: usize,
    height: usize,
    bias: T,
    max: usize,
) -> LevelOfDetail<T> {
    let (w, h) = (T::of(width as f64), T::of(height as f64));
    let (sx, sy) = (duv[0].x * w, duv[0].y * w);
    let (tx, ty) = (duv[1].x * h, duv[1].y * h);
    let (a, b, c) = (sx * sx + tx * tx, sy * sy + ty * ty, sx * sy + tx * ty);
    let half = T::of(0.5);
    let half_difference = (a - b) * half;
    // The longer half axis of the ellipse, squared.
    let axis = (a + b) * half + (half_difference * half_difference + c * c).sqrt();
    let level = if axis > T::zero() { axis.log2_fast() * half + bias } else { T::zero() };
    LevelOfDetail { level: level.clamp_to(T::zero(), T::of(max as f64)) }
}
