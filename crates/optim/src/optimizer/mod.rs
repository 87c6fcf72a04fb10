//! The optimizer: a temporal filter, and spatial filters before it, after it, or around it.

mod fused;
mod staged;
mod temporal;

use crate::error::OptimError;
use crate::scan::{Rows, mean_square};
use crate::spatial::{Placement, SpatialFilter};
use crate::state::State;
use photofit_scalar::Real;
use staged::Scratch;
pub use temporal::{SecondMoment, Temporal};

/// A filter and its place.
#[derive(Debug)]
struct Placed<T> {
    placement: Placement,
    filter: Box<dyn SpatialFilter<T>>,
}

/// First-order optimizer of one parameter group: every method is a [`Temporal`] filter combined with any number of
/// [`SpatialFilter`]s (Belhe et al. 2025 show Adam and Large Steps as cases of this form).
///
/// One step: filter `g` (prefilter); `m = b1 m + (1 - b1) g`, `v = b2 v + (1 - b2) g^2`; filter copies of `m` and `v`
/// (postfilter); correct the bias; `p -= rate m^ / (sqrt(v^) + eps)` with `eps = relative_epsilon sqrt(mean g^2)`, so a
/// step does not depend on the gradients' scale. Filters take their weights from the parameters before the step.
///
/// | method | temporal | spatial |
/// |---|---|---|
/// | gradient descent, with momentum | [`Temporal::descent`] | |
/// | Adam, `UniformAdam`, `VectorAdam` | [`Temporal::adam`], ... | |
/// | Laplacian smoothing (Sobolev gradients) | any | [`ScreenedPoisson`](crate::ScreenedPoisson) or [`LargeSteps`](crate::LargeSteps), [`Placement::PRE`] or `POST` |
/// | Large Steps | [`Temporal::uniform_adam`] | [`LargeSteps`](crate::LargeSteps), [`Placement::VARIABLE`] |
/// | spatiotemporal bilateral on grids | [`Temporal::paired`] | [`GridBilateral`](crate::GridBilateral), [`Placement::POST`] |
/// | bilateral on meshes | [`Temporal::uniform_adam`] | [`LargeSteps`](crate::LargeSteps) `PRE`, [`EdgeAware`](crate::EdgeAware) or [`SampledNormals`](crate::SampledNormals) `FIRST` |
///
/// Results are bitwise the same for any number of threads.
///
/// ```
/// use photofit_optim::{Optimizer, Temporal};
/// let mut x = [4.0_f32, -3.0];
/// let mut adam = Optimizer::new("x", x.len(), Temporal::adam())?;
/// for _ in 0..400 {
///     let gradient = x.map(|x| 2e-10 * x);
///     adam.step(&mut x, &gradient, 0.05)?;
/// }
/// assert!(x.iter().all(|x| x.abs() < 0.01));
/// # Ok::<(), photofit_optim::OptimError>(())
/// ```
///
/// A texture of 32 x 32 texels of three channels, filtered along its own edges:
/// ```
/// use photofit_optim::{Bilateral, Grid, GridBilateral, Optimizer, Placement, Temporal};
/// let filter = GridBilateral::new("albedo", Grid::plane(32, 32), 3, Bilateral::default())?;
/// let mut optimizer = Optimizer::new("albedo", 32 * 32 * 3, Temporal::adam().paired(0.5))?
///     .with_filter(Placement::POST, filter)?;
/// let mut texels = vec![0.5_f32; 32 * 32 * 3];
/// let gradient: Vec<f32> = texels.iter().map(|t| t - 0.25).collect();
/// optimizer.step(&mut texels, &gradient, 0.01)?;
/// assert!(texels.iter().all(|t| (t - 0.49).abs() < 1e-5));
/// # Ok::<(), photofit_optim::OptimError>(())
/// ```
#[derive(Debug)]
pub struct Optimizer<T: Real> {
    group: String,
    len: usize,
    temporal: Temporal,
    filters: Vec<Placed<T>>,
    state: State<T>,
    /// Bias corrections by the number of steps a row has taken.
    table: Vec<[T; 2]>,
    scratch: Scratch<T>,
}

impl<T: Real> Optimizer<T> {
    /// For a group of `len` parameters, named for messages.
    ///
    /// # Errors
    /// [`OptimError::Setting`] for settings outside their ranges.
    pub fn new(group: &str, len: usize, temporal: Temporal) -> Result<Self, OptimError> {
        temporal.check(group, len)?;
        let [m, v] = temporal.memory(len);
        Ok(Self {
            group: group.to_owned(),
            len,
            temporal,
            filters: Vec::new(),
            state: State::new(m, v),
            table: Vec::new(),
            scratch: Scratch::default(),
        })
    }

