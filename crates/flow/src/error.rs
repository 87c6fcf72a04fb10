//! The error type of the crate.

use photofit_optim::OptimError;

/// Why a guide was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FlowError {
    /// A setting lies outside its range.
    #[error("{setting} is {value}, but must be {rule}")]
    Setting {
        /// The setting.
        setting: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        rule: &'static str,
    },
    /// Gradients or parameters are NaN or infinite after so many steps of training; the parameters that answer are the ones before.
    #[error(
        "training diverged: after {steps} steps gradients or parameters are NaN or infinite, but must be finite (lower rates help)"
    )]
    Diverged {
        /// Steps of training.
        steps: u64,
    },
    /// A step of training failed; the parameters that answer are unchanged.
    #[error(transparent)]
    Step(#[from] OptimError),
}
