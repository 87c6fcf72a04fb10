//! The tasks of Wang et al. (2025) that need no renderer: quadratic, Gaussian well, squares that move in an image.

use photofit_optim::sampled::{Batch, Estimator, Kernel, Settings, Stencil};
use photofit_sampling::Rng;
use rayon::prelude::*;

/// One antithetic pair, or one 4-point stencil, for each parameter.
pub(super) const PAIR: Estimator =
    Estimator { samples: 1, stencil: Stencil::Antithetic, kernel: Kernel::Coordinates, stratified: true };
pub(super) const FOUR: Estimator = Estimator { stencil: Stencil::FourPoint, ..PAIR };

/// A function of the parameters; the seed is the renderer's.
pub(super) type Function = Box<dyn Fn(&[f64], u64) -> f64 + Sync>;

/// Something to minimise, with a known answer.
pub(super) struct Task {
    pub(super) name: &'static str,
    pub(super) f: Function,
    pub(super) target: Vec<f64>,
    /// A start for each seed.
    pub(super) start: Box<dyn Fn(u64) -> Vec<f64>>,
    /// First and last sigma.
    pub(super) sigma: [f64; 2],
    /// Adam: learning rate, iterations of the annealing, samples.
    pub(super) rate: f64,
    pub(super) adam: (usize, Estimator),
    /// Whether one value takes long enough to be worth a thread.
    pub(super) parallel: bool,
    /// Evaluations after which a method has failed.
    pub(super) budget: u64,
    /// Evaluations to 99% that the specification found: Adam, L-BFGS.
    pub(super) known: [Option<u64>; 2],
}

impl Task {
    pub(super) fn dimension(&self) -> usize {
        self.target.len()
    }

    /// The default settings, with one 4-point stencil per parameter where parameters are so many that their sum tells signal
    /// from noise. Not pairs: in them the slopes along all other parameters are noise. Trust is that of the paper.
    pub(super) fn settings(&self) -> Settings {
        let default = Settings::default();
        if self.dimension() > 100 {
            Settings { gradient: FOUR, most_samples: 1, trust: 10.0, ..default }
        } else {
            default
        }
    }

    /// Distance from the answer.
    pub(super) fn error(&self, theta: &[f64]) -> f64 {
        theta.iter().zip(&self.target).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    }

    /// Values at the points of a batch; on all threads where that pays.
    pub(super) fn values(&self, batch: &Batch<'_>, values: &mut [f64]) {
        let f = &self.f;
        let value = |(i, v): (usize, &mut f64)| *v = f(batch.point(i), batch.seed(i));
        if self.parallel {
            values.par_iter_mut().enumerate().for_each(value);
        } else {
            values.iter_mut().enumerate().for_each(value);
        }
    }
}

/// Uniform numbers in [-1, 1] that depend on the task and on the seed of the run.
pub(super) fn uniform(stream: u64, seed: u64, n: usize) -> Vec<f64> {
    let mut rng = Rng::new(seed, stream);
    (0..n).map(|_| 2.0 * rng.next_f64() - 1.0).collect()
}

/// A point in a random direction.
fn on_circle(radius: f64, stream: u64, seed: u64) -> Vec<f64> {
    let (sin, cos) = (std::f64::consts::PI * uniform(stream, seed, 1)[0]).sin_cos();
    vec![radius * cos, radius * sin]
}

/// QUAD: 5 x^2 + 5 y^2 + 7.5 x y from a distance of 5.
pub(super) fn quad() -> Task {
    Task {
        name: "QUAD",
        f: Box::new(|x, _| 5.0 * x[0] * x[0] + 5.0 * x[1] * x[1] + 7.5 * x[0] * x[1]),
        target: vec![0.0; 2],
        start: Box::new(|seed| on_circle(5.0, 1, seed)),
        sigma: [1.0, 0.01],
        rate: 0.5,
        adam: (200, PAIR),
        parallel: false,
        budget: 4000,
        known: [Some(536), Some(332)],
    }
}

