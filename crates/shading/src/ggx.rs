//! Lambertian diffuse plus GGX specular reflection: value and derivatives.
//!
//! `f(wo, wi) = diffuse / pi + F D V` with, for `h = wo + wi`, `s = |h|^2`, `a = roughness^2` and `n` the normal:
//!
//! - `D = a^2 s^2 / (pi q^2)`, `q = |n x h|^2 + a^2 (n.h)^2` (Walter et al. 2007; the cross product keeps the narrow
//!   lobes exact in `f32`, where `1 - (n.h)^2` would cancel),
//! - `V = G / (4 n.wo n.wi) = 1 / (2 (n.wi Lo + n.wo Li))`, `Lo = sqrt((n.wo)^2 (1 - a^2) + a^2)`: height-correlated
//!   Smith (Heitz 2014),
//! - `F = F0 + (1 - F0)(1 - |h|/2)^5`: Schlick with `F90 = 1`; `wo.h/|h| = |h|/2` for unit directions.
//!
//! The diffuse lobe is not reduced by the Fresnel term, so a white dielectric reflects up to a few percent more
//! than it receives; the specular lobe alone never does.
//!
//! Clamps: roughness at [`ROUGHNESS_MIN`], `n.wo` at [`COSINE_MIN`] (a viewer below the horizon sees the surface as
//! if at the horizon), `n.wi <= 0` gives zero. Clamped quantities have a zero derivative. Directions and normals are
//! unit vectors; derivatives are those of the formulas above, and their components along the vector itself have no
//! meaning (they vanish in the adjoint of a normalisation).

use crate::surface::{Lobes, LobesGradient, Surface, SurfaceGradient};
use photofit_scalar::{Real, Vec3};

/// Smallest perceptual roughness: alpha 0.002, the narrowest lobe that `f32` directions resolve well.
pub const ROUGHNESS_MIN: f64 = 0.045;
/// Smallest `n.wo` used in the specular lobe.
pub const COSINE_MIN: f64 = 1e-4;
/// Added to `|h|^2`, so that opposite directions divide by something.
const HALF_EPSILON: f64 = 1e-10;

/// Gradient of [`eval`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EvalGradient<T = f32> {
    /// With respect to the material.
    pub surface: SurfaceGradient<T>,
    /// With respect to the normal.
    pub n: Vec3<T>,
    /// With respect to the direction to the viewer.
    pub wo: Vec3<T>,
    /// With respect to the direction to the light.
    pub wi: Vec3<T>,
}

/// Gradient of [`eval_lobes`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LobesEvalGradient<T = f32> {
    /// With respect to the lobes.
    pub lobes: LobesGradient<T>,
    /// With respect to the normal.
    pub n: Vec3<T>,
    /// With respect to the direction to the viewer.
    pub wo: Vec3<T>,
    /// With respect to the direction to the light.
    pub wi: Vec3<T>,
}

/// BSDF times cosine, `f(wo, wi) max(n.wi, 0)`, in 1/sr per colour channel.
///
/// `n`, `wo` and `wi` are unit vectors; `wo` and `wi` point away from the surface.
///
/// ```
/// use photofit_scalar::vec3;
/// use photofit_shading::{Surface, eval};
/// let s = Surface { base_color: vec3(0.8_f32, 0.4, 0.2), roughness: 1.0, metallic: 0.0, gamma: 0.0 };
/// let z = vec3(0.0, 0.0, 1.0);
/// let f = eval(&s, z, z, z);
/// assert!((f.x - (0.8 + 0.04 / 4.0) / std::f32::consts::PI).abs() < 1e-6);
/// ```
#[inline(always)]
pub fn eval<T: Real>(surface: &Surface<T>, n: Vec3<T>, wo: Vec3<T>, wi: Vec3<T>) -> Vec3<T> {
    eval_lobes(&surface.lobes(), n, wo, wi)
}

/// Adjoint of [`eval`] for the gradient `g` of its result.
#[inline(always)]
pub fn eval_vjp<T: Real>(
    surface: &Surface<T>,
    n: Vec3<T>,
    wo: Vec3<T>,
    wi: Vec3<T>,
    g: Vec3<T>,
) -> EvalGradient<T> {
    let (_, d) = eval_lobes_vjp(&surface.lobes(), n, wo, wi, |_| g);
    EvalGradient { surface: surface.lobes_vjp(&d.lobes), n: d.n, wo: d.wo, wi: d.wi }
}

/// [`eval`] on prepared lobes (one preparation serves many lights).
#[inline(always)]
pub fn eval_lobes<T: Real>(lobes: &Lobes<T>, n: Vec3<T>, wo: Vec3<T>, wi: Vec3<T>) -> Vec3<T> {
    let nl = n.dot(wi);
    if nl > T::zero() {
        let t = Terms::new(lobes, n, wo, wi, nl);
        lobes.diffuse * (nl * T::of(std::f64::consts::FRAC_1_PI)) + t.fresnel(lobes) * (t.k * nl)
    } else {
        Vec3::zero()
    }
}

