//! The piecewise smooth problems of figures 2 and 3 of the bilateral optimizer's paper (Belhe et al. 2025), in one and
//! two dimensions, and the methods that are compared on them. Shared by the gates and the benchmark.

use photofit_optim::{
    Bilateral, Grid, GridBilateral, OptimError, Optimizer, Placement, Schedule, ScreenedPoisson, Sigma, Taps,
    Temporal,
};
use photofit_sampling::Rng;
use std::f64::consts::TAU;

/// A target on a grid.
#[derive(Clone, Debug)]
pub(crate) struct Target {
    pub(crate) grid: Grid,
    pub(crate) values: Vec<f32>,
}

impl Target {
    /// 1000 samples in 12 segments with distinct cuts in [20, 980); base U(-1, 1); the segments in turn constant, with a
    /// ramp of slope U(-.3, .3), and with a sine of amplitude .1.
    pub(crate) fn line(seed: u64) -> Self {
        let mut rng = Rng::new(seed, 1);
        let mut cuts = vec![0, 1000];
        while cuts.len() < 13 {
            let cut = 20 + rng.range(960) as usize;
            if !cuts.contains(&cut) {
                cuts.push(cut);
            }
        }
        cuts.sort_unstable();
        let mut values = Vec::with_capacity(1000);
        for (k, pair) in cuts.windows(2).enumerate() {
            let base = 2.0 * rng.next_f64() - 1.0;
            let slope = 0.6 * rng.next_f64() - 0.3;
            let length = (pair[1] - pair[0]) as f64;
            for i in 0..pair[1] - pair[0] {
                let u = i as f64 / length;
                let shape = [0.0, slope * u, 0.1 * (TAU * u).sin()][k % 3];
                values.push((base + shape) as f32);
            }
        }
        Self { grid: Grid::line(1000), values }
    }

    /// `n x n` samples in 12 cells of nearest centres, with the same three kinds of content across a cell.
    pub(crate) fn plane(seed: u64, n: usize) -> Self {
        let mut rng = Rng::new(seed, 2);
        let mut cells = Vec::new();
        for _ in 0..12 {
            let numbers: [f64; 5] = std::array::from_fn(|_| rng.next_f64());
            cells.push(numbers);
        }
        let sample = |x: f64, y: f64| {
            let distance = |c: &[f64; 5]| (x - c[0]).powi(2) + (y - c[1]).powi(2);
            let nearest =
                (0..cells.len()).min_by(|a, b| distance(&cells[*a]).total_cmp(&distance(&cells[*b])));
            let k = nearest.unwrap_or(0);
            let [cx, cy, base, slope, angle] = cells[k];
            let (sin, cos) = (TAU * angle).sin_cos();
            let u = 2.0 * ((x - cx) * cos + (y - cy) * sin);
            2.0 * base - 1.0 + [0.0, (0.6 * slope - 0.3) * u, 0.1 * (TAU * u).sin()][k % 3]
        };
        let at = |i: usize| (i as f64 + 0.5) / n as f64;
        let values = (0..n * n).map(|i| sample(at(i % n), at(i / n)) as f32).collect();
        Self { grid: Grid::plane(n, n), values }
    }

    /// `|theta - theta*| / |theta*|`.
    pub(crate) fn error(&self, theta: &[f32]) -> f64 {
        let square = |x: f32| f64::from(x) * f64::from(x);
        let off: f64 = theta.iter().zip(&self.values).map(|(t, v)| square(t - v)).sum();
        (off / self.values.iter().map(|v| square(*v)).sum::<f64>()).sqrt()
    }
}

/// Where gradients come from.
#[derive(Debug)]
pub(crate) enum Source {
    /// `|A (theta - theta*)|^2`, `A` square with standard normal entries: anisotropic, without noise (figure 2).
    Anisotropic(Vec<f32>),
    /// `|theta - theta*|^2` with standard normal noise on every gradient (figure 3).
    Noisy(Box<Rng>),
}

impl Source {
    pub(crate) fn anisotropic(seed: u64, n: usize) -> Self {
        let mut rng = Rng::new(seed, 3);
        Self::Anisotropic((0..n * n).map(|_| rng.normal()).collect())
    }

    pub(crate) fn noisy(seed: u64) -> Self {
        Self::Noisy(Box::new(Rng::new(seed, 4)))
    }

