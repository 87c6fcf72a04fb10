//! Compensation of the energy that single scattering between microfacets loses (Kulla and Conty 2017).
//!
//! With the albedo `E(mu)` of the GGX lobe for `F = 1` and its average `Ea = 2 int mu E dmu`, the lobe
//! `Fm (1 - E(mu_o)) (1 - E(mu_i)) / (pi (1 - Ea))` returns what is lost; `Fm = Fa^2 Ea / (1 - Fa (1 - Ea))` accounts for
//! the Fresnel reflections in between, `Fa = f0 20/21 + f90 / 21` is the average of Schlick's term. It is reciprocal.
//! The Lambertian lobe below gets `(1 - e(mu_o)) (1 - e(mu_i)) / (1 - ea)` of its light, with the whole albedo `e` of
//! the specular reflection and its average `ea`.
//!
//! `E` is the table of [`crate::split_sum()`] (of the module `bsdf::anisotropic` for two alphas); its averages are
//! tabulated here, once per process at first use. Values and adjoints serve both renderers.

use crate::bsdf::ALPHA_DELTA;
use crate::split_sum::{SplitSum, split_sum};
use crate::surface::{Lobes, LobesGradient};
use photofit_scalar::{Real, Vec3};
use std::sync::LazyLock;

/// What happens to the energy that single scattering loses or that the lobes count twice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Energy {
    /// Single scattering, and a Lambertian lobe that the specular reflection does not reduce: the reference model of
    /// glTF. A white metal of roughness 1 loses up to half of the light; a white dielectric returns a few percent
    /// more than it receives.
    #[default]
    Single,
    /// Multiple scattering between microfacets is added, and the Lambertian lobe gets what the specular one leaves:
    /// white surfaces return what they receive.
    Compensated,
}

/// Roughnesses in the table of averages, evenly spaced in `[0, 1]`.
const ROUGHNESSES: usize = 64;

/// Averages `2 int mu (scale, bias) dmu` over the hemisphere, by roughness.
static AVERAGES: LazyLock<Vec<[f32; 2]>> = LazyLock::new(|| {
    let steps = 256;
    let average = |j: usize| {
        let r = j as f64 / (ROUGHNESSES - 1) as f64;
        let mut sum = [0.0; 2];
        for i in 0..steps {
            let mu = (i as f64 + 0.5) / steps as f64;
            let s = split_sum(mu, r);
            sum[0] += 2.0 * mu * s.scale;
            sum[1] += 2.0 * mu * s.bias;
        }
        sum.map(|s| (s / steps as f64) as f32)
    };
    (0..ROUGHNESSES).map(average).collect()
});

/// The table of averages.
#[cfg(feature = "gpu")]
pub(crate) fn averages_table() -> &'static [[f32; 2]] {
    &AVERAGES
}

/// Averages of scale and bias for a perceptual roughness, and their derivatives.
#[inline]
fn averages<T: Real>(roughness: T) -> [[T; 2]; 2] {
    let slope = T::of((ROUGHNESSES - 1) as f64);
    let x = roughness.relu().min(T::one()) * slope;
    let i = (x.f64() as usize).min(ROUGHNESSES - 2);
    let f = x - T::of(i as f64);
    let at = |i: usize, k: usize| T::of(f64::from(AVERAGES[i][k]));
    let rise = std::array::from_fn(|k| at(i + 1, k) - at(i, k));
    [std::array::from_fn(|k| at(i, k) + rise[k] * f), rise.map(|r| r * slope)]
}

/// The albedos of a specular lobe with Schlick's Fresnel term, for one material.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SpecularAlbedo<T> {
    f0: Vec3<T>,
    f90: T,
    roughness: T,
    /// `Fm`.
    multiple: Vec3<T>,
    /// `1 - Ea`.
    lost: T,
    /// Average of the whole albedo.
    average: Vec3<T>,
}

/// Smallest denominator: where less is lost, nothing is given back.
const LOST_MIN: f64 = 1e-5;
/// Share of `f0` in the average of Schlick's term.
const F0_SHARE: f64 = 20.0 / 21.0;

