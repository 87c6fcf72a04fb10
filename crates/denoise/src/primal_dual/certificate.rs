//! The primal-dual gap: how far an image can be from the optimum of ROF, at most.

use photofit_scalar::Real;
use rayon::prelude::{IntoParallelIterator, ParallelIterator};

use crate::admm::{Coupling, DataTerm, Problem};
use crate::operators::{Boundary, divergence};

/// Energy of an estimate and a lower bound of the optimum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap {
    /// `E(u)`.
    pub primal: f64,
    /// Dual value, at most the optimum.
    pub dual: f64,
}

impl Gap {
    /// `(primal - dual) / primal`; 0 for a zero energy.
    pub fn relative(self) -> f64 {
        if self.primal > 0.0 { (self.primal - self.dual) / self.primal } else { 0.0 }
    }
}

/// The gap of an estimate `u` and a dual variable `y` (for each channel the plane of x, then of y) of ROF:
/// `D(y) = sum -u0 div y - (div y)^2 / (2 lambda)` with `y` projected to `|y| <= alpha` and natural boundaries.
///
/// The bound holds for any `y`, whatever method it comes from.
///
/// # Panics
/// If the data term is not quadratic with `lambda > 0` everywhere, there is no total variation, or a length is wrong.
pub fn rof_gap<T: Real>(problem: &Problem<'_, T>, u: &[T], y: &[T]) -> Gap {
    let shape = problem.shape;
    assert_eq!(y.len(), 2 * shape.len(), "two dual components per sample");
    let DataTerm::L2 { lambda } = &problem.data else {
        panic!("the certificate needs a quadratic data term")
    };
    let alpha = problem.alpha.as_ref().expect("the certificate needs total variation");
    let (height, width, n) = (shape.height, shape.width, shape.pixels());
    let mut dual: Vec<f64> = y.iter().map(|v| v.f64()).collect();
    for plane in dual.chunks_exact_mut(2 * n) {
        let (x, y) = plane.split_at_mut(n);
        x.chunks_exact_mut(width).for_each(|row| row[width - 1] = 0.0);
        y[(height - 1) * width..].fill(0.0);
    }
    let group = if problem.coupling == Coupling::Vectorial { shape.channels } else { 1 };
    for (g, planes) in dual.chunks_exact_mut(2 * group * n).enumerate() {
        for k in 0..n {
            let length = planes[k..].iter().step_by(n).map(|v| v * v).sum::<f64>().sqrt();
            let radius = alpha.at(g * n + k, shape).f64();
            if length > radius {
                planes[k..].iter_mut().step_by(n).for_each(|v| *v *= radius / length);
            }
        }
    }
    let sums: Vec<f64> = (0..shape.channels)
        .into_par_iter()
        .map(|c| {
            let div = divergence(Boundary::Neumann, width, height, &dual[2 * c * n..2 * (c + 1) * n]);
            let value = |k: usize| {
                let (weight, d) = (lambda.at(c * n + k, shape).f64(), div[k]);
                assert!(weight > 0.0, "the certificate needs lambda > 0 everywhere");
                -problem.target[c * n + k].f64() * d - d * d / (2.0 * weight)
            };
            (0..n).map(value).sum()
        })
        .collect();
    Gap { primal: problem.energy(u), dual: sums.iter().sum() }
}
