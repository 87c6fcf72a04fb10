//! The metallic-roughness model for one pair of directions: BSDF times cosine, and its adjoint.
//!
//! [`Energy::Single`] is `(diffuse / pi + F D V) n.wi` (formulas in `ggx.rs`): the diffuse lobe is not reduced by the
//! Fresnel term, so a white dielectric reflects up to a few percent more than it receives; the specular lobe alone
//! never does. [`Energy::Compensated`] replaces the first term by the one of [`crate::energy`].

use crate::energy::{Energy, SpecularAlbedo};
use crate::ggx::{Half, Terms};
use crate::split_sum::{SplitSum, split_sum};
use crate::surface::{Lobes, LobesGradient, Surface, SurfaceGradient};
use photofit_scalar::{Real, Vec3};

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

/// Gradient of [`crate::bsdf::MetallicRoughness`] with respect to its lobes, the normal and the directions.
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
/// use photofit_shading::{Energy, Surface, eval};
/// let s = Surface { base_color: vec3(0.8_f32, 0.4, 0.2), roughness: 1.0, metallic: 0.0, gamma: 0.0 };
/// let z = vec3(0.0, 0.0, 1.0);
/// let f = eval(&s, Energy::Single, z, z, z);
/// assert!((f.x - (0.8 + 0.04 / 4.0) / std::f32::consts::PI).abs() < 1e-6);
/// ```
#[inline(always)]
pub fn eval<T: Real>(surface: &Surface<T>, energy: Energy, n: Vec3<T>, wo: Vec3<T>, wi: Vec3<T>) -> Vec3<T> {
    let lobes = surface.lobes();
    let compensation = Compensation::by(energy, &lobes, n.dot(wo));
    eval_lobes(&lobes, compensation.as_ref(), n, wo, wi)
}

/// Adjoint of [`eval`] for the gradient `g` of its result.
#[inline(always)]
pub fn eval_vjp<T: Real>(
    surface: &Surface<T>,
    energy: Energy,
    n: Vec3<T>,
    wo: Vec3<T>,
    wi: Vec3<T>,
    g: Vec3<T>,
) -> EvalGradient<T> {
    let lobes = surface.lobes();
    let compensation = Compensation::by(energy, &lobes, n.dot(wo));
    let (_, d) = eval_lobes_vjp(&lobes, compensation.as_ref(), n, wo, wi, g);
    EvalGradient { surface: surface.lobes_vjp(&d.lobes), n: d.n, wo: d.wo, wi: d.wi }
}

/// What compensation needs of a material and a viewer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Compensation<T> {
    pub(crate) albedo: SpecularAlbedo<T>,
    /// Scale and bias of the single scattering towards the viewer.
    pub(crate) viewer: SplitSum<T>,
}

impl<T: Real> Compensation<T> {
    /// For lobes seen under the cosine `nv`.
    #[inline]
    pub(crate) fn new(lobes: &Lobes<T>, nv: T) -> Self {
        let albedo = SpecularAlbedo::new(lobes.f0, lobes.f90, lobes.roughness);
        Self { albedo, viewer: split_sum(nv, lobes.roughness) }
    }

    /// [`Self::new`] where the policy asks for it.
    #[inline(always)]
    pub(crate) fn by(energy: Energy, lobes: &Lobes<T>, nv: T) -> Option<Self> {
        match energy {
            Energy::Single => None,
            Energy::Compensated => Some(Self::new(lobes, nv)),
        }
    }

    /// Value without cosine of the Lambertian lobe and of multiple scattering, for light under the cosine `nl`.
    #[inline]
    pub(crate) fn broad(&self, lobes: &Lobes<T>, nl: T) -> Vec3<T> {
        let light = split_sum(nl, lobes.roughness);
        self.albedo.broad(lobes.diffuse, &self.viewer, &light)
    }
}

/// [`eval`] on prepared lobes (one preparation serves many lights).
#[inline(always)]
pub(crate) fn eval_lobes<T: Real>(
    lobes: &Lobes<T>,
    compensation: Option<&Compensation<T>>,
    n: Vec3<T>,
    wo: Vec3<T>,
    wi: Vec3<T>,
) -> Vec3<T> {
    let nl = n.dot(wi);
    if nl > T::zero() {
        let half = Half::new(n, wo, wi);
        value(lobes, compensation, &Terms::in_world(lobes.roughness, n, wo, nl, &half))
    } else {
        Vec3::zero()
    }
}

