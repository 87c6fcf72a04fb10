//! BFGS with limited memory or with a matrix, on gradients with common random numbers.

use std::collections::VecDeque;

use super::walk::{Step, Stepper, Walk, dot};
use crate::sampled::error::SampledError;
use crate::sampled::estimate::{Estimate, norm};
use crate::sampled::objective::Objective;

/// L-BFGS keeps a pair when the cosine of step and change of gradient exceeds this.
const COSINE: f64 = 1e-6;

/// Powell's damping: the curvature of a pair becomes at least this share of the one expected.
const DAMPING: f64 = 0.2;

/// An approximation of the Hessian or its inverse, from steps and changes of the gradient.
#[derive(Debug)]
pub(crate) enum Memory {
    /// The last pairs, newest last.
    Limited { pairs: VecDeque<Pair>, most: usize },
    /// The inverse Hessian row by row; `None` before the first pair.
    Dense { n: usize, inverse: Option<Vec<f64>> },
}

/// A step and the change of the gradient over it.
#[derive(Debug)]
pub(crate) struct Pair {
    s: Vec<f64>,
    y: Vec<f64>,
    /// `1 / (s . y)`.
    rho: f64,
}

impl Memory {
    pub(crate) fn limited(most: usize) -> Self {
        Self::Limited { pairs: VecDeque::with_capacity(most.min(64)), most }
    }

    pub(crate) fn dense(n: usize) -> Self {
        Self::Dense { n, inverse: None }
    }

    fn clear(&mut self) {
        match self {
            Self::Limited { pairs, .. } => pairs.clear(),
            Self::Dense { inverse, .. } => *inverse = None,
        }
    }

    /// Takes a pair in; the length of a step over the change of gradient, `s.y / y.y`, where it was kept.
    fn learn(&mut self, s: Vec<f64>, y: Vec<f64>) -> Option<f64> {
        let (sy, yy) = (dot(&s, &y), dot(&y, &y));
        let good = sy > COSINE * norm(&s) * norm(&y);
        match self {
            Self::Limited { pairs, most } => {
                if !good {
                    return None;
                }
                if pairs.len() >= *most {
                    pairs.pop_front();
                }
                pairs.push_back(Pair { rho: 1.0 / sy, s, y });
            }
            Self::Dense { n, inverse } => {
                if inverse.is_none() && !good {
                    return None;
                }
                let n = *n;
                let h = inverse.get_or_insert_with(|| {
                    let mut identity = vec![0.0; n * n];
                    identity.iter_mut().step_by(n + 1).for_each(|d| *d = sy / yy);
                    identity
                });
                update_damped(h, &s, y);
            }
        }
        good.then_some(sy / yy)
    }

    /// `-H^-1 g`, starting from `scale` times the identity.
    fn direction(&self, g: &[f64], scale: f64) -> Vec<f64> {
        match self {
            Self::Limited { pairs, .. } => two_loop(pairs, g, scale),
            Self::Dense { n, inverse } => match inverse {
                Some(h) => h.chunks_exact(*n).map(|row| -dot(row, g)).collect(),
                None => g.iter().map(|g| -scale * g).collect(),
            },
        }
    }
}

/// The two-loop recursion (Nocedal 1980).
fn two_loop(pairs: &VecDeque<Pair>, g: &[f64], scale: f64) -> Vec<f64> {
    let mut q: Vec<f64> = g.iter().map(|g| -g).collect();
    let mut alphas = Vec::with_capacity(pairs.len());
    for Pair { s, y, rho } in pairs.iter().rev() {
        let alpha = rho * dot(s, &q);
        q.iter_mut().zip(y).for_each(|(q, y)| *q -= alpha * y);
        alphas.push(alpha);
    }
    let newest = pairs.back().map_or(scale, |p| 1.0 / (p.rho * dot(&p.y, &p.y)));
    q.iter_mut().for_each(|q| *q *= newest);
    for (Pair { s, y, rho }, alpha) in pairs.iter().zip(alphas.iter().rev()) {
        let beta = rho * dot(y, &q);
        q.iter_mut().zip(s).for_each(|(q, s)| *q += (alpha - beta) * s);
    }
    q
}

