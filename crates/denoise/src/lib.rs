//! Variational denoising of images and depth maps, Monte Carlo denoising, and surfaces from points.
//!
//! Everything works on plain slices: an image is one plane per channel, rows from the top ([`Shape`]).
//!
//! - [`mc`] denoises Monte Carlo renderings with automatic parameters.
//! - [`models`] names the convex models, [`admm`] solves them: a [`admm::Problem`] says what, [`admm::Admm`] does it.
//! - [`primal_dual`] holds Beltrami, TGV2, the accelerated method for ROF, and the certificate of its optimum.
//! - [`operators`] and [`transform`] hold the finite differences and the fast linear solvers below.
//!
//! ```
//! use photofit_denoise::{Shape, admm::{Admm, Stop}, models};
//! let shape = Shape::new(32, 32, 1);
//! let noisy: Vec<f32> = (0..1024).map(|k| (k / 512) as f32 + 0.1 * ((k * 37 % 11) as f32 / 5.0 - 1.0)).collect();
//! let mut admm = Admm::new(&models::rof(shape, &noisy, 4.0))?;
//! let report = admm.solve(Stop::Tolerance { tolerance: 1e-4, limit: 200 });
//! assert!(report.converged && admm.solution()[5 * 32 + 5].abs() < 0.1);
//! # Ok::<(), photofit_denoise::DenoiseError>(())
//! ```

pub mod admm;
mod error;
mod field;
mod future;
#[cfg(feature = "gpu")]
mod gpu;
pub mod mc;
pub mod models;
pub mod operators;
pub mod primal_dual;
pub mod surface;
pub mod transform;
mod wide;

pub use error::DenoiseError;
pub use field::{Shape, check_finite, mask_non_finite};
#[cfg(feature = "gpu")]
pub use gpu::KERNELS;
