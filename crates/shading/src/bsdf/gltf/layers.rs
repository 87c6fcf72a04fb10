//! The layered BSDF of a glTF material with extensions.

use super::glass::Glass;
use super::{GltfParameters, sheen};
use crate::bsdf::anisotropic;
use crate::bsdf::ggx::{Ggx, Reflection};
use crate::bsdf::refraction::{REFRACTION_DELTA, refracted_cosine, refraction};
use crate::bsdf::{ALPHA_DELTA, TransportMode, mirror_z};
use crate::energy::{Energy, SpecularAlbedo, schlick_weight};
use photofit_scalar::{Real, Vec3, vec3};

/// A glTF material with layers, transmission or anisotropy; made by [`GltfParameters::bsdf`].
///
/// What a material does not use is skipped by a bit of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GltfBsdf<T = f32> {
    pub(super) uses: u8,
    pub(super) energy: Energy,
    pub(super) mode: TransportMode,
    /// Albedo of the Lambertian lobe.
    pub(super) diffuse: Vec3<T>,
    /// Tint of the transmitted light: zero for opaque materials.
    pub(super) transmitted: Vec3<T>,
    /// Schlick's term of the reflection, dielectric and metal together.
    pub(super) f0: Vec3<T>,
    pub(super) f90: T,
    /// Schlick's term of the dielectric alone.
    pub(super) dielectric_f0: Vec3<T>,
    pub(super) dielectric_f90: T,
    pub(super) base: Ggx<T>,
    /// Cosine and sine of the direction of anisotropy.
    pub(super) direction: [T; 2],
    /// Part of the surface that refracts.
    pub(super) glass: T,
    /// Index of refraction of the volume.
    pub(super) ior: T,
    pub(super) coat: Coat<T>,
    pub(super) sheen_color: Vec3<T>,
    pub(super) sheen_roughness: T,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Coat<T> {
    pub(super) weight: T,
    pub(super) alpha: T,
    pub(super) normal: Vec3<T>,
}

/// Bits of `uses`.
pub(super) const TRANSMISSION: u8 = 1;
pub(super) const VOLUME: u8 = 2;
pub(super) const SHEEN: u8 = 4;
pub(super) const COAT: u8 = 8;
const ANISOTROPY: u8 = 16;
/// The microfacets of the base and of the coat are smooth; refraction is a delta lobe.
pub(super) const SMOOTH: u8 = 32;
pub(super) const SMOOTH_COAT: u8 = 64;
pub(super) const SMOOTH_REFRACTION: u8 = 128;

/// Reflectance of the coat at normal incidence (index 1.5).
const COAT_F0: f64 = 0.04;

/// Lobes in the order of their probabilities: the microfacets of the base, which reflect or transmit; what is sampled by
/// the cosine on either side; the layers.
pub(super) const MICROFACETS: usize = 0;
pub(super) const BROAD: usize = 1;
pub(super) const BROAD_TRANSMITTED: usize = 2;
pub(super) const SHEEN_LOBE: usize = 3;
const COAT_LOBE: usize = 4;

/// Least share of reflection where refraction alone is a delta lobe: microfacets that are seen at grazing angles
/// reflect more than the plane.
const REFLECTION_MIN: f64 = 0.05;

/// What depends on `wo` alone.
pub(super) struct Prepared<T> {
    /// Above the surface, along the axes of the anisotropy.
    pub(super) wo: Vec3<T>,
    /// The frame was mirrored: `wo` came from below.
    pub(super) mirrored: bool,
    /// `wo` lies inside of the volume.
    pub(super) inside: bool,
    /// Relative index of refraction of the other side; 1 for thin walls.
    pub(super) eta: T,
    pub(super) compensation: Option<Compensation<T>>,
    /// Multiple scattering at a boundary that refracts.
    pub(super) glass: Option<Glass<T>>,
    pub(super) coat_normal: Vec3<T>,
    /// Albedos of the layers times their weights.
    pub(super) sheen: T,
    pub(super) coat: T,
    pub(super) probability: [T; 5],
}

pub(super) struct Compensation<T> {
    albedo: SpecularAlbedo<T>,
    e_o: Vec3<T>,
    lost_o: T,
}

