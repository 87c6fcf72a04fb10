//! The error type of the crate.

/// Why a step or a factorisation was refused; parameters and state are then unchanged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum OptimError {
    /// A gradient is NaN or infinite.
    #[error("gradient {index} of parameter group `{group}` is {value}")]
    NonFiniteGradient {
        /// Name of the parameter group.
        group: String,
        /// Index of the first such gradient.
        index: usize,
        /// The gradient.
        value: f64,
    },
    /// A parameter that guides a filter is NaN or infinite.
    #[error("parameter {index} of group `{group}` is {value}, and cannot guide a filter")]
    NonFiniteParameter {
        /// Name of the parameter group.
        group: String,
        /// Index of the first such parameter.
        index: usize,
        /// The parameter.
        value: f64,
    },
    /// A combination that has no meaning.
    #[error("{what} of `{group}` cannot be combined with {with}")]
    Combination {
        /// Name of the parameter group.
        group: String,
        /// What was asked for.
        what: &'static str,
        /// What stands against it.
        with: &'static str,
    },
    /// The device failed or refused a buffer or a kernel.
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Device(#[from] photofit_gpu::GpuError),
    /// A slice has the wrong length.
    #[error("{what} of `{group}` has {found} entries, expected {expected}")]
    Length {
        /// Name of the parameter group or operator.
        group: String,
        /// The slice.
        what: &'static str,
        /// Entries found.
        found: usize,
        /// Entries expected.
        expected: usize,
    },
    /// A setting lies outside its range.
    #[error("{setting} of `{group}` is {value}, but must be {rule}")]
    Setting {
        /// Name of the parameter group or operator.
        group: String,
        /// The setting.
        setting: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        rule: &'static str,
    },
    /// An edge names a vertex that does not exist.
    #[error("edge {edge} names vertex {vertex}, but there are {vertices} vertices")]
    EdgeOutOfRange {
        /// Index of the edge.
        edge: usize,
        /// The vertex it names.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// The sparse factorisation failed (out of memory, or more entries than its indices count).
    #[error("the Cholesky factorisation of {vertices} vertices failed: {reason}")]
    Factorization {
        /// Number of vertices.
        vertices: usize,
        /// The solver's words.
        reason: String,
    },
}

impl OptimError {
    pub(crate) fn length(group: &str, what: &'static str, found: usize, expected: usize) -> Result<(), Self> {
        if found == expected {
            Ok(())
        } else {
            Err(Self::Length { group: group.to_owned(), what, found, expected })
        }
    }

    pub(crate) fn setting(
        group: &str,
        setting: &'static str,
        value: f64,
        rule: &'static str,
        holds: bool,
    ) -> Result<(), Self> {
        if holds { Ok(()) } else { Err(Self::Setting { group: group.to_owned(), setting, value, rule }) }
    }
}
