//! The principled model of Burley (2012), reflection only, with the conventions of Mitsuba 3: exact dielectric Fresnel
//! for the untinted part, separable masking, a clear coat of Berry's distribution (GTR1).
//!
//! `f = (1 - m) c / pi (f_d + f_r) + sheen (1 - m) F_d c_s + F D G / (4 wo.z wi.z) + coat / 4 F_c D_c G_c` with metallic
//! `m`, base colour `c`, the diffuse term `f_d = (1 - F_o / 2)(1 - F_i / 2)` and retro-reflection
//! `f_r = R (F_o + F_i + F_o F_i (R - 1))`, `R = 2 roughness cos^2 theta_d`; `F_x = (1 - cos theta_x)^5`.

use super::fresnel::fresnel_dielectric;
use super::refraction::{Facets, reflect, reflection, refracted_cosine};
use super::{BsdfSample, Distribution, Masking, Microfacet, Scatter, weighted};
use photofit_sampling::cosine_hemisphere;
use photofit_scalar::{Real, Vec3, vec3};

/// Smallest alpha of the main reflection.
const ALPHA_MIN: f64 = 0.001;
/// Alpha of the masking of the coat.
const COAT_MASKING: f64 = 0.25;
/// Reflectance of the coat at normal incidence.
const COAT_F0: f64 = 0.04;

/// Parameters of [`Principled`], each in `[0, 1]` unless noted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrincipledParameters<T = f32> {
    /// Colour of the base.
    pub base_color: Vec3<T>,
    /// Perceptual roughness; its square is alpha.
    pub roughness: T,
    /// Stretch of highlights along x.
    pub anisotropic: T,
    /// Share of metal.
    pub metallic: T,
    /// Tint of the dielectric reflection towards the base colour.
    pub spec_tint: T,
    /// Sheen at grazing angles.
    pub sheen: T,
    /// Tint of the sheen towards the base colour.
    pub sheen_tint: T,
    /// Blend towards a flatter diffuse lobe (Hanrahan and Krueger's approximation of subsurface scattering).
    pub flatness: T,
    /// Strength of the clear coat.
    pub clearcoat: T,
    /// Gloss of the clear coat: its alpha runs from 0.1 to 0.001.
    pub clearcoat_gloss: T,
    /// Index of refraction, positive.
    pub eta: T,
}

/// The model, one-sided; see the [module documentation](super) for the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Principled<T = f32> {
    p: PrincipledParameters<T>,
    surface: Microfacet<T>,
    /// Squared alpha of the coat.
    coat_alpha2: T,
}

/// `(1 - c)^5`.
#[inline(always)]
fn schlick<T: Real>(c: T) -> T {
    let m = (T::one() - c).clamp_to(T::zero(), T::one());
    let m2 = m * m;
    m2 * m2 * m
}

/// From `a` to `b`.
#[inline(always)]
fn mix<T: Real>(a: T, b: T, t: T) -> T {
    a + (b - a) * t
}

impl<T: Real> Principled<T> {
    /// The model of these parameters.
    #[inline]
    pub fn new(p: &PrincipledParameters<T>) -> Self {
        let one = T::one();
        let (least, square) = (T::of(ALPHA_MIN), p.roughness * p.roughness);
        let aspect = (one - T::of(0.9) * p.anisotropic).sqrt();
        let surface = Microfacet {
            distribution: Distribution::Ggx,
            masking: Masking::Separable,
            alpha_x: (square / aspect).max(least),
            alpha_y: (square * aspect).max(least),
        };
        let coat = mix(T::of(0.1), T::of(ALPHA_MIN), p.clearcoat_gloss);
        Self { p: *p, surface, coat_alpha2: coat * coat }
    }

    /// The base colour over its luminance.
    #[inline(always)]
    fn tint(&self) -> Vec3<T> {
        let c = self.p.base_color;
        let l = T::of(0.2126) * c.x + T::of(0.7152) * c.y + T::of(0.0722) * c.z;
        if l > T::zero() { c / l } else { Vec3::splat(T::one()) }
    }

    /// Fresnel term of the main reflection for the cosine at the microfacet.
    #[inline(always)]
    fn fresnel(&self, cosine: T) -> Vec3<T> {
        let (p, one) = (&self.p, T::one());
        let dielectric = fresnel_dielectric(cosine, p.eta);
        // Into a thinner medium the weight follows the refracted direction.
        let grazing = if p.eta > one {
            schlick(cosine)
        } else {
            schlick(refracted_cosine(cosine, p.eta).unwrap_or(T::zero()))
        };
        let ratio = (p.eta - one) / (p.eta + one);
        let towards_white = |f0: Vec3<T>| f0.map(|x| mix(x, one, grazing));
        let mut out = Vec3::splat((one - p.metallic) * (one - p.spec_tint) * dielectric);
        out += towards_white(p.base_color) * p.metallic;
        if p.spec_tint > T::zero() {
            out += towards_white(self.tint() * (ratio * ratio)) * ((one - p.metallic) * p.spec_tint);
        }
        out
    }