    /// Adds a spatial filter; several at one place run in the order in which they were added.
    ///
    /// # Errors
    /// [`OptimError::Setting`] when the filter's sites do not divide what it is to filter, and
    /// [`OptimError::Combination`] for a change of variables beside another filter.
    pub fn with_filter(
        mut self,
        placement: Placement,
        filter: impl SpatialFilter<T> + 'static,
    ) -> Result<Self, OptimError> {
        let sites = filter.sites();
        let fits = |len: usize| if sites == 0 { len == 0 } else { len.is_multiple_of(sites) };
        let whole = fits(self.len) && (!placement.second || fits(self.temporal.second_len(self.len)));
        let rule = "a divisor of the parameter count and of the second moment's";
        OptimError::setting(&self.group, "number of filter sites", sites as f64, rule, whole)?;
        let alone = self.filters.is_empty() && placement == Placement::VARIABLE;
        let variable = placement.variable || self.filters.iter().any(|f| f.placement.variable);
        if variable && !alone {
            return Err(OptimError::Combination {
                group: self.group,
                what: "a change of variables",
                with: "another filter",
            });
        }
        self.filters.push(Placed { placement, filter: Box::new(filter) });
        Ok(self)
    }

    /// Name of the parameter group.
    pub fn group(&self) -> &str {
        &self.group
    }

    /// The temporal filter.
    pub fn temporal(&self) -> &Temporal {
        &self.temporal
    }

    /// What a checkpoint has to keep.
    pub fn state(&self) -> &State<T> {
        &self.state
    }

    /// Continues from a saved state, to the same bits.
    ///
    /// # Errors
    /// [`OptimError::Length`] or [`OptimError::Setting`] when the state is not one of this group.
    pub fn restore(&mut self, state: State<T>) -> Result<(), OptimError> {
        state.check(&self.group, &self.state)?;
        let rows = state.row_steps.len();
        if rows > 0 && !self.len.is_multiple_of(rows) {
            return OptimError::length(&self.group, "row counts", rows, self.len);
        }
        self.state = state;
        Ok(())
    }

    /// One step: `params` moves against `grads` at learning rate `rate`.
    ///
    /// # Errors
    /// [`OptimError::NonFiniteGradient`], [`OptimError::Length`], for a rate that is negative or not finite
    /// [`OptimError::Setting`], and what a filter finds wrong with its guide; parameters and state are then unchanged.
    pub fn step(&mut self, params: &mut [T], grads: &[T], rate: T) -> Result<(), OptimError> {
        self.step_guided(params, grads, rate, &[])
    }

    /// [`Self::step`] with a further guide for the filters, such as the current vertex normals; see each filter.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn step_guided(
        &mut self,
        params: &mut [T],
        grads: &[T],
        rate: T,
        guide: &[T],
    ) -> Result<(), OptimError> {
        let width = match self.state.row_steps.len() {
            0 => 1,
            rows => self.len / rows,
        };
        if width == 1 {
            return self.advance(params, grads, &Rows { rates: &[rate], touched: None }, guide);
        }
        self.advance(params, grads, &Rows { rates: &vec![rate; width], touched: None }, guide)
    }

    /// One step with a learning rate per channel, skipping rows that were not touched (lazy rows).
    ///
    /// Parameters are rows of `rows.rates.len()` consecutive samples (the 16 channels of a texel, say). What happens:
    /// - An untouched row is left alone: its parameters, both moments and its own step count keep their bits, its
    ///   gradients are not read. For it, time stands still: moments do not decay while it is not seen, and its bias
    ///   correction counts its own steps, so a row seen for the first time at step 1000 moves by `rate` as it would
    ///   have at step 1. (Dense Adam would go on moving it by momentum and then move it by a fraction of `rate`.)
    /// - A channel with rate 0 is frozen: its parameter keeps its bits, its gradient counts as zero in the moments
    ///   and is left out of epsilon's mean; it must be finite all the same.
    /// - When no row is touched nothing changes, the step count included.
    ///
    /// Row counts come into being at the first call with `touched`; until then all rows count as stepped together.
    /// Untouched rows need moments of their own: `touched` goes with [`SecondMoment::PerEntry`] and without filters.
    ///
    /// # Errors
    /// As [`Self::step`], and [`OptimError::Combination`].
    pub fn step_rows(&mut self, params: &mut [T], grads: &[T], rows: &Rows<'_, T>) -> Result<(), OptimError> {
        self.advance(params, grads, rows, &[])
    }

    fn advance(
        &mut self,
        params: &mut [T],
        grads: &[T],
        rows: &Rows<'_, T>,
        guide: &[T],
    ) -> Result<(), OptimError> {
        rows.check(&self.group, params, grads, self.len)?;
        let width = rows.rates.len();
        if !self.state.row_steps.is_empty() {
            OptimError::length(&self.group, "row counts", self.state.row_steps.len(), self.len / width)?;
        }
        let fused = self.filters.is_empty() && self.temporal.second == SecondMoment::PerEntry;
        if !fused && (rows.touched.is_some() || !self.state.row_steps.is_empty()) {
            return Err(OptimError::Combination {
                group: self.group.clone(),
                what: "rows that step apart",
                with: "spatial filters or a pooled second moment",
            });
        }
        let Some(mean) = mean_square(&self.group, grads, rows)? else { return Ok(()) };
        if fused {
            self.fused(params, grads, rows, mean);
            Ok(())
        } else {
            self.staged(params, grads, rows, mean, guide)
        }
    }
}

#[cfg(test)]
mod tests;