impl<T: Real> GltfBsdf<T> {
    /// The layered BSDF, also where a simpler one would do.
    #[inline]
    pub fn new(p: &GltfParameters<T>) -> Self {
        let (zero, one, delta) = (T::zero(), T::one(), T::of(ALPHA_DELTA));
        let base = p.base().lobes;
        let (dielectric_f0, dielectric_f90) = p.dielectric();
        let transmitted = base.diffuse * p.transmission;
        let transmits = transmitted != Vec3::zero();
        let (ax, ay) = p.alphas(transmits);
        let coat_roughness = p.clearcoat_roughness.relu();
        let coat =
            Coat { weight: p.clearcoat, alpha: coat_roughness * coat_roughness, normal: p.clearcoat_normal };
        let ior = if p.ior < one { T::of(1.5) } else { p.ior };
        let mut uses = 0;
        let mut set = |bit: u8, on: bool| uses |= if on { bit } else { 0 };
        set(TRANSMISSION, transmits);
        set(VOLUME, transmits && p.volume);
        set(SHEEN, p.sheen_color != Vec3::zero());
        set(COAT, p.clearcoat > zero);
        set(ANISOTROPY, ax != ay);
        set(SMOOTH, ax < delta);
        set(SMOOTH_COAT, coat.alpha < delta);
        set(SMOOTH_REFRACTION, ax < delta || p.volume && ax * (ior - one) < T::of(REFRACTION_DELTA));
        Self {
            uses,
            energy: p.energy,
            mode: p.mode,
            diffuse: base.diffuse - transmitted,
            transmitted,
            f0: base.f0,
            f90: base.f90,
            dielectric_f0,
            dielectric_f90,
            base: Ggx { ax, ay },
            direction: p.anisotropy_direction,
            glass: if p.volume { p.transmission * (one - p.metallic) } else { zero },
            ior,
            coat,
            sheen_color: p.sheen_color,
            sheen_roughness: p.sheen_roughness,
        }
    }

    #[inline(always)]
    pub(super) fn uses(&self, bits: u8) -> bool {
        self.uses & bits != 0
    }

    /// Albedos of the base's reflection for Schlick's `f0` and `f90`.
    #[inline(always)]
    pub(super) fn albedos(&self, f0: Vec3<T>, f90: T) -> SpecularAlbedo<T> {
        if self.uses(ANISOTROPY) && !self.uses(SMOOTH) {
            SpecularAlbedo::with_averages(f0, f90, self.base.ax.sqrt(), anisotropic::average(&self.base))
        } else {
            SpecularAlbedo::new(f0, f90, self.base.ax.sqrt())
        }
    }

    /// Albedo towards `v`, and what single scattering loses.
    #[inline(always)]
    pub(super) fn albedo_at(&self, albedo: &SpecularAlbedo<T>, v: Vec3<T>) -> (Vec3<T>, T) {
        if self.uses(ANISOTROPY) && !self.uses(SMOOTH) {
            albedo.of(anisotropic::directional(&self.base, v))
        } else {
            albedo.at(v.z.abs())
        }
    }

    /// To the axes of the anisotropy.
    #[inline(always)]
    pub(super) fn turn(&self, v: Vec3<T>) -> Vec3<T> {
        let [c, s] = self.direction;
        if self.uses(ANISOTROPY) { vec3(c * v.x + s * v.y, c * v.y - s * v.x, v.z) } else { v }
    }

    #[inline(always)]
    pub(super) fn turn_back(&self, v: Vec3<T>) -> Vec3<T> {
        let [c, s] = self.direction;
        if self.uses(ANISOTROPY) { vec3(c * v.x - s * v.y, c * v.y + s * v.x, v.z) } else { v }
    }

    /// Schlick's cosine: that on the side of the lower index, 0 at total internal reflection.
    #[inline(always)]
    fn schlick_cosine(&self, inside: bool, eta: T, c: T) -> T {
        if inside { refracted_cosine(c, eta).unwrap_or(T::zero()) } else { c }
    }

    /// Schlick's term of the reflection; total internal reflection is total.
    #[inline(always)]
    pub(super) fn fresnel(&self, inside: bool, eta: T, c: T) -> Vec3<T> {
        let p = schlick_weight(self.schlick_cosine(inside, eta, c));
        let f90 = if inside && p >= T::one() { T::one() } else { self.f90 };
        self.f0 * (T::one() - p) + Vec3::splat(f90 * p)
    }

