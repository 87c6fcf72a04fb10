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
        let (zero, one) = (T::zero(), T::one());
        let (o, i) = (self.masked(wo), self.masked(wi));
        let (zo, zi) = (wo.z.abs(), wi.z.abs());
        let (ax, ay) = self.alphas();
        let inverse = [one / ax, one / ay];
        let q = {
            let (x, y) = (m.x * inverse[0], m.y * inverse[1]);
            [x * x, y * y]
        };
        let scale = match self.distribution {
            Distribution::Ggx => T::of(4.0) / (q[0] + q[1] + m.z * m.z),
            Distribution::Beckmann => T::of(2.0) / (m.z * m.z),
        };
        // Of |z| (1 + Lambda) = `whole` by half the square of the stretched length.
        let slope = |v: Vec3<T>, z: T, whole: T| match self.distribution {
            Distribution::Ggx => T::of(0.5) / (whole + whole - z),
            Distribution::Beckmann => {
                let (x, y) = (ax * v.x, ay * v.y);
                let t = (x * x + y * y).sqrt();
                if t <= T::of(1e-6) * z {
                    return zero;
                }
                let a = z / t;
                T::of(0.25 * FRAC_2_SQRT_PI) * (-a * a).exp() / t
            }
        };
        let (by_o, by_i) = (slope(wo, zo, o), slope(wi, zi, i));
        let (by_o, by_i) = match self.masking {
            Masking::Separable => (by_o / o, by_i / i),
            Masking::Correlated => {
                let joined = one / (zi * o + zo * i - zo * zi);
                (by_o * zi * joined, by_i * zo * joined)
            }
        };
        let axis = |a: T, inverse: T, q: T, (xo, xi): (T, T)| {
            (scale * q - one) * inverse - a * (by_o * xo * xo + by_i * xi * xi)
        };
        [axis(ax, inverse[0], q[0], (wo.x, wi.x)), axis(ay, inverse[1], q[1], (wo.y, wi.y))]
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

    /// As [`Self::eval_vjp`] where the `value` is known, which may have a further factor that `g` then lacks: without
    /// Fresnel's equations. A channel of the reflectance that is 0 gets none here: [`Self::eval_vjp`] tells it.
    pub fn eval_vjp_of(
        &self,
        wo: Vec3<T>,
        wi: Vec3<T>,
        g: Vec3<T>,
        value: Vec3<T>,
    ) -> RoughConductorGradient<T> {
        let zero = T::zero();
        if !(wo.z > zero && wi.z > zero) || self.surface.is_smooth() {
            return RoughConductorGradient::default();
        }
        let part = g.mul(value);
        let m = (wo + wi).normalize_or_zero();
        let along = part.x + part.y + part.z;
        let alpha = self.surface.log_derivative(m, wo, wi).map(|d| d * along);
        let over = |part: T, factor: T| if factor > zero { part / factor } else { zero };
        let r = self.metal.reflectance;
        RoughConductorGradient {
            reflectance: vec3(over(part.x, r.x), over(part.y, r.y), over(part.z, r.z)),
            alpha,
        }
    }
}
