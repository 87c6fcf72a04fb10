//! The principled model of Burley (2012 and 2015) with the conventions of Mitsuba 3: exact dielectric Fresnel for the
//! untinted part, separable masking, a clear coat of Berry's distribution (GTR1).
//!
//! `f = (1 - t)(1 - m) c / pi (f_d + f_r) + sheen (1 - m) F_d c_s + F D G / (4 wo.z wi.z) + coat / 4 F_c D_c G_c`, and
//! refraction with `(1 - m) t sqrt(c) (1 - F)`, with metallic `m`, transmission `t`, base colour `c`, the diffuse term
//! `f_d = (1 - F_o / 2)(1 - F_i / 2)` and retro-reflection `f_r = R (F_o + F_i + F_o F_i (R - 1))`,
//! `R = 2 roughness cos^2 theta_d`; `F_x = (1 - cos theta_x)^5`. Where nothing is refracted (`t = 0` or `m = 1`) the model
//! is one-sided; otherwise the surface bounds a solid that is seen from inside too, without coat and diffuse lobe.

use super::fresnel::fresnel_dielectric;
use super::refraction::{
    Facets, REFRACTION_DELTA, reflect, reflection, refract, refracted_cosine, refraction,
};
use super::{BsdfSample, Distribution, Masking, Microfacet, Scatter, mirror_z, weighted};
use photofit_sampling::cosine_hemisphere;
use photofit_scalar::{Real, Vec3, vec3};

/// Smallest alpha of the main reflection.
const ALPHA_MIN: f64 = 0.001;
/// Alpha of the masking of the coat.
const COAT_MASKING: f64 = 0.25;
/// Reflectance of the coat at normal incidence.
const COAT_F0: f64 = 0.04;
/// Index of refraction that stands for 1 where light is refracted: nothing else tells the sides apart.
const NEARLY_ONE: f64 = 1.001;

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
    /// Share of what is not metal that refracts light instead of scattering it diffusely.
    pub spec_trans: T,
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

/// The model; see the [module documentation](super) for the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Principled<T = f32> {
    p: PrincipledParameters<T>,
    surface: Microfacet<T>,
    /// Squared alpha of the coat.
    coat_alpha2: T,
}

/// `(1 - c)^5`.
#[inline(always)]
pub(super) fn schlick<T: Real>(c: T) -> T {
    let m = (T::one() - c).clamp_to(T::zero(), T::one());
    let m2 = m * m;
    m2 * m2 * m
}

/// From `a` to `b`.
#[inline(always)]
pub(super) fn mix<T: Real>(a: T, b: T, t: T) -> T {
    a + (b - a) * t
}

/// The colour over its luminance; white of black.
#[inline(always)]
pub(super) fn tint<T: Real>(c: Vec3<T>) -> Vec3<T> {
    let l = T::of(0.2126) * c.x + T::of(0.7152) * c.y + T::of(0.0722) * c.z;
    if l > T::zero() { c / l } else { Vec3::splat(T::one()) }
}

/// The surface of a roughness in `[0, 1]` whose highlights are stretched by `anisotropic`.
#[inline]
pub(super) fn stretched<T: Real>(roughness: T, anisotropic: T) -> Microfacet<T> {
    let (least, square) = (T::of(ALPHA_MIN), roughness * roughness);
    let aspect = (T::one() - T::of(0.9) * anisotropic).sqrt();
    Microfacet {
        distribution: Distribution::Ggx,
        masking: Masking::Separable,
        alpha_x: (square / aspect).max(least),
        alpha_y: (square * aspect).max(least),
    }
}

/// Diffuse lobe with retro-reflection over `c / pi`, for the cosines of both directions and their half angle.
#[inline(always)]
pub(super) fn matte<T: Real>(roughness: T, flatness: T, [o, i, half]: [T; 3]) -> T {
    let (one, h) = (T::one(), T::of(0.5));
    let (fo, fi) = (schlick(o), schlick(i));
    let retro = T::of(2.0) * roughness * half * half;
    let value = (one - h * fi) * (one - h * fo) + retro * (fo + fi + fo * fi * (retro - one));
    if flatness <= T::zero() {
        return value;
    }
    let f90 = h * retro;
    let f = mix(one, f90, fo) * mix(one, f90, fi);
    mix(value, T::of(1.25) * (f * (one / (o + i) - h) + h), flatness)
}