    /// Density of the coat's microfacet normals.
    #[inline(always)]
    fn coat_d(&self, z: T) -> T {
        let a2 = self.coat_alpha2;
        let less = a2 - T::one();
        less / (T::of(std::f64::consts::PI) * a2.ln() * (T::one() + less * z * z))
    }

    /// Masking of one direction by the coat.
    #[inline(always)]
    fn coat_masking(v: Vec3<T>) -> T {
        let (one, a) = (T::one(), T::of(COAT_MASKING));
        let z2 = v.z * v.z;
        T::of(2.0) / (one + (one + a * a * (one - z2) / z2).sqrt())
    }

    /// Probabilities of the diffuse lobe and the coat; the rest is the main reflection.
    #[inline(always)]
    fn chosen(&self) -> (T, T) {
        let (diffuse, coat) = (T::one() - self.p.metallic, T::of(0.25) * self.p.clearcoat);
        let sum = T::one() + diffuse + coat;
        (diffuse / sum, coat / sum)
    }

    /// Diffuse lobe, retro-reflection and sheen, times the cosine.
    #[inline(always)]
    fn base(&self, wo: Vec3<T>, wi: Vec3<T>, half: T) -> Vec3<T> {
        let (p, one, two) = (&self.p, T::one(), T::of(2.0));
        let (fo, fi) = (schlick(wo.z), schlick(wi.z));
        let h = T::of(0.5);
        let retro = two * p.roughness * half * half;
        let mut value = (one - h * fi) * (one - h * fo) + retro * (fo + fi + fo * fi * (retro - one));
        if p.flatness > T::zero() {
            let f90 = h * retro;
            let f = mix(one, f90, fo) * mix(one, f90, fi);
            let flat = T::of(1.25) * (f * (one / (wo.z + wi.z) - h) + h);
            value = mix(value, flat, p.flatness);
        }
        let matte = (one - p.metallic) * wi.z;
        let mut out = p.base_color * (matte * value * T::of(std::f64::consts::FRAC_1_PI));
        if p.sheen > T::zero() {
            let color = self.tint().map(|t| mix(one, t, p.sheen_tint));
            out += color * (p.sheen * matte * schlick(half));
        }
        out
    }
}

impl<T: Real> Scatter<T> for Principled<T> {
    #[inline]
    fn eval_pdf(&self, wo: Vec3<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        let zero = T::zero();
        if !(wo.z > zero && wi.z > zero) {
            return (Vec3::zero(), zero);
        }
        let h = (wo + wi).normalize_or_zero();
        let half = wi.dot(h);
        let (diffuse, coat) = self.chosen();
        let mut value = Vec3::zero();
        let mut pdf = zero;
        if diffuse > zero {
            value += self.base(wo, wi, half);
            pdf += diffuse * wi.z * T::of(std::f64::consts::FRAC_1_PI);
        }
        if let Some(e) = reflection(&self.surface, wo, wi) {
            value += self.fresnel(e.cosine) * e.value;
            pdf += (T::one() - diffuse - coat) * e.pdf;
        }
        if coat > zero && half > zero {
            let d = self.coat_d(h.z);
            let f = mix(T::of(COAT_F0), T::one(), schlick(half));
            let g = Self::coat_masking(wo) * Self::coat_masking(wi);
            value += Vec3::splat(T::of(0.25) * self.p.clearcoat * f * d * g * wi.z);
            pdf += coat * d * h.z / (T::of(4.0) * half);
        }
        (value, pdf)
    }

    #[inline]
    fn sample(&self, wo: Vec3<T>, lobe: T, u: [T; 2]) -> Option<BsdfSample<T>> {
        if wo.z <= T::zero() || wo.z.is_nan() {
            return None;
        }
        let (diffuse, coat) = self.chosen();
        let wi = if lobe < diffuse {
            cosine_hemisphere(u)
        } else if lobe < diffuse + coat {
            let one = T::one();
            let a2 = self.coat_alpha2;
            let z2 = ((one - a2.powf(one - u[1])) / (one - a2)).clamp_to(T::zero(), one);
            let (sin, cos) = (T::of(2.0 * std::f64::consts::PI) * u[0]).sin_cos();
            let r = (one - z2).sqrt();
            reflect(wo, vec3(r * cos, r * sin, z2.sqrt()))
        } else {
            reflect(wo, self.surface.sample(wo, u))
        };
        weighted(wi, self.eval_pdf(wo, wi), T::one())
    }

    #[inline]
    fn is_delta(&self) -> bool {
        false
    }

    #[inline]
    fn transmits(&self) -> bool {
        false
    }

    #[inline]
    fn albedo(&self, wo: Vec3<T>) -> Vec3<T> {
        let f = self.fresnel(wo.z.abs());
        f + self.p.base_color * ((T::one() - self.p.metallic) * (T::one() - f.x))
    }
}