    /// `1 - F` of the dielectric.
    #[inline(always)]
    pub(super) fn passed(&self, inside: bool, eta: T, c: T) -> Vec3<T> {
        let p = schlick_weight(self.schlick_cosine(inside, eta, c));
        let f90 = if inside && p >= T::one() { T::one() } else { self.dielectric_f90 };
        self.dielectric_f0.map(|f0| (T::one() - f0 * (T::one() - p) - f90 * p).relu())
    }

    /// Factor of refraction that carries `mode`.
    #[inline(always)]
    pub(super) fn scale(&self, eta: T) -> T {
        match self.mode {
            TransportMode::Radiance => T::one() / (eta * eta),
            TransportMode::Importance => T::one(),
        }
    }

    /// Index of refraction on the other side over that on the side of the viewer, who may look from below; 1 without
    /// volume.
    #[inline(always)]
    pub(super) fn eta_from(&self, below: bool) -> T {
        match (self.uses(VOLUME), below) {
            (false, _) => T::one(),
            (true, false) => self.ior,
            (true, true) => T::one() / self.ior,
        }
    }

    /// `None` where nothing is scattered towards `wo`.
    #[inline]
    pub(super) fn prepare(&self, wo: Vec3<T>) -> Option<Prepared<T>> {
        let zero = T::zero();
        let mirrored = wo.z < zero;
        let usable = wo.z > zero || mirrored && self.uses(TRANSMISSION);
        if !usable {
            return None;
        }
        let inside = mirrored && self.uses(VOLUME);
        let eta = self.eta_from(mirrored);
        let flip = |v: Vec3<T>| if mirrored { mirror_z(v) } else { v };
        let wo = self.turn(flip(wo));
        let coat_normal = self.turn(flip(self.coat.normal));
        let compensated = self.energy == Energy::Compensated;
        let compensation = (compensated && !inside).then(|| {
            let albedo = self.albedos(self.f0, self.f90);
            let (e_o, lost_o) = self.albedo_at(&albedo, wo);
            Compensation { albedo, e_o, lost_o }
        });
        let glass = (compensated && self.uses(VOLUME) && !self.uses(SMOOTH_REFRACTION)).then(|| {
            let f0 = self.dielectric_f0.sum() * T::of(1.0 / 3.0);
            let alpha = (self.base.ax * self.base.ay).sqrt();
            Glass::new(f0, self.dielectric_f90, alpha, self.ior, inside, wo.z)
        });
        let mut p = Prepared {
            wo,
            mirrored,
            inside,
            eta,
            compensation,
            glass,
            coat_normal,
            sheen: if self.uses(SHEEN) { self.sheen_albedo(wo.z) } else { zero },
            coat: if self.uses(COAT) { self.coat_albedo(coat_normal.dot(wo)) } else { zero },
            probability: [zero; 5],
        };
        p.probability = self.probabilities(&p);
        Some(p)
    }

    /// Albedo of the sheen times the largest channel of its colour.
    #[inline(always)]
    fn sheen_albedo(&self, cosine: T) -> T {
        let c = self.sheen_color;
        sheen::albedo(cosine, self.sheen_roughness) * c.x.max(c.y).max(c.z)
    }

    /// Albedo of the coat times its weight.
    #[inline(always)]
    fn coat_albedo(&self, cosine: T) -> T {
        let coat = SpecularAlbedo::new(Vec3::splat(T::of(COAT_F0)), T::one(), self.coat.alpha.sqrt());
        self.coat.weight * coat.single(coat.at(cosine.abs())).x
    }

    #[inline(always)]
    pub(super) fn coat_fresnel(cosine: T) -> T {
        let f0 = T::of(COAT_F0);
        f0 + (T::one() - f0) * schlick_weight(cosine)
    }