/// BSDF times cosine from the terms of the specular lobe: the one formula of both renderers.
#[inline(always)]
pub(crate) fn value<T: Real>(
    lobes: &Lobes<T>,
    compensation: Option<&Compensation<T>>,
    t: &Terms<T>,
) -> Vec3<T> {
    let broad = match compensation {
        None => lobes.diffuse * (t.nl * T::of(std::f64::consts::FRAC_1_PI)),
        Some(c) => c.broad(lobes, t.nl) * t.nl,
    };
    broad + t.specular(lobes)
}

/// Value and adjoint of [`value`] by single scattering.
#[inline(always)]
fn single_vjp<T: Real>(
    lobes: &Lobes<T>,
    t: &Terms<T>,
    half: &Half<T>,
    n: Vec3<T>,
    wo: Vec3<T>,
    wi: Vec3<T>,
    g: Vec3<T>,
) -> (Vec3<T>, LobesEvalGradient<T>) {
    let inv_pi = T::of(std::f64::consts::FRAC_1_PI);
    let value = lobes.diffuse * (t.nl * inv_pi) + t.specular(lobes);
    let g_nl = g.dot(lobes.diffuse) * inv_pi;
    let mut d = t.specular_vjp(lobes, n, wo, wi, half, g, g_nl);
    d.lobes.diffuse = g * (t.nl * inv_pi);
    (value, d)
}

/// [`eval_lobes_vjp`] by single scattering without a branch, for many points side by side: where no light arrives, or it
/// cannot be told because the normal's cosine is not a number, value and gradients are zero.
#[inline(always)]
pub(crate) fn eval_single_vjp<T: Real>(
    lobes: &Lobes<T>,
    n: Vec3<T>,
    wo: Vec3<T>,
    wi: Vec3<T>,
    g: Vec3<T>,
) -> (Vec3<T>, LobesEvalGradient<T>) {
    let nl = n.dot(wi);
    let arrives = nl > T::zero();
    let half = Half::new(n, wo, wi);
    // Any positive cosine will do where nothing is kept.
    let t = Terms::in_world(lobes.roughness, n, wo, if arrives { nl } else { T::one() }, &half);
    let (value, d) = single_vjp(lobes, &t, &half, n, wo, wi, g);
    let kept = |x: T| if arrives { x } else { T::zero() };
    let Lobes { diffuse, f0, f90, roughness } = d.lobes;
    let (f90, roughness) = (kept(f90), kept(roughness));
    let lobes = Lobes { diffuse: diffuse.map(kept), f0: f0.map(kept), f90, roughness };
    let d = LobesEvalGradient { lobes, n: d.n.map(kept), wo: d.wo.map(kept), wi: d.wi.map(kept) };
    (value.map(kept), d)
}

/// Value and adjoint of [`eval_lobes`] for the gradient `g` of the value.
#[inline(always)]
pub(crate) fn eval_lobes_vjp<T: Real>(
    lobes: &Lobes<T>,
    compensation: Option<&Compensation<T>>,
    n: Vec3<T>,
    wo: Vec3<T>,
    wi: Vec3<T>,
    g: Vec3<T>,
) -> (Vec3<T>, LobesEvalGradient<T>) {
    let nl = n.dot(wi);
    if nl <= T::zero() || nl.is_nan() {
        return (Vec3::zero(), LobesEvalGradient::default());
    }
    let half = Half::new(n, wo, wi);
    let t = Terms::in_world(lobes.roughness, n, wo, nl, &half);
    match compensation {
        None => single_vjp(lobes, &t, &half, n, wo, wi, g),
        Some(c) => {
            let light = split_sum(nl, lobes.roughness);
            let broad = c.albedo.broad(lobes.diffuse, &c.viewer, &light);
            let value = broad * nl + t.specular(lobes);
            let b = c.albedo.broad_vjp(lobes.diffuse, &c.viewer, &light, g * nl);
            let mut d = t.specular_vjp(lobes, n, wo, wi, &half, g, g.dot(broad) + b.cosines[1]);
            d.lobes += b.lobes;
            // `split_sum` is flat where it clamps `n.wo`.
            d.n += wo * b.cosines[0];
            d.wo += n * b.cosines[0];
            (value, d)
        }
    }
}
