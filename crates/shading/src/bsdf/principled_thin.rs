//! The thin principled model (Burley 2015, as in Mitsuba 3): a sheet without thickness whose reflection, transmission and
//! diffuse lobes are the same from both sides.
//!
//! With transmission `t`, the share `d` of diffuse light that passes, and base colour `c`:
//! `f = t F D G / (4 wo.z wi.z) + (1 - t)(1 - d) (c / pi (f_d + f_r) + sheen F_d c_s)` on the viewer's side, and
//! `f = t c (1 - F) D' G' / (4 wo.z wi.z) + (1 - t) d c / pi` behind, where `D'` is the distribution of
//! `roughness (0.65 eta - 0.35)` for the light mirrored to the viewer's side.

use super::fresnel::fresnel_dielectric;
use super::principled::{matte, mix, schlick, stretched, tint};
use super::refraction::{Facets, reflect, reflection};
use super::{BsdfSample, Microfacet, Scatter, mirror_z, weighted};
use photofit_sampling::cosine_hemisphere;
use photofit_scalar::{Real, Vec3};

/// Least probability of reflection and of transmission, of what is not diffuse.
const LEAST: f64 = 0.1;

/// Parameters of [`PrincipledThin`], each in `[0, 1]` unless noted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrincipledThinParameters<T = f32> {
    /// Colour of the sheet.
    pub base_color: Vec3<T>,
    /// Perceptual roughness; its square is alpha.
    pub roughness: T,
    /// Stretch of highlights along x.
    pub anisotropic: T,
    /// Share of light that is reflected and passes as by a pane; the rest is diffuse.
    pub spec_trans: T,
    /// Share of diffuse light that passes: half of Mitsuba's `diff_trans`.
    pub diff_trans: T,
    /// Tint of the reflection towards the base colour.
    pub spec_tint: T,
    /// Sheen at grazing angles.
    pub sheen: T,
    /// Tint of the sheen towards the base colour.
    pub sheen_tint: T,
    /// Blend towards a flatter diffuse lobe.
    pub flatness: T,
    /// Index of refraction, greater than 1.
    pub eta: T,
}

/// The model; see the [module documentation](super) for the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrincipledThin<T = f32> {
    p: PrincipledThinParameters<T>,
    reflecting: Microfacet<T>,
    passing: Microfacet<T>,
}

impl<T: Real> PrincipledThin<T> {
    /// The model of these parameters.
    #[inline]
    pub fn new(p: &PrincipledThinParameters<T>) -> Self {
        let scale = (T::of(0.65) * p.eta - T::of(0.35)).relu();
        Self {
            p: *p,
            reflecting: stretched(p.roughness, p.anisotropic),
            passing: stretched(p.roughness * scale, p.anisotropic),
        }
    }

    /// Whether highlights are stretched: x matters.
    pub fn is_anisotropic(&self) -> bool {
        self.p.anisotropic > T::zero()
    }

    /// Probability that what is not diffuse is reflected, seen from above.
    #[inline(always)]
    fn reflected(&self, wo: Vec3<T>) -> T {
        fresnel_dielectric(wo.z, self.p.eta).clamp_to(T::of(LEAST), T::of(1.0 - LEAST))
    }

    /// Fresnel term of the reflection.
    #[inline(always)]
    fn fresnel(&self, cosine: T) -> Vec3<T> {
        let (p, one) = (&self.p, T::one());
        let plain = Vec3::splat((one - p.spec_tint) * fresnel_dielectric(cosine, p.eta));
        if p.spec_tint <= T::zero() {
            return plain;
        }
        let ratio = (p.eta - one) / (p.eta + one);
        let tinted = tint(p.base_color).map(|c| mix(c * ratio * ratio, one, schlick(cosine)));
        plain + tinted * p.spec_tint
    }