    fn probabilities(&self, p: &Prepared<T>) -> [T; 5] {
        let (zero, one) = (T::zero(), T::one());
        let mut w = [zero; 5];
        let coat_cosine = p.coat_normal.dot(p.wo);
        let mut rest = one - p.coat;
        if self.uses(COAT) && !p.inside && coat_cosine > zero {
            w[COAT_LOBE] = T::of(3.0) * self.coat.weight * Self::coat_fresnel(coat_cosine);
        }
        if self.uses(SHEEN) && !p.inside {
            w[SHEEN_LOBE] = rest * self.sheen_color.sum() * sheen::albedo(p.wo.z, self.sheen_roughness);
        }
        rest *= one - p.sheen;
        let passed = self.passed(p.inside, p.eta, p.wo.z);
        let transmitted = self.transmitted.mul(passed).sum();
        match &p.compensation {
            None => {
                w[MICROFACETS] = rest * (self.fresnel(p.inside, p.eta, p.wo.z).sum() + transmitted);
                w[BROAD] = rest * self.diffuse.sum();
            }
            Some(c) => {
                let multiple = (c.albedo.multiple_albedo(c.lost_o) * (one - self.glass)).sum();
                let left = c.e_o.map(|e| (one - e).relu());
                w[MICROFACETS] = rest * (c.albedo.single((c.e_o, c.lost_o)).sum() + transmitted);
                w[BROAD] = rest * (multiple + self.diffuse.mul(left).sum());
                if !self.uses(VOLUME) {
                    w[BROAD_TRANSMITTED] = rest * self.transmitted.sum() * c.lost_o;
                }
            }
        }
        if let Some(glass) = &p.glass {
            let [reflected, passed] = glass.albedo();
            w[BROAD] += rest * T::of(3.0) * self.glass * reflected;
            w[BROAD_TRANSMITTED] += rest * self.transmitted.sum() * passed;
        }
        let sum: T = w.into_iter().sum();
        if sum > zero {
            w.map(|w| w / sum)
        } else {
            w[MICROFACETS] = one;
            w
        }
    }

    /// Probability that a microfacet seen under a cosine reflects.
    #[inline(always)]
    pub(super) fn reflected_share(&self, p: &Prepared<T>, cosine: T) -> T {
        if !self.uses(TRANSMISSION) {
            return T::one();
        }
        let straight = self.uses(SMOOTH_REFRACTION) && !self.uses(SMOOTH);
        let cosine = if straight { p.wo.z } else { cosine };
        let reflected = self.fresnel(p.inside, p.eta, cosine).sum();
        let passed = self.transmitted.mul(self.passed(p.inside, p.eta, cosine)).sum();
        let sum = reflected + passed;
        let share = if sum > T::zero() { reflected / sum } else { T::one() };
        if straight { share.max(T::of(REFLECTION_MIN)) } else { share }
    }

    /// Part of the base that the layers leave, for `wi` along the axes of the anisotropy.
    #[inline(always)]
    pub(super) fn below_layers(&self, p: &Prepared<T>, wi: Vec3<T>) -> T {
        let mut rest = T::one();
        if self.uses(SHEEN) {
            rest *= T::one() - p.sheen.max(self.sheen_albedo(wi.z.abs()));
        }
        if self.uses(COAT) {
            rest *= T::one() - p.coat.max(self.coat_albedo(p.coat_normal.dot(wi)));
        }
        rest
    }

    /// [`Self::below_layers`] for directions in the local frame; 0 where nothing is scattered.
    pub(in crate::bsdf) fn left_by_layers(&self, wo: Vec3<T>, wi: Vec3<T>) -> T {
        match self.prepare(wo) {
            Some(p) => self.below_layers(&p, self.turn(if p.mirrored { mirror_z(wi) } else { wi })),
            None => T::zero(),
        }
    }

    /// Value and density, for `wi` in the frame of `Prepared::wo`.
    pub(super) fn evaluate(&self, p: &Prepared<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        if wi.z > T::zero() {
            self.evaluate_reflection(p, wi)
        } else if wi.z < T::zero() && self.uses(TRANSMISSION) {
            self.evaluate_transmission(p, wi)
        } else {
            (Vec3::zero(), T::zero())
        }
    }

