//! What can go wrong with a device.

/// Errors of devices, buffers and kernels.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// No adapter fits the choice.
    #[error("no GPU adapter {wanted}; found: {found}")]
    NoAdapter {
        /// The choice, as a phrase.
        wanted: String,
        /// Names of the adapters that there are.
        found: String,
    },
    /// The adapter gave no device.
    #[error("adapter {adapter} gives no device: {reason}")]
    NoDevice {
        /// Name of the adapter.
        adapter: String,
        /// What the driver said.
        reason: String,
    },
    /// A buffer exceeds what the device can bind.
    #[error("buffer {name} takes {bytes} bytes; {device} binds at most {limit} ({which})")]
    TooLarge {
        /// Label of the buffer.
        name: String,
        /// Its size.
        bytes: u64,
        /// The device's limit.
        limit: u64,
        /// Name of the limit.
        which: &'static str,
        /// Name of the adapter.
        device: String,
    },
    /// The device's memory is used up.
    #[error("out of device memory for buffer {name} of {bytes} bytes")]
    OutOfMemory {
        /// Label of the buffer.
        name: String,
        /// Its size.
        bytes: u64,
    },
    /// A kernel does not compile, or not on this device.
    #[error("kernel {kernel}: {reason}")]
    Kernel {
        /// Name of the kernel.
        kernel: String,
        /// The compiler's or the driver's message.
        reason: String,
    },
    /// A dispatch does not fit its kernel.
    #[error("kernel {kernel}: {rule}")]
    Dispatch {
        /// Name of the kernel.
        kernel: String,
        /// The rule that is broken.
        rule: String,
    },
    /// A copy, a write or a clear does not fit its buffer.
    #[error("buffer {name}: {rule}")]
    Buffer {
        /// Label of the buffer.
        name: String,
        /// The rule that is broken.
        rule: String,
    },
    /// The driver refused a command.
    #[error("the device refused a command: {0}")]
    Device(String),
    /// The device is gone: driver reset, unplugged, or out of time.
    #[error("the device was lost: {0}")]
    Lost(String),
}

impl GpuError {
    /// Whether something is larger than the device takes or than it has room for: less might fit.
    pub fn is_of_size(&self) -> bool {
        matches!(self, Self::TooLarge { .. } | Self::OutOfMemory { .. })
    }
}
