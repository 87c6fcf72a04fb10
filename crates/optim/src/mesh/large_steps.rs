//! Large Steps: diffusion of mesh gradients through `M = I + lambda L`.

use super::screened::Screened;
use super::solve::Lanes;
use crate::error::OptimError;
use crate::spatial::{Guidance, SpatialFilter};
use photofit_scalar::Real;
use rayon::prelude::*;
use std::sync::Arc;

/// The filter `M^-1`, `M = I + lambda L`, `L = degree - adjacency`, of Nicolet et al. 2021, "Large Steps in Inverse
/// Rendering of Geometry".
///
/// With [`Placement::VARIABLE`](crate::Placement::VARIABLE) and
/// [`Temporal::uniform_adam`](crate::Temporal::uniform_adam) it is their optimizer: the step is made in `u = M x`. The
/// same steps come from `PRE` and `FIRST` on `x` itself, without the product by `M`. Vertices are the welded ones:
/// equal positions joined first, or uv seams tear. The factor is made once per topology and shared by clones. All
/// solves run in f64 and one thread, whatever the scalar: bitwise the same on any number of cores.
/// The form `M = (1 - a) I + a L` is this one with `lambda = a / (1 - a)`, up to a factor.
///
/// ```
/// use photofit_optim::LargeSteps;
/// let path = LargeSteps::new(3, &[[0, 1], [1, 2]], 2.0)?;
/// let x = [0.0_f32, 1.0, 2.0, 0.5, 0.5, 0.5, 3.0, 2.0, 1.0];
/// let u = path.to_u(&x)?;
/// assert!(path.to_x(&u)?.iter().zip(&x).all(|(a, b)| (a - b).abs() < 1e-5));
/// # Ok::<(), photofit_optim::OptimError>(())
/// ```
#[derive(Clone, Debug)]
pub struct LargeSteps {
    screened: Arc<Screened>,
    lanes: Vec<Lanes>,
}

/// Name in messages.
const NAME: &str = "large steps";

impl LargeSteps {
    /// Factorises for `vertices` vertices joined by `edges` (undirected; repeats and loops count once and not at
    /// all); `lambda` finite and not negative, 19 in the paper.
    ///
    /// # Errors
    /// [`OptimError::EdgeOutOfRange`], [`OptimError::Setting`] for `lambda`, and [`OptimError::Factorization`] when memory
    /// runs out.
    pub fn new(vertices: usize, edges: &[[u32; 2]], lambda: f64) -> Result<Self, OptimError> {
        let screened = Arc::new(Screened::new(NAME, vertices, edges, lambda)?);
        Ok(Self { screened, lanes: Vec::new() })
    }

    /// Number of vertices.
    pub fn vertices(&self) -> usize {
        self.screened.vertices()
    }

    /// The weight of the Laplacian.
    pub fn lambda(&self) -> f64 {
        self.screened.lambda
    }

    /// Bytes held by the factor's values.
    pub fn factor_bytes(&self) -> usize {
        self.screened.factor_bytes()
    }

    /// `u = M x`, for 3-vectors stored one after the other (length `3 vertices`).
    ///
    /// # Errors
    /// [`OptimError::Length`].
    pub fn to_u<T: Real>(&self, x: &[T]) -> Result<Vec<T>, OptimError> {
        OptimError::length(NAME, "positions", x.len(), 3 * self.vertices())?;
        let mut u = vec![T::zero(); x.len()];
        self.multiply(x, &mut u);
        Ok(u)
    }

    /// `M x` of rows of one or more samples.
    fn multiply<T: Real>(&self, x: &[T], u: &mut [T]) {
        let Screened { offsets, neighbours, lambda, .. } = &*self.screened;
        if x.is_empty() {
            return;
        }
        let width = x.len() / self.vertices();
        u.par_chunks_mut(width).with_min_len(2048).enumerate().for_each(|(i, u)| {
            let row = &neighbours[offsets[i] as usize..offsets[i + 1] as usize];
            for (k, u) in u.iter_mut().enumerate() {
                let own = x[width * i + k].f64();
                let around: f64 = row.iter().map(|&j| own - x[width * j as usize + k].f64()).sum();
                *u = T::of(own + lambda * around);
            }
        });
    }

    /// `x`, the solution of `M x = u`, for 3-vectors stored one after the other (length `3 vertices`). It is also the
    /// gradient in `u` of a function whose gradient in `x` is the argument (`M` is symmetric).
    ///
    /// # Errors
    /// [`OptimError::Length`].
    pub fn to_x<T: Real>(&self, u: &[T]) -> Result<Vec<T>, OptimError> {
        OptimError::length(NAME, "right-hand sides", u.len(), 3 * self.vertices())?;
        let mut x = vec![T::zero(); u.len()];
        self.screened.apply(&[u], &mut [&mut x], &mut Vec::new());
        Ok(x)
    }
}

impl<T: Real> SpatialFilter<T> for LargeSteps {
    fn sites(&self) -> usize {
        self.vertices()
    }

    fn prepare(&mut self, _: &Guidance<'_, T>) -> Result<(), OptimError> {
        Ok(())
    }

    fn apply(&mut self, fields: &[&[T]], out: &mut [&mut [T]]) {
        self.screened.apply(fields, out, &mut self.lanes);
    }

    fn unapply(&mut self, x: &[T], u: &mut [T]) -> bool {
        self.multiply(x, u);
        true
    }
}
