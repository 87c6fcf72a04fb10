//! The loop that all estimators share: place groups of samples, evaluate the black box, weigh, average.

use std::ops::Range;

use super::black_box::{Batch, BlackBox};
use super::error::SampledError;
use super::noise::{Noise, hash};

/// At most this many points, and this many numbers, go to the black box at once.
const BATCH_POINTS: usize = 1 << 14;
const BATCH_NUMBERS: usize = 1 << 20;

/// A sampled derivative with its statistical error.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// The estimate: gradient, Hessian (row by row), Hessian-vector product or a single number.
    pub value: Vec<f64>,
    /// Variance of each entry, from the scatter of the groups of samples behind it; NaN where there was one group only.
    /// For stratified samples it is an upper bound.
    pub variance: Vec<f64>,
    /// Mean of the black box over the samples: roughly the loss, seen through the sampling density.
    pub mean: f64,
    /// Evaluations spent.
    pub evaluations: u64,
    /// False when all values were exactly equal: the samples saw nothing but a plateau, and [`Self::value`] holds noise
    /// or zeros. Never divide by it.
    pub informative: bool,
}

impl Estimate {
    /// Length of the estimate over the root of its summed variances, `None` while the variance is unknown; infinite
    /// for an estimate without noise, 0 for an exact zero.
    pub fn signal_to_noise(&self) -> Option<f64> {
        let signal = norm(&self.value);
        let noise = self.variance.iter().sum::<f64>().sqrt();
        (!noise.is_nan()).then_some(if signal == 0.0 { 0.0 } else { signal / noise })
    }

    /// Standard error of entry `i`; NaN where unknown.
    pub fn standard_error(&self, i: usize) -> f64 {
        self.variance[i].sqrt()
    }
}

/// Euclidean length, without overflow or underflow of the squares.
pub(crate) fn norm(x: &[f64]) -> f64 {
    let largest = x.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    if largest == 0.0 || !largest.is_finite() {
        return largest;
    }
    largest * x.iter().map(|x| (x / largest).powi(2)).sum::<f64>().sqrt()
}

/// How one estimator places and weighs its samples, in units of sigma around the centre.
pub(crate) trait Pattern {
    /// Numbers estimated.
    fn entries(&self) -> usize;
    /// Groups of samples in all.
    fn groups(&self) -> usize;
    /// Points of a group: they share their noise, and no part of them is an estimate.
    fn points(&self) -> usize;
    /// Whether the value at the centre shall be taken off all others (one evaluation more).
    fn centred(&self) -> bool {
        false
    }
    /// The points of a group, one after the other.
    fn place(&self, group: usize, noise: &mut Noise, t: &mut [f64]);
    /// The entries to which a group contributes.
    fn target(&self, _group: usize) -> Range<usize> {
        0..self.entries()
    }
    /// The estimate of one group for its entries, in units of sigma; `out` comes zeroed.
    fn weigh(&self, group: usize, t: &[f64], values: &[f64], out: &mut [f64]);
}

/// A black box with the count of its evaluations and the buffers of an estimate.
#[derive(Clone, Debug)]
pub(crate) struct Evaluator<B> {
    pub(crate) black_box: B,
    pub(crate) evaluations: u64,
    t: Vec<f64>,
    points: Vec<f64>,
    seeds: Vec<u64>,
    values: Vec<f64>,
}

impl<B: BlackBox> Evaluator<B> {
    pub(crate) fn new(black_box: B) -> Self {
        let (t, points, seeds, values) = Default::default();
        Self { black_box, evaluations: 0, t, points, seeds, values }
    }

    /// Evaluates the points in `self.points`.
    fn evaluate(&mut self, dimension: usize) -> Result<(), SampledError<B::Error>> {
        self.values.clear();
        self.values.resize(self.seeds.len(), 0.0);
        let batch = Batch::new(dimension, &self.points, &self.seeds);
        self.black_box.evaluate(&batch, &mut self.values).map_err(SampledError::BlackBox)?;
        if let Some(i) = self.values.iter().position(|v| !v.is_finite()) {
            return Err(SampledError::NonFinite {
                evaluation: self.evaluations + i as u64,
                seed: batch.seed(i),
                value: self.values[i],
                point: batch.point(i).to_vec(),
            });
        }
        self.evaluations += self.seeds.len() as u64;
        Ok(())
    }

