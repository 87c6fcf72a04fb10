//! Validation: analytic answers and statistical tests of whole renders, before any golden image.

mod agreement;
mod analytic;
mod bounded;
mod furnace;
mod geometry;
mod lights;
mod media;
#[cfg(feature = "mitsuba")]
mod mitsuba;
mod plans;
mod progressive;
mod scenes;
#[cfg(feature = "mitsuba")]
mod seen_through;
mod statistics;
mod stress;
