//! Why a device cannot hold a fit, and which option makes it smaller.

use photofit_gpu::GpuError;
use photofit_optim::OptimError;
use std::borrow::Cow;

/// What a device cannot hold, or does not run.
#[derive(Debug, thiserror::Error)]
#[error("{source}{}", advice(.option))]
pub struct NoRoom {
    /// What the device says: the limit, what is needed and what it has.
    pub source: OptimError,
    /// The option that what is needed grows with; none where it is not a matter of size.
    pub option: Option<Cow<'static, str>>,
}

fn advice(option: &Option<Cow<'static, str>>) -> String {
    option.as_ref().map_or(String::new(), |option| format!("; a smaller `{option}` needs less"))
}

impl NoRoom {
    /// Pictures.
    pub(super) fn pictures(e: GpuError) -> Self {
        Self { source: e.into(), option: Some("resolution".into()) }
    }

    /// Maps and what belongs to their texels.
    pub(super) fn maps(e: impl Into<OptimError>) -> Self {
        Self { source: e.into(), option: Some("texture_size".into()) }
    }

    /// Whether memory is used up.
    pub(super) fn is_out_of_memory(&self) -> bool {
        matches!(&self.source, OptimError::Device(GpuError::OutOfMemory { .. }))
    }

    /// What has an entry per vertex or triangle.
    pub(super) fn mesh(e: impl Into<OptimError>) -> Self {
        Self { source: e.into(), option: Some("triangles".into()) }
    }
}

impl From<GpuError> for NoRoom {
    fn from(e: GpuError) -> Self {
        Self { source: e.into(), option: None }
    }
}
