//! The error type of the crate.

use crate::Shape;

/// Why a problem was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DenoiseError {
    /// A slice has the wrong length.
    #[error("{what} has {found} values, expected {expected} ({shape})")]
    Length {
        /// The slice.
        what: &'static str,
        /// Values found.
        found: usize,
        /// Values expected.
        expected: usize,
        /// The shape of the problem.
        shape: Shape,
    },
    /// A value is NaN or infinite where the model reads it.
    #[error("{what} is {value} at row {row}, column {col}, channel {channel}")]
    NotFinite {
        /// The slice.
        what: &'static str,
        /// Its value there.
        value: f64,
        /// Row, 0 at the top.
        row: usize,
        /// Column.
        col: usize,
        /// Channel.
        channel: usize,
    },
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
    /// A frame of a sequence does not say where its pixels lie, so that no history can follow them.
    #[error(
        "has neither positions nor depths of a camera that can be inverted; a frame of a sequence must have one of them"
    )]
    Unplaced,
    /// No kernel does this.
    #[cfg(feature = "gpu")]
    #[error("there are no kernels for {what}")]
    NotOnDevice {
        /// The model or the parts of a problem.
        what: String,
    },
    /// The device failed or refused a buffer or a kernel.
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Device(#[from] photofit_gpu::GpuError),
    /// The image has no pixels or too many.
    #[error("an image of {shape} has no pixels, no channels or more than 2^31 samples")]
    Size {
        /// The shape.
        shape: Shape,
    },
}

impl DenoiseError {
    pub(crate) fn length(
        what: &'static str,
        found: usize,
        expected: usize,
        shape: Shape,
    ) -> Result<(), Self> {
        if found == expected { Ok(()) } else { Err(Self::Length { what, found, expected, shape }) }
    }

    pub(crate) fn setting(
        setting: &'static str,
        value: f64,
        rule: &'static str,
        holds: bool,
    ) -> Result<(), Self> {
        if holds { Ok(()) } else { Err(Self::Setting { setting, value, rule }) }
    }
}
