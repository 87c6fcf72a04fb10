//! The layered BSDF of a glTF material with extensions.

use super::{GltfParameters, sheen};
use crate::bsdf::anisotropic;
use crate::bsdf::energy::{Energy, SpecularAlbedo, schlick_weight};
use crate::bsdf::ggx::{Ggx, Reflection};
use crate::bsdf::refraction::{Facets, REFRACTION_DELTA, reflect, refract, refracted_cosine, refraction};
use crate::bsdf::{ALPHA_DELTA, BsdfSample, Scatter, TransportMode, mirror_z, reflect_z, weighted};
use photofit_sampling::{cosine_hemisphere, uniform_hemisphere};
use photofit_scalar::{Real, Vec3, vec3};

/// A glTF material with layers, transmission or anisotropy; made by [`GltfParameters::bsdf`].
///
/// What a material does not use is skipped by a bit of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GltfBsdf<T = f32> {
    uses: u8,
    energy: Energy,
    mode: TransportMode,
    /// Albedo of the Lambertian lobe.
    diffuse: Vec3<T>,
    /// Tint of the transmitted light: zero for opaque materials.
    transmitted: Vec3<T>,
    /// Schlick's term of the reflection, dielectric and metal together.
    f0: Vec3<T>,
    f90: T,
    /// Schlick's term of the dielectric alone.
    dielectric_f0: Vec3<T>,
    dielectric_f90: T,
    base: Ggx<T>,
    /// Cosine and sine of the direction of anisotropy.
    direction: [T; 2],
    /// Index of refraction of the volume.
    ior: T,
    coat: Coat<T>,
    sheen_color: Vec3<T>,
    sheen_roughness: T,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Coat<T> {
    weight: T,
    alpha: T,
    normal: Vec3<T>,
}

/// Bits of `uses`.
const TRANSMISSION: u8 = 1;
const VOLUME: u8 = 2;
const SHEEN: u8 = 4;
const COAT: u8 = 8;
const ANISOTROPY: u8 = 16;
/// The microfacets of the base and of the coat are smooth; refraction is a delta lobe.
const SMOOTH: u8 = 32;
const SMOOTH_COAT: u8 = 64;
const SMOOTH_REFRACTION: u8 = 128;

/// Reflectance of the coat at normal incidence (index 1.5).
const COAT_F0: f64 = 0.04;

/// Lobes in the order of their probabilities.
const BROAD: usize = 0;
const REFLECTION: usize = 1;
const TRANSMITTED: usize = 2;
const BROAD_TRANSMITTED: usize = 3;
const SHEEN_LOBE: usize = 4;
const COAT_LOBE: usize = 5;

/// What depends on `wo` alone.
struct Prepared<T> {
    /// Above the surface, along the axes of the anisotropy.
    wo: Vec3<T>,
    /// The frame was mirrored: `wo` came from below.
    mirrored: bool,
    /// `wo` lies inside of the volume.
    inside: bool,
    /// Relative index of refraction of the other side; 1 for thin walls.
    eta: T,
    compensation: Option<Compensation<T>>,
    coat_normal: Vec3<T>,
    /// Albedos of the layers times their weights.
    sheen: T,
    coat: T,
    probability: [T; 6],
}

struct Compensation<T> {
    albedo: SpecularAlbedo<T>,
    e_o: Vec3<T>,
    lost_o: T,
}