    /// Runs a pattern around `theta` with the standard deviations `sigma`, sample set `seed`. The units of the result
    /// are those of sigma.
    pub(crate) fn estimate(
        &mut self,
        theta: &[f64],
        sigma: &[f64],
        seed: u64,
        pattern: &impl Pattern,
    ) -> Result<Estimate, SampledError<B::Error>> {
        let n = theta.len();
        let before = self.evaluations;
        let mut totals = Totals::new(pattern.entries());
        if pattern.centred() {
            self.points.clear();
            self.points.extend_from_slice(theta);
            self.seeds.clear();
            self.seeds.push(hash(!seed, 0));
            self.evaluate(n)?;
            totals.see(&self.values);
            totals.centre = self.values[0];
        }
        let size = pattern.points();
        let at_once = (BATCH_POINTS / size).min(BATCH_NUMBERS / (size * n)).max(1);
        let mut scratch = Vec::new();
        for first in (0..pattern.groups()).step_by(at_once) {
            let groups = first..pattern.groups().min(first + at_once);
            self.t.clear();
            self.t.resize(groups.len() * size * n, 0.0);
            self.seeds.clear();
            for (group, t) in groups.clone().zip(self.t.chunks_exact_mut(size * n)) {
                pattern.place(group, &mut Noise::new(seed, group as u64 + 1), t);
                // With a centre, all differences are taken to one evaluation: its noise must be everyone's.
                let noise = if pattern.centred() { 0 } else { group as u64 };
                self.seeds.extend(std::iter::repeat_n(hash(!seed, noise), size));
            }
            self.points.clear();
            for t in self.t.chunks_exact(n) {
                self.points.extend(t.iter().zip(theta).zip(sigma).map(|((t, x), s)| x + s * t));
            }
            self.evaluate(n)?;
            totals.see(&self.values);
            if totals.centre != 0.0 {
                self.values.iter_mut().for_each(|v| *v -= totals.centre);
            }
            for (group, (t, v)) in
                groups.zip(self.t.chunks_exact(size * n).zip(self.values.chunks_exact(size)))
            {
                let target = pattern.target(group);
                scratch.clear();
                scratch.resize(target.len(), 0.0);
                pattern.weigh(group, t, v, &mut scratch);
                totals.add(target, &scratch);
            }
        }
        Ok(totals.finish(self.evaluations - before))
    }
}

/// Running means and squared deviations (Welford 1962).
struct Totals {
    count: Vec<f64>,
    mean: Vec<f64>,
    squares: Vec<f64>,
    centre: f64,
    sum: f64,
    range: [f64; 2],
}

impl Totals {
    fn new(entries: usize) -> Self {
        let zeros = vec![0.0; entries];
        let range = [f64::INFINITY, f64::NEG_INFINITY];
        Self { count: zeros.clone(), mean: zeros.clone(), squares: zeros, centre: 0.0, sum: 0.0, range }
    }

    fn see(&mut self, values: &[f64]) {
        for v in values {
            self.sum += v;
            self.range = [self.range[0].min(*v), self.range[1].max(*v)];
        }
    }

    fn add(&mut self, target: Range<usize>, values: &[f64]) {
        for (i, v) in target.zip(values) {
            self.count[i] += 1.0;
            let delta = v - self.mean[i];
            self.mean[i] += delta / self.count[i];
            self.squares[i] += delta * (v - self.mean[i]);
        }
    }

    fn finish(self, evaluations: u64) -> Estimate {
        let variance =
            |(squares, n): (f64, &f64)| if *n > 1.0 { squares / (n * (n - 1.0)) } else { f64::NAN };
        Estimate {
            variance: self.squares.into_iter().zip(&self.count).map(variance).collect(),
            value: self.mean,
            mean: self.sum / evaluations.max(1) as f64,
            evaluations,
            informative: self.range[0] < self.range[1],
        }
    }
}

/// How the samples of an estimate are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimator {
    /// Groups of samples: per parameter (or per entry of the Hessian) for [`Kernel::Coordinates`], in all otherwise.
    pub samples: usize,
    /// Points of a group.
    pub stencil: Stencil,
    /// The density.
    pub kernel: Kernel,
    /// Whether the first random number of the groups is stratified: one in each of `samples` equal parts.
    pub stratified: bool,
}

impl Default for Estimator {
    fn default() -> Self {
        Self { samples: 2, stencil: Stencil::Antithetic, kernel: Kernel::Coordinates, stratified: true }
    }
}

/// Points that are evaluated together, so that what is known to cancel does cancel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stencil {
    /// Single points. For comparison: constants do not cancel.
    Plain,
    /// Pairs `{xi, 1 - xi}`, mirrored at the centre. For the gradient, even parts of the function cancel. For a Hessian
    /// entry both fall in one lobe and nothing cancels: it is for the aggregate kernel, which takes the centre off.
    Antithetic,
    /// `{xi, 1/2 - xi, 1/2 + xi, 1 - xi}`: for the Hessian two points in the outer lobes and two in the inner, so that
    /// constant and linear parts cancel exactly; for the gradient two pairs of which one lies far where the other lies
    /// near. Off the diagonal the four quadrants.
    FourPoint,
}

/// The density from which samples are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernel {
    /// One parameter (or one entry) after the other by its own kernel: cost grows with the number of entries.
    Coordinates,
    /// Each sample by the kernel of one random entry, weighed for all entries by the mixture of all kernels: any number
    /// of samples gives a full estimate.
    Aggregate,
    /// Plain Gaussian samples, the classical score-function estimator (as in evolution strategies). For comparison.
    Score,
}

/// A random number in (0, 1) for group `index` of `count`, stratified or not.
#[inline]
pub(crate) fn stratum(noise: &mut Noise, index: usize, count: usize, stratified: bool) -> f64 {
    let u = noise.uniform();
    if stratified { ((index as f64 + u) / count as f64).clamp(f64::EPSILON, 1.0 - f64::EPSILON) } else { u }
}