/// Value and adjoint of [`eval_lobes`]; `seed` maps the value to its gradient.
#[inline(always)]
pub fn eval_lobes_vjp<T: Real>(
    lobes: &Lobes<T>,
    n: Vec3<T>,
    wo: Vec3<T>,
    wi: Vec3<T>,
    seed: impl FnOnce(Vec3<T>) -> Vec3<T>,
) -> (Vec3<T>, LobesEvalGradient<T>) {
    let nl = n.dot(wi);
    if nl <= T::zero() || nl.is_nan() {
        return (Vec3::zero(), LobesEvalGradient::default());
    }
    let (one, two, half) = (T::one(), T::of(2.0), T::of(0.5));
    let inv_pi = T::of(std::f64::consts::FRAC_1_PI);
    let t = Terms::new(lobes, n, wo, wi, nl);
    let f = t.fresnel(lobes);
    let spec = t.k * nl;
    let value = lobes.diffuse * (nl * inv_pi) + f * spec;
    let g = seed(value);

    // value = diffuse nl / pi + F K,  K = k nl
    let g_k = g.dot(f) * spec; // gradient of ln K
    let g_p = spec * (g.sum() - g.dot(lobes.f0));
    // vh = sqrt(s) / 2, p = (1 - vh)^5
    let g_vh = -T::of(5.0) * g_p * t.m4;
    let g_s = two * g_k * t.inv_s + g_vh * T::of(0.125) / t.vh;
    let g_q = -two * g_k * t.inv_q;
    let g_den = g_k * t.inv_den;
    let keep = one - t.a2;
    let g_nl = g.dot(lobes.diffuse) * inv_pi + g.dot(f) * t.k - g_den * (t.lo + t.nv * nl * keep * t.inv_li);
    let g_nv = if t.nv_free { -g_den * (t.li + nl * t.nv * keep * t.inv_lo) } else { T::zero() };
    let d_den_a2 = half * (nl * (one - t.nv * t.nv) * t.inv_lo + t.nv * (one - nl * nl) * t.inv_li);
    let g_a2 = g_k / t.a2 + g_q * (t.nh * t.nh + T::of(HALF_EPSILON)) - g_den * d_den_a2;

    // q = |n x h|^2 + a2 (n.h)^2, s = h.h
    let scale = two * g_q;
    let along = t.a2 * t.nh;
    let g_n = (t.h.cross(t.c) + t.h * along) * scale + wi * g_nl + wo * g_nv;
    let g_h = (t.c.cross(n) + n * along) * scale + t.h * (two * g_s);
    let r = lobes.roughness;
    let gradient = LobesEvalGradient {
        lobes: Lobes {
            diffuse: g * (nl * inv_pi),
            f0: g * (spec * (one - t.p)),
            roughness: T::of(4.0) * r * r * r * g_a2,
        },
        n: g_n,
        wo: g_h + n * g_nv,
        wi: g_h + n * g_nl,
    };
    (value, gradient)
}

/// Intermediate quantities of the specular lobe; names as in the module documentation.
struct Terms<T> {
    h: Vec3<T>,
    c: Vec3<T>,
    nh: T,
    nv: T,
    nv_free: bool,
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
    /// `D V`.
    k: T,
}

impl<T: Real> Terms<T> {
    #[inline(always)]
    fn new(lobes: &Lobes<T>, n: Vec3<T>, wo: Vec3<T>, wi: Vec3<T>, nl: T) -> Self {
        let (one, half, eps) = (T::one(), T::of(0.5), T::of(HALF_EPSILON));
        let alpha = lobes.roughness * lobes.roughness;
        let a2 = alpha * alpha;
        let h = wo + wi;
        let c = n.cross(h);
        let nh = n.dot(h);
        let s = h.length_squared() + eps;
        let inv_s = one / s;
        let inv_q = one / (c.length_squared() + a2 * (nh * nh + eps));
        let nv = n.dot(wo);
        let nv_free = nv > T::of(COSINE_MIN);
        let nv = if nv_free { nv } else { T::of(COSINE_MIN) };
        let lo = (nv * nv * (one - a2) + a2).sqrt();
        let li = (nl * nl * (one - a2) + a2).sqrt();
        let inv_den = one / (nl * lo + nv * li);
        let vh = half * s.sqrt();
        let m = one - vh;
        let m4 = (m * m) * (m * m);
        let ratio = s * inv_q;
        let k = a2 * ratio * ratio * inv_den * T::of(0.5 * std::f64::consts::FRAC_1_PI);
        Self {
            h,
            c,
            nh,
            nv,
            nv_free,
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
            k,
        }
    }

    #[inline(always)]
    fn fresnel(&self, lobes: &Lobes<T>) -> Vec3<T> {
        lobes.f0 * (T::one() - self.p) + Vec3::splat(self.p)
    }
}
