//! Random numbers, low-discrepancy points, warps and discrete distributions.
//!
//! Everything is a pure function of its seeds: [`Rng`] and [`Sobol`] use integer arithmetic and exactly rounded
//! floating-point operations alone, so that they give the same bits on every platform. The warps call the platform's
//! sine and cosine, whose last bit may differ.
//!
//! ```
//! use photofit_sampling::{Rng, cosine_hemisphere};
//! let mut rng = Rng::new(7, 0);
//! let wo = cosine_hemisphere([rng.next_f32(), rng.next_f32()]);
//! assert!(wo.z >= 0.0 && (wo.length() - 1.0).abs() < 1e-6);
//! ```

mod alias;
mod bilinear;
pub mod chi_square;
mod direction;
mod mis;
mod normal;
mod rng;
mod rotation;
mod sobol;
mod warp;

#[cfg(test)]
mod statistics;

pub use alias::{AliasError, AliasSample, AliasTable};
pub use bilinear::Bilinear;
pub use direction::{
    DirectionSample, DirectionSampler, Paths, Scattering, ScatteringSampler, SideBySide, Vertex,
};
pub use mis::{balance_heuristic, power_heuristic};
pub use normal::inverse_normal_cdf;
pub use rng::{Rng, SplitMix64, WGSL, hash, unit_f32, unit_f64};
pub use rotation::random_rotation;
pub use sobol::{SOBOL_DIMENSIONS, Sobol, SobolPoint, nested_uniform_scramble, sobol_u32};
pub use warp::{
    concentric_disk, concentric_disk_pdf, cosine_hemisphere, cosine_hemisphere_pdf, fibonacci_sphere,
    uniform_hemisphere, uniform_hemisphere_pdf, uniform_sphere, uniform_sphere_pdf, uniform_triangle,
    uniform_triangle_pdf,
};
