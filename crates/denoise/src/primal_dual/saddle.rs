//! `min_u max_y <grad u, y> - F*(y) + sum lambda/2 (u-u0)^2`: one iteration of the primal-dual method.

use photofit_scalar::Real;
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};

use super::layout::{BAND, add_dx, add_dx_backward, add_dy, add_dy_backward, lane, to_planes, to_rows};
use crate::Shape;
use crate::admm::{Coupling, Weight};
use crate::wide::run_widest;

/// The proximal map of `sigma F*` on the vectors of the pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) enum DualMap<'a, T> {
    /// Total variation: projection onto balls of radius `alpha`.
    Ball(&'a Weight<T>),
    /// `F(g) = sqrt(1 + beta^2 |g|^2)`.
    Beltrami(f64),
}

/// Estimate, its extrapolation and the dual variable, by rows.
#[derive(Clone, Debug)]
pub(crate) struct Saddle<T> {
    shape: Shape,
    coupling: Coupling,
    target: Vec<T>,
    u: Vec<T>,
    extrapolated: Vec<T>,
    dual: Vec<T>,
}

/// Steps of one iteration: dual, primal, extrapolation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Steps {
    pub(crate) sigma: f64,
    pub(crate) tau: f64,
    pub(crate) theta: f64,
}

impl<T: Real> Saddle<T> {
    /// Starts at the target; what is not finite there (a hole) starts at 0.
    pub(crate) fn new(shape: Shape, coupling: Coupling, target: &[T]) -> Self {
        let mut target = to_rows(target, shape.width, shape.height);
        for v in target.iter_mut().filter(|v| !v.is_finite()) {
            *v = T::zero();
        }
        let dual = vec![T::zero(); 2 * target.len()];
        Self { shape, coupling, u: target.clone(), extrapolated: target.clone(), target, dual }
    }

    pub(crate) fn solution(&self) -> Vec<T> {
        to_planes(&self.u, self.shape.width, self.shape.height)
    }

    /// The dual variable: for each channel the plane of x, then of y.
    pub(crate) fn dual(&self) -> Vec<T> {
        to_planes(&self.dual, self.shape.width, self.shape.height)
    }

    pub(crate) fn step(&mut self, map: DualMap<'_, T>, lambda: &Weight<T>, steps: Steps) {
        let Shape { width, height, channels } = self.shape;
        let (shape, coupling, extrapolated) = (self.shape, self.coupling, &self.extrapolated);
        self.dual.par_chunks_mut(BAND * 2 * channels * width).enumerate().for_each(|(band, y)| {
            let mut norm = vec![T::zero(); width];
            run_widest(
                #[inline(always)]
                || {
                    for (k, y) in y.chunks_exact_mut(2 * channels * width).enumerate() {
                        let i = band * BAND + k;
                        dual_row(shape, coupling, extrapolated, map, T::of(steps.sigma), i, y, &mut norm);
                    }
                },
            );
        });
        let (dual, target) = (&self.dual, &self.target);
        let bands = self.u.par_chunks_mut(BAND * channels * width);
        bands.zip(self.extrapolated.par_chunks_mut(BAND * channels * width)).enumerate().for_each(
            |(band, (u, extrapolated))| {
                let mut sum = vec![T::zero(); width];
                run_widest(
                    #[inline(always)]
                    || {
                        let lanes = u.chunks_exact_mut(width).zip(extrapolated.chunks_exact_mut(width));
                        for (k, (u, extrapolated)) in lanes.enumerate() {
                            let (i, c) = (band * BAND + k / channels, k % channels);
                            sum.fill(T::zero());
                            add_divergence(dual, channels, width, height, i, c, &mut sum);
                            let target = lane(target, channels, width, i, c);
                            primal_row(shape, lambda, [i, c], target, &sum, steps, u, extrapolated);
                        }
                    },
                );
            },
        );
    }
}

