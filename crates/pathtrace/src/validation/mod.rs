//! Validation: analytic answers and statistical tests of whole renders, before any golden image.

mod absorption;
mod adaptive;
mod agreement;
mod analytic;
mod bounded;
mod distances;
mod edits;
mod furnace;
mod geometry;
mod gradients;
mod library;
mod lights;
mod media;
mod medium_emission;
#[cfg(feature = "mitsuba")]
mod mitsuba;
mod plans;
mod progressive;
#[cfg(feature = "mitsuba")]
mod reference_gradients;
mod scenes;
#[cfg(feature = "mitsuba")]
mod seen_through;
mod sinks;
mod statistics;
mod stress;
mod textured_lights;
mod thrown;
mod volume_gradients;
