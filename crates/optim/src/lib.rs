//! Optimizers on plain slices: gradient descent, the Adam family, Large Steps, schedules and constraints.
//!
//! One optimizer holds the state of one parameter group (a named flat slice); the caller passes the learning rate at
//! each step. Every step first checks the gradients: a NaN or an infinity is an error naming group and index, and leaves
//! parameters and state as they were. Work runs in fixed chunks on all threads, and the results do not depend on
//! their number. [`State`] is all that a checkpoint needs to resume to the same bits.

mod adam;
mod constrain;
mod error;
mod large_steps;
pub mod sampled;
mod scan;
mod schedule;
mod sgd;
mod state;
mod uniform_adam;

pub use adam::{Adam, AdamConfig};
pub use constrain::{clamp_channels, normalize_vectors};
pub use error::OptimError;
pub use large_steps::LargeSteps;
pub use scan::Rows;
pub use schedule::{LaplacianWeight, Schedule};
pub use sgd::Sgd;
pub use state::{Optimizer, State};
pub use uniform_adam::UniformAdam;
