//! Compute kernels: WGSL in parts, whose bindings are read from the source.

use crate::GpuError;
use crate::adapter::STORAGE_BUFFERS;

/// Numbers the invocations of a dispatch: put first into [`Kernel::source`].
pub const INDEX: &str = include_str!("wgsl/index.wgsl");
/// Column and row of a lane in a square of 8 x 8, along a Z curve (`z_curve`).
pub const Z_CURVE: &str = include_str!("wgsl/z_curve.wgsl");

/// A compute kernel: a constant.
#[derive(Clone, Copy, Debug)]
pub struct Kernel {
    /// Name in messages and profiles.
    pub name: &'static str,
    /// WGSL, in parts that are joined.
    pub source: &'static [&'static str],
    /// Entry point. `@group(0) @binding(0)` is a uniform with the parameters, or not used; the other bindings are
    /// storage buffers.
    pub entry: &'static str,
}

/// What a kernel's source says of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Reflection {
    /// Size of the parameters in bytes; 0 without any.
    pub(crate) params: u32,
    /// Number of each storage binding that the entry point uses, ascending, and whether it is written.
    pub(crate) storage: Vec<(u32, bool)>,
    /// Lanes of a workgroup.
    pub(crate) lanes: u32,
}

impl Kernel {
    pub(crate) fn text(&self) -> String {
        self.source.join("\n")
    }

    pub(crate) fn error(&self, reason: impl Into<String>) -> GpuError {
        GpuError::Kernel { kernel: self.name.into(), reason: reason.into() }
    }

    /// Parses and validates the source, without a device.
    pub(crate) fn reflect(&self) -> Result<Reflection, GpuError> {
        let text = self.text();
        let module = naga::front::wgsl::parse_str(&text).map_err(|e| self.error(e.emit_to_string(&text)))?;
        let (flags, capabilities) =
            (naga::valid::ValidationFlags::all(), naga::valid::Capabilities::default());
        let info = naga::valid::Validator::new(flags, capabilities)
            .validate(&module)
            .map_err(|e| self.error(e.emit_to_string(&text)))?;
        let at = module
            .entry_points
            .iter()
            .position(|e| e.name == self.entry)
            .ok_or_else(|| self.error(format!("has no entry point {}", self.entry)))?;
        let [x, y, z] = module.entry_points[at].workgroup_size;
        let mut out = Reflection { params: 0, storage: Vec::new(), lanes: x * y * z };
        let used = info.get_entry_point(at);
        for (handle, variable) in module.global_variables.iter() {
            let Some(binding) = variable.binding.filter(|_| !used[handle].is_empty()) else { continue };
            let name = variable.name.as_deref().unwrap_or("?");
            if binding.group != 0 {
                return Err(
                    self.error(format!("{name} is in group {}; all bindings are in group 0", binding.group))
                );
            }
            match variable.space {
                naga::AddressSpace::Uniform if binding.binding == 0 => {
                    out.params = module.types[variable.ty].inner.size(module.to_ctx());
                }
                naga::AddressSpace::Storage { access } if binding.binding > 0 => {
                    out.storage.push((binding.binding, access.contains(naga::StorageAccess::STORE)));
                }
                _ => {
                    return Err(self.error(format!(
                        "{name} at binding {}: a uniform is at 0, storage buffers after it",
                        binding.binding
                    )));
                }
            }
        }
        out.storage.sort_unstable();
        let bound = out.storage.len();
        if bound > STORAGE_BUFFERS as usize {
            let rule = format!("binds {bound} storage buffers; adapters are asked for {STORAGE_BUFFERS}");
            return Err(self.error(rule));
        }
        Ok(out)
    }
}

/// Checks a kernel without a device.
///
/// # Errors
/// [`GpuError::Kernel`] with the place in the source, or with the convention that is broken.
pub fn validate(kernel: &Kernel) -> Result<(), GpuError> {
    kernel.reflect().map(|_| ())
}
