//! What can be wrong with a scene that is to be rendered.

use photofit_rays::AccelError;

/// An error of this crate; the message names the place and the rule.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PathtraceError {
    /// A part of the scene breaks a rule.
    #[error("{place}: {rule}")]
    Invalid {
        /// Where: "instance 3", "light 0", "camera".
        place: String,
        /// The rule that is broken.
        rule: String,
    },
    /// A mesh that no acceleration structure can be built for.
    #[error("shape {shape}: {cause}")]
    Accel {
        /// Index of the shape.
        shape: usize,
        /// Why.
        cause: AccelError,
    },
    /// Nothing in the scene gives light.
    #[error(
        "the scene has no light; it must have an emitting surface or medium, a light source or an environment that is not black"
    )]
    NoLight,
    /// A saved state that cannot be continued.
    #[error("the saved state cannot be continued: {0}")]
    State(String),
}

/// What is wrong where something is named that is not there; `what` has its index.
pub(crate) fn absent(what: impl std::fmt::Display, count: usize) -> String {
    format!("{what} is not there; the index must be below {count}")
}

/// A broken rule at a place.
pub(crate) fn invalid(place: impl Into<String>, rule: impl Into<String>) -> PathtraceError {
    PathtraceError::Invalid { place: place.into(), rule: rule.into() }
}
