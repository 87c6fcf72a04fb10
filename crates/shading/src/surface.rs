//! What a point of a surface looks like, and the two lobes that follow from it.

use crate::ggx::ROUGHNESS_MIN;
use photofit_scalar::{Real, Vec3};

/// Reflectance of a dielectric at normal incidence (index of refraction 1.5).
pub const DIELECTRIC_F0: f64 = 0.04;

/// Material of a surface point: the metallic-roughness model of glTF 2.0 with a specular suppression.
///
/// Expected ranges are `[0, 1]` for every number; derivatives are those of the formulas as written, so that a
/// value outside of the range still has a gradient.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Surface<T = f32> {
    /// Linear base colour `kd`.
    pub base_color: Vec3<T>,
    /// Perceptual roughness `r`; GGX alpha is `r^2`. Values below [`ROUGHNESS_MIN`] count as that.
    pub roughness: T,
    /// Metalness `m`.
    pub metallic: T,
    /// Specular suppression `gamma`: 0 leaves `F0` as it is, 1 removes it.
    pub gamma: T,
}

/// Gradient with respect to a [`Surface`], field by field.
pub type SurfaceGradient<T = f32> = Surface<T>;

/// The lobes of a [`Surface`]: what scattering needs, independent of directions.
///
/// Of a [`Surface`]: `diffuse = kd (1 - m)`, `f0 = (0.04 (1 - m) + m kd) (1 - gamma)`, `f90 = 1`,
/// `roughness = max(r, ROUGHNESS_MIN)`. Other values of `f90` come from `KHR_materials_specular`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lobes<T = f32> {
    /// Albedo of the Lambertian lobe.
    pub diffuse: Vec3<T>,
    /// Reflectance of the specular lobe at normal incidence.
    pub f0: Vec3<T>,
    /// Reflectance of the specular lobe at grazing incidence.
    pub f90: T,
    /// Perceptual roughness of the specular lobe, at least [`ROUGHNESS_MIN`].
    pub roughness: T,
}

/// Gradient with respect to [`Lobes`], field by field.
pub type LobesGradient<T = f32> = Lobes<T>;

impl<T: Real> Surface<T> {
    /// Converts the numbers to another scalar.
    #[inline]
    pub fn cast<U: Real>(&self) -> Surface<U> {
        Surface {
            base_color: self.base_color.cast(),
            roughness: U::of(self.roughness.f64()),
            metallic: U::of(self.metallic.f64()),
            gamma: U::of(self.gamma.f64()),
        }
    }

    /// The lobes of this material.
    #[inline(always)]
    pub fn lobes(&self) -> Lobes<T> {
        let (one, floor) = (T::one(), T::of(ROUGHNESS_MIN));
        let (m, kd) = (self.metallic, self.base_color);
        let dielectric = Vec3::splat(T::of(DIELECTRIC_F0) * (one - m));
        Lobes {
            diffuse: kd * (one - m),
            f0: (dielectric + kd * m) * (one - self.gamma),
            f90: one,
            roughness: if self.roughness > floor { self.roughness } else { floor },
        }
    }

    /// Adjoint of [`Self::lobes`]: the gradient with respect to this surface, from that of its lobes.
    ///
    /// The roughness has its one-sided derivative at [`ROUGHNESS_MIN`], so that a value clamped there can leave.
    #[inline(always)]
    pub fn lobes_vjp(&self, g: &LobesGradient<T>) -> Self {
        let (one, floor) = (T::one(), T::of(ROUGHNESS_MIN));
        let (m, kd) = (self.metallic, self.base_color);
        let keep = one - self.gamma;
        let f0 = Vec3::splat(T::of(DIELECTRIC_F0) * (one - m)) + kd * m;
        let d_metal = kd - Vec3::splat(T::of(DIELECTRIC_F0));
        Self {
            base_color: g.diffuse * (one - m) + g.f0 * (m * keep),
            roughness: if self.roughness >= floor { g.roughness } else { T::zero() },
            metallic: g.f0.dot(d_metal) * keep - g.diffuse.dot(kd),
            gamma: -g.f0.dot(f0),
        }
    }
}

impl<T: Real> std::ops::AddAssign for Surface<T> {
    #[inline(always)]
    fn add_assign(&mut self, o: Self) {
        self.base_color += o.base_color;
        self.roughness += o.roughness;
        self.metallic += o.metallic;
        self.gamma += o.gamma;
    }
}

impl<T: Real> std::ops::AddAssign for Lobes<T> {
    #[inline(always)]
    fn add_assign(&mut self, o: Self) {
        self.diffuse += o.diffuse;
        self.f0 += o.f0;
        self.f90 += o.f90;
        self.roughness += o.roughness;
    }
}
