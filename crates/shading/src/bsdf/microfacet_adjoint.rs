//! Adjoint of rough reflection with respect to the alphas of a [`Microfacet`] surface.

use super::refraction::{Facets, reflection};
use super::{Conductor, Distribution, Masking, Microfacet, RoughConductor};
use photofit_scalar::{Real, Vec3, vec3};
use std::f64::consts::FRAC_2_SQRT_PI;

/// Gradient of [`RoughConductor`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RoughConductorGradient<T = f32> {
    /// With respect to the factor of the reflectance.
    pub reflectance: Vec3<T>,
    /// With respect to alpha along x and along y.
    pub alpha: [T; 2],
}

impl<T: Real> Microfacet<T> {
    /// Derivatives of the logarithm of `D(m) G(wo, wi)` with respect to alpha along x and y, directions held.
    ///
    /// `D`: `4 (x / a)^2 / (a e) - 1 / a` (GGX), `(2 (x / (a z))^2 - 1) / a` (Beckmann). The masking follows from
    /// `|z| (1 + Lambda)`, whose derivative by the stretched length `t = sqrt((ax x)^2 + (ay y)^2)` is `t / (2 s)` (GGX)
    /// and `exp(-(z / t)^2) / (2 sqrt(pi))` (Beckmann).
    fn log_derivative(&self, m: Vec3<T>, wo: Vec3<T>, wi: Vec3<T>) -> [T; 2] {
        let (zero, one, half) = (T::zero(), T::one(), T::of(0.5));
        let (o, i) = (self.masked(wo), self.masked(wi));
        let (zo, zi) = (wo.z.abs(), wi.z.abs());
        let alpha = {
            let (x, y) = self.alphas();
            [x, y]
        };
        let e = {
            let (x, y) = (m.x / alpha[0], m.y / alpha[1]);
            x * x + y * y + m.z * m.z
        };
        let masked = |v: Vec3<T>, axis: usize| {
            let (x, y) = (alpha[0] * v.x, alpha[1] * v.y);
            let square = x * x + y * y;
            let along = if axis == 0 { v.x } else { v.y };
            // t dt/da
            let slope = alpha[axis] * along * along;
            match self.distribution {
                Distribution::Ggx => half * slope / (v.z * v.z + square).sqrt(),
                Distribution::Beckmann => {
                    let t = square.sqrt();
                    if t <= T::of(1e-6) * v.z.abs() {
                        return zero;
                    }
                    let a = v.z.abs() / t;
                    T::of(0.25 * FRAC_2_SQRT_PI) * (-a * a).exp() * slope / t
                }
            }
        };
        [0, 1].map(|axis| {
            let (a, x) = (alpha[axis], if axis == 0 { m.x } else { m.y });
            let q = x / a;
            let d = match self.distribution {
                Distribution::Ggx => T::of(4.0) * q * q / e - one,
                Distribution::Beckmann => T::of(2.0) * q * q / (m.z * m.z) - one,
            } / a;
            let (d_o, d_i) = (masked(wo, axis), masked(wi, axis));
            let g = match self.masking {
                Masking::Separable => -d_o / o - d_i / i,
                Masking::Correlated => -(zi * d_o + zo * d_i) / (zi * o + zo * i - zo * zi),
            };
            d + g
        })
    }
}

impl<T: Real> RoughConductor<T> {
    /// Adjoint of [`super::Scatter::eval`] for the gradient `g` of the value; zero where the surface is smooth.
    pub fn eval_vjp(&self, wo: Vec3<T>, wi: Vec3<T>, g: Vec3<T>) -> RoughConductorGradient<T> {
        let none = RoughConductorGradient::default();
        if !(wo.z > T::zero() && wi.z > T::zero()) || self.surface.is_smooth() {
            return none;
        }
        let Some(event) = reflection(&self.surface, wo, wi) else { return none };
        let one = vec3(T::one(), T::one(), T::one());
        let fresnel = Conductor { reflectance: one, ..self.metal }.fresnel(event.cosine) * event.value;
        let along = g.dot(fresnel.mul(self.metal.reflectance));
        let m = (wo + wi).normalize_or_zero();
        let alpha = self.surface.log_derivative(m, wo, wi).map(|d| d * along);
        RoughConductorGradient { reflectance: g.mul(fresnel), alpha }
    }
}
