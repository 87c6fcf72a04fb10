//! Reflection and refraction at a plane and at microfacets (Walter et al. 2007).
//!
//! `eta` is the index of refraction on the other side over that on the side of `wo`; `wo` and `m` lie above the surface.

use photofit_scalar::{Real, Vec3};

/// Width of a refracted lobe in radians, `alpha |eta - 1|`, below which it is a delta lobe: directions in `f32` do not
/// resolve its microfacets.
pub(super) const REFRACTION_DELTA: f64 = 2e-5;

/// A distribution of microfacet normals with masking.
pub(super) trait Facets<T: Real> {
    /// Density `D` of a unit normal above the surface.
    fn d(&self, m: Vec3<T>) -> T;
    /// `|v.z| / G1(v)`, which stays positive at grazing.
    fn masked(&self, v: Vec3<T>) -> T;
    /// Masking of both directions over `4 |wo.z wi.z|`; they may lie on different sides.
    fn visibility(&self, wo: Vec3<T>, wi: Vec3<T>) -> T;
    /// A visible normal for `wo` above the surface.
    fn sample(&self, wo: Vec3<T>, u: [T; 2]) -> Vec3<T>;
    /// Larger alpha.
    fn alpha_max(&self) -> T;

    /// Density of [`Self::sample`] per solid angle of the normal: `D G1 (wo.m) / wo.z`.
    #[inline(always)]
    fn pdf(&self, wo: Vec3<T>, m: Vec3<T>) -> T {
        self.d(m) * wo.dot(m).relu() / self.masked(wo)
    }
}

/// What scattering at the microfacets between two directions comes to, but for Fresnel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Event<T> {
    /// `f |cos theta_i|`, without the factor of radiance at refraction.
    pub(super) value: T,
    /// Density of `wi` if the microfacet always scatters this way.
    pub(super) pdf: T,
    /// Cosine between `wo` and the microfacet normal.
    pub(super) cosine: T,
}

/// Reflection from `wi` to `wo`, both above the surface.
#[inline(always)]
pub(super) fn reflection<T: Real>(facets: &impl Facets<T>, wo: Vec3<T>, wi: Vec3<T>) -> Option<Event<T>> {
    let m = (wo + wi).normalize_or_zero();
    let cosine = wo.dot(m);
    if cosine <= T::zero() || cosine.is_nan() {
        return None;
    }
    let d = facets.d(m);
    // The cosine of the density of normals and that of the reflection cancel.
    let pdf = T::of(0.25) * d / facets.masked(wo);
    Some(Event { value: d * facets.visibility(wo, wi) * wi.z, pdf, cosine })
}

/// Refraction from `wi` below the surface to `wo` above it.
#[inline(always)]
pub(super) fn refraction<T: Real>(
    facets: &impl Facets<T>,
    wo: Vec3<T>,
    wi: Vec3<T>,
    eta: T,
) -> Option<Event<T>> {
    let mut m = (wo + wi * eta).normalize_or_zero();
    if m.z < T::zero() {
        m = -m;
    }
    let (co, ci) = (wo.dot(m), wi.dot(m));
    // Light passes from one side of the microfacet to the other.
    if !(co > T::zero() && ci < T::zero()) {
        return None;
    }
    let sum = co + eta * ci;
    // |dm / dwi|
    let jacobian = eta * eta * -ci / (sum * sum);
    let value = T::of(4.0) * facets.d(m) * facets.visibility(wo, wi) * wi.z.abs() * co * jacobian;
    let pdf = facets.pdf(wo, m) * jacobian;
    if pdf < T::infinity() { Some(Event { value, pdf, cosine: co }) } else { None }
}

/// The direction of `wo` after reflection at `m`.
#[inline(always)]
pub(super) fn reflect<T: Real>(wo: Vec3<T>, m: Vec3<T>) -> Vec3<T> {
    m * (wo.dot(m) * T::of(2.0)) - wo
}

/// The direction of `wo` after refraction at `m`; `None` at total internal reflection.
#[inline(always)]
pub(super) fn refract<T: Real>(wo: Vec3<T>, m: Vec3<T>, eta: T) -> Option<Vec3<T>> {
    let c = wo.dot(m);
    let t = refracted_cosine(c, eta)?;
    Some((m * (c / eta - t) - wo / eta).normalize_or_zero())
}

/// Cosine of the refracted direction for the cosine `c` of the incident one; `None` at total internal reflection.
#[inline(always)]
pub(super) fn refracted_cosine<T: Real>(c: T, eta: T) -> Option<T> {
    let one = T::one();
    let s2 = (one - c * c) / (eta * eta);
    if s2 < one { Some((one - s2).sqrt()) } else { None }
}
