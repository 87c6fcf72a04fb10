//! Entries of the Hessian of the smoothed objective: single ones, the diagonal, or all from each sample.

use std::ops::Range;

use super::estimate::{Estimator, Kernel, Pattern, Stencil, stratum};
use super::gradient::split;
use super::kernel::{
    GRADIENT_WEIGHT, HESSIAN_WEIGHT, OFF_DIAGONAL_WEIGHT, gradient_magnitude, gradient_quantile,
    hessian_inner, hessian_outer, hessian_quantile,
};
use super::noise::Noise;

/// Samples of a list of entries, one after the other.
#[derive(Clone, Debug)]
pub(crate) struct Entries {
    pub(crate) dimension: usize,
    /// Row and column of each.
    pub(crate) list: Vec<[usize; 2]>,
    pub(crate) estimator: Estimator,
}

/// Points of a group for one entry.
fn size(stencil: Stencil) -> usize {
    match stencil {
        Stencil::Plain => 1,
        Stencil::Antithetic => 2,
        Stencil::FourPoint => 4,
    }
}

/// The coordinates `t` of the points of a group along one axis, for the second derivative.
///
/// The 4-point stencil consists of both outer and both inner points; a pair is `{xi, 1 - xi}`, in one lobe.
pub(crate) fn along_axis(stencil: Stencil, xi: f64) -> ([f64; 4], usize) {
    match stencil {
        Stencil::Plain => ([hessian_quantile(xi), 0.0, 0.0, 0.0], 1),
        Stencil::Antithetic => ([hessian_quantile(xi), -hessian_quantile(xi), 0.0, 0.0], 2),
        Stencil::FourPoint => {
            let (outer, inner) = (hessian_outer(xi), hessian_inner(xi));
            ([-outer, -inner, inner, outer], 4)
        }
    }
}

/// Sign of the second derivative's kernel.
#[inline]
pub(crate) fn lobe(t: f64) -> f64 {
    if t.abs() > 1.0 { 1.0 } else { -1.0 }
}

/// The mean over a group of the values weighed by [`lobe`], times the kernel's weight; `t(i)` is the place of point i.
///
/// Differences of an outer and an inner value come first, so that constants cancel exactly.
pub(crate) fn second_difference(t: &[f64], values: &[f64]) -> f64 {
    if let ([_, _, _, _], [a, b, c, d]) = (t, values) {
        return 0.25 * HESSIAN_WEIGHT * ((a - b) + (d - c));
    }
    let sum: f64 = t.iter().zip(values).map(|(t, v)| lobe(*t) * v).sum();
    HESSIAN_WEIGHT * sum / values.len() as f64
}

impl Pattern for Entries {
    fn entries(&self) -> usize {
        self.list.len()
    }

    fn groups(&self) -> usize {
        self.list.len() * self.estimator.samples
    }

    fn points(&self) -> usize {
        size(self.estimator.stencil)
    }

    fn place(&self, group: usize, noise: &mut Noise, t: &mut [f64]) {
        let Estimator { samples, stratified, stencil, .. } = self.estimator;
        let [i, j] = self.list[group / samples];
        let n = self.dimension;
        let xi = stratum(noise, group % samples, samples, stratified);
        let other = noise.uniform();
        // The perpendicular jitter is shared: what depends on it alone cancels.
        let (first, rest) = t.split_at_mut(n);
        noise.fill_normal(first);
        rest.chunks_exact_mut(n).for_each(|point| point.copy_from_slice(first));
        if i == j {
            let (places, _) = along_axis(stencil, xi);
            t.chunks_exact_mut(n).zip(places).for_each(|(point, at)| point[i] = at);
            return;
        }
        let (a, b) = match stencil {
            Stencil::Plain | Stencil::Antithetic => (gradient_quantile(xi), gradient_quantile(other)),
            Stencil::FourPoint => (gradient_magnitude(xi), gradient_magnitude(other)),
        };
        let signs = [[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]];
        for (point, [x, y]) in t.chunks_exact_mut(n).zip(signs) {
            (point[i], point[j]) = (x * a, y * b);
        }
    }

    fn target(&self, group: usize) -> Range<usize> {
        let entry = group / self.estimator.samples;
        entry..entry + 1
    }

