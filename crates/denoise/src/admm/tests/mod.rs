//! Tests of the splitting: optima, closed forms, limits, printed errors, plan, stress.

mod closed_forms;
mod errata;
mod holes;
mod optima;
mod plan;
pub(crate) mod problems;
mod reference;
mod stress;

use super::{Admm, Penalties, Problem, Stop};
use crate::transform::Sample;

/// The estimate after a fixed number of iterations.
pub(crate) fn solved<T: Sample>(problem: &Problem<'_, T>, iterations: usize) -> Vec<T> {
    let mut admm = Admm::new(problem).expect("a good problem");
    admm.solve(Stop::Iterations(iterations));
    admm.solution()
}

/// The same from a given start.
pub(crate) fn solved_from<T: Sample>(problem: &Problem<'_, T>, start: &[T], iterations: usize) -> Vec<T> {
    let penalties = Penalties::for_problem(problem);
    let mut admm = Admm::with_penalties(problem, penalties, Some(start)).expect("a good problem");
    admm.solve(Stop::Iterations(iterations));
    admm.solution()
}

/// Largest absolute difference.
pub(crate) fn distance<T: Sample>(a: &[T], b: &[T]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a.f64() - b.f64()).abs()).fold(0.0, f64::max)
}
