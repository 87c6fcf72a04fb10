//! Denoising of Monte Carlo renderings, with automatic parameters: nothing needs tuning.
//!
//! ```text
//! radiance --holes, exact pixels, noise of features--> / divisor --exposure--> fireflies --(history: reproject, average)--> irradiance
//!   auto:         regression on normal and position in cells, width by estimated error --> detail --> x divisor --> edges
//!   rof, tvl1, hybrid: log(1+x) --> ADMM with alpha = c sigma W --> exp(x)-1 --> x divisor
//!   atrous:       five edge-stopping levels --> x divisor
//! ```
//!
//! [`denoise`] takes one [`Frame`], [`Sequence`] several of a static scene. Every stage writes a line into the
//! [`Plan`] of the result: what ran, what was skipped and why, and the time.

mod accumulate;
mod antialias;
mod atrous;
mod basis;
mod bilateral;
mod black;
mod camera;
mod coherence;
mod demodulate;
mod detail;
mod exact;
mod feature_filter;
mod feature_noise;
mod firefly;
mod frame;
mod gaussian;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;
mod log_domain;
mod noise;
mod peaks;
mod pipeline;
mod plan;
mod pooled;
mod prepare;
mod regression;
mod restore;
mod stage;
pub mod synthetic;
mod variational;
mod window;

#[cfg(test)]
mod tests;

/// Samples that one thread takes at a time where planes are copied or scaled.
const RUN: usize = 1 << 14;

pub use accumulate::{Accumulator, TemporalFrame, TemporalSettings};
pub use camera::Camera;
pub use coherence::{SHARPNESS, blended_weight, curvature};
pub use demodulate::{ALBEDO_FLOOR, demodulate, divisor, remodulate};
pub use frame::{Frame, Guides};
#[cfg(all(test, feature = "gpu"))]
pub(crate) use log_domain::way_back;
pub use noise::{log_sigma, mad_sigma};
#[cfg(all(feature = "gpu", not(target_arch = "wasm32")))]
pub use pipeline::denoise_on;
#[cfg(feature = "gpu")]
pub use pipeline::fetch_denoised;
pub use pipeline::{Denoised, Model, Sequence, Settings, denoise};
pub use plan::{Plan, Step};
pub use stage::{Stage, Stages};
pub use variational::{VariationalModel, adaptive_weight, choose_by_halves, solve_variational};
#[cfg(all(test, feature = "gpu"))]
pub(crate) use variational::{problem, score};
