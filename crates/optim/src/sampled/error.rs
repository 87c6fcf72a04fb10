//! The error type of sampled derivatives.

use crate::OptimError;

/// Why an estimate or a minimisation ended without a result.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SampledError<E> {
    /// The black box gave NaN or an infinity.
    #[error("evaluation {evaluation} of the black box (seed {seed:#x}) is {value} at {}", list(point))]
    NonFinite {
        /// Which evaluation, counted from 0 over the objective's life.
        evaluation: u64,
        /// The seed it was given.
        seed: u64,
        /// The value.
        value: f64,
        /// The parameters.
        point: Vec<f64>,
    },
    /// The black box failed.
    #[error("the black box failed: {0}")]
    BlackBox(E),
    /// A slice has the wrong length, or a setting lies outside its range.
    #[error(transparent)]
    Setting(#[from] OptimError),
}

/// The first parameters of a point, for a message.
fn list(point: &[f64]) -> String {
    const SHOWN: usize = 6;
    let shown: Vec<String> = point.iter().take(SHOWN).map(f64::to_string).collect();
    let rest = if point.len() > SHOWN { format!(", ... ({} in all)", point.len()) } else { String::new() };
    format!("[{}{rest}]", shown.join(", "))
}
