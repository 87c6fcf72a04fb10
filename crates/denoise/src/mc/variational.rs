//! The convex models on the logarithm of the irradiance, with weights that follow the noise.

use crate::admm::{Admm, Coupling, DataTerm, LinearStep, Problem, Stop, Weight};
use crate::primal_dual::Tgv2;
use crate::{DenoiseError, Shape};
use std::borrow::Cow;

/// Primal-dual iterations of TGV2 for one of the other models.
const TGV_STEPS: usize = 4;

/// The convex models by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VariationalModel {
    /// Quadratic data term.
    Rof,
    /// Absolute data term: impulses do not count.
    TvL1,
    /// Both, `0.1 |r| + 0.5/2 r^2`.
    Hybrid,
    /// Second-order total generalised variation, quadratic data term: ramps without staircases, slower.
    Tgv,
}

impl VariationalModel {
    /// The data term at weight `w` per pixel.
    fn data(self, weight: &[f32]) -> DataTerm<f32> {
        // Without holes the solver needs no map.
        let uniform = weight.first().copied().filter(|w| *w > 0.0 && weight.iter().all(|v| v == w));
        let times = |k: f32| match uniform {
            Some(w) => Weight::Uniform(k * w),
            None => weight.iter().map(|w| k * w).collect::<Vec<f32>>().into(),
        };
        match self {
            Self::Rof | Self::Tgv => DataTerm::L2 { lambda: times(1.0) },
            Self::TvL1 => DataTerm::L1 { lambda: times(1.0) },
            Self::Hybrid => DataTerm::Hybrid { l1: times(0.1), l2: times(0.5) },
        }
    }

    /// Factors of [`Self::strength`]'s grid, relative to it.
    pub(crate) const GRID: [f32; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];

    /// The default `c` of `alpha = c sigma max(W_aux, 0.2)`, for samples without halves.
    pub fn strength(self) -> f32 {
        match self {
            Self::Rof | Self::Tgv => 3.0,
            Self::TvL1 => 16.0,
            Self::Hybrid => 4.0,
        }
    }
}

/// `alpha(x) = c sigma(x) max(W_aux(x), 0.2)`.
///
/// Total variation removes noise of deviation `sigma` at a weight proportional to it, so one `c` serves pictures of
/// any noise; the floor of the coherence keeps noise on edges from staying.
///
/// # Panics
/// If the lengths differ.
pub fn adaptive_weight(c: f32, sigma: &[f32], auxiliary: &[f32]) -> Vec<f32> {
    assert_eq!(sigma.len(), auxiliary.len(), "one value per pixel");
    sigma.iter().zip(auxiliary).map(|(s, w)| c * s * w.max(0.2)).collect()
}

/// Minimises the model for 3 planes with vectorial total variation of weight `alpha` (1 plane).
///
/// # Errors
/// If a plane has a wrong length or a value that is not finite.
pub fn solve_variational(
    model: VariationalModel,
    shape: Shape,
    target: &[f32],
    weight: &[f32],
    alpha: &[f32],
    iterations: usize,
) -> Result<Vec<f32>, DenoiseError> {
    minimise(model, shape, Cow::Borrowed(target), weight, alpha.to_vec(), iterations)
}

/// As [`solve_variational`]; an owned target is freed as soon as the solver has its own.
pub(super) fn minimise(
    model: VariationalModel,
    shape: Shape,
    target: Cow<'_, [f32]>,
    weight: &[f32],
    alpha: Vec<f32>,
    iterations: usize,
) -> Result<Vec<f32>, DenoiseError> {
    if model == VariationalModel::Tgv {
        // TGV2 has one weight of its regulariser; the data term is divided by `alpha` instead. Where there is no noise
        // the target stays.
        let lambda: Vec<f32> = weight.iter().zip(alpha).map(|(w, a)| w / a.max(1e-3)).collect();
        let mut solver = Tgv2::new(shape, &target, lambda, [1.0, 2.0], Coupling::Vectorial)?;
        drop(target);
        solver.iterate(TGV_STEPS * iterations);
        return Ok(solver.solution());
    }
    let problem = problem(model, shape, &target, weight, alpha);
    // Few steps: the absolute terms are stiff, for which sweeps take more of them.
    let mut admm = Admm::owning(problem, LinearStep::Exact)?;
    drop(target);
    admm.solve(Stop::Iterations(iterations));
    Ok(admm.into_solution())
}

/// What all models but TGV2 minimise.
pub(crate) fn problem<'a>(
    model: VariationalModel,
    shape: Shape,
    target: &'a [f32],
    weight: &[f32],
    alpha: Vec<f32>,
) -> Problem<'a, f32> {
    Problem::new(shape, target, model.data(weight)).with_gradient(alpha).vectorial()
}

/// The entry of `grid` with the least error across two halves `A` and `B` of the samples:
/// `(|u_c(A) - B|^2 + |u_c(B) - A|^2) / 2` over the pixels with weight. The noise of the halves is independent, so this
/// is the error against the truth plus a constant, whatever the noise is. Returns the entry and all scores.
///
/// # Errors
/// Those of `solve`.
///
/// # Panics
/// If the grid is empty or the lengths differ.
pub fn choose_by_halves<E>(
    grid: &[f32],
    [a, b]: [&[f32]; 2],
    weight: &[f32],
    mut solve: impl FnMut(f32, &[f32]) -> Result<Vec<f32>, E>,
) -> Result<(f32, Vec<f64>), E> {
    assert!(!grid.is_empty() && a.len() == b.len(), "a grid, and halves of one size");
    let mut scores = Vec::with_capacity(grid.len());
    for c in grid {
        let errors = [score(&solve(*c, a)?, b, weight), score(&solve(*c, b)?, a, weight)];
        scores.push(0.5 * (errors[0] + errors[1]));
    }
    Ok((least(grid, &scores), scores))
}

/// The squared distance of an estimate from the other half over the pixels with weight.
pub(crate) fn score(u: &[f32], other: &[f32], weight: &[f32]) -> f64 {
    let pairs = u.iter().zip(other).zip(weight.iter().cycle());
    pairs.map(|((u, v), w)| f64::from(w * (u - v) * (u - v))).sum()
}

/// The entry of a grid that is not empty with the least score.
pub(super) fn least(grid: &[f32], scores: &[f64]) -> f32 {
    let best = (0..grid.len()).min_by(|i, j| scores[*i].total_cmp(&scores[*j])).unwrap_or(0);
    grid[best]
}
