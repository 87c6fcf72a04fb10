//! Adjoints of scattering functions: gradients with respect to their parameters, for path replay.
//!
//! Directions, densities and the choice of lobes are held; the normal is that of the local frame, +z.

use super::{Bsdf, Diffuse, GltfBsdf, GltfParameters, RoughConductorGradient};
use crate::eval::LobesEvalGradient;
use crate::ggx::ROUGHNESS_MIN;
use crate::surface::LobesGradient;
use photofit_scalar::{Real, Vec3};
use std::ops::Add;

/// Gradient of [`Diffuse`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DiffuseGradient<T = f32> {
    /// With respect to the reflectance.
    pub reflectance: Vec3<T>,
    /// With respect to the normal, in the local frame.
    pub n: Vec3<T>,
}

/// Gradient of a [`Bsdf`] that has one.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum BsdfGradient<T = f32> {
    /// Of Lambertian reflection.
    Diffuse(DiffuseGradient<T>),
    /// Of the metallic-roughness model; [`crate::Surface::lobes_vjp`] leads on to base colour, roughness and metalness.
    MetallicRoughness(LobesEvalGradient<T>),
    /// Of a rough metal.
    RoughConductor(RoughConductorGradient<T>),
}

/// Gradient with respect to the base of [`GltfParameters`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GltfGradient<T = f32> {
    /// With respect to the base colour.
    pub base_color: Vec3<T>,
    /// With respect to the metalness.
    pub metallic: T,
    /// With respect to the perceptual roughness.
    pub roughness: T,
    /// With respect to the normal, in the local frame, through the base alone: what coat and sheen cover is held.
    pub n: Vec3<T>,
}

impl<T: Real> BsdfGradient<T> {
    /// Whether what it says of the material and of the normal is finite.
    pub fn is_finite(&self) -> bool {
        let sum = match self {
            Self::Diffuse(d) => (d.reflectance + d.n).sum(),
            Self::MetallicRoughness(d) => {
                (d.lobes.diffuse + d.lobes.f0 + d.n).sum() + d.lobes.f90 + d.lobes.roughness
            }
            Self::RoughConductor(d) => d.reflectance.sum() + d.alpha[0] + d.alpha[1],
        };
        sum.is_finite()
    }
}

impl<T: Real> Add for BsdfGradient<T> {
    type Output = Self;

    /// The sum of two gradients of one BSDF, which are of one kind; of directions it means something where these are the same.
    #[inline]
    fn add(self, other: Self) -> Self {
        match (self, other) {
            (Self::Diffuse(a), Self::Diffuse(b)) => {
                Self::Diffuse(DiffuseGradient { reflectance: a.reflectance + b.reflectance, n: a.n + b.n })
            }
            (Self::MetallicRoughness(a), Self::MetallicRoughness(b)) => {
                let lobes = LobesGradient {
                    diffuse: a.lobes.diffuse + b.lobes.diffuse,
                    f0: a.lobes.f0 + b.lobes.f0,
                    f90: a.lobes.f90 + b.lobes.f90,
                    roughness: a.lobes.roughness + b.lobes.roughness,
                };
                let (n, wo, wi) = (a.n + b.n, a.wo + b.wo, a.wi + b.wi);
                Self::MetallicRoughness(LobesEvalGradient { lobes, n, wo, wi })
            }
            (Self::RoughConductor(a), Self::RoughConductor(b)) => {
                let alpha = [0, 1].map(|axis| a.alpha[axis] + b.alpha[axis]);
                Self::RoughConductor(RoughConductorGradient {
                    reflectance: a.reflectance + b.reflectance,
                    alpha,
                })
            }
            _ => unreachable!("one BSDF has gradients of one kind"),
        }
    }
}

impl<T: Real> Diffuse<T> {
    /// Adjoint of [`super::Scatter::eval`] for the gradient `g` of the value.
    #[inline]
    pub fn eval_vjp(&self, wo: Vec3<T>, wi: Vec3<T>, g: Vec3<T>) -> DiffuseGradient<T> {
        if !(wo.z > T::zero() && wi.z > T::zero()) {
            return DiffuseGradient::default();
        }
        let inv_pi = T::of(std::f64::consts::FRAC_1_PI);
        DiffuseGradient { reflectance: g * (wi.z * inv_pi), n: wi * (g.dot(self.reflectance) * inv_pi) }
    }
}

impl<T: Real> Bsdf<T> {
    /// Adjoint of [`Self::eval`] for the gradient `g` of the value; `None` for the kinds that have none.
    #[inline]
    pub fn eval_vjp(&self, wo: Vec3<T>, wi: Vec3<T>, g: Vec3<T>) -> Option<BsdfGradient<T>> {
        match self {
            Self::Diffuse(b) => Some(BsdfGradient::Diffuse(b.eval_vjp(wo, wi, g))),
            Self::MetallicRoughness(b) => Some(BsdfGradient::MetallicRoughness(b.eval_vjp(wo, wi, g))),
            Self::RoughConductor(b) => Some(BsdfGradient::RoughConductor(b.eval_vjp(wo, wi, g))),
            _ => None,
        }
    }
}

impl<T: Real> GltfParameters<T> {
    /// Adjoint of [`Bsdf::eval`] of [`Self::bsdf`] for the gradient `g` of the value, with respect to the base: what
    /// coat and sheen leave of the light is its factor. `None` where the surface transmits or is anisotropic: those
    /// gradients are missing.
    pub fn eval_vjp(&self, wo: Vec3<T>, wi: Vec3<T>, g: Vec3<T>) -> Option<GltfGradient<T>> {
        let (zero, one, m) = (T::zero(), T::one(), self.metallic);
        let left = match self.bsdf() {
            Bsdf::MetallicRoughness(_) => one,
            _ if self.anisotropy > zero || self.transmission > zero => return None,
            _ => GltfBsdf::new(self).left_by_layers(wo, wi),
        };
        let d = self.base().eval_vjp(wo, wi, g * left);
        let (f0, f90) = self.dielectric();
        // diffuse = c (1 - m), f0 = F0 (1 - m) + c m, f90 = F90 (1 - m) + m
        let by_metal = d.lobes.f0.dot(self.base_color - f0) - d.lobes.diffuse.dot(self.base_color);
        Some(GltfGradient {
            base_color: d.lobes.diffuse * (one - m) + d.lobes.f0 * m,
            metallic: by_metal + d.lobes.f90 * (one - f90),
            roughness: if self.roughness >= T::of(ROUGHNESS_MIN) { d.lobes.roughness } else { zero },
            n: d.n,
        })
    }
}