    fn gradient(&mut self, target: &Target, theta: &[f32], g: &mut [f32]) {
        let off: Vec<f32> = theta.iter().zip(&target.values).map(|(t, v)| t - v).collect();
        match self {
            Self::Anisotropic(a) => {
                g.fill(0.0);
                for row in a.chunks_exact(off.len()) {
                    let dot = 2.0 * dot(row, &off);
                    g.iter_mut().zip(row).for_each(|(g, a)| *g += a * dot);
                }
            }
            Self::Noisy(rng) => g.iter_mut().zip(&off).for_each(|(g, d)| *g = 2.0 * d + rng.normal()),
        }
    }
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut lanes = [0.0_f32; 16];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<16>(), b.as_chunks::<16>());
    for (a, b) in a.iter().zip(b) {
        for k in 0..16 {
            lanes[k] += a[k] * b[k];
        }
    }
    lanes.iter().sum::<f32>() + a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum::<f32>()
}

/// What filters.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Filter {
    None,
    Laplacian(f64),
    Bilateral(Bilateral),
}

/// A method with its settings.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Method {
    #[allow(dead_code, reason = "the benchmark's names")]
    pub(crate) name: &'static str,
    pub(crate) rate: f64,
    pub(crate) beta1: f64,
    pub(crate) filter: Filter,
    pub(crate) placement: Placement,
    pub(crate) schedule: Schedule,
}

impl Method {
    pub(crate) const fn adam(rate: f64, beta1: f64) -> Self {
        let (filter, placement) = (Filter::None, Placement::POST);
        Self { name: "Adam", rate, beta1, filter, placement, schedule: Schedule::Constant }
    }

    pub(crate) const fn laplacian(rate: f64, beta1: f64, lambda: f64) -> Self {
        Self { name: "Laplacian", filter: Filter::Laplacian(lambda), ..Self::adam(rate, beta1) }
    }

    /// The bilateral filter with B3 taps and strides 1 to 16.
    pub(crate) const fn bilateral(rate: f64, beta1: f64, sigma: Sigma) -> Self {
        let filter = Filter::Bilateral(Bilateral {
            levels: 5,
            taps: Taps::B3,
            map: photofit_optim::GuideMap::Linear,
            sigma,
            source: photofit_optim::Source::Parameters,
            coarse_to_fine: false,
        });
        Self { name: "bilateral", filter, ..Self::adam(rate, beta1) }
    }

    #[allow(dead_code, reason = "the benchmark's names")]
    pub(crate) const fn named(self, name: &'static str) -> Self {
        Self { name, ..self }
    }

    /// The rate falls to zero at step `total` along half a cosine.
    pub(crate) const fn cosine(self, total: u64) -> Self {
        Self { schedule: Schedule::WarmupCosine { warmup: 0, total, floor: 0.0 }, ..self }
    }

    pub(crate) const fn placed(self, placement: Placement) -> Self {
        Self { placement, ..self }
    }

    pub(crate) fn optimizer(&self, grid: Grid) -> Result<Optimizer<f32>, OptimError> {
        let plain = Optimizer::new("theta", grid.sites(), Temporal::adam().paired(self.beta1))?;
        match self.filter {
            Filter::None => Ok(plain),
            Filter::Laplacian(lambda) => {
                plain.with_filter(self.placement, ScreenedPoisson::new("theta", grid, lambda)?)
            }
            Filter::Bilateral(config) => {
                plain.with_filter(self.placement, GridBilateral::new("theta", grid, 1, config)?)
            }
        }
    }

    /// Errors after 0, 1, ..., `steps` steps from zero.
    pub(crate) fn run(
        &self,
        target: &Target,
        mut source: Source,
        steps: usize,
    ) -> Result<Vec<f64>, OptimError> {
        let mut optimizer = self.optimizer(target.grid)?;
        let mut theta = vec![0.0; target.values.len()];
        let mut g = theta.clone();
        let mut errors = vec![target.error(&theta)];
        for t in 0..steps {
            source.gradient(target, &theta, &mut g);
            optimizer.step(&mut theta, &g, (self.rate * self.schedule.factor(t as u64)) as f32)?;
            errors.push(target.error(&theta));
        }
        Ok(errors)
    }
}

/// Errors of gradient descent with rate `1 / 2t` on the noisy problem: the mean of all gradients, the honest floor of
/// methods that do not look at neighbours.
pub(crate) fn floor(target: &Target, mut source: Source, steps: usize) -> Vec<f64> {
    let mut theta = vec![0.0_f32; target.values.len()];
    let mut g = theta.clone();
    let mut errors = vec![target.error(&theta)];
    for t in 1..=steps {
        source.gradient(target, &theta, &mut g);
        theta.iter_mut().zip(&g).for_each(|(x, g)| *x -= g / (2 * t) as f32);
        errors.push(target.error(&theta));
    }
    errors
}

/// First step at which the error is below `limit`; `None` if it does not get there.
pub(crate) fn steps_below(errors: &[f64], limit: f64) -> Option<usize> {
    errors.iter().position(|e| *e < limit)
}
