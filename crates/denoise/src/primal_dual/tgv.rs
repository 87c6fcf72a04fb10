//! Second-order total generalised variation.

use photofit_scalar::Real;
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};

use super::layout::{BAND, add_dx, add_dx_backward, add_dy, add_dy_backward, lane, to_planes, to_rows};
use crate::admm::{Coupling, DataTerm, Problem, Weight, contrast};
use crate::wide::run_widest;
use crate::{DenoiseError, Shape};

/// TGV2 (Bredies, Kunisch and Pock 2010): `min_w lambda/2 (u-u0)^2 + a1 |grad u - w| + a0 |E w|`, `E` the symmetrised derivative (its
/// mixed entry counts twice in the norm), with natural boundaries: affine ramps cost nothing. Best on piecewise affine
/// images; over-relaxed primal-dual iterations, `|K|^2 <= 12`.
///
/// ```
/// use photofit_denoise::{Shape, admm::Coupling, primal_dual::Tgv2};
/// let ramp: Vec<f64> = (0..256).map(|k| (k % 16) as f64 / 16.0).collect();
/// let mut solver = Tgv2::new(Shape::new(16, 16, 1), &ramp, 8.0, [1.0, 2.0], Coupling::Separate)?;
/// solver.iterate(300);
/// assert!(solver.solution().iter().zip(&ramp).all(|(a, b)| (a - b).abs() < 1e-3));
/// # Ok::<(), photofit_denoise::DenoiseError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Tgv2<T> {
    shape: Shape,
    coupling: Coupling,
    lambda: Weight<T>,
    weights: [f64; 2],
    tau: f64,
    sigma: f64,
    target: Vec<T>,
    /// Estimate and slope `w`, by rows: for each channel u, w1, w2.
    primal: Vec<T>,
    extrapolated: Vec<T>,
    /// Duals of `grad u - w` and of `E w`: for each channel p1, p2, q11, q22, q12.
    dual: Vec<T>,
}

const RELAXATION: f64 = 1.9;
/// Primal lanes per channel.
const PRIMAL: usize = 3;
/// Dual lanes per channel.
const DUAL: usize = 5;

impl<T: Real> Tgv2<T> {
    /// Starts at the target; `[a1, a0]` weigh the first and the second derivative. `lambda` may be a map with 0 at
    /// holes.
    ///
    /// # Errors
    /// If a length or range is wrong, or a target that is read is not finite.
    pub fn new(
        shape: Shape,
        target: &[T],
        lambda: impl Into<Weight<T>>,
        weights: [f64; 2],
        coupling: Coupling,
    ) -> Result<Self, DenoiseError> {
        let lambda = lambda.into();
        let problem = Problem::new(shape, target, DataTerm::L2 { lambda: lambda.clone() });
        problem.check()?;
        for (value, name) in weights.into_iter().zip(["a1", "a0"]) {
            DenoiseError::setting(name, value, "positive and finite", value > 0.0 && value.is_finite())?;
        }
        // Primal steps in the units of the image over those of the duals.
        let ratio = 0.2 * contrast(&problem) / weights[0];
        let readable: Vec<T> = target.iter().map(|v| if v.is_finite() { *v } else { T::zero() }).collect();
        let target = to_rows(&readable, shape.width, shape.height);
        let mut primal = vec![T::zero(); PRIMAL * target.len()];
        for (lanes, row) in
            primal.chunks_exact_mut(PRIMAL * shape.width).zip(target.chunks_exact(shape.width))
        {
            lanes[..shape.width].copy_from_slice(row);
        }
        Ok(Self {
            shape,
            coupling,
            lambda,
            weights,
            tau: ratio / 12.0_f64.sqrt(),
            sigma: 1.0 / (ratio * 12.0_f64.sqrt()),
            extrapolated: vec![T::zero(); primal.len()],
            dual: vec![T::zero(); DUAL * target.len()],
            target,
            primal,
        })
    }

