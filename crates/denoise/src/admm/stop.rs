//! When to stop.

/// The stopping rule.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stop {
    /// After a fixed number of iterations.
    Iterations(usize),
    /// As soon as `max(|u-p|, |p - previous p|) < tolerance |u|` (Euclidean norms over a channel without its mean, or
    /// over all channels if coupled), not before the fifth iteration, at the latest after `limit`. A solution that is
    /// constant but for rounding is measured by a small share of the target's norm.
    Tolerance {
        /// Relative change, for example 1e-4.
        tolerance: f64,
        /// Most iterations.
        limit: usize,
    },
}

/// How a solve ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// Iterations of this solve.
    pub iterations: usize,
    /// The last relative change, largest over the channels; `None` after a fixed number of iterations.
    pub residual: Option<f64>,
    /// True if the tolerance was reached, or there was none.
    pub converged: bool,
}
