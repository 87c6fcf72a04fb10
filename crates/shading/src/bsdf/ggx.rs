//! The GGX distribution of microfacet normals in the local frame, isotropic or not (Trowbridge and Reitz 1975, Walter et
//! al. 2007), with Smith masking (Heitz 2014) and sampling of visible normals by spherical caps (Dupuy and Benyoub
//! 2023).
//!
//! `D(m) = 1 / (pi ax ay e^2)`, `e = (m.x / ax)^2 + (m.y / ay)^2 + m.z^2`. With the stretched length
//! `s(v) = sqrt(v.z^2 + (ax v.x)^2 + (ay v.y)^2)` the masking of one direction is `G1 = 2 |v.z| / (|v.z| + s)` and that of
//! both, height-correlated, `G / (4 |wo.z wi.z|) = 1 / (2 (|wi.z| s(wo) + |wo.z| s(wi)))`.

use super::refraction::Facets;
use crate::ggx::HALF_EPSILON;
use photofit_scalar::{Real, Vec3, vec3};

/// The distribution: alpha along x and y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ggx<T> {
    pub(super) ax: T,
    pub(super) ay: T,
}

/// What reflection at the microfacets between two directions comes to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reflection<T> {
    /// `D G / (4 wo.z wi.z)`: the value but for Fresnel and cosine.
    pub(super) value: T,
    /// Density of `wi` by visible normals: `D G1 / (4 wo.z)`.
    pub(super) pdf: T,
    /// Cosine between either direction and the half vector.
    pub(super) cosine: T,
}

impl<T: Real> Ggx<T> {
    #[inline(always)]
    pub(super) fn isotropic(alpha: T) -> Self {
        Self { ax: alpha, ay: alpha }
    }

    /// `s(v)`.
    #[inline(always)]
    pub(super) fn stretched(&self, v: Vec3<T>) -> T {
        let (x, y) = (self.ax * v.x, self.ay * v.y);
        (v.z * v.z + x * x + y * y).sqrt()
    }

    /// Reflection from `wi` to `wo`, both above the surface.
    #[inline(always)]
    pub(super) fn reflection(&self, wo: Vec3<T>, wi: Vec3<T>) -> Reflection<T> {
        let half = T::of(0.5);
        let h = wo + wi;
        let s = h.length_squared() + T::of(HALF_EPSILON);
        // D from the half vector as it is: normalising it first would round it.
        let (x, y) = (h.x / self.ax, h.y / self.ay);
        let ratio = s / (x * x + y * y + h.z * h.z + T::of(HALF_EPSILON));
        let d = ratio * ratio * T::of(std::f64::consts::FRAC_1_PI) / (self.ax * self.ay);
        let (so, si) = (self.stretched(wo), self.stretched(wi));
        Reflection {
            value: half * d / (wi.z * so + wo.z * si),
            pdf: half * d / (wo.z + so),
            cosine: half * s.sqrt(),
        }
    }
}

impl<T: Real> Facets<T> for Ggx<T> {
    #[inline(always)]
    fn d(&self, m: Vec3<T>) -> T {
        let (x, y) = (m.x / self.ax, m.y / self.ay);
        let e = x * x + y * y + m.z * m.z;
        T::of(std::f64::consts::FRAC_1_PI) / (self.ax * self.ay * e * e)
    }

    #[inline(always)]
    fn masked(&self, v: Vec3<T>) -> T {
        (v.z.abs() + self.stretched(v)) * T::of(0.5)
    }

    #[inline(always)]
    fn visibility(&self, wo: Vec3<T>, wi: Vec3<T>) -> T {
        T::of(0.5) / (wi.z.abs() * self.stretched(wo) + wo.z.abs() * self.stretched(wi))
    }

    #[inline(always)]
    fn sample(&self, wo: Vec3<T>, u: [T; 2]) -> Vec3<T> {
        let one = T::one();
        let v = vec3(self.ax * wo.x, self.ay * wo.y, wo.z).normalize_or_zero();
        let z = (one - u[1]) * (one + v.z) - v.z;
        let r = (one - z * z).relu().sqrt();
        let (sin, cos) = (T::of(2.0 * std::f64::consts::PI) * u[0]).sin_cos();
        let h = vec3(self.ax * (r * cos + v.x), self.ay * (r * sin + v.y), (z + v.z).relu());
        h.normalize_or_zero()
    }

    #[inline(always)]
    fn alpha_max(&self) -> T {
        self.ax.max(self.ay)
    }
}