    /// Both directions above the sheet.
    #[inline(always)]
    fn same_side(&self, wo: Vec3<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        let (p, one) = (&self.p, T::one());
        let (mut value, mut pdf) = (Vec3::zero(), T::zero());
        let (matt, stays) = (one - p.spec_trans, one - p.diff_trans);
        if matt > T::zero() && stays > T::zero() {
            let half = wi.dot((wo + wi).normalize_or_zero());
            let lambert = wi.z * T::of(std::f64::consts::FRAC_1_PI);
            let lobe = matte(p.roughness, p.flatness, [wo.z, wi.z, half]);
            value += p.base_color * (matt * stays * lobe * lambert);
            let sheen = tint(p.base_color).map(|t| mix(one, t, p.sheen_tint));
            value += sheen * (p.sheen * matt * stays * wi.z * schlick(half));
            pdf += matt * stays * lambert;
        }
        if p.spec_trans > T::zero()
            && let Some(e) = reflection(&self.reflecting, wo, wi)
        {
            value += self.fresnel(e.cosine) * (p.spec_trans * e.value);
            pdf += p.spec_trans * self.reflected(wo) * e.pdf;
        }
        (value, pdf)
    }

    /// `wo` above the sheet; `mirrored` is the direction below, mirrored to above.
    #[inline(always)]
    fn other_side(&self, wo: Vec3<T>, mirrored: Vec3<T>) -> (Vec3<T>, T) {
        let (p, one) = (&self.p, T::one());
        let matt = (one - p.spec_trans) * p.diff_trans;
        let lambert = mirrored.z * T::of(std::f64::consts::FRAC_1_PI);
        let (mut value, mut pdf) = (p.base_color * (matt * lambert), matt * lambert);
        if p.spec_trans > T::zero()
            && let Some(e) = reflection(&self.passing, wo, mirrored)
        {
            // Light passes from one side of the microfacet to the other.
            let m = (wo + mirrored).normalize_or_zero();
            if mirror_z(mirrored).dot(m) < T::zero() {
                let t = one - fresnel_dielectric(e.cosine, p.eta);
                value += p.base_color * (p.spec_trans * t * e.value);
            }
            pdf += p.spec_trans * (one - self.reflected(wo)) * e.pdf;
        }
        (value, pdf)
    }
}

impl<T: Real> Scatter<T> for PrincipledThin<T> {
    #[inline]
    fn eval_pdf(&self, wo: Vec3<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        let zero = T::zero();
        let (wo, wi) = if wo.z < zero { (mirror_z(wo), mirror_z(wi)) } else { (wo, wi) };
        if wo.z > zero && wi.z > zero {
            self.same_side(wo, wi)
        } else if wo.z > zero && wi.z < zero {
            self.other_side(wo, mirror_z(wi))
        } else {
            (Vec3::zero(), zero)
        }
    }

    #[inline]
    fn sample(&self, wo: Vec3<T>, lobe: T, u: [T; 2]) -> Option<BsdfSample<T>> {
        let (zero, one) = (T::zero(), T::one());
        let below = wo.z < zero;
        let up = if below { mirror_z(wo) } else { wo };
        if up.z <= zero || up.z.is_nan() {
            return None;
        }
        let matt = one - self.p.spec_trans;
        let (wi, passes) = if lobe < matt {
            (cosine_hemisphere(u), lobe < matt * self.p.diff_trans)
        } else {
            let passes = lobe >= matt + self.p.spec_trans * self.reflected(up);
            let surface = if passes { &self.passing } else { &self.reflecting };
            (reflect(up, surface.sample(up, u)), passes)
        };
        if wi.z <= zero || wi.z.is_nan() {
            return None;
        }
        let found = if passes { self.other_side(up, wi) } else { self.same_side(up, wi) };
        let wi = if passes != below { mirror_z(wi) } else { wi };
        weighted(wi, found, one)
    }

    #[inline]
    fn transmits(&self) -> bool {
        true
    }

    #[inline]
    fn albedo(&self, wo: Vec3<T>) -> Vec3<T> {
        let f = self.fresnel(wo.z.abs());
        let plain = T::one() - fresnel_dielectric(wo.z.abs(), self.p.eta);
        let matt = T::one() - self.p.spec_trans;
        f * self.p.spec_trans + self.p.base_color * (matt + self.p.spec_trans * plain)
    }
}
