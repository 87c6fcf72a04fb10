//! Edge-aware diffusion over a mesh: the Laplacian's weights come from the normals.

use super::screened::Screened;
use super::solve::Lanes;
use crate::error::OptimError;
use crate::spatial::{Guidance, SpatialFilter};
use photofit_scalar::Real;

/// The filter `(I + lambda L_w)^-1`, where the edge between vertices `i` and `j` weighs `exp(-|n_i - n_j| / sigma)`.
///
/// Smooth regions share their steps, creases part them. One factorisation (the pattern is kept) and one solve for every
/// four channels per step, where [`SampledNormals`](super::SampledNormals) takes one solve per sample. The inverse
/// has non-negative entries with rows of sum one, so steps stay bounded. The guide of each step
/// ([`Optimizer::step_guided`](crate::Optimizer::step_guided)) is the vertex normals, `3 vertices` numbers of any
/// finite length; zero normals (of degenerate triangles) are at distance one from unit normals.
#[derive(Debug)]
pub struct EdgeAware {
    screened: Screened,
    sigma: f64,
    normals: Vec<f64>,
    lanes: Vec<Lanes>,
}

/// Name in messages.
const NAME: &str = "edge-aware diffusion";

impl EdgeAware {
    /// For `vertices` welded vertices joined by `edges` (undirected; repeats and loops count once and not at all);
    /// `lambda` finite and not negative; `sigma` positive, .5 is a start.
    ///
    /// # Errors
    /// [`OptimError::EdgeOutOfRange`], [`OptimError::Setting`], and [`OptimError::Factorization`] when memory runs out.
    pub fn new(vertices: usize, edges: &[[u32; 2]], lambda: f64, sigma: f64) -> Result<Self, OptimError> {
        OptimError::setting(NAME, "sigma", sigma, "positive", sigma > 0.0)?;
        let screened = Screened::new(NAME, vertices, edges, lambda)?;
        Ok(Self { screened, sigma, normals: Vec::new(), lanes: Vec::new() })
    }
}

/// Checks the vertex normals given with a step and takes them in double precision.
pub(super) fn take_normals<T: Real>(
    guidance: &Guidance<'_, T>,
    vertices: usize,
) -> Result<Vec<f64>, OptimError> {
    OptimError::length(guidance.group, "guiding normals", guidance.guide.len(), 3 * vertices)?;
    if let Some(x) = guidance.guide.iter().find(|x| !x.is_finite()) {
        OptimError::setting(guidance.group, "guiding normal", x.f64(), "finite", false)?;
    }
    Ok(guidance.guide.iter().map(|x| x.f64()).collect())
}

impl<T: Real> SpatialFilter<T> for EdgeAware {
    fn sites(&self) -> usize {
        self.screened.vertices()
    }

    fn prepare(&mut self, guidance: &Guidance<'_, T>) -> Result<(), OptimError> {
        let normals = take_normals(guidance, self.screened.vertices())?;
        if normals == self.normals {
            return Ok(());
        }
        let sigma = self.sigma;
        self.screened.reweigh(|i, j| {
            let square: f64 = (0..3).map(|k| (normals[3 * i + k] - normals[3 * j + k]).powi(2)).sum();
            (-square.sqrt() / sigma).exp()
        })?;
        self.normals = normals;
        Ok(())
    }

    fn apply(&mut self, fields: &[&[T]], out: &mut [&mut [T]]) {
        self.screened.apply(fields, out, &mut self.lanes);
    }
}
