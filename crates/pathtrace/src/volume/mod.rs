//! Participating media: grids of density in boxes, and media that surfaces bound.

mod bounded;
mod derivative;
mod emission;
mod field;
mod grid;
mod media;
mod parameter;
mod phase;
mod track;
mod untold;

pub use bounded::BoundedMedium;
pub use field::Field;
pub use grid::Volume;
pub use media::Boundary;
pub use parameter::{MediumRef, MediumValue};

pub(crate) use bounded::{InteriorMedium, Segment};
pub(crate) use derivative::Derivatives;
pub(crate) use emission::EmittingPart;
pub(crate) use grid::Medium;
pub(crate) use media::Media;
pub(crate) use phase::{phase, sample_phase};
pub(crate) use untold::Untold;