/// `sum += div y` of one row of channel `c`.
#[inline(always)]
fn add_divergence<T: Real>(
    dual: &[T],
    channels: usize,
    width: usize,
    height: usize,
    i: usize,
    c: usize,
    sum: &mut [T],
) {
    let row = |i: usize, k: usize| lane(dual, 2 * channels, width, i, 2 * c + k);
    add_dx_backward(row(i, 0), T::one(), sum);
    add_dy_backward((i + 1 < height).then(|| row(i, 1)), i.checked_sub(1).map(|i| row(i, 1)), T::one(), sum);
}

/// `u = (u + tau (div y + lambda u0)) / (1 + tau lambda)` and its extrapolation.
#[inline(always)]
fn primal_row<T: Real>(
    shape: Shape,
    lambda: &Weight<T>,
    [i, c]: [usize; 2],
    target: &[T],
    divergence: &[T],
    steps: Steps,
    u: &mut [T],
    extrapolated: &mut [T],
) {
    let (tau, theta) = (T::of(steps.tau), T::of(steps.theta));
    let start = (c * shape.height + i) * shape.width;
    for j in 0..u.len() {
        let l = lambda.at(start + j, shape);
        let new = (u[j] + tau * (divergence[j] + l * target[j])) / (T::one() + tau * l);
        extrapolated[j] = new + theta * (new - u[j]);
        u[j] = new;
    }
}

/// `y = prox(y + sigma grad u)` in row `i`.
#[inline(always)]
fn dual_row<T: Real>(
    shape: Shape,
    coupling: Coupling,
    u: &[T],
    map: DualMap<'_, T>,
    sigma: T,
    i: usize,
    y: &mut [T],
    norm: &mut [T],
) {
    let Shape { width, height, channels } = shape;
    for (c, y) in y.chunks_exact_mut(2 * width).enumerate() {
        let row = |i: usize| lane(u, channels, width, i, c);
        let (x, y) = y.split_at_mut(width);
        add_dx(row(i), sigma, x);
        add_dy(row(i), (i + 1 < height).then(|| row(i + 1)), sigma, y);
    }
    let group = if coupling == Coupling::Vectorial { channels } else { 1 };
    for (g, y) in y.chunks_exact_mut(2 * group * width).enumerate() {
        norm.fill(T::zero());
        for lane in y.chunks_exact(width) {
            for (n, v) in norm.iter_mut().zip(lane) {
                *n += *v * *v;
            }
        }
        match map {
            DualMap::Ball(alpha) => {
                let start = (g * height + i) * width;
                for (j, n) in norm.iter_mut().enumerate() {
                    let alpha = alpha.at(start + j, shape);
                    *n = alpha / n.sqrt().max(alpha).max(T::min_positive_value());
                }
            }
            DualMap::Beltrami(beta) => {
                for n in norm.iter_mut() {
                    *n = beltrami_scale(n.sqrt(), T::of(beta), sigma);
                }
            }
        }
        for lane in y.chunks_exact_mut(width) {
            for (v, n) in lane.iter_mut().zip(norm.iter()) {
                *v *= *n;
            }
        }
    }
}

/// `|phi| / m` for the `phi` that solves `phi + sigma phi / (beta sqrt(beta^2 - |phi|^2)) = m` (lengths).
///
/// With `|phi| = beta t / sqrt(1+t^2)` this is `t / sqrt(1+t^2) + k t = m / beta`, `k = sigma / beta^2`: increasing
/// and concave, so that Newton's method from below never overshoots.
#[inline(always)]
pub(crate) fn beltrami_scale<T: Real>(m: T, beta: T, sigma: T) -> T {
    let one = T::one();
    let (goal, k) = (m / beta, sigma / (beta * beta));
    let mut t = (goal / (one + k)).max((goal - one) / k);
    for _ in 0..8 {
        let r = one / (one + t * t).sqrt();
        t += (goal - t * r - k * t) / (r * r * r + k);
    }
    let phi = beta * t / (one + t * t).sqrt();
    if m > T::zero() { phi / m } else { T::zero() }
}