/// The BFGS update of the inverse Hessian `h`, with `y` moved so far towards `B s` that `s.y >= 0.2 s.B.s` in the dual
/// form: `s` moves towards `H y` so that `y.s >= 0.2 y.H.y` (Powell 1978, for the inverse).
fn update_damped(h: &mut [f64], s: &[f64], y: Vec<f64>) {
    let n = s.len();
    let hy: Vec<f64> = h.chunks_exact(n).map(|row| dot(row, &y)).collect();
    let (sy, yhy) = (dot(s, &y), dot(&y, &hy));
    if yhy.is_nan() || yhy <= 0.0 {
        return;
    }
    let share = if sy >= DAMPING * yhy { 1.0 } else { (1.0 - DAMPING) * yhy / (yhy - sy) };
    let s: Vec<f64> = s.iter().zip(&hy).map(|(s, hy)| share * s + (1.0 - share) * hy).collect();
    let sy = dot(&s, &y);
    let factor = 1.0 + yhy / sy;
    for (i, row) in h.chunks_exact_mut(n).enumerate() {
        for (j, h) in row.iter_mut().enumerate() {
            *h += (factor * s[i] * s[j] - hy[i] * s[j] - s[i] * hy[j]) / sy;
        }
    }
}

/// Quasi-Newton steps; all gradients of a stage come from one sample set.
#[derive(Debug)]
pub(crate) struct QuasiNewtonSteps {
    memory: Memory,
    /// Parameters in units of the scales, gradient over `unit`.
    last: Option<(Vec<f64>, Vec<f64>)>,
    /// `s.y / y.y` of the newest pair; outlives the pairs.
    scale: Option<f64>,
    /// Size of the first gradient: a power of ten more or less does not change the steps.
    unit: f64,
}

impl QuasiNewtonSteps {
    pub(crate) fn new(memory: Memory) -> Self {
        Self { memory, last: None, scale: None, unit: 0.0 }
    }
}

impl<O: Objective> Stepper<O> for QuasiNewtonSteps {
    fn step(&mut self, walk: &mut Walk<'_, O>) -> Result<Step, SampledError<O::Error>> {
        let wanted = |g: &Estimate| self.scale.map(|s| s * norm(&g.value) / self.unit);
        let (gradient, resampled) = walk.sure_gradient(walk.sample_set, wanted)?;
        if resampled {
            <Self as Stepper<O>>::restart(self);
        }
        let size = norm(&gradient.value);
        if !gradient.informative || size == 0.0 {
            return Ok(Step::of(&gradient, [0.0; 2]));
        }
        if self.unit == 0.0 {
            self.unit = size;
        }
        let g: Vec<f64> = gradient.value.iter().map(|g| g / self.unit).collect();
        let u: Vec<f64> = walk.theta.iter().zip(&walk.scales).map(|(x, s)| x / s).collect();
        if let Some((u_old, g_old)) = self.last.take() {
            let difference = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect();
            self.scale = self.memory.learn(difference(&u, &u_old), difference(&g, &g_old)).or(self.scale);
        }
        let reach = gradient.signal_to_noise().map_or(walk.trust, |s| walk.trust.min(0.5 * s));
        let limit = walk.sigma * reach;
        let first = limit / norm(&g);
        let mut d = self.memory.direction(&g, self.scale.unwrap_or(first));
        if dot(&d, &g) >= -1e-8 * norm(&d) * norm(&g) {
            // Not downhill: what was learnt is wrong here.
            self.memory.clear();
            d = g.iter().map(|g| -first * g).collect();
        }
        self.last = Some((u, g));
        let length = walk.advance(&d, limit);
        Ok(Step::of(&gradient, length))
    }

    fn restart(&mut self) {
        self.memory.clear();
        self.last = None;
    }
}
