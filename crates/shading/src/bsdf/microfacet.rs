//! Microfacet distributions by choice: GGX or Beckmann, isotropic or not, with correlated or separable masking.

use super::ALPHA_DELTA;
use super::beckmann::Beckmann;
use super::ggx::Ggx;
use super::refraction::Facets;
use photofit_scalar::{Real, Vec3};

/// Which distribution of microfacet normals.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Distribution {
    /// Trowbridge and Reitz 1975; long tails.
    #[default]
    Ggx,
    /// Beckmann and Spizzichino 1963: Gaussian slopes.
    Beckmann,
}

/// How masking and shadowing join.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Masking {
    /// `1 / (1 + Lambda_o + Lambda_i)`: correlated by height (Heitz 2014).
    #[default]
    Correlated,
    /// `G1(wo) G1(wi)`: what Mitsuba computes.
    Separable,
}

/// A rough surface: distribution, alpha along x and y, masking.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Microfacet<T = f32> {
    /// The distribution.
    pub distribution: Distribution,
    /// The masking.
    pub masking: Masking,
    /// Alpha along x, positive.
    pub alpha_x: T,
    /// Alpha along y, positive.
    pub alpha_y: T,
}

impl<T: Real> Microfacet<T> {
    /// An isotropic surface with correlated masking.
    #[inline]
    pub fn isotropic(distribution: Distribution, alpha: T) -> Self {
        Self { distribution, masking: Masking::Correlated, alpha_x: alpha, alpha_y: alpha }
    }

    /// Whether the surface is a mirror: the larger alpha lies below [`ALPHA_DELTA`].
    #[inline(always)]
    pub fn is_smooth(&self) -> bool {
        self.alpha_max() < T::of(ALPHA_DELTA)
    }

    /// Alphas with the floor that keeps one axis of a rough surface from being a delta.
    #[inline(always)]
    pub(super) fn alphas(&self) -> (T, T) {
        let floor = T::of(ALPHA_DELTA);
        (self.alpha_x.max(floor), self.alpha_y.max(floor))
    }

    #[inline(always)]
    fn ggx(&self) -> Ggx<T> {
        let (ax, ay) = self.alphas();
        Ggx { ax, ay }
    }

    #[inline(always)]
    fn beckmann(&self) -> Beckmann<T> {
        let (ax, ay) = self.alphas();
        Beckmann { ax, ay }
    }
}

impl<T: Real> Facets<T> for Microfacet<T> {
    #[inline(always)]
    fn d(&self, m: Vec3<T>) -> T {
        match self.distribution {
            Distribution::Ggx => self.ggx().d(m),
            Distribution::Beckmann => self.beckmann().d(m),
        }
    }

    #[inline(always)]
    fn masked(&self, v: Vec3<T>) -> T {
        match self.distribution {
            Distribution::Ggx => self.ggx().masked(v),
            Distribution::Beckmann => self.beckmann().masked(v),
        }
    }

    #[inline(always)]
    fn visibility(&self, wo: Vec3<T>, wi: Vec3<T>) -> T {
        let (o, i) = (self.masked(wo), self.masked(wi));
        let quarter = T::of(0.25);
        match self.masking {
            Masking::Separable => quarter / (o * i),
            Masking::Correlated => {
                let (zo, zi) = (wo.z.abs(), wi.z.abs());
                quarter / (zi * o + zo * i - zo * zi)
            }
        }
    }

    #[inline(always)]
    fn sample(&self, wo: Vec3<T>, u: [T; 2]) -> Vec3<T> {
        match self.distribution {
            Distribution::Ggx => self.ggx().sample(wo, u),
            Distribution::Beckmann => self.beckmann().sample(wo, u),
        }
    }

    #[inline(always)]
    fn alpha_max(&self) -> T {
        self.alpha_x.max(self.alpha_y)
    }
}