impl<T: Real> GltfBsdf<T> {
    /// The layered BSDF, also where a simpler one would do.
    #[inline]
    pub fn new(p: &GltfParameters<T>) -> Self {
        let (zero, one, delta) = (T::zero(), T::one(), T::of(ALPHA_DELTA));
        let base = p.base();
        let (dielectric_f0, dielectric_f90) = p.dielectric();
        let (ax, ay) = p.alphas();
        let transmitted = base.diffuse * p.transmission;
        let coat_roughness = p.clearcoat_roughness.relu();
        let coat =
            Coat { weight: p.clearcoat, alpha: coat_roughness * coat_roughness, normal: p.clearcoat_normal };
        let ior = if p.ior < one { T::of(1.5) } else { p.ior };
        let mut uses = 0;
        let mut set = |bit: u8, on: bool| uses |= if on { bit } else { 0 };
        let transmits = transmitted != Vec3::zero();
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
            ior,
            coat,
            sheen_color: p.sheen_color,
            sheen_roughness: p.sheen_roughness,
        }
    }

    #[inline(always)]
    fn uses(&self, bits: u8) -> bool {
        self.uses & bits != 0
    }

    /// Albedos of the base's reflection for Schlick's `f0` and `f90`.
    #[inline(always)]
    fn albedos(&self, f0: Vec3<T>, f90: T) -> SpecularAlbedo<T> {
        if self.uses(ANISOTROPY) && !self.uses(SMOOTH) {
            SpecularAlbedo::with_averages(f0, f90, self.base.ax, anisotropic::average(&self.base))
        } else {
            SpecularAlbedo::new(f0, f90, self.base.ax)
        }
    }

    /// Albedo towards `v`, and what single scattering loses.
    #[inline(always)]
    fn albedo_at(&self, albedo: &SpecularAlbedo<T>, v: Vec3<T>) -> (Vec3<T>, T) {
        if self.uses(ANISOTROPY) && !self.uses(SMOOTH) {
            albedo.of(anisotropic::directional(&self.base, v))
        } else {
            albedo.at(v.z.abs())
        }
    }

    /// To the axes of the anisotropy.
    #[inline(always)]
    fn turn(&self, v: Vec3<T>) -> Vec3<T> {
        let [c, s] = self.direction;
        if self.uses(ANISOTROPY) { vec3(c * v.x + s * v.y, c * v.y - s * v.x, v.z) } else { v }
    }

    #[inline(always)]
    fn turn_back(&self, v: Vec3<T>) -> Vec3<T> {
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
    fn fresnel(&self, inside: bool, eta: T, c: T) -> Vec3<T> {
        let p = schlick_weight(self.schlick_cosine(inside, eta, c));
        let f90 = if inside && p >= T::one() { T::one() } else { self.f90 };
        self.f0 * (T::one() - p) + Vec3::splat(f90 * p)
    }

    /// `1 - F` of the dielectric.
    #[inline(always)]
    fn passed(&self, inside: bool, eta: T, c: T) -> Vec3<T> {
        let p = schlick_weight(self.schlick_cosine(inside, eta, c));
        let f90 = if inside && p >= T::one() { T::one() } else { self.dielectric_f90 };
        self.dielectric_f0.map(|f0| (T::one() - f0 * (T::one() - p) - f90 * p).relu())
    }

    /// Factor of refraction that carries `mode`.
    #[inline(always)]
    fn scale(&self, eta: T) -> T {
        match self.mode {
            TransportMode::Radiance => T::one() / (eta * eta),
            TransportMode::Importance => T::one(),
        }
    }

    /// `None` where nothing is scattered towards `wo`.
    #[inline]
    fn prepare(&self, wo: Vec3<T>) -> Option<Prepared<T>> {
        let (zero, one) = (T::zero(), T::one());
        let mirrored = wo.z < zero;
        let usable = wo.z > zero || mirrored && self.uses(TRANSMISSION);
        if !usable {
            return None;
        }
        let inside = mirrored && self.uses(VOLUME);
        let eta = if !self.uses(VOLUME) {
            one
        } else if inside {
            one / self.ior
        } else {
            self.ior
        };
        let flip = |v: Vec3<T>| if mirrored { mirror_z(v) } else { v };
        let wo = self.turn(flip(wo));
        let coat_normal = self.turn(flip(self.coat.normal));
        let compensated = self.energy == Energy::Compensated && !self.uses(VOLUME);
        let compensation = compensated.then(|| {
            let albedo = self.albedos(self.f0, self.f90);
            let (e_o, lost_o) = self.albedo_at(&albedo, wo);
            Compensation { albedo, e_o, lost_o }
        });
        let mut p = Prepared {
            wo,
            mirrored,
            inside,
            eta,
            compensation,
            coat_normal,
            sheen: if self.uses(SHEEN) { self.sheen_albedo(wo.z) } else { zero },
            coat: if self.uses(COAT) { self.coat_albedo(coat_normal.dot(wo)) } else { zero },
            probability: [zero; 6],
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
        let coat = SpecularAlbedo::new(Vec3::splat(T::of(COAT_F0)), T::one(), self.coat.alpha);
        self.coat.weight * coat.single(coat.at(cosine.abs())).x
    }

    #[inline(always)]
    fn coat_fresnel(cosine: T) -> T {
        let f0 = T::of(COAT_F0);
        f0 + (T::one() - f0) * schlick_weight(cosine)
    }

    fn probabilities(&self, p: &Prepared<T>) -> [T; 6] {
        let (zero, one) = (T::zero(), T::one());
        let mut w = [zero; 6];
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
        w[TRANSMITTED] = rest * self.transmitted.mul(passed).sum();
        match &p.compensation {
            None => {
                w[REFLECTION] = rest * self.fresnel(p.inside, p.eta, p.wo.z).sum();
                w[BROAD] = rest * self.diffuse.sum();
            }
            Some(c) => {
                let multiple = c.albedo.multiple_albedo(c.lost_o).sum();
                let left = c.e_o.map(|e| (one - e).relu());
                w[REFLECTION] = rest * (c.e_o.sum() - multiple).relu();
                w[BROAD] = rest * (multiple + self.diffuse.mul(left).sum());
                w[BROAD_TRANSMITTED] = rest * self.transmitted.sum() * c.lost_o;
            }
        }
        let sum: T = w.into_iter().sum();
        if sum > zero {
            w.map(|w| w / sum)
        } else {
            w[REFLECTION] = one;
            w
        }
    }

    /// Part of the base that the layers leave, for `wi` along the axes of the anisotropy.
    #[inline(always)]
    fn below_layers(&self, p: &Prepared<T>, wi: Vec3<T>) -> T {
        let mut rest = T::one();
        if self.uses(SHEEN) {
            rest *= T::one() - p.sheen.max(self.sheen_albedo(wi.z.abs()));
        }
        if self.uses(COAT) {
            rest *= T::one() - p.coat.max(self.coat_albedo(p.coat_normal.dot(wi)));
        }
        rest
    }

    /// Value and density, for `wi` in the frame of `Prepared::wo`.
    fn evaluate(&self, p: &Prepared<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
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
                self.diffuse.mul(c.albedo.below(c.e_o, e_i)) * inv_pi + c.albedo.multiple(c.lost_o, lost_i)
            }
        } * wi.z;
        let mut pdf = p.probability[BROAD] * wi.z * inv_pi;
        if !self.uses(SMOOTH) {
            let r = self.base.reflection(p.wo, wi);
            value += self.fresnel(p.inside, p.eta, r.cosine) * (r.value * wi.z);
            pdf += p.probability[REFLECTION] * r.pdf;
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
            pdf = p.probability[TRANSMITTED] * r.pdf;
        } else if !thin
            && !self.uses(SMOOTH_REFRACTION)
            && let Some(r) = refraction(&self.base, p.wo, wi, p.eta)
        {
            let passed = self.passed(p.inside, p.eta, r.cosine);
            value = self.transmitted.mul(passed) * (r.value * self.scale(p.eta));
            pdf = p.probability[TRANSMITTED] * r.pdf;
        }
        if let Some(c) = &p.compensation {
            let (_, lost_i) = self.albedo_at(&c.albedo, wi);
            let value_here = c.albedo.multiple_passed(c.lost_o, lost_i);
            value += self.transmitted.mul(value_here) * -wi.z;
            pdf += p.probability[BROAD_TRANSMITTED] * -wi.z * inv_pi;
        }
        (value * self.below_layers(p, wi), pdf)
    }

    /// Weight and direction of a delta lobe, in the frame of `Prepared::wo`.
    fn delta(&self, p: &Prepared<T>, lobe: usize) -> Option<(Vec3<T>, Vec3<T>)> {
        let mirror = reflect_z(p.wo);
        match lobe {
            REFLECTION if self.uses(SMOOTH) => {
                let value = self.fresnel(p.inside, p.eta, p.wo.z);
                Some((mirror, value * self.below_layers(p, mirror)))
            }
            TRANSMITTED if self.uses(VOLUME) && self.uses(SMOOTH_REFRACTION) => {
                let up = vec3(T::zero(), T::zero(), T::one());
                let wi = refract(p.wo, up, p.eta)?;
                let passed = if self.uses(SMOOTH) {
                    self.passed(p.inside, p.eta, p.wo.z)
                } else {
                    let albedo = self.albedos(self.dielectric_f0, self.dielectric_f90);
                    albedo.single(self.albedo_at(&albedo, p.wo)).map(|e| (T::one() - e).relu())
                };
                let value = self.transmitted.mul(passed) * self.scale(p.eta);
                Some((wi, value * self.below_layers(p, wi)))
            }
            TRANSMITTED if !self.uses(VOLUME) && self.uses(SMOOTH) => {
                let value = self.transmitted.mul(self.passed(false, p.eta, p.wo.z));
                Some((-p.wo, value * self.below_layers(p, -p.wo)))
            }
            COAT_LOBE if self.uses(SMOOTH_COAT) => {
                let cosine = p.coat_normal.dot(p.wo);
                let value = self.coat.weight * Self::coat_fresnel(cosine);
                Some((reflect(p.wo, p.coat_normal), Vec3::splat(value)))
            }
            _ => None,
        }
    }

    /// Whether a lobe is a delta lobe.
    #[inline(always)]
    fn is_delta_lobe(&self, lobe: usize) -> bool {
        match lobe {
            REFLECTION => self.uses(SMOOTH),
            TRANSMITTED if self.uses(VOLUME) => self.uses(SMOOTH_REFRACTION),
            TRANSMITTED => self.uses(SMOOTH),
            COAT_LOBE => self.uses(SMOOTH_COAT),
            _ => false,
        }
    }

    /// A direction of a lobe that is no delta lobe, in the frame of `Prepared::wo`.
    fn sample_lobe(&self, p: &Prepared<T>, lobe: usize, u: [T; 2]) -> Option<Vec3<T>> {
        Some(match lobe {
            BROAD => cosine_hemisphere(u),
            REFLECTION => reflect(p.wo, self.base.sample(p.wo, u)),
            TRANSMITTED if self.uses(VOLUME) => refract(p.wo, self.base.sample(p.wo, u), p.eta)?,
            TRANSMITTED => mirror_z(reflect(p.wo, self.base.sample(p.wo, u))),
            BROAD_TRANSMITTED => mirror_z(cosine_hemisphere(u)),
            SHEEN_LOBE => uniform_hemisphere(u),
            _ => {
                let n = p.coat_normal;
                let (s, t) = n.orthonormal_pair();
                let wo = vec3(s.dot(p.wo), t.dot(p.wo), n.dot(p.wo));
                let wi = reflect(wo, Ggx::isotropic(self.coat.alpha).sample(wo, u));
                s * wi.x + t * wi.y + n * wi.z
            }
        })
    }
}