    #[inline(always)]
    fn evaluate_reflection(&self, p: &Prepared<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        let (zero, one) = (T::zero(), T::one());
        let inv_pi = T::of(std::f64::consts::FRAC_1_PI);
        let mut value = match &p.compensation {
            None if p.inside => {
                // Total internal reflection leaves nothing for the Lambertian lobe.
                let (o, i) = (self.fresnel(true, p.eta, p.wo.z), self.fresnel(true, p.eta, wi.z));
                self.diffuse.mul(o.max(i).map(|f| (one - f).relu())) * inv_pi
            }
            None => self.diffuse * inv_pi,
            Some(c) => {
                let (e_i, lost_i) = self.albedo_at(&c.albedo, wi);
                let multiple = c.albedo.multiple(c.lost_o, lost_i) * (one - self.glass);
                self.diffuse.mul(c.albedo.below(c.e_o, e_i)) * inv_pi + multiple
            }
        } * wi.z;
        if let Some(glass) = &p.glass {
            value += Vec3::splat(self.glass * glass.value(wi.z, false) * wi.z);
        }
        let mut pdf = p.probability[BROAD] * wi.z * inv_pi;
        if !self.uses(SMOOTH) {
            let r = self.base.reflection(p.wo, wi);
            value += self.fresnel(p.inside, p.eta, r.cosine) * (r.value * wi.z);
            pdf += p.probability[MICROFACETS] * self.reflected_share(p, r.cosine) * r.pdf;
        }
        if !self.uses(SHEEN | COAT) {
            return (value, pdf);
        }
        // From the inside out, as in `below_layers`.
        if self.uses(SHEEN) {
            value *= one - p.sheen.max(self.sheen_albedo(wi.z));
            if !p.inside {
                value += self.sheen_color * (sheen::value(self.sheen_roughness, p.wo, wi) * wi.z);
                pdf += p.probability[SHEEN_LOBE] * T::of(0.5) * inv_pi;
            }
        }
        if self.uses(COAT) {
            let (co, ci) = (p.coat_normal.dot(p.wo), p.coat_normal.dot(wi));
            value *= one - p.coat.max(self.coat_albedo(ci));
            if !p.inside && !self.uses(SMOOTH_COAT) && co > zero && ci > zero {
                let r = self.coat_reflection(p, wi, co, ci);
                value += Vec3::splat(self.coat.weight * Self::coat_fresnel(r.cosine) * r.value * ci);
                pdf += p.probability[COAT_LOBE] * r.pdf;
            }
        }
        (value, pdf)
    }

    /// Reflection by the coat: about its own normal.
    #[inline(always)]
    fn coat_reflection(&self, p: &Prepared<T>, wi: Vec3<T>, co: T, ci: T) -> Reflection<T> {
        let n = p.coat_normal;
        let (s, t) = n.orthonormal_pair();
        let local = |v: Vec3<T>, cosine: T| vec3(s.dot(v), t.dot(v), cosine);
        Ggx::isotropic(self.coat.alpha).reflection(local(p.wo, co), local(wi, ci))
    }

    #[inline(always)]
    fn evaluate_transmission(&self, p: &Prepared<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        let inv_pi = T::of(std::f64::consts::FRAC_1_PI);
        let (mut value, mut pdf) = (Vec3::zero(), T::zero());
        let thin = !self.uses(VOLUME);
        if thin && !self.uses(SMOOTH) {
            let r = self.base.reflection(p.wo, mirror_z(wi));
            value = self.transmitted.mul(self.passed(false, p.eta, r.cosine)) * (r.value * -wi.z);
            pdf = p.probability[MICROFACETS] * (T::one() - self.reflected_share(p, r.cosine)) * r.pdf;
        } else if !thin
            && !self.uses(SMOOTH_REFRACTION)
            && let Some(r) = refraction(&self.base, p.wo, wi, p.eta)
        {
            let passed = self.passed(p.inside, p.eta, r.cosine);
            value = self.transmitted.mul(passed) * (r.value * self.scale(p.eta));
            pdf = p.probability[MICROFACETS] * (T::one() - self.reflected_share(p, r.cosine)) * r.pdf;
        }
        if let Some(glass) = &p.glass {
            value += self.transmitted * (glass.value(-wi.z, true) * self.scale(p.eta) * -wi.z);
            pdf += p.probability[BROAD_TRANSMITTED] * -wi.z * inv_pi;
        }
        if let Some(c) = p.compensation.as_ref().filter(|_| thin) {
            let (_, lost_i) = self.albedo_at(&c.albedo, wi);
            let value_here = c.albedo.multiple_passed(c.lost_o, lost_i);
            value += self.transmitted.mul(value_here) * -wi.z;
            pdf += p.probability[BROAD_TRANSMITTED] * -wi.z * inv_pi;
        }
        (value * self.below_layers(p, wi), pdf)
    }
}
