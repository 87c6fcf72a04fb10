//! Curvature along one direction, and the Hessian times a vector.

use super::estimate::{Estimator, Pattern, Stencil, norm, stratum};
use super::hessian::{along_axis, second_difference};
use super::kernel::{GRADIENT_WEIGHT, HESSIAN_WEIGHT, gradient_quantile, hessian_quantile};
use super::noise::Noise;

/// Replaces the part of `z` along the unit vector `axis` by `at`.
pub(crate) fn set_along(z: &mut [f64], axis: &[f64], at: f64) {
    let before: f64 = z.iter().zip(axis).map(|(z, a)| z * a).sum();
    z.iter_mut().zip(axis).for_each(|(z, a)| *z += (at - before) * a);
}

/// `d^T H d` by a one-dimensional kernel along `d`, with jitter perpendicular to it that the stencil shares. Its variance
/// does not depend on the dimension.
#[derive(Clone, Debug)]
pub(crate) struct Curvature {
    /// Unit vector in units of sigma.
    pub(crate) axis: Vec<f64>,
    pub(crate) estimator: Estimator,
}

impl Pattern for Curvature {
    fn entries(&self) -> usize {
        1
    }

    fn groups(&self) -> usize {
        self.estimator.samples
    }

    fn points(&self) -> usize {
        along_axis(self.estimator.stencil, 0.5).1
    }

    fn place(&self, group: usize, noise: &mut Noise, t: &mut [f64]) {
        let Estimator { samples, stratified, stencil, .. } = self.estimator;
        let n = self.axis.len();
        let (places, _) = along_axis(stencil, stratum(noise, group, samples, stratified));
        let (first, rest) = t.split_at_mut(n);
        noise.fill_normal(first);
        set_along(first, &self.axis, 0.0);
        rest.chunks_exact_mut(n).for_each(|point| point.copy_from_slice(first));
        for (point, at) in t.chunks_exact_mut(n).zip(places) {
            point.iter_mut().zip(&self.axis).for_each(|(t, a)| *t += at * a);
        }
    }

    fn weigh(&self, _group: usize, t: &[f64], values: &[f64], out: &mut [f64]) {
        let mut places = [0.0; 4];
        for (at, t) in places.iter_mut().zip(t.chunks_exact(self.axis.len())) {
            *at = t.iter().zip(&self.axis).map(|(t, a)| t * a).sum();
        }
        out[0] = second_difference(&places[..values.len()], values);
    }
}

/// `H v` by the direct kernel `(t (t.v) - v) / sigma^2`: the part of `t` along `v` comes half from the Hessian's and
/// half from the gradient's kernel, which keeps all weights bounded along it.
#[derive(Clone, Debug)]
pub(crate) struct Product {
    /// Unit vector in units of sigma.
    pub(crate) axis: Vec<f64>,
    pub(crate) estimator: Estimator,
}

impl Product {
    fn weights(&self, t: &[f64], weight: f64, out: &mut [f64]) {
        let s: f64 = t.iter().zip(&self.axis).map(|(t, a)| t * a).sum();
        let density = 0.5 * ((s * s - 1.0).abs() / HESSIAN_WEIGHT + s.abs() / GRADIENT_WEIGHT);
        let factor = weight / density;
        out.iter_mut().zip(t.iter().zip(&self.axis)).for_each(|(out, (t, a))| *out += factor * (s * t - a));
    }
}

impl Pattern for Product {
    fn entries(&self) -> usize {
        self.axis.len()
    }

    fn groups(&self) -> usize {
        self.estimator.samples
    }

    fn points(&self) -> usize {
        match self.estimator.stencil {
            Stencil::Plain => 1,
            Stencil::Antithetic => 2,
            Stencil::FourPoint => 4,
        }
    }

    fn centred(&self) -> bool {
        self.estimator.stencil != Stencil::Plain
    }

    fn place(&self, group: usize, noise: &mut Noise, t: &mut [f64]) {
        let Estimator { samples, stratified, stencil, .. } = self.estimator;
        let n = self.axis.len();
        let u = 2.0 * stratum(noise, group, samples, stratified);
        let s = if u < 1.0 { hessian_quantile(u) } else { gradient_quantile(u - 1.0) };
        let (first, rest) = t.split_at_mut(n);
        noise.fill_normal(first);
        // The four signs of the parts along and across: their odd-odd part is what the product needs off its axis.
        set_along(first, &self.axis, 0.0);
        rest.chunks_exact_mut(n).for_each(|point| point.copy_from_slice(first));
        let signs: &[[f64; 2]] = match stencil {
            Stencil::Plain => &[[1.0, 1.0]],
            Stencil::Antithetic => &[[1.0, 1.0], [-1.0, -1.0]],
            Stencil::FourPoint => &[[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]],
        };
        for (point, [along, across]) in t.chunks_exact_mut(n).zip(signs) {
            point.iter_mut().zip(&self.axis).for_each(|(t, a)| *t = across * *t + along * s * a);
        }
    }

    fn weigh(&self, _group: usize, t: &[f64], values: &[f64], out: &mut [f64]) {
        let share = 1.0 / values.len() as f64;
        for (t, v) in t.chunks_exact(self.axis.len()).zip(values) {
            self.weights(t, share * v, out);
        }
    }
}

/// The direction `d` in units of sigma as a unit vector and a length; `None` for zero.
pub(crate) fn axis(direction: &[f64], sigma: &[f64]) -> Option<(Vec<f64>, f64)> {
    let mut axis: Vec<f64> = direction.iter().zip(sigma).map(|(d, s)| d / s).collect();
    let length = norm(&axis);
    if length == 0.0 || !length.is_finite() {
        return None;
    }
    axis.iter_mut().for_each(|a| *a /= length);
    Some((axis, length))
}
