//! Which features of positions a flow is conditioned on.

use crate::FlowError;
use crate::grid::Grid;
use crate::tensor::Tensor;
use photofit_scalar::Real;

/// Learned features of positions in the unit cube.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Encoding {
    /// See [`Grid`].
    Hash(Grid),
    /// See [`Tensor`].
    Tensor(Tensor),
}

impl Default for Encoding {
    fn default() -> Self {
        Self::Tensor(Tensor::default())
    }
}

impl Encoding {
    /// Number of parameters.
    pub fn len(&self) -> usize {
        match self {
            Self::Hash(grid) => grid.len(),
            Self::Tensor(tensor) => tensor.len(),
        }
    }

    /// Whether there are no parameters.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of features.
    pub fn features(&self) -> usize {
        match self {
            Self::Hash(grid) => grid.features(),
            Self::Tensor(_) => Tensor::FEATURES,
        }
    }

    /// Parameters before training, of numbers in `[-1, 1)`.
    pub fn init<T: Real>(&self, table: &mut [T], mut random: impl FnMut() -> T) {
        match self {
            Self::Hash(_) => table.iter_mut().for_each(|v| *v = T::of(0.05) * random()),
            Self::Tensor(tensor) => tensor.init(table, random),
        }
    }

    /// Features at `p` (clamped to the unit cube) into `out`.
    #[inline]
    pub fn forward<T: Real>(&self, table: &[T], p: [T; 3], out: &mut [T]) {
        match self {
            Self::Hash(grid) => grid.forward(table, p, out),
            Self::Tensor(tensor) => tensor.forward(table, p, out),
        }
    }

    /// Adds to the gradients of the parameters for those of the features.
    pub fn forward_vjp<T: Real>(&self, table: &[T], p: [T; 3], g: &[T], g_table: &mut [T]) {
        match self {
            Self::Hash(grid) => grid.forward_vjp(p, g, g_table),
            Self::Tensor(tensor) => tensor.forward_vjp(table, p, g, g_table),
        }
    }

    /// # Errors
    /// [`FlowError::Setting`] for sizes outside their ranges.
    pub(crate) fn check(&self) -> Result<(), FlowError> {
        let cells = |g: &Grid| g.coarsest as f64 * g.growth.powi(g.levels as i32);
        let rules = match self {
            Self::Hash(g) => vec![
                ("features of the grid", g.features() as f64, "at most 25", g.features() <= 25),
                (
                    "entries of a grid level",
                    g.entries as f64,
                    "a power of two up to 2^22",
                    g.entries.is_power_of_two() && g.entries <= 1 << 22,
                ),
                (
                    "cells of the finest grid",
                    cells(g),
                    "1 to 2^20 at every level",
                    g.coarsest >= 1 && g.growth >= 1.0 && cells(g) <= f64::from(1 << 20),
                ),
            ],
            Self::Tensor(t) => {
                vec![("nodes of an edge", t.nodes as f64, "2 to 1024", (2..=1024).contains(&t.nodes))]
            }
        };
        match rules.into_iter().find(|r| !r.3) {
            Some((setting, value, rule, _)) => Err(FlowError::Setting { setting, value, rule }),
            None => Ok(()),
        }
    }
}