impl<T: Real> Principled<T> {
    /// The model of these parameters.
    #[inline]
    pub fn new(p: &PrincipledParameters<T>) -> Self {
        let one = T::one();
        let mut p = *p;
        let mut surface = stretched(p.roughness, p.anisotropic);
        if p.spec_trans > T::zero() && p.metallic < one {
            // Nearer to 1, the lobes that directions resolve would be wide ones.
            let (over, under) = (T::of(NEARLY_ONE), one / T::of(NEARLY_ONE));
            if p.eta > under && p.eta < over {
                p.eta = if p.eta < one { under } else { over };
            }
            // Refracted lobes that directions resolve.
            let least = T::of(REFRACTION_DELTA) / (p.eta - one).abs();
            surface.alpha_x = surface.alpha_x.max(least);
            surface.alpha_y = surface.alpha_y.max(least);
        }
        let coat = mix(T::of(0.1), T::of(ALPHA_MIN), p.clearcoat_gloss);
        Self { p, surface, coat_alpha2: coat * coat }
    }

    /// Whether highlights are stretched: x matters.
    pub fn is_anisotropic(&self) -> bool {
        self.p.anisotropic > T::zero()
    }

    /// Share of refraction.
    #[inline(always)]
    fn refracted(&self) -> T {
        (T::one() - self.p.metallic) * self.p.spec_trans
    }

    /// Share of the diffuse lobe.
    #[inline(always)]
    fn diffuse(&self) -> T {
        (T::one() - self.p.metallic) * (T::one() - self.p.spec_trans)
    }

    /// The weight of Schlick's approximation: into a thinner medium it follows the refracted direction.
    #[inline(always)]
    fn grazing(&self, cosine: T) -> T {
        if self.p.eta > T::one() {
            schlick(cosine)
        } else {
            schlick(refracted_cosine(cosine, self.p.eta).unwrap_or(T::zero()))
        }
    }

