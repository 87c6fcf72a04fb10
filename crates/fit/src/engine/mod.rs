//! The parts that a fit is assembled from: reference, views, model, loss, trainer, judge.

pub(crate) mod checkpoint;
pub(crate) mod judge;
pub(crate) mod plan;
pub(crate) mod pool;
pub(crate) mod reference;
pub(crate) mod trainer;
pub mod views;