    /// One iteration.
    pub fn step(&mut self) {
        let Shape { width, channels, .. } = self.shape;
        let (shape, target, lambda, tau, dual) =
            (self.shape, &self.target, &self.lambda, self.tau, &self.dual);
        let stride = BAND * PRIMAL * channels * width;
        let bands = self.primal.par_chunks_mut(stride).zip(self.extrapolated.par_chunks_mut(stride));
        bands.enumerate().for_each(|(band, (x, extrapolated))| {
            run_widest(
                #[inline(always)]
                || {
                    let lanes =
                        x.chunks_exact_mut(PRIMAL * width).zip(extrapolated.chunks_exact_mut(PRIMAL * width));
                    for (k, (x, extrapolated)) in lanes.enumerate() {
                        let place = [band * BAND + k / channels, k % channels];
                        primal_rows(shape, place, dual, target, lambda, T::of(tau), x, extrapolated);
                    }
                },
            );
        });
        let (extrapolated, coupling, weights, sigma) =
            (&self.extrapolated, self.coupling, self.weights, self.sigma);
        self.dual.par_chunks_mut(BAND * DUAL * channels * width).enumerate().for_each(|(band, y)| {
            let mut scratch = vec![T::zero(); (DUAL * channels + 1) * width];
            run_widest(
                #[inline(always)]
                || {
                    for (k, y) in y.chunks_exact_mut(DUAL * channels * width).enumerate() {
                        let i = band * BAND + k;
                        dual_rows(shape, coupling, i, extrapolated, weights, T::of(sigma), y, &mut scratch);
                    }
                },
            );
        });
    }

    /// A fixed number of iterations.
    pub fn iterate(&mut self, iterations: usize) {
        for _ in 0..iterations {
            self.step();
        }
    }

    /// The estimate.
    pub fn solution(&self) -> Vec<T> {
        self.planes(&[0])
    }

    /// The slope `w`: for each channel the plane of x, then of y.
    pub fn slope(&self) -> Vec<T> {
        self.planes(&[1, 2])
    }

    fn planes(&self, lanes: &[usize]) -> Vec<T> {
        let n = self.shape.pixels();
        let planes = to_planes(&self.primal, self.shape.width, self.shape.height);
        let all = planes.chunks_exact(n).enumerate().filter(|(k, _)| lanes.contains(&(k % PRIMAL)));
        all.flat_map(|(_, plane)| plane.iter().copied()).collect()
    }
}

/// The primal step of one row of one channel.
#[inline(always)]
fn primal_rows<T: Real>(
    shape: Shape,
    [i, c]: [usize; 2],
    dual: &[T],
    target: &[T],
    lambda: &Weight<T>,
    tau: T,
    x: &mut [T],
    extrapolated: &mut [T],
) {
    let Shape { width, height, channels } = shape;
    let row = |i: usize, k: usize| lane(dual, DUAL * channels, width, i, DUAL * c + k);
    let (own, above) = (|k| (i + 1 < height).then(|| row(i, k)), |k| i.checked_sub(1).map(|i| row(i, k)));
    let below = |k| (i + 1 < height).then(|| row(i + 1, k));
    let (du, dw) = extrapolated.split_at_mut(width);
    let (dw1, dw2) = dw.split_at_mut(width);
    // Directions first: div p, and p + the adjoint of E.
    du.fill(T::zero());
    add_dx_backward(row(i, 0), T::one(), du);
    add_dy_backward(own(1), above(1), T::one(), du);
    dw1.copy_from_slice(row(i, 0));
    add_dx(row(i, 2), T::one(), dw1);
    add_dy(row(i, 4), below(4), T::one(), dw1);
    dw2.copy_from_slice(row(i, 1));
    add_dy(row(i, 3), below(3), T::one(), dw2);
    add_dx(row(i, 4), T::one(), dw2);
    let target = lane(target, channels, width, i, c);
    let (rho, two) = (T::of(RELAXATION), T::of(2.0));
    let (u, w) = x.split_at_mut(width);
    let start = (c * height + i) * width;
    for j in 0..width {
        let l = lambda.at(start + j, shape);
        let new = (u[j] + tau * (du[j] + l * target[j])) / (T::one() + tau * l);
        du[j] = two * new - u[j];
        u[j] += rho * (new - u[j]);
    }
    for (w, d) in w.iter_mut().zip(dw) {
        let new = *w + tau * *d;
        *d = two * new - *w;
        *w += rho * (new - *w);
    }
}