/// A well, negative Gaussian, from a distance of 2.5: beyond the inflection, where the curvature is negative.
pub(super) fn gaussian() -> Task {
    Task {
        name: "-Gaussian",
        f: Box::new(|x, _| -(-0.5 * (x[0] * x[0] + x[1] * x[1])).exp()),
        target: vec![0.0; 2],
        start: Box::new(|seed| on_circle(2.5, 2, seed)),
        sigma: [1.0, 0.01],
        rate: 0.3,
        adam: (160, PAIR),
        parallel: false,
        budget: 4000,
        known: [Some(444), Some(152)],
    }
}

/// Pixels along a side of the images of squares, which show [-6, 6]^2: a square that leaves would lower the loss.
const SIZE: usize = 48;

/// Adds a square of side 1, its coverage exact in each pixel, in a grey of its own.
fn draw(image: &mut [f64], x: f64, y: f64, grey: f64) {
    let pixel = 12.0 / SIZE as f64;
    let cover = |centre: f64| {
        let mut share = [0.0; SIZE];
        for (i, s) in share.iter_mut().enumerate() {
            let low = -6.0 + i as f64 * pixel;
            *s = ((low + pixel).min(centre + 0.5) - low.max(centre - 0.5)).max(0.0) / pixel;
        }
        share
    };
    let (columns, rows) = (cover(x), cover(y));
    for (row, out) in rows.iter().zip(image.chunks_exact_mut(SIZE)) {
        out.iter_mut().zip(&columns).for_each(|(o, c)| *o += grey * row * c);
    }
}

/// Squares at `theta`, two numbers each.
fn squares(theta: &[f64]) -> Vec<f64> {
    let mut image = vec![0.0; SIZE * SIZE];
    for (k, at) in theta.chunks_exact(2).enumerate() {
        draw(&mut image, at[0], at[1], 1.0 - 0.18 * k as f64);
    }
    image
}

fn squares_task(target: Vec<f64>) -> (Function, Vec<f64>) {
    let reference = squares(&target);
    let f = move |theta: &[f64], _| {
        let image = squares(theta);
        let sum: f64 = image.iter().zip(&reference).map(|(a, b)| (a - b).powi(2)).sum();
        sum / (SIZE * SIZE) as f64
    };
    (Box::new(f), target)
}

/// BOX2: one square moves across the image; at first it overlaps its place nowhere.
pub(super) fn box2() -> Task {
    let (f, target) = squares_task(vec![0.7, -0.4]);
    Task {
        name: "BOX2",
        f,
        target,
        start: Box::new(|seed| {
            let u = uniform(3, seed, 1)[0];
            vec![-0.9, 0.4 + 0.8 * u]
        }),
        sigma: [1.5, 0.01],
        rate: 0.3,
        adam: (70, FOUR),
        parallel: false,
        budget: 8000,
        known: [Some(684), Some(556)],
    }
}

/// BOX10: five squares of different greys, each displaced by up to 0.6 in both directions; they may overlap.
pub(super) fn box10() -> Task {
    let (f, target) = squares_task(vec![-1.0, -1.0, 1.0, -1.0, 0.0, 0.1, -1.0, 1.0, 1.0, 1.0]);
    let at = target.clone();
    Task {
        name: "BOX10",
        f,
        target,
        start: Box::new(move |seed| at.iter().zip(uniform(4, seed, 10)).map(|(x, u)| x + 0.6 * u).collect()),
        sigma: [0.6, 0.01],
        rate: 0.05,
        adam: (90, FOUR),
        parallel: false,
        budget: 20_000,
        known: [Some(4336), Some(5632)],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_are_minima_and_starts_lie_away() {
        for task in [quad(), gaussian(), box2(), box10()] {
            let best = (task.f)(&task.target, 0);
            for seed in 0..20 {
                let start = (task.start)(seed);
                assert!((task.f)(&start, 0) > best + 1e-3, "{} seed {seed}", task.name);
                assert!(task.error(&start) > 0.5, "{} seed {seed}", task.name);
            }
            assert_eq!(task.error(&task.target), 0.0);
        }
    }

    #[test]
    fn squares_cover_their_area() {
        for (x, y) in [(0.0, 0.0), (0.31, -1.07), (-1.4, 1.4)] {
            let mut image = vec![0.0; SIZE * SIZE];
            draw(&mut image, x, y, 1.0);
            let area = image.iter().sum::<f64>() * (12.0 / SIZE as f64).powi(2);
            assert!((area - 1.0).abs() < 1e-12, "{area}");
        }
    }
}
