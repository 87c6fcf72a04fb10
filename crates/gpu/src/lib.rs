//! One wgpu device: adapters, buffers, compute kernels, and recordings of them.
//!
//! The only crate that opens a device. Operations of other crates bring their WGSL as [`Kernel`] constants and put them
//! into a [`Recorder`]; the finished [`Recording`] is run again and again without allocation, in one submission.
//!
//! ```
//! use photofit_gpu::{Choice, Gpu, GpuError, INDEX, Kernel};
//! const DOUBLE: Kernel = Kernel {
//!     name: "double",
//!     source: &[INDEX, "
//!         struct Params { count: u32, a: u32, b: u32, c: u32 }
//!         @group(0) @binding(0) var<uniform> params: Params;
//!         @group(0) @binding(1) var<storage, read_write> x: array<f32>;
//!         @compute @workgroup_size(64)
//!         fn run(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
//!                @builtin(local_invocation_index) lane: u32) {
//!             let i = index(group, groups, lane, 64u);
//!             if i < params.count { x[i] *= 2.0; }
//!         }"],
//!     entry: "run",
//! };
//! let gpu = match Gpu::new(&Choice::Any) {
//!     Err(GpuError::NoAdapter { .. }) => return Ok(()),
//!     gpu => gpu?,
//! };
//! let x = gpu.upload("x", &[1.0_f32, 2.0, 3.0])?;
//! let mut recorder = gpu.record("example");
//! recorder.dispatch(&DOUBLE, &[3_u32, 0, 0, 0], &[x.bind()], 3)?;
//! let mut recording = recorder.finish()?;
//! recording.run()?;
//! recording.run()?;
//! assert_eq!(gpu.read(&x)?, [4.0, 8.0, 12.0]);
//! # Ok::<(), GpuError>(())
//! ```

mod adapter;
mod buffer;
mod device;
mod error;
mod fixed;
mod kernel;
mod memory;
mod profile;
mod record;
#[cfg(not(target_arch = "wasm32"))]
mod testing;
mod wait;

#[cfg(not(target_arch = "wasm32"))]
pub use adapter::adapters;
pub use adapter::{AdapterKind, AdapterReport, Choice, adapters_found};
pub use buffer::{Bind, Buffer};
pub use device::{Gpu, Traffic};
pub use error::GpuError;
pub use fixed::{FIXED, FIXED_LIMITED, FIXED_LOST, FIXED_READ, fixed_words};
pub use kernel::{INDEX, Kernel, Z_CURVE, validate};
pub use memory::Caps;
pub use profile::KernelReport;
pub use record::{CopySlot, Recorder, Recording, Slot};
#[cfg(not(target_arch = "wasm32"))]
pub use testing::{assert_twin, run_device_tests, test_device};

#[cfg(test)]
mod tests;