impl<T: Real> Scatter<T> for GltfBsdf<T> {
    #[inline]
    fn eval_pdf(&self, wo: Vec3<T>, wi: Vec3<T>) -> (Vec3<T>, T) {
        match self.prepare(wo) {
            None => (Vec3::zero(), T::zero()),
            Some(p) => self.evaluate(&p, self.turn(if p.mirrored { mirror_z(wi) } else { wi })),
        }
    }

    #[inline]
    fn sample(&self, wo: Vec3<T>, lobe: T, u: [T; 2]) -> Option<BsdfSample<T>> {
        let p = self.prepare(wo)?;
        let chosen = choose(&p.probability, lobe);
        let transmits = chosen == TRANSMITTED || chosen == BROAD_TRANSMITTED;
        let eta = if transmits { p.eta } else { T::one() };
        let right_side = |wi: Vec3<T>| if transmits { wi.z < T::zero() } else { wi.z > T::zero() };
        let out = |wi: Vec3<T>| {
            let wi = self.turn_back(wi);
            if p.mirrored { mirror_z(wi) } else { wi }
        };
        if self.is_delta_lobe(chosen) {
            let (wi, value) = self.delta(&p, chosen).filter(|(wi, _)| right_side(*wi))?;
            let weight = value / p.probability[chosen];
            return Some(BsdfSample { wi: out(wi), weight, pdf: T::one(), delta: true, eta });
        }
        let wi = self.sample_lobe(&p, chosen, u).filter(|wi| right_side(*wi))?;
        weighted(wi, self.evaluate(&p, wi), eta).map(|s| BsdfSample { wi: out(s.wi), ..s })
    }