impl<T: Real> SpecularAlbedo<T> {
    /// For a perceptual roughness; delta lobes lose nothing.
    #[inline]
    pub(crate) fn new(f0: Vec3<T>, f90: T, roughness: T) -> Self {
        if is_delta(roughness) {
            let average = f0.map(|f0| average_fresnel(f0, f90));
            return Self { f0, f90, roughness, multiple: Vec3::zero(), lost: T::zero(), average };
        }
        Self::with_averages(f0, f90, roughness, averages(roughness)[0])
    }

    /// For a lobe with these averages of scale and bias; `roughness` serves [`Self::at`] alone.
    #[inline]
    pub(crate) fn with_averages(f0: Vec3<T>, f90: T, roughness: T, [scale, bias]: [T; 2]) -> Self {
        let one = T::one();
        let whole = scale + bias;
        let lost = one - whole;
        let multiple = f0.map(|f0| {
            let f = average_fresnel(f0, f90);
            f * f * whole / (one - f * lost)
        });
        let average = f0.map(|f| f * scale + f90 * bias) + multiple * lost;
        Self { f0, f90, roughness, multiple, lost, average }
    }

    /// Whole albedo towards a direction of cosine `mu`, and the part `1 - E` that single scattering loses.
    #[inline]
    pub(crate) fn at(&self, mu: T) -> (Vec3<T>, T) {
        if is_delta(self.roughness) {
            let p = schlick_weight(mu);
            return (self.f0 * (T::one() - p) + Vec3::splat(self.f90 * p), T::zero());
        }
        let s = split_sum(mu, self.roughness);
        self.of([s.scale, s.bias])
    }

    /// The same for a direction of this scale and bias.
    #[inline]
    pub(crate) fn of(&self, [scale, bias]: [T; 2]) -> (Vec3<T>, T) {
        let lost = (T::one() - scale - bias).relu();
        (self.f0 * scale + Vec3::splat(self.f90 * bias) + self.multiple * lost, lost)
    }

    /// Albedo of single scattering, from what [`Self::at`] says.
    #[inline]
    pub(crate) fn single(&self, (e, lost): (Vec3<T>, T)) -> Vec3<T> {
        e - self.multiple * lost
    }

    /// Value without cosine of what passes through a thin wall after multiple scattering, for the lost parts of both
    /// directions.
    #[inline]
    pub(crate) fn multiple_passed(&self, lost_o: T, lost_i: T) -> Vec3<T> {
        if self.lost > T::of(LOST_MIN) {
            let each = lost_o * lost_i * T::of(std::f64::consts::FRAC_1_PI) / self.lost;
            self.multiple.map(|m| (T::one() - m).relu() * each)
        } else {
            Vec3::zero()
        }
    }

    /// Value of multiple scattering without cosine, for the lost parts of both directions.
    #[inline]
    pub(crate) fn multiple(&self, lost_o: T, lost_i: T) -> Vec3<T> {
        if self.lost > T::of(LOST_MIN) {
            self.multiple * (lost_o * lost_i * T::of(std::f64::consts::FRAC_1_PI) / self.lost)
        } else {
            Vec3::zero()
        }
    }

    /// Albedo of multiple scattering towards a direction that loses `lost`.
    #[inline]
    pub(crate) fn multiple_albedo(&self, lost: T) -> Vec3<T> {
        if self.lost > T::of(LOST_MIN) { self.multiple * lost } else { Vec3::zero() }
    }

    /// Value without cosine of a Lambertian lobe below the specular one, and of multiple scattering, for the scale and
    /// bias towards both directions.
    #[inline]
    pub(crate) fn broad(&self, diffuse: Vec3<T>, viewer: &SplitSum<T>, light: &SplitSum<T>) -> Vec3<T> {
        let (e_o, lost_o) = self.of([viewer.scale, viewer.bias]);
        let (e_i, lost_i) = self.of([light.scale, light.bias]);
        let inv_pi = T::of(std::f64::consts::FRAC_1_PI);
        diffuse.mul(self.below(e_o, e_i)) * inv_pi + self.multiple(lost_o, lost_i)
    }