    /// Fresnel term of the main reflection for the cosine at the microfacet.
    #[inline(always)]
    fn fresnel(&self, cosine: T) -> Vec3<T> {
        let (p, one) = (&self.p, T::one());
        let dielectric = fresnel_dielectric(cosine, p.eta);
        let grazing = self.grazing(cosine);
        let ratio = (p.eta - one) / (p.eta + one);
        let towards_white = |f0: Vec3<T>| f0.map(|x| mix(x, one, grazing));
        let mut out = Vec3::splat((one - p.metallic) * (one - p.spec_tint) * dielectric);
        out += towards_white(p.base_color) * p.metallic;
        if p.spec_tint > T::zero() {
            out += towards_white(tint(p.base_color) * (ratio * ratio)) * ((one - p.metallic) * p.spec_tint);
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

    /// Probabilities of the diffuse lobe and the coat, seen from outside; the rest is reflection and refraction.
    #[inline(always)]
    fn chosen(&self) -> (T, T) {
        let (diffuse, coat) = (self.diffuse(), T::of(0.25) * self.p.clearcoat);
        let sum = T::one() + diffuse + coat;
        (diffuse / sum, coat / sum)
    }

    /// Diffuse lobe, retro-reflection and sheen, times the cosine.
    #[inline(always)]
    fn base(&self, wo: Vec3<T>, wi: Vec3<T>, half: T) -> Vec3<T> {
        let p = &self.p;
        let value = matte(p.roughness, p.flatness, [wo.z, wi.z, half]);
        let mut out = p.base_color * (self.diffuse() * wi.z * value * T::of(std::f64::consts::FRAC_1_PI));
        if p.sheen > T::zero() {
            let color = tint(p.base_color).map(|t| mix(T::one(), t, p.sheen_tint));
            out += color * (p.sheen * (T::one() - p.metallic) * wi.z * schlick(half));
        }
        out
    }

    /// Reflection and refraction seen from inside: `wo` mirrored to above.
    #[inline(always)]
    fn inside(&self, wo: Vec3<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        let eta = T::one() / self.p.eta;
        if wi.z > T::zero() {
            let Some(e) = reflection(&self.surface, wo, wi) else { return (Vec3::zero(), T::zero()) };
            let f = fresnel_dielectric(e.cosine, eta);
            return (Vec3::splat(self.refracted() * f * e.value), f * e.pdf);
        }
        self.through(wo, wi, eta, T::one())
    }

    /// Refraction from above, where the surface is chosen with probability `chosen`.
    #[inline(always)]
    fn through(&self, wo: Vec3<T>, wi: Vec3<T>, eta: T, chosen: T) -> (Vec3<T>, T) {
        let Some(e) = refraction(&self.surface, wo, wi, eta) else { return (Vec3::zero(), T::zero()) };
        let t = T::one() - fresnel_dielectric(e.cosine, eta);
        let passed = self.refracted() * t / (eta * eta);
        (self.p.base_color.map(T::sqrt) * (passed * e.value), chosen * t * e.pdf)
    }
}

impl<T: Real> Scatter<T> for Principled<T> {
    #[inline]
    fn eval_pdf(&self, wo: Vec3<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        let (zero, refracted) = (T::zero(), self.refracted());
        if wo.z < zero && refracted > zero {
            return self.inside(mirror_z(wo), mirror_z(wi));
        }
        if wo.z > zero && wi.z < zero && refracted > zero {
            let (diffuse, coat) = self.chosen();
            return self.through(wo, wi, self.p.eta, (T::one() - diffuse - coat) * refracted);
        }
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
            let passed =
                if refracted > zero { T::one() - fresnel_dielectric(e.cosine, self.p.eta) } else { zero };
            pdf += (T::one() - diffuse - coat) * (T::one() - refracted * passed) * e.pdf;
        }
        if coat > zero && half > zero {
            let d = self.coat_d(h.z);
            let f = mix(T::of(COAT_F0), T::one(), self.grazing(half));
            let g = Self::coat_masking(wo) * Self::coat_masking(wi);
            value += Vec3::splat(T::of(0.25) * self.p.clearcoat * f * d * g * wi.z);
            pdf += coat * d * h.z / (T::of(4.0) * half);
        }
        (value, pdf)
    }

    #[inline]
    fn sample(&self, wo: Vec3<T>, lobe: T, u: [T; 2]) -> Option<BsdfSample<T>> {
        let (zero, one, refracted) = (T::zero(), T::one(), self.refracted());
        if wo.z < zero && refracted > zero {
            let (up, eta) = (mirror_z(wo), one / self.p.eta);
            let m = self.surface.sample(up, u);
            let passes = lobe >= fresnel_dielectric(up.dot(m), eta);
            let wi = if passes { refract(up, m, eta)? } else { reflect(up, m) };
            if (wi.z < zero) != passes {
                return None;
            }
            return weighted(mirror_z(wi), self.inside(up, wi), if passes { eta } else { one });
        }
        if wo.z <= zero || wo.z.is_nan() {
            return None;
        }
        let (diffuse, coat) = self.chosen();
        let wi = if lobe < diffuse {
            cosine_hemisphere(u)
        } else if lobe < diffuse + coat {
            let a2 = self.coat_alpha2;
            let z2 = ((one - a2.powf(one - u[1])) / (one - a2)).clamp_to(zero, one);
            let (sin, cos) = (T::of(2.0 * std::f64::consts::PI) * u[0]).sin_cos();
            let r = (one - z2).sqrt();
            reflect(wo, vec3(r * cos, r * sin, z2.sqrt()))
        } else {
            let m = self.surface.sample(wo, u);
            if refracted > zero {
                let rest = (lobe - diffuse - coat) / (one - diffuse - coat);
                if rest < refracted * (one - fresnel_dielectric(wo.dot(m), self.p.eta)) {
                    let wi = refract(wo, m, self.p.eta).filter(|wi| wi.z < zero)?;
                    return weighted(wi, self.eval_pdf(wo, wi), self.p.eta);
                }
            }
            reflect(wo, m)
        };
        if wi.z <= zero {
            return None;
        }
        weighted(wi, self.eval_pdf(wo, wi), one)
    }

    #[inline]
    fn transmits(&self) -> bool {
        self.refracted() > T::zero()
    }

    #[inline]
    fn eta(&self, wo: Vec3<T>) -> T {
        let (one, below) = (T::one(), wo.z < T::zero());
        match self.refracted() > T::zero() {
            false => one,
            true if below => one / self.p.eta,
            true => self.p.eta,
        }
    }

    #[inline]
    fn albedo(&self, wo: Vec3<T>) -> Vec3<T> {
        let f = self.fresnel(wo.z.abs());
        let rest = T::one() - f.x;
        f + (self.p.base_color * self.diffuse() + self.p.base_color.map(T::sqrt) * self.refracted()) * rest
    }
}
