//! Compensation of the energy that single scattering between microfacets loses (Kulla and Conty 2017).
//!
//! With the albedo `E(mu)` of the GGX lobe for `F = 1` and its average `Ea = 2 int mu E dmu`, the lobe
//! `Fm (1 - E(mu_o)) (1 - E(mu_i)) / (pi (1 - Ea))` returns what is lost; `Fm = Fa^2 Ea / (1 - Fa (1 - Ea))` accounts for
//! the Fresnel reflections in between, `Fa = f0 20/21 + f90 / 21` is the average of Schlick's term. It is reciprocal.
//!
//! `E` is the table of [`crate::split_sum()`] (of the module `anisotropic` for two alphas); its averages are tabulated
//! here, once per process at first use.

use crate::split_sum::split_sum;
use photofit_scalar::{Real, Vec3};
use std::sync::LazyLock;

/// What happens to the energy that single scattering loses or that the lobes count twice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Energy {
    /// Single scattering, and a Lambertian lobe that the specular reflection does not reduce: what the rasterizer
    /// shows ([`crate::eval`]). A white metal of roughness 1 loses up to half of the light; a white dielectric returns
    /// a few percent more than it receives.
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

/// Averages of scale and bias for GGX alpha.
#[inline]
fn averages<T: Real>(alpha: T) -> [T; 2] {
    let x = alpha.relu().sqrt().min(T::one()) * T::of((ROUGHNESSES - 1) as f64);
    let i = (x.f64() as usize).min(ROUGHNESSES - 2);
    let f = x - T::of(i as f64);
    let (a, b) = (AVERAGES[i], AVERAGES[i + 1]);
    std::array::from_fn(|k| {
        let (a, b) = (T::of(f64::from(a[k])), T::of(f64::from(b[k])));
        a + (b - a) * f
    })
}

/// The albedos of a specular lobe with Schlick's Fresnel term, for one material.
#[derive(Clone, Copy, Debug)]
pub(super) struct SpecularAlbedo<T> {
    f0: Vec3<T>,
    f90: T,
    alpha: T,
    /// `Fm`.
    multiple: Vec3<T>,
    /// `1 - Ea`.
    lost: T,
    /// Average of the whole albedo.
    average: Vec3<T>,
}

/// Smallest denominator: where less is lost, nothing is given back.
const LOST_MIN: f64 = 1e-5;

impl<T: Real> SpecularAlbedo<T> {
    #[inline]
    pub(super) fn new(f0: Vec3<T>, f90: T, alpha: T) -> Self {
        if alpha < T::of(super::ALPHA_DELTA) {
            let fresnel = |f0: T| f0 * T::of(20.0 / 21.0) + f90 * T::of(1.0 / 21.0);
            let zero = T::zero();
            return Self { f0, f90, alpha, multiple: Vec3::zero(), lost: zero, average: f0.map(fresnel) };
        }
        Self::with_averages(f0, f90, alpha, averages(alpha))
    }

    /// For a lobe with these averages of scale and bias; `alpha` serves [`Self::at`] alone.
    #[inline]
    pub(super) fn with_averages(f0: Vec3<T>, f90: T, alpha: T, [scale, bias]: [T; 2]) -> Self {
        let one = T::one();
        let whole = scale + bias;
        let lost = one - whole;
        let multiple = f0.map(|f0| {
            let f = f0 * T::of(20.0 / 21.0) + f90 * T::of(1.0 / 21.0);
            f * f * whole / (one - f * lost)
        });
        let average = f0.map(|f| f * scale + f90 * bias) + multiple * lost;
        Self { f0, f90, alpha, multiple, lost, average }
    }

    /// Whole albedo towards a direction of cosine `mu`, and the part `1 - E` that single scattering loses.
    #[inline]
    pub(super) fn at(&self, mu: T) -> (Vec3<T>, T) {
        if self.alpha < T::of(super::ALPHA_DELTA) {
            let p = schlick_weight(mu);
            return (self.f0 * (T::one() - p) + Vec3::splat(self.f90 * p), T::zero());
        }
        let s = split_sum(mu, self.alpha.sqrt());
        self.of([s.scale, s.bias])
    }

    /// The same for a direction of this scale and bias.
    #[inline]
    pub(super) fn of(&self, [scale, bias]: [T; 2]) -> (Vec3<T>, T) {
        let lost = (T::one() - scale - bias).relu();
        (self.f0 * scale + Vec3::splat(self.f90 * bias) + self.multiple * lost, lost)
    }

    /// Albedo of single scattering, from what [`Self::at`] says.
    #[inline]
    pub(super) fn single(&self, (e, lost): (Vec3<T>, T)) -> Vec3<T> {
        e - self.multiple * lost
    }

    /// Value without cosine of what passes through a thin wall after multiple scattering, for the lost parts of both
    /// directions.
    #[inline]
    pub(super) fn multiple_passed(&self, lost_o: T, lost_i: T) -> Vec3<T> {
        if self.lost > T::of(LOST_MIN) {
            let each = lost_o * lost_i * T::of(std::f64::consts::FRAC_1_PI) / self.lost;
            self.multiple.map(|m| (T::one() - m).relu() * each)
        } else {
            Vec3::zero()
        }
    }

    /// Value of multiple scattering without cosine, for the lost parts of both directions.
    #[inline]
    pub(super) fn multiple(&self, lost_o: T, lost_i: T) -> Vec3<T> {
        if self.lost > T::of(LOST_MIN) {
            self.multiple * (lost_o * lost_i * T::of(std::f64::consts::FRAC_1_PI) / self.lost)
        } else {
            Vec3::zero()
        }
    }

    /// Albedo of multiple scattering towards a direction that loses `lost`.
    #[inline]
    pub(super) fn multiple_albedo(&self, lost: T) -> Vec3<T> {
        if self.lost > T::of(LOST_MIN) { self.multiple * lost } else { Vec3::zero() }
    }

    /// Factor of a Lambertian lobe below, for the albedos of both directions: `(1 - Eo)(1 - Ei) / (1 - average)`.
    #[inline]
    pub(super) fn below(&self, e_o: Vec3<T>, e_i: Vec3<T>) -> Vec3<T> {
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

/// `(1 - cosine)^5`.
#[inline(always)]
pub(super) fn schlick_weight<T: Real>(cosine: T) -> T {
    let m = (T::one() - cosine).relu();
    let m2 = m * m;
    m2 * m2 * m
}
