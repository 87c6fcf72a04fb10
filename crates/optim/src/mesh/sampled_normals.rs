//! The bilateral filter of meshes by sampled normals (Solomon et al. 2014).

use super::edge_aware::take_normals;
use super::screened::Screened;
use super::solve::Lanes;
use crate::error::OptimError;
use crate::spatial::{Guidance, SpatialFilter};
use photofit_scalar::Real;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Solves that run at the same time; a fixed number, so that sums have a fixed order.
const BATCH: usize = 4;

/// Settings of [`SampledNormals`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampledNormalsConfig {
    /// Weight of the Laplacian: extent of the filter.
    pub lambda: f64,
    /// Width of the lobes by which vertices splat into the samples, positive.
    pub sigma_splat: f64,
    /// Width of the lobes by which vertices blend the samples, positive.
    pub sigma_blend: f64,
    /// Directions on the sphere (a Fibonacci lattice), at least 1.
    pub samples: usize,
}

impl Default for SampledNormalsConfig {
    /// The settings of the paper.
    fn default() -> Self {
        Self { lambda: 19.0, sigma_splat: 0.5, sigma_blend: 0.4, samples: 32 }
    }
}

/// The generalised bilateral filter guided by vertex normals: for every direction `s`, splat with
/// `d_i = exp(n_i . s / sigma_splat)`, diffuse `M^-1 [f d, d]` with `M = I + lambda L`, and blend with
/// `phi_i = exp(n_i . s / sigma_blend)`: `F_i = sum_s phi_i M^-1[f d]_i / sum_s phi_i M^-1[d]_i`.
///
/// The weight between normals at angle `gamma` is about `sinh R / R`, `R^2 = 1/a^2 + 1/b^2 + 2 cos(gamma) / (a b)`:
/// weak, .38 at a right angle and .1 at opposite normals for the paper's widths, and 32 samples carry 7% (rms) of error.
/// [`EdgeAware`](super::EdgeAware) separates better at one solve instead of one per sample and three channels. The
/// guide of each step is the vertex normals, `3 vertices` numbers.
#[derive(Debug)]
pub struct SampledNormals {
    screened: Screened,
    config: SampledNormalsConfig,
    directions: Vec<[f64; 3]>,
    normals: Vec<f64>,
}

/// Name in messages.
const NAME: &str = "sampled normals";

impl SampledNormals {
    /// For `vertices` welded vertices joined by `edges` (undirected; repeats and loops count once and not at all).
    ///
    /// # Errors
    /// [`OptimError::EdgeOutOfRange`], [`OptimError::Setting`], and [`OptimError::Factorization`] when memory runs out.
    pub fn new(
        vertices: usize,
        edges: &[[u32; 2]],
        config: SampledNormalsConfig,
    ) -> Result<Self, OptimError> {
        for (setting, sigma) in [("splat width", config.sigma_splat), ("blend width", config.sigma_blend)] {
            OptimError::setting(NAME, setting, sigma, "positive", sigma > 0.0)?;
        }
        let samples = config.samples;
        let good = (1..=1 << 16).contains(&samples);
        OptimError::setting(NAME, "sample count", samples as f64, "from 1 to 65536", good)?;
        let screened = Screened::new(NAME, vertices, edges, config.lambda)?;
        Ok(Self { screened, config, directions: fibonacci(samples), normals: Vec::new() })
    }

    /// Up to three channels with the diffused splat weights in the last lane, for one direction; rows in the
    /// factor's order.
    fn diffuse(&self, channels: &[Lanes], direction: [f64; 3]) -> Vec<Lanes> {
        let (forward, _) = self.screened.order();
        let mut lanes: Vec<Lanes> = forward
            .iter()
            .zip(channels)
            .map(|(&i, c)| {
                // Relative to the largest weight that there can be: exp(1 / sigma) overflows for small sigma.
                let d = ((self.cosine(i as usize, direction) - 1.0) / self.config.sigma_splat).exp();
                [c[0] * d, c[1] * d, c[2] * d, d]
            })
            .collect();
        self.screened.solve(&mut lanes);
        lanes
    }

    fn cosine(&self, i: usize, s: [f64; 3]) -> f64 {
        let n = &self.normals[3 * i..3 * i + 3];
        (n[0] * s[0] + n[1] * s[1] + n[2] * s[2]).clamp(-1.0, 1.0)
    }

    /// The filter on up to three channels, rows in the factor's order.
    fn filter(&self, channels: &[Lanes]) -> Vec<Lanes> {
        let (forward, _) = self.screened.order();
        let mut sums = vec![[0.0_f64; 4]; channels.len()];
        for batch in self.directions.chunks(BATCH) {
            let diffused: Vec<Vec<Lanes>> = batch.par_iter().map(|s| self.diffuse(channels, *s)).collect();
            sums.par_iter_mut().with_min_len(1024).enumerate().for_each(|(r, sum)| {
                let i = forward[r] as usize;
                for (s, diffused) in batch.iter().zip(&diffused) {
                    let phi = ((self.cosine(i, *s) - 1.0) / self.config.sigma_blend).exp();
                    for k in 0..4 {
                        sum[k] += phi * diffused[r][k];
                    }
                }
            });
        }
        for (sum, own) in sums.iter_mut().zip(channels) {
            // No sample within reach of a very small sigma: nobody else either.
            let usable = sum[3] > f64::MIN_POSITIVE;
            *sum = if usable { sum.map(|x| x / sum[3]) } else { *own };
        }
        sums
    }
}

/// `n` directions spread evenly over the sphere.
fn fibonacci(n: usize) -> Vec<[f64; 3]> {
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    let direction = |k: usize| {
        let z = 1.0 - (2 * k + 1) as f64 / n as f64;
        let (radius, angle) = ((1.0 - z * z).max(0.0).sqrt(), golden * k as f64);
        [radius * angle.cos(), radius * angle.sin(), z]
    };
    (0..n).map(direction).collect()
}

impl<T: Real> SpatialFilter<T> for SampledNormals {
    fn sites(&self) -> usize {
        self.screened.vertices()
    }

    fn prepare(&mut self, guidance: &Guidance<'_, T>) -> Result<(), OptimError> {
        self.normals = take_normals(guidance, self.screened.vertices())?;
        Ok(())
    }

    fn apply(&mut self, fields: &[&[T]], out: &mut [&mut [T]]) {
        let n = self.screened.vertices();
        if n == 0 {
            return;
        }
        let (forward, inverse) = self.screened.order();
        for (field, out) in fields.iter().zip(out) {
            let width = field.len() / n;
            for first in (0..width).step_by(3) {
                let count = (width - first).min(3);
                let gather = |&i: &u32| {
                    let mut lane = [0.0; 4];
                    for (k, lane) in lane.iter_mut().enumerate().take(count) {
                        *lane = field[width * i as usize + first + k].f64();
                    }
                    lane
                };
                let channels: Vec<Lanes> = forward.iter().map(gather).collect();
                let filtered = self.filter(&channels);
                for (row, &r) in out.chunks_exact_mut(width).zip(inverse) {
                    for k in 0..count {
                        row[first + k] = T::of(filtered[r as usize][k]);
                    }
                }
            }
        }
    }
}
