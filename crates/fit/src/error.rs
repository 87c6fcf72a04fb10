//! Why a fit cannot be done.

use std::fmt;
use std::ops::RangeInclusive;
use std::path::PathBuf;

/// Errors of the fitting tasks.
#[derive(Debug, thiserror::Error)]
pub enum FitError {
    /// The asset cannot be read, written or used.
    #[error(transparent)]
    Scene(#[from] photofit_scene::SceneError),
    /// Decimation failed.
    #[error("decimation: {0}")]
    Decimate(#[from] photofit_geometry::decimate::DecimateError),
    /// The atlas failed.
    #[error("texture atlas: {0}")]
    Atlas(#[from] photofit_geometry::atlas::AtlasError),
    /// Baking failed.
    #[error("baking: {0}")]
    Bake(#[from] crate::bake::BakeError),
    /// An optimizer refused its input: a gradient that is not finite, with the step it happened at.
    #[error("step {step}: {source}; {kept}")]
    Optim {
        /// Step of the fit.
        step: u64,
        /// What the optimizer says.
        source: photofit_optim::OptimError,
        /// What remains.
        kept: String,
    },
    /// The loss is not finite.
    #[error("step {step}: the loss is {value}; {kept}")]
    Loss {
        /// Step of the fit.
        step: u64,
        /// The loss.
        value: f64,
        /// What remains.
        kept: String,
    },
    /// The device that the fit ran on failed.
    #[error("step {step}: {source}; {kept}")]
    Device {
        /// Step of the fit.
        step: u64,
        /// What the device says.
        source: Box<dyn std::error::Error + Send + Sync>,
        /// What remains.
        kept: String,
    },
    /// The values of a step have no picture or no derivatives.
    #[error("step {step}: {source}; {kept}")]
    Picture {
        /// Step of the fit.
        step: u64,
        /// Why.
        source: Box<Self>,
        /// What remains.
        kept: String,
    },
    /// A device cannot hold the fit.
    #[cfg(feature = "gpu")]
    #[error("the fit does not fit on {device}: {source}")]
    NoRoom {
        /// The device.
        device: String,
        /// What it says, and which option makes the fit smaller.
        source: Box<crate::engine::gpu::NoRoom>,
    },
    /// The device that draws the pictures of a reference failed.
    #[cfg(feature = "gpu")]
    #[error("pictures of the reference on {device}: {source}")]
    Drawing {
        /// The device.
        device: String,
        /// What it says.
        source: photofit_gpu::GpuError,
    },
    /// An optimizer or its preconditioner could not be set up.
    #[error("preconditioner: {0}")]
    Preconditioner(#[source] photofit_optim::OptimError),
    /// The reference cannot be path traced.
    #[error("path tracing: {0}")]
    PathTrace(#[from] photofit_pathtrace::PathtraceError),
    /// A guide of path tracing could not be made or trained.
    #[error("guiding: {0}")]
    Guide(#[from] photofit_flow::FlowError),
    /// A picture could not be written.
    #[error(transparent)]
    Image(#[from] photofit_image::ImageError),
    /// A file could not be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// A checkpoint that does not belong to this fit.
    #[error("{path}: {rule}")]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// The rule that it breaks.
        rule: String,
    },
    /// A checkpoint of a fit with other options, or of another asset, light or picture.
    #[error("{path}: is the checkpoint of another fit: {}", told(differences))]
    OtherFit {
        /// The file.
        path: PathBuf,
        /// What differs; at least one.
        differences: Vec<Difference>,
    },
    /// A setting out of range.
    #[error("{field} {rule}")]
    Setting {
        /// Name of the field.
        field: &'static str,
        /// What it is and what it must be.
        rule: String,
    },
    /// A folder of pictures that cannot be used.
    #[error("{path}: {rule}")]
    Pictures {
        /// The file.
        path: PathBuf,
        /// The place in it and the rule that is broken.
        rule: String,
    },
    /// Stopped by the user before there was anything to keep.
    #[error("stopped before there was anything to keep; nothing was written")]
    Interrupted,
}

/// What differs between the fit that wrote a checkpoint and the one that reads it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// Name of the option, or of what is fitted or looked at.
    pub field: String,
    /// Its value in the checkpoint; `None` where it had none.
    pub was: Option<String>,
    /// Its value now.
    pub is: Option<String>,
    /// Whether the values are digests, which say nothing to people.
    pub digest: bool,
}

impl FitError {
    /// The error of a fit at a step, of which `kept` says what remains, where a device failed that draws for it.
    pub(crate) fn at_step(self, step: u64, kept: impl FnOnce() -> String) -> Self {
        #[cfg(feature = "gpu")]
        if let Self::Drawing { source, .. } = self {
            return Self::Device { step, source: Box::new(source), kept: kept() };
        }
        let _ = (step, kept);
        self
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.digest {
            return write!(f, "{} is not the same", self.field);
        }
        let value = |v: &Option<String>| v.clone().unwrap_or_else(|| "not given".into());
        write!(f, "{} was {} and is {}", self.field, value(&self.was), value(&self.is))
    }
}

/// Differences in one line.
fn told(differences: &[Difference]) -> String {
    differences.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

/// Checks options, each with its name and its range.
///
/// # Errors
/// [`FitError::Setting`] for the first that is out of its range.
pub(crate) fn in_ranges<const N: usize>(
    options: [(&'static str, usize, RangeInclusive<usize>); N],
) -> Result<(), FitError> {
    for (field, is, range) in options {
        if !range.contains(&is) {
            let rule = format!("is {is}; it must be {} to {}", range.start(), range.end());
            return Err(FitError::Setting { field, rule });
        }
    }
    Ok(())
}