    /// Integral of [`Self::broad`] times the cosine of the light.
    #[inline]
    pub(crate) fn broad_albedo(&self, diffuse: Vec3<T>, viewer: &SplitSum<T>) -> Vec3<T> {
        let (e, lost) = self.of([viewer.scale, viewer.bias]);
        diffuse.mul(e.map(|e| (T::one() - e).relu())) + self.multiple_albedo(lost)
    }

    /// Adjoint of [`Self::broad`] for the gradient `g` of its result.
    pub(crate) fn broad_vjp(
        &self,
        diffuse: Vec3<T>,
        viewer: &SplitSum<T>,
        light: &SplitSum<T>,
        g: Vec3<T>,
    ) -> BroadGradient<T> {
        let (one, inv_pi) = (T::one(), T::of(std::f64::consts::FRAC_1_PI));
        let (e_o, lost_o) = self.of([viewer.scale, viewer.bias]);
        let (e_i, lost_i) = self.of([light.scale, light.bias]);
        let mut sum = AlbedoGradient::default();
        let (mut g_o, mut g_i) = (Vec3::zero(), Vec3::zero());
        let mut g_diffuse = Vec3::zero();
        for k in 0..3 {
            let rest = one - self.average[k];
            if rest > T::of(LOST_MIN) {
                let (o, i) = ((one - e_o[k]).relu(), (one - e_i[k]).relu());
                let below = o * i / rest;
                g_diffuse[k] = g[k] * below * inv_pi;
                let g_below = g[k] * diffuse[k] * inv_pi / rest;
                g_o[k] = if e_o[k] < one { -g_below * i } else { T::zero() };
                g_i[k] = if e_i[k] < one { -g_below * o } else { T::zero() };
                sum.average[k] = g_below * below;
            }
        }
        let (mut g_lost_o, mut g_lost_i) = (T::zero(), T::zero());
        if self.lost > T::of(LOST_MIN) {
            let each = inv_pi / self.lost;
            sum.multiple = g * (lost_o * lost_i * each);
            let by_multiple = g.dot(self.multiple) * each;
            g_lost_o = by_multiple * lost_i;
            g_lost_i = by_multiple * lost_o;
            sum.lost = -by_multiple * lost_o * lost_i / self.lost;
        }
        let cosine_o = self.of_vjp(viewer, lost_o, g_o, g_lost_o, &mut sum);
        let cosine_i = self.of_vjp(light, lost_i, g_i, g_lost_i, &mut sum);
        self.gradient(g_diffuse, sum, [cosine_o, cosine_i])
    }

    /// Adjoint of [`Self::broad_albedo`] for the gradient `g` of its result; the second cosine has none.
    pub(crate) fn broad_albedo_vjp(
        &self,
        diffuse: Vec3<T>,
        viewer: &SplitSum<T>,
        g: Vec3<T>,
    ) -> BroadGradient<T> {
        let one = T::one();
        let (e, lost) = self.of([viewer.scale, viewer.bias]);
        let mut sum = AlbedoGradient::default();
        let rest = e.map(|e| (one - e).relu());
        let mut g_e = -g.mul(diffuse);
        for k in 0..3 {
            if e[k] >= one {
                g_e[k] = T::zero();
            }
        }
        let mut g_lost = T::zero();
        if self.lost > T::of(LOST_MIN) {
            sum.multiple = g * lost;
            g_lost = g.dot(self.multiple);
        }
        let cosine = self.of_vjp(viewer, lost, g_e, g_lost, &mut sum);
        self.gradient(g.mul(rest), sum, [cosine, T::zero()])
    }

    /// Adjoint of [`Self::of`] for the gradients of both results: the gradient of the cosine.
    #[inline]
    fn of_vjp(&self, s: &SplitSum<T>, lost: T, g_e: Vec3<T>, g_lost: T, sum: &mut AlbedoGradient<T>) -> T {
        sum.f0 += g_e * s.scale;
        sum.f90 += g_e.sum() * s.bias;
        sum.multiple += g_e * lost;
        let g_lost = if lost > T::zero() { g_lost + g_e.dot(self.multiple) } else { T::zero() };
        let g_scale = g_e.dot(self.f0) - g_lost;
        let g_bias = g_e.sum() * self.f90 - g_lost;
        sum.roughness += g_scale * s.d_scale[1] + g_bias * s.d_bias[1];
        g_scale * s.d_scale[0] + g_bias * s.d_bias[0]
    }

