//! Filters over space: what every one of them offers, and where in a step it acts.

use crate::error::OptimError;
use photofit_scalar::Real;
use std::fmt::Debug;

pub(crate) mod bilateral;
pub(crate) mod grid;
#[cfg(feature = "fft")]
pub(crate) mod screened_poisson;

/// What a filter may look at before a step.
#[derive(Clone, Copy, Debug)]
pub struct Guidance<'a, T> {
    /// Name of the parameter group, for messages.
    pub group: &'a str,
    /// Parameters before the step.
    pub params: &'a [T],
    /// Gradients as they came.
    pub grads: &'a [T],
    /// Learning rate of the step (the largest one of its channels).
    pub rate: T,
    /// Further guide given with the step, such as vertex normals; empty if none was given.
    pub guide: &'a [T],
}

/// A linear filter over the sites of a grid or a mesh, with non-negative weights that sum to one at every site.
///
/// Its weights are fixed by [`Self::prepare`] once in a step and shared by everything that is filtered in that step: this
/// is what keeps steps bounded ([`Temporal::bound`](crate::Temporal::bound)).
pub trait SpatialFilter<T: Real>: Debug + Send + Sync {
    /// Number of sites; a field is `sites` rows of one or more consecutive samples.
    fn sites(&self) -> usize;

    /// Takes the guide of this step.
    ///
    /// # Errors
    /// [`OptimError`] when the guide does not fit; the filter then stays as it was.
    fn prepare(&mut self, guidance: &Guidance<'_, T>) -> Result<(), OptimError>;

    /// Writes the filtered `fields` to `out`, field by field of the same length. Called after [`Self::prepare`].
    fn apply(&mut self, fields: &[&[T]], out: &mut [&mut [T]]);

    /// The inverse of the filter, for [`Placement::VARIABLE`]: `u = F^-1 x`. `false` where there is none.
    fn unapply(&mut self, x: &[T], u: &mut [T]) -> bool {
        let _ = (x, u);
        false
    }
}

/// Where in a step a filter acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Placement {
    /// On the gradient, before it enters the moments.
    pub gradient: bool,
    /// On a copy of the first moment.
    pub first: bool,
    /// On a copy of the second moment.
    pub second: bool,
    /// As a change of variables `x = F u`: the step is made in `u`.
    pub variable: bool,
}

impl Placement {
    const NOWHERE: Self = Self { gradient: false, first: false, second: false, variable: false };
    /// Prefilter: on the gradient.
    pub const PRE: Self = Self { gradient: true, ..Self::NOWHERE };
    /// Postfilter: on copies of both moments. Written back, they would be blurred again in every later step.
    pub const POST: Self = Self { first: true, second: true, ..Self::NOWHERE };
    /// Prefilter and postfilter.
    pub const BOTH: Self = Self { gradient: true, ..Self::POST };
    /// On a copy of the first moment alone. Bounded only with [`SecondMoment::GlobalMax`](crate::SecondMoment::GlobalMax)
    /// or without a second moment; with any other, steps grow without limit where `v` is small beside `m~`.
    pub const FIRST: Self = Self { first: true, ..Self::NOWHERE };
    /// Change of variables, as Large Steps is stated: `u = F^-1 x`, gradient `F g` in `u`, and `x = F u` after the step.
    /// Equal to [`Self::PRE`] and [`Self::FIRST`] together with the global maximum.
    pub const VARIABLE: Self = Self { variable: true, ..Self::NOWHERE };
}