    #[inline]
    fn is_delta(&self) -> bool {
        let coat = !self.uses(COAT) || self.uses(SMOOTH_COAT);
        self.uses(SMOOTH) && self.diffuse == Vec3::zero() && !self.uses(SHEEN) && coat
    }

    #[inline]
    fn transmits(&self) -> bool {
        self.uses(TRANSMISSION)
    }

    fn albedo(&self, wo: Vec3<T>) -> Vec3<T> {
        let Some(p) = self.prepare(wo) else { return Vec3::zero() };
        let albedo = self.albedos(self.f0, self.f90);
        let e = albedo.single(self.albedo_at(&albedo, p.wo));
        let below = self.diffuse + self.transmitted;
        let base = match self.energy {
            Energy::Single => self.diffuse + e + self.transmitted.mul(e.map(|e| (T::one() - e).relu())),
            Energy::Compensated => e + below.mul(e.map(|e| (T::one() - e).relu())),
        };
        let cover = Vec3::splat(p.coat)
            + self.sheen_color * (sheen::albedo(p.wo.z, self.sheen_roughness) * (T::one() - p.coat));
        base * ((T::one() - p.coat) * (T::one() - p.sheen)) + cover
    }
}

/// The lobe that a number in `[0, 1)` chooses; one of positive probability.
#[inline(always)]
fn choose<T: Real>(probability: &[T; 6], lobe: T) -> usize {
    let mut rest = lobe;
    let mut last = REFLECTION;
    for (i, &p) in probability.iter().enumerate() {
        if p > T::zero() {
            last = i;
            if rest < p {
                break;
            }
            rest -= p;
        }
    }
    last
}
