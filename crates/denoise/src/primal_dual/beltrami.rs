//! Beltrami regularisation by a linearly convergent primal-dual method.

use photofit_scalar::Real;

use super::layout::range;
use super::saddle::{DualMap, Saddle, Steps};
use crate::admm::{Coupling, DataTerm, Problem, Weight, contrast};
use crate::{DenoiseError, Shape};

/// `E(u) = sum sqrt(1 + beta^2 |grad u|^2) + lambda/2 (u-u0)^2`, the root per pixel (Zosso and Bustin 2014): between the
/// square of the gradient (`beta -> 0`) and `beta` times total variation (`beta -> inf`), without staircases.
///
/// The dual variable has the fixed point `phi = beta^2 grad u / sqrt(1 + beta^2 |grad u|^2)`; its step is the exact
/// proximal map. The energy is strongly convex and its regulariser smooth, so that the error falls geometrically
/// (algorithm 3 of Chambolle and Pock 2011), with the square root of `1 + 8 beta^2 / lambda`.
///
/// ```
/// use photofit_denoise::{Shape, primal_dual::Beltrami};
/// let noisy: Vec<f64> = (0..256).map(|k| if k % 16 < 8 { 0.2 } else { 0.8 }).collect();
/// let mut solver = Beltrami::new(Shape::new(16, 16, 1), &noisy, 40.0, 5.0)?;
/// solver.iterate(100);
/// assert!(solver.solution()[0] > 0.2);
/// # Ok::<(), photofit_denoise::DenoiseError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Beltrami<T> {
    saddle: Saddle<T>,
    lambda: Weight<T>,
    beta: f64,
    steps: Steps,
}

impl<T: Real> Beltrami<T> {
    /// Starts at the target. `lambda` may be a map, with 0 at holes (then convergence is no longer geometric).
    ///
    /// # Errors
    /// If a length or range is wrong, or a target that is read is not finite.
    pub fn new(
        shape: Shape,
        target: &[T],
        lambda: impl Into<Weight<T>>,
        beta: f64,
    ) -> Result<Self, DenoiseError> {
        let lambda = lambda.into();
        let problem = Problem::new(shape, target, DataTerm::L2 { lambda: lambda.clone() });
        problem.check()?;
        DenoiseError::setting("beta", beta, "positive and finite", beta > 0.0 && beta.is_finite())?;
        let [low, _] = range(&lambda, shape);
        let length = 8.0_f64.sqrt();
        let steps = if low > 0.0 {
            let mu = 2.0 * low.sqrt() / (length * beta);
            Steps { sigma: 0.5 * mu * beta * beta, tau: 0.5 * mu / low, theta: 1.0 / (1.0 + mu) }
        } else {
            let ratio = contrast(&problem) / beta;
            Steps { sigma: 1.0 / (length * ratio), tau: ratio / length, theta: 1.0 }
        };
        Ok(Self { saddle: Saddle::new(shape, Coupling::Separate, target), lambda, beta, steps })
    }

    /// One iteration.
    pub fn step(&mut self) {
        self.saddle.step(DualMap::Beltrami(self.beta), &self.lambda, self.steps);
    }

    /// A fixed number of iterations.
    pub fn iterate(&mut self, iterations: usize) {
        for _ in 0..iterations {
            self.step();
        }
    }

    /// The estimate.
    pub fn solution(&self) -> Vec<T> {
        self.saddle.solution()
    }

    /// The dual variable `phi`: for each channel the plane of x, then of y.
    pub fn dual(&self) -> Vec<T> {
        self.saddle.dual()
    }
}

/// The energy that [`Beltrami`] minimises.
///
/// # Panics
/// If a length is wrong.
pub fn beltrami_energy<T: Real>(shape: Shape, u: &[T], target: &[T], lambda: &Weight<T>, beta: f64) -> f64 {
    assert!(u.len() == shape.len() && target.len() == shape.len(), "images of {shape}");
    let mut sum = 0.0;
    for k in 0..shape.len() {
        let (i, j, _) = shape.position(k);
        let own = u[k].f64();
        let x = if j + 1 < shape.width { u[k + 1].f64() - own } else { 0.0 };
        let y = if i + 1 < shape.height { u[k + shape.width].f64() - own } else { 0.0 };
        sum += (1.0 + beta * beta * (x * x + y * y)).sqrt();
        let weight = lambda.at(k, shape).f64();
        if weight > 0.0 {
            sum += 0.5 * weight * (own - target[k].f64()).powi(2);
        }
    }
    sum
}