/// The dual step of one row of all channels.
#[inline(always)]
fn dual_rows<T: Real>(
    shape: Shape,
    coupling: Coupling,
    i: usize,
    x: &[T],
    weights: [f64; 2],
    sigma: T,
    y: &mut [T],
    scratch: &mut [T],
) {
    let Shape { width, height, channels } = shape;
    let (new, norm) = scratch.split_at_mut(DUAL * channels * width);
    new.copy_from_slice(y);
    for (c, new) in new.chunks_exact_mut(DUAL * width).enumerate() {
        let row = |i: usize, k: usize| lane(x, PRIMAL * channels, width, i, PRIMAL * c + k);
        let (p, q) = new.split_at_mut(2 * width);
        let (p1, p2) = p.split_at_mut(width);
        add_dx(row(i, 0), sigma, p1);
        for (p, w) in p1[..width - 1].iter_mut().zip(row(i, 1)) {
            *p -= sigma * *w;
        }
        if i + 1 < height {
            add_dy(row(i, 0), Some(row(i + 1, 0)), sigma, p2);
            for (p, w) in p2.iter_mut().zip(row(i, 2)) {
                *p -= sigma * *w;
            }
        }
        strain(width, height, i, row, sigma, q);
    }
    let group = if coupling == Coupling::Vectorial { channels } else { 1 };
    let groups = new.chunks_exact_mut(DUAL * group * width).zip(y.chunks_exact_mut(DUAL * group * width));
    for (new, y) in groups {
        for (part, weight) in [0..2, 2..DUAL].into_iter().zip(weights) {
            let member = |k: &usize| part.contains(&(k % DUAL));
            norm.fill(T::zero());
            for k in (0..DUAL * group).filter(member) {
                let factor = if k % DUAL == 4 { T::of(2.0) } else { T::one() };
                for (n, v) in norm.iter_mut().zip(&new[k * width..]) {
                    *n += factor * *v * *v;
                }
            }
            let radius = T::of(weight);
            for n in norm.iter_mut() {
                *n = radius / n.sqrt().max(radius);
            }
            let rho = T::of(RELAXATION);
            for k in (0..DUAL * group).filter(member) {
                let lanes = y[k * width..(k + 1) * width].iter_mut().zip(&new[k * width..]);
                for ((y, v), n) in lanes.zip(norm.iter()) {
                    *y += rho * (*v * *n - *y);
                }
            }
        }
    }
}

/// `q += s E w` of one row, where `E w` counts: backward differences inside the border.
#[inline(always)]
fn strain<'a, T: Real>(
    width: usize,
    height: usize,
    i: usize,
    row: impl Fn(usize, usize) -> &'a [T],
    s: T,
    q: &mut [T],
) {
    let inside = i > 0 && i + 1 < height;
    let half = T::of(0.5) * s;
    let (w1, w2) = (row(i, 1), row(i, 2));
    let (q11, rest) = q.split_at_mut(width);
    let (q22, q12) = rest.split_at_mut(width);
    for j in 1..width.max(2) - 1 {
        q11[j] += s * (w1[j] - w1[j - 1]);
    }
    if inside {
        let (a1, a2) = (row(i - 1, 1), row(i - 1, 2));
        for j in 0..width {
            q22[j] += s * (w2[j] - a2[j]);
        }
        for j in 1..width.max(2) - 1 {
            q12[j] += half * (w1[j] - a1[j] + w2[j] - w2[j - 1]);
        }
    }
}

/// The energy that [`Tgv2`] minimises, at an estimate and its slope.
///
/// # Panics
/// If a length is wrong.
pub fn tgv2_energy<T: Real>(
    problem: (Shape, &[T], &Weight<T>),
    [a1, a0]: [f64; 2],
    coupling: Coupling,
    u: &[T],
    slope: &[T],
) -> f64 {
    let (shape, target, lambda) = problem;
    let Shape { width, height, channels } = shape;
    let n = shape.pixels();
    assert!(u.len() == shape.len() && target.len() == shape.len(), "images of {shape}");
    assert_eq!(slope.len(), 2 * shape.len(), "two slopes per sample");
    let mut sum = 0.0;
    for k in 0..n {
        let (i, j) = (k / width, k % width);
        let (mut first, mut second) = (0.0, 0.0);
        for c in 0..channels {
            let at = |d: usize| u[c * n + d].f64();
            let w = |part: usize, d: usize| slope[(2 * c + part) * n + d].f64();
            if j + 1 < width {
                first += (at(k + 1) - at(k) - w(0, k)).powi(2);
            }
            if i + 1 < height {
                first += (at(k + width) - at(k) - w(1, k)).powi(2);
            }
            let (inside_x, inside_y) = (j > 0 && j + 1 < width, i > 0 && i + 1 < height);
            if inside_x {
                second += (w(0, k) - w(0, k - 1)).powi(2);
            }
            if inside_y {
                second += (w(1, k) - w(1, k - width)).powi(2);
            }
            if inside_x && inside_y {
                second += 0.5 * (w(0, k) - w(0, k - width) + w(1, k) - w(1, k - 1)).powi(2);
            }
            let weight = lambda.at(c * n + k, shape).f64();
            if weight > 0.0 {
                sum += 0.5 * weight * (at(k) - target[c * n + k].f64()).powi(2);
            }
            if coupling == Coupling::Separate {
                sum += a1 * first.sqrt() + a0 * second.sqrt();
                (first, second) = (0.0, 0.0);
            }
        }
        sum += a1 * first.sqrt() + a0 * second.sqrt();
    }
    sum
}
