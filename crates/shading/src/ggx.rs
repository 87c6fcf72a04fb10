//! The GGX specular lobe and the Lambertian lobe under it: value and derivatives for one pair of directions.
//!
//! `f(wo, wi) = diffuse / pi + F D V` with, for `h = wo + wi`, `s = |h|^2`, `a = roughness^2` and `n` the normal:
//!
//! - `D = a^2 s^2 / (pi q^2)`, `q = |n x h|^2 + a^2 (n.h)^2` (Walter et al. 2007; the cross product keeps the narrow
//!   lobes exact in `f32`, where `1 - (n.h)^2` would cancel),
//! - `V = G / (4 n.wo n.wi) = 1 / (2 (n.wi Lo + n.wo Li))`, `Lo = sqrt((n.wo)^2 (1 - a^2) + a^2)`: height-correlated
//!   Smith (Heitz 2014),
//! - `F = F0 + (F90 - F0)(1 - |h|/2)^5`: Schlick; `wo.h/|h| = |h|/2` for unit directions.
//!
//! [`Terms`] is the one place where these numbers are worked out: [`crate::eval()`] takes it in world space,
//! [`crate::bsdf::MetallicRoughness`] in the local frame.
//!
//! Clamps: roughness at [`ROUGHNESS_MIN`] (in [`Lobes`]), `n.wo` at [`COSINE_MIN`] (a viewer below the horizon sees the
//! surface as if at the horizon), `n.wi <= 0` gives zero. Clamped quantities have a zero derivative. Directions and
//! normals are unit vectors; derivatives are those of the formulas above, and their components along the vector itself
//! have no meaning (they vanish in the adjoint of a normalisation).

use crate::eval::LobesEvalGradient;
use crate::surface::Lobes;
use photofit_scalar::{Real, Vec3};

/// Smallest perceptual roughness, of both renderers and of fits: alpha 9e-4, a reflection of 0.1 degrees. Smoother
/// surfaces are drawn with it.
pub const ROUGHNESS_MIN: f64 = 0.03;
/// Smallest `n.wo` used in the specular lobe.
pub const COSINE_MIN: f64 = 1e-4;
/// Added to `|h|^2`, so that opposite directions divide by something.
pub(crate) const HALF_EPSILON: f64 = 1e-10;

/// Intermediate quantities of the specular lobe; names as in the module documentation.
pub(crate) struct Terms<T> {
    pub(crate) nl: T,
    pub(crate) nv: T,
    nv_free: bool,
    nh: T,
    a2: T,
    inv_s: T,
    inv_q: T,
    lo: T,
    li: T,
    inv_lo: T,
    inv_li: T,
    inv_den: T,
    vh: T,
    /// `(1 - vh)^4` and `(1 - vh)^5`.
    m4: T,
    p: T,
    /// `s / q`, squared, times `a^2`.
    normals: T,
    /// `D V`.
    pub(crate) k: T,
}

/// Unnormalised half vector of a pair of directions, and its cross product with the normal.
pub(crate) struct Half<T> {
    h: Vec3<T>,
    c: Vec3<T>,
}

impl<T: Real> Half<T> {
    /// For the normal `n`.
    #[inline(always)]
    pub(crate) fn new(n: Vec3<T>, wo: Vec3<T>, wi: Vec3<T>) -> Self {
        let h = wo + wi;
        Self { h, c: n.cross(h) }
    }
}

impl<T: Real> Terms<T> {
    /// For directions in world space about the normal `n`; `nl = n.wi` is positive.
    #[inline(always)]
    pub(crate) fn in_world(roughness: T, n: Vec3<T>, wo: Vec3<T>, nl: T, half: &Half<T>) -> Self {
        Self::new(roughness, n.dot(wo), nl, n.dot(half.h), half.h.length_squared(), half.c.length_squared())
    }

    /// For directions in the local frame, whose normal is +z, both above the surface.
    #[inline(always)]
    pub(crate) fn in_local(roughness: T, wo: Vec3<T>, wi: Vec3<T>) -> Self {
        let h = wo + wi;
        Self::new(roughness, wo.z, wi.z, h.z, h.length_squared(), h.y * h.y + h.x * h.x)
    }

