//! What can go wrong with a reconstruction.

/// Why a surface cannot be reconstructed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SurfaceError {
    /// A cloud without points.
    #[error("the cloud has no points")]
    Empty,
    /// Points that break a rule.
    #[error("points: {rule}")]
    Points {
        /// What it is, and what it must be.
        rule: String,
    },
    /// A camera that breaks a rule.
    #[error("camera: {rule}")]
    Camera {
        /// What it is, and what it must be.
        rule: String,
    },
    /// An option that breaks a rule.
    #[error("options: {rule}")]
    Option {
        /// What it is, and what it must be.
        rule: String,
    },
    /// No point falls into the picture.
    #[error("none of the {points} points is in front of the camera and inside of the picture")]
    NothingInView {
        /// Points of the cloud.
        points: usize,
    },
    /// The solver refused its input.
    #[error(transparent)]
    Solver(#[from] crate::DenoiseError),
    /// The caller asked to stop.
    #[error("interrupted")]
    Interrupted,
}
