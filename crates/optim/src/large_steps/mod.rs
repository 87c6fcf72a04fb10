//! Diffusion of mesh gradients through `M = I + lambda L`, by a cached sparse Cholesky factorisation.

mod solve;

use crate::error::OptimError;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Par, Side};
use photofit_scalar::Real;
use rayon::prelude::*;
use solve::{Lanes, solve};

/// The reparametrisation `u = M x`, `M = I + lambda L`, `L = degree - adjacency`, of Nicolet et al. 2021, "Large Steps in
/// Inverse Rendering of Geometry".
///
/// Optimise `u` with [`UniformAdam`](crate::UniformAdam) and [`Self::gradient`]; read positions by [`Self::to_x`]. Vertices
/// are the welded ones: equal positions joined first, or uv seams tear. The factor is made once per topology. All
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
#[derive(Debug)]
pub struct LargeSteps {
    lambda: f64,
    /// Neighbours of each vertex, ascending, in compressed rows.
    offsets: Vec<u32>,
    neighbours: Vec<u32>,
    symbolic: SymbolicCholesky<u32>,
    factor: Vec<f64>,
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
        let good = lambda >= 0.0 && lambda.is_finite();
        OptimError::setting(NAME, "lambda", lambda, "finite and not negative", good)?;
        let count = edges.len() as f64;
        OptimError::setting(NAME, "edge count", count, "below 2^29", edges.len() < 1 << 29)?;
        OptimError::setting(NAME, "vertex count", vertices as f64, "below 2^30", vertices < 1 << 30)?;
        let mut pairs = Vec::with_capacity(2 * edges.len());
        for (edge, &[a, b]) in edges.iter().enumerate() {
            if a.max(b) as usize >= vertices {
                return Err(OptimError::EdgeOutOfRange { edge, vertex: a.max(b), vertices });
            }
            if a != b {
                pairs.extend([[a, b], [b, a]]);
            }
        }
        pairs.par_sort_unstable();
        pairs.dedup();
        let mut offsets = vec![0_u32; vertices + 1];
        for [a, _] in &pairs {
            offsets[*a as usize + 1] += 1;
        }
        for i in 0..vertices {
            offsets[i + 1] += offsets[i];
        }
        let neighbours: Vec<u32> = pairs.into_iter().map(|[_, b]| b).collect();
        let (symbolic, factor) = factorize(&offsets, &neighbours, lambda)
            .map_err(|reason| OptimError::Factorization { vertices, reason })?;
        Ok(Self { lambda, offsets, neighbours, symbolic, factor })
    }

    /// Number of vertices.
    pub fn vertices(&self) -> usize {
        self.offsets.len() - 1
    }

    /// The weight of the Laplacian.
    pub fn lambda(&self) -> f64 {
        self.lambda
    }

    /// Bytes held by the factor's values.
    pub fn factor_bytes(&self) -> usize {
        size_of_val(self.factor.as_slice())
    }

    /// `u = M x`, for 3-vectors stored one after the other (length `3 vertices`).
    ///
    /// # Errors
    /// [`OptimError::Length`].
    pub fn to_u<T: Real>(&self, x: &[T]) -> Result<Vec<T>, OptimError> {
        OptimError::length(NAME, "positions", x.len(), 3 * self.vertices())?;
        let mut u = vec![T::zero(); x.len()];
        u.par_chunks_mut(3).with_min_len(2048).enumerate().for_each(|(i, u)| {
            let row = &self.neighbours[self.offsets[i] as usize..self.offsets[i + 1] as usize];
            for k in 0..3 {
                let own = x[3 * i + k].f64();
                let around: f64 = row.iter().map(|&j| own - x[3 * j as usize + k].f64()).sum();
                u[k] = T::of(own + self.lambda * around);
            }
        });
        Ok(u)
    }

    /// `x`, the solution of `M x = u`, for 3-vectors stored one after the other (length `3 vertices`).
    ///
    /// # Errors
    /// [`OptimError::Length`].
    pub fn to_x<T: Real>(&self, u: &[T]) -> Result<Vec<T>, OptimError> {
        OptimError::length(NAME, "right-hand sides", u.len(), 3 * self.vertices())?;
        if u.is_empty() {
            return Ok(Vec::new());
        }
        let (SymbolicCholeskyRaw::Supernodal(symbolic), Some(order)) =
            (self.symbolic.raw(), self.symbolic.perm())
        else {
            let reason = "the factor is not the ordered, supernodal one that was asked for".to_owned();
            return Err(OptimError::Factorization { vertices: self.vertices(), reason });
        };
        let (forward, inverse) = order.arrays();
        let mut lanes: Vec<Lanes> = forward
            .par_iter()
            .with_min_len(4096)
            .map(|&i| {
                let at = 3 * i as usize;
                [u[at].f64(), u[at + 1].f64(), u[at + 2].f64(), 0.0]
            })
            .collect();
        solve(symbolic, &self.factor, &mut lanes);
        let mut x = vec![T::zero(); u.len()];
        x.par_chunks_mut(3).with_min_len(4096).zip(inverse).for_each(|(x, &i)| {
            for k in 0..3 {
                x[k] = T::of(lanes[i as usize][k]);
            }
        });
        Ok(x)
    }

    /// Gradient in `u` of a function whose gradient in `x` is `g`: `M^-1 g` (`M` is symmetric). Also the prefilter of
    /// gradients and the postfilter of first moments when optimising `x` itself.
    ///
    /// # Errors
    /// [`OptimError::Length`].
    pub fn gradient<T: Real>(&self, g: &[T]) -> Result<Vec<T>, OptimError> {
        self.to_x(g)
    }
}

/// Lower triangle of `I + lambda L` by columns, ordered by AMD and factorised in one thread.
fn factorize(
    offsets: &[u32],
    neighbours: &[u32],
    lambda: f64,
) -> Result<(SymbolicCholesky<u32>, Vec<f64>), String> {
    let n = offsets.len() - 1;
    let mut starts = Vec::with_capacity(n + 1);
    let mut rows = Vec::with_capacity(n + neighbours.len() / 2);
    let mut values = Vec::with_capacity(n + neighbours.len() / 2);
    starts.push(0_u32);
    for j in 0..n {
        let row = &neighbours[offsets[j] as usize..offsets[j + 1] as usize];
        rows.push(j as u32);
        values.push(1.0 + lambda * row.len() as f64);
        for &i in row.iter().filter(|&&i| i as usize > j) {
            rows.push(i);
            values.push(-lambda);
        }
        starts.push(rows.len() as u32);
    }
    let structure = SymbolicSparseColMatRef::new_checked(n, n, &starts, None, &rows);
    let matrix = SparseColMatRef::new(structure, &values);
    let params = CholeskySymbolicParams {
        supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
        ..CholeskySymbolicParams::default()
    };
    let symbolic = factorize_symbolic_cholesky(structure, Side::Lower, SymmetricOrdering::Amd, params)
        .map_err(|e| e.to_string())?;
    let mut factor = Vec::new();
    factor.try_reserve_exact(symbolic.len_val()).map_err(|e| e.to_string())?;
    factor.resize(symbolic.len_val(), 0.0);
    let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
    let mut memory = MemBuffer::try_new(scratch).map_err(|e| format!("out of memory ({e:?})"))?;
    symbolic
        .factorize_numeric_llt(
            &mut factor,
            matrix,
            Side::Lower,
            LltRegularization::default(),
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        )
        .map_err(|e| e.to_string())?;
    Ok((symbolic, factor))
}

#[cfg(test)]
mod tests;