    /// From the cosines, `|h|^2` and `|n x h|^2`.
    #[inline(always)]
    fn new(roughness: T, nv: T, nl: T, nh: T, h2: T, c2: T) -> Self {
        let (one, half, eps) = (T::one(), T::of(0.5), T::of(HALF_EPSILON));
        let alpha = roughness * roughness;
        let a2 = alpha * alpha;
        let s = h2 + eps;
        let inv_s = one / s;
        let inv_q = one / (c2 + a2 * (nh * nh + eps));
        let nv_free = nv > T::of(COSINE_MIN);
        let nv = if nv_free { nv } else { T::of(COSINE_MIN) };
        let lo = (nv * nv * (one - a2) + a2).sqrt();
        let li = (nl * nl * (one - a2) + a2).sqrt();
        let inv_den = one / (nl * lo + nv * li);
        let vh = half * s.sqrt();
        let m = one - vh;
        let m4 = (m * m) * (m * m);
        let ratio = s * inv_q;
        let normals = a2 * ratio * ratio;
        let k = normals * inv_den * T::of(0.5 * std::f64::consts::FRAC_1_PI);
        Self {
            nl,
            nv,
            nv_free,
            nh,
            a2,
            inv_s,
            inv_q,
            lo,
            li,
            inv_lo: one / lo,
            inv_li: one / li,
            inv_den,
            vh,
            m4,
            p: m4 * m,
            normals,
            k,
        }
    }

    /// `F`.
    #[inline(always)]
    pub(crate) fn fresnel(&self, lobes: &Lobes<T>) -> Vec3<T> {
        lobes.f0 * (T::one() - self.p) + Vec3::splat(lobes.f90 * self.p)
    }

    /// `F D V n.wi`.
    #[inline(always)]
    pub(crate) fn specular(&self, lobes: &Lobes<T>) -> Vec3<T> {
        self.fresnel(lobes) * (self.k * self.nl)
    }

    /// Density of `wi` where the normals that `wo` sees reflect it: `D G1 / (4 n.wo)`.
    #[inline(always)]
    pub(crate) fn pdf(&self) -> T {
        self.normals * T::of(0.5 * std::f64::consts::FRAC_1_PI) / (self.nv + self.lo)
    }

    /// Adjoint of [`Self::specular`] for its gradient `g`; `g_nl` is what other terms add to the gradient of `n.wi`.
    #[inline(always)]
    pub(crate) fn specular_vjp(
        &self,
        lobes: &Lobes<T>,
        n: Vec3<T>,
        wo: Vec3<T>,
        wi: Vec3<T>,
        half_vector: &Half<T>,
        g: Vec3<T>,
        g_nl: T,
    ) -> LobesEvalGradient<T> {
        let (one, two, half) = (T::one(), T::of(2.0), T::of(0.5));
        let (f, spec) = (self.fresnel(lobes), self.k * self.nl);
        let (nl, nv) = (self.nl, self.nv);
        let g_k = g.dot(f) * spec; // gradient of ln k
        let g_p = spec * (g.sum() * lobes.f90 - g.dot(lobes.f0));
        // vh = sqrt(s) / 2, p = (1 - vh)^5
        let g_vh = -T::of(5.0) * g_p * self.m4;
        let g_s = two * g_k * self.inv_s + g_vh * T::of(0.125) / self.vh;
        let g_q = -two * g_k * self.inv_q;
        let g_den = g_k * self.inv_den;
        let keep = one - self.a2;
        let g_nl = g_nl + g.dot(f) * self.k - g_den * (self.lo + nv * nl * keep * self.inv_li);
        let g_nv = if self.nv_free { -g_den * (self.li + nl * nv * keep * self.inv_lo) } else { T::zero() };
        let d_den_a2 = half * (nl * (one - nv * nv) * self.inv_lo + nv * (one - nl * nl) * self.inv_li);
        let g_a2 = g_k / self.a2 + g_q * (self.nh * self.nh + T::of(HALF_EPSILON)) - g_den * d_den_a2;

        // q = |n x h|^2 + a2 (n.h)^2, s = h.h
        let Half { h, c } = *half_vector;
        let scale = two * g_q;
        let along = self.a2 * self.nh;
        let g_n = (h.cross(c) + h * along) * scale + wi * g_nl + wo * g_nv;
        let g_h = (c.cross(n) + n * along) * scale + h * (two * g_s);
        let r = lobes.roughness;
        LobesEvalGradient {
            lobes: Lobes {
                diffuse: Vec3::zero(),
                f0: g * (spec * (one - self.p)),
                f90: g.sum() * spec * self.p,
                roughness: T::of(4.0) * r * r * r * g_a2,
            },
            n: g_n,
            wo: g_h + n * g_nv,
            wi: g_h + n * g_nl,
        }
    }
}