    fn weigh(&self, group: usize, t: &[f64], values: &[f64], out: &mut [f64]) {
        let [i, j] = self.list[group / self.estimator.samples];
        if i == j {
            let mut places = [0.0; 4];
            places.iter_mut().zip(t.chunks_exact(self.dimension)).for_each(|(p, t)| *p = t[i]);
            out[0] = second_difference(&places[..values.len()], values);
        } else if let [a, b, c, d] = values {
            out[0] = 0.25 * OFF_DIAGONAL_WEIGHT * ((a - c) + (b - d));
        } else {
            let points = t.chunks_exact(self.dimension).zip(values);
            let sum: f64 = points.map(|(t, v)| t[i].signum() * t[j].signum() * v).sum();
            out[0] = OFF_DIAGONAL_WEIGHT * sum / values.len() as f64;
        }
    }
}

/// All entries from each sample.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Aggregate {
    pub(crate) dimension: usize,
    pub(crate) estimator: Estimator,
}

impl Aggregate {
    /// `weight` times the kernels of all entries over the mixture's density, in units of the normal density.
    fn weights(&self, t: &[f64], weight: f64, out: &mut [f64]) {
        let n = self.dimension;
        let density = match self.estimator.kernel {
            Kernel::Score => 1.0,
            _ => mixture(t),
        };
        let factor = weight / density;
        for (k, row) in out.chunks_exact_mut(n).enumerate() {
            row.iter_mut().zip(t).for_each(|(out, t_l)| *out += factor * t[k] * t_l);
            row[k] -= factor;
        }
    }
}

/// Density of the mixture of all `n^2` entries' kernels over the normal density.
fn mixture(t: &[f64]) -> f64 {
    let (mut lobes, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for t in t {
        lobes += (t * t - 1.0).abs();
        sum += t.abs();
        squares += t * t;
    }
    let off = if t.len() > 1 { (sum * sum - squares) / GRADIENT_WEIGHT.powi(2) } else { 0.0 };
    (lobes / HESSIAN_WEIGHT + off) / (t.len() * t.len()) as f64
}

impl Pattern for Aggregate {
    fn entries(&self) -> usize {
        self.dimension * self.dimension
    }

    fn groups(&self) -> usize {
        self.estimator.samples
    }

    fn points(&self) -> usize {
        size(self.estimator.stencil)
    }

    fn centred(&self) -> bool {
        self.estimator.stencil != Stencil::Plain
    }

    fn place(&self, group: usize, noise: &mut Noise, t: &mut [f64]) {
        let n = self.dimension;
        let Estimator { samples, stratified, stencil, kernel } = self.estimator;
        let (entry, xi) = split(stratum(noise, group, samples, stratified), n * n);
        let (i, j) = (entry / n, entry % n);
        let other = noise.uniform();
        let four = stencil == Stencil::FourPoint;
        // Pairs of mirrored points; the second pair of a 4-point stencil has the other lobe, or the other two quadrants.
        for (p, pair) in t.chunks_mut(2 * n).enumerate() {
            let (plus, minus) = pair.split_at_mut(n);
            noise.fill_normal(plus);
            match (kernel, i == j) {
                (Kernel::Score, _) => {}
                (_, true) if four => plus[i] = if p == 0 { hessian_outer(xi) } else { hessian_inner(xi) },
                (_, true) => plus[i] = hessian_quantile(xi),
                (_, false) => {
                    let flip = if p == 0 { 1.0 } else { -1.0 };
                    (plus[i], plus[j]) = (gradient_quantile(xi), flip * gradient_quantile(other));
                }
            }
            minus.iter_mut().zip(plus).for_each(|(m, p)| *m = -*p);
        }
    }

    fn weigh(&self, _group: usize, t: &[f64], values: &[f64], out: &mut [f64]) {
        if values.len() == 1 {
            return self.weights(t, values[0], out);
        }
        let share = 1.0 / values.len() as f64;
        for (t, v) in t.chunks_exact(2 * self.dimension).zip(values.chunks_exact(2)) {
            self.weights(&t[..self.dimension], share * (v[0] + v[1]), out);
        }
    }
}
