//! Optimizers on plain slices: one first-order design of temporal and spatial filters, schedules and constraints.
//!
//! An [`Optimizer`] holds the state of one parameter group (a named flat slice); the caller passes the learning rate at
//! each step. Every step first checks the gradients: a NaN or an infinity is an error naming group and index, and leaves
//! parameters and state as they were. Work runs in fixed chunks on all threads, and the results do not depend on
//! their number. [`State`] is all that a checkpoint needs to resume to the same bits.
//!
//! | feature | adds | needs |
//! |---|---|---|
//! | `mesh` | diffusion over meshes: `LargeSteps`, `EdgeAware`, `SampledNormals` | `faer` (sparse Cholesky) |
//! | `gpu` | twins of a fit's optimizers on a device: module `gpu` | `wgpu` |
//! | `fft` | diffusion over grids: `ScreenedPoisson` | `photofit-fft` |
//!
//! None is on by default: optimizers, bilateral filters and [`sampled`] derivatives need neither.

mod constrain;
mod error;
#[cfg(feature = "gpu")]
pub mod gpu;
#[cfg(feature = "mesh")]
mod mesh;
mod optimizer;
pub mod sampled;
mod scan;
mod schedule;
mod spatial;
mod state;

pub use constrain::{clamp_channels, normalize_vectors};
pub use error::OptimError;
#[cfg(feature = "mesh")]
pub use mesh::{EdgeAware, LargeSteps, SampledNormals, SampledNormalsConfig};
pub use optimizer::{Optimizer, SecondMoment, Temporal};
pub use scan::Rows;
pub use schedule::{LaplacianWeight, Schedule};
pub use spatial::bilateral::{Bilateral, GridBilateral, GuideMap, Sigma, Source, Taps};
pub use spatial::grid::Grid;
#[cfg(feature = "fft")]
pub use spatial::screened_poisson::ScreenedPoisson;
pub use spatial::{Guidance, Placement, SpatialFilter};
pub use state::State;
