//! Participating media: grids of density with absorption and scattering.

mod grid;
mod phase;
mod track;

pub use grid::Volume;
pub(crate) use grid::{Media, Medium};
pub(crate) use phase::{phase, sample_phase};
