//! Gradient of the smoothed objective.

use std::ops::Range;

use super::estimate::{Estimator, Kernel, Pattern, Stencil, stratum};
use super::kernel::{GRADIENT_WEIGHT, gradient_magnitude, gradient_quantile};
use super::noise::Noise;

/// Samples of the gradient; see [`Estimator`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gradient {
    pub(crate) dimension: usize,
    pub(crate) estimator: Estimator,
}

impl Gradient {
    fn size(&self) -> usize {
        match self.estimator.stencil {
            Stencil::Plain => 1,
            Stencil::Antithetic => 2,
            Stencil::FourPoint => 4,
        }
    }

    /// The coordinate that a group samples by the gradient kernel, and its random number.
    fn pick(&self, group: usize, noise: &mut Noise) -> (usize, f64) {
        let Estimator { samples, stratified, .. } = self.estimator;
        match self.estimator.kernel {
            Kernel::Coordinates => (group / samples, stratum(noise, group % samples, samples, stratified)),
            Kernel::Aggregate | Kernel::Score => {
                split(stratum(noise, group, samples, stratified), self.dimension)
            }
        }
    }

    /// The weights of one point for all coordinates.
    fn weights(&self, t: &[f64], scale: f64, out: &mut [f64]) {
        let factor = match self.estimator.kernel {
            Kernel::Score => scale,
            _ => scale * GRADIENT_WEIGHT * t.len() as f64 / t.iter().map(|t| t.abs()).sum::<f64>(),
        };
        out.iter_mut().zip(t).for_each(|(out, t)| *out += factor * t);
    }
}

/// Number in (0, 1) as one of `n` choices and what remains of it, again in (0, 1).
#[inline]
pub(crate) fn split(u: f64, n: usize) -> (usize, f64) {
    let scaled = u * n as f64;
    let choice = (scaled as usize).min(n - 1);
    (choice, (scaled - choice as f64).clamp(f64::EPSILON, 1.0 - f64::EPSILON))
}

impl Pattern for Gradient {
    fn entries(&self) -> usize {
        self.dimension
    }

    fn groups(&self) -> usize {
        match self.estimator.kernel {
            Kernel::Coordinates => self.estimator.samples * self.dimension,
            Kernel::Aggregate | Kernel::Score => self.estimator.samples,
        }
    }

    fn points(&self) -> usize {
        self.size()
    }

    fn place(&self, group: usize, noise: &mut Noise, t: &mut [f64]) {
        let (k, xi) = self.pick(group, noise);
        let score = self.estimator.kernel == Kernel::Score;
        let n = self.dimension;
        noise.fill_normal(&mut t[..n]);
        if self.estimator.stencil == Stencil::Plain {
            t[k] = if score { t[k] } else { gradient_quantile(xi) };
            return;
        }
        let (first, second) = t.split_at_mut(2 * n);
        if !second.is_empty() {
            if self.estimator.kernel == Kernel::Coordinates {
                // The other coordinates mirrored once more: their linear part cancels between the pairs.
                second[..n].iter_mut().zip(first.iter()).for_each(|(b, a)| *b = -*a);
            } else {
                noise.fill_normal(&mut second[..n]);
            }
        }
        // Magnitudes of {xi, 1 - xi} and, in a 4-point stencil, {1/2 - xi, 1/2 + xi}.
        for (pair, y) in [(first, xi), (second, 1.0 - xi)] {
            if pair.is_empty() {
                break;
            }
            let (plus, minus) = pair.split_at_mut(n);
            if !score {
                plus[k] = gradient_magnitude(y);
            }
            // The whole vector is mirrored: all even parts cancel, and at a symmetric minimum nothing is left.
            minus.iter_mut().zip(plus).for_each(|(m, p)| *m = -*p);
        }
    }

    fn target(&self, group: usize) -> Range<usize> {
        match self.estimator.kernel {
            Kernel::Coordinates => {
                let k = group / self.estimator.samples;
                k..k + 1
            }
            Kernel::Aggregate | Kernel::Score => 0..self.dimension,
        }
    }

    fn weigh(&self, group: usize, t: &[f64], values: &[f64], out: &mut [f64]) {
        let share = 1.0 / values.len() as f64;
        if self.estimator.kernel == Kernel::Coordinates {
            let k = group / self.estimator.samples;
            for (t, v) in t.chunks_exact(self.dimension).zip(values) {
                out[0] += share * GRADIENT_WEIGHT * v * t[k].signum();
            }
            return;
        }
        if values.len() == 1 {
            return self.weights(t, values[0], out);
        }
        for (t, v) in t.chunks_exact(2 * self.dimension).zip(values.chunks_exact(2)) {
            self.weights(&t[..self.dimension], share * (v[0] - v[1]), out);
        }
    }
}