    /// Adjoint of [`Self::new`], and the rest of the gradient beside it.
    fn gradient(&self, diffuse: Vec3<T>, sum: AlbedoGradient<T>, cosines: [T; 2]) -> BroadGradient<T> {
        let (one, two) = (T::one(), T::of(2.0));
        let [[scale, bias], [d_scale, d_bias]] = averages(self.roughness);
        let (whole, lost) = (scale + bias, self.lost);
        // average = f0 scale + f90 bias + multiple lost
        let mut f0 = sum.f0 + sum.average * scale;
        let mut f90 = sum.f90 + sum.average.sum() * bias;
        let mut g_scale = sum.average.dot(self.f0);
        let mut g_bias = sum.average.sum() * self.f90;
        let mut g_lost = sum.lost + sum.average.dot(self.multiple);
        let g_multiple = sum.multiple + sum.average * lost;
        // multiple = f^2 whole / (1 - f lost), f = f0 20/21 + f90 / 21
        let mut g_whole = T::zero();
        for k in 0..3 {
            let f = average_fresnel(self.f0[k], self.f90);
            let inv = one / (one - f * lost);
            let g_f = g_multiple[k] * f * whole * (two - f * lost) * inv * inv;
            f0[k] += g_f * T::of(F0_SHARE);
            f90 += g_f * T::of(1.0 - F0_SHARE);
            g_whole += g_multiple[k] * f * f * inv;
            g_lost += g_multiple[k] * f * f * f * whole * inv * inv;
        }
        // lost = 1 - whole, whole = scale + bias
        g_scale += g_whole - g_lost;
        g_bias += g_whole - g_lost;
        let roughness = sum.roughness + g_scale * d_scale + g_bias * d_bias;
        BroadGradient { lobes: Lobes { diffuse, f0, f90, roughness }, cosines }
    }

    /// Factor of a Lambertian lobe below, for the albedos of both directions: `(1 - Eo)(1 - Ei) / (1 - average)`.
    #[inline]
    pub(crate) fn below(&self, e_o: Vec3<T>, e_i: Vec3<T>) -> Vec3<T> {
        let (one, floor) = (T::one(), T::of(LOST_MIN));
        let channel = |o: T, i: T, a: T| {
            let rest = one - a;
            if rest > floor { (one - o).relu() * (one - i).relu() / rest } else { T::zero() }
        };
        Vec3 {
            x: channel(e_o.x, e_i.x, self.average.x),
            y: channel(e_o.y, e_i.y, self.average.y),
            z: channel(e_o.z, e_i.z, self.average.z),
        }
    }
}

/// Gradient of [`SpecularAlbedo::broad`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct BroadGradient<T> {
    /// With respect to the lobes.
    pub(crate) lobes: LobesGradient<T>,
    /// With respect to the cosines of the viewer and of the light.
    pub(crate) cosines: [T; 2],
}

/// Gradients of what [`SpecularAlbedo`] holds, and of the roughness by other ways.
#[derive(Default)]
struct AlbedoGradient<T> {
    f0: Vec3<T>,
    f90: T,
    roughness: T,
    multiple: Vec3<T>,
    lost: T,
    average: Vec3<T>,
}

#[inline(always)]
fn is_delta<T: Real>(roughness: T) -> bool {
    roughness * roughness < T::of(ALPHA_DELTA)
}

/// Average of Schlick's term over the hemisphere, weighted by the cosine.
#[inline(always)]
fn average_fresnel<T: Real>(f0: T, f90: T) -> T {
    f0 * T::of(F0_SHARE) + f90 * T::of(1.0 - F0_SHARE)
}

/// `(1 - cosine)^5`.
#[inline(always)]
pub(crate) fn schlick_weight<T: Real>(cosine: T) -> T {
    let m = (T::one() - cosine).relu();
    let m2 = m * m;
    m2 * m2 * m
}
