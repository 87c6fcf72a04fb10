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

/// The largest words that a device adds to in memory, from many invocations at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum WordsAdded {
    Bits32,
    Bits64,
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
    /// The source for devices that add words of 64 bits in memory, or for the others: lines between `//@ 32` and `//@` or
    /// `//@ 64` are for others alone, those between `//@ 64` and `//@` for these.
    pub(crate) fn text(&self, words: WordsAdded) -> String {
        let (mut text, mut section) = (String::new(), None);
        for line in self.source.iter().flat_map(|part| part.lines()) {
            match line {
                "//@ 32" => section = Some(WordsAdded::Bits32),
                "//@ 64" => section = Some(WordsAdded::Bits64),
                "//@" => section = None,
                _ if section.is_none_or(|s| s == words) => {
                    text += line;
                    text.push('\n');
                }
                _ => {}
            }
        }
        text
    }

    pub(crate) fn error(&self, reason: impl Into<String>) -> GpuError {
        GpuError::Kernel { kernel: self.name.into(), reason: reason.into() }
    }

    /// Parses and validates the source, without a device.
    pub(crate) fn reflect(&self, words: WordsAdded) -> Result<Reflection, GpuError> {
        let text = self.text(words);
        let module = naga::front::wgsl::parse_str(&text).map_err(|e| self.error(e.emit_to_string(&text)))?;
        let flags = naga::valid::ValidationFlags::all();
        let mut capabilities = naga::valid::Capabilities::default();
        if words == WordsAdded::Bits64 {
            capabilities |= naga::valid::Capabilities::SHADER_INT64
                | naga::valid::Capabilities::SHADER_INT64_ATOMIC_ALL_OPS;
        }
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
    kernel.reflect(WordsAdded::Bits64)?;
    kernel.reflect(WordsAdded::Bits32).map(|_| ())
}
