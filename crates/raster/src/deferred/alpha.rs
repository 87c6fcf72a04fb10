//! The alpha that a fragment is blended with, and its adjoint.

use super::Masks;
use photofit_scalar::Real;
use photofit_texture::AlphaMode;

/// The alpha that is blended with, for that of the map.
#[inline(always)]
pub(super) fn drawn_alpha<T: Real>(alpha: T, mode: AlphaMode, masks: Masks) -> T {
    match (mode, masks) {
        (AlphaMode::Mask { cutoff }, Masks::Faded { slope }) => {
            faded(alpha, cutoff, slope).clamp_to(T::zero(), T::one())
        }
        _ => mode.coverage(alpha),
    }
}

/// Adjoint of [`drawn_alpha`] with respect to the map's alpha, which lies in `[0, 1]` but for the rounding of lookups.
#[inline(always)]
pub(super) fn drawn_alpha_vjp<T: Real>(alpha: T, mode: AlphaMode, masks: Masks, g: T) -> T {
    match (mode, masks) {
        (AlphaMode::Blend, _) => g,
        (AlphaMode::Mask { cutoff }, Masks::Faded { slope }) => {
            // The ends belong to the range that moves: with a slope of 1 no alpha in [0, 1] is stuck.
            let f = faded(alpha, cutoff, slope);
            if f >= T::zero() && f <= T::one() { g * T::of(f64::from(slope)) } else { T::zero() }
        }
        (AlphaMode::Opaque | AlphaMode::Mask { .. }, _) => T::zero(),
    }
}

/// [`Masks::Faded`] before it is clamped.
#[inline(always)]
fn faded<T: Real>(alpha: T, cutoff: f32, slope: f32) -> T {
    T::of(0.5) + T::of(f64::from(slope)) * (alpha - T::of(f64::from(cutoff)))
}
