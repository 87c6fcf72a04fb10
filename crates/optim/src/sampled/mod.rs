//! Derivatives of black boxes by sampling: gradients, Hessians and optimizers for functions known by values only.
//!
//! A renderer without derivatives, or one whose derivatives are zero almost everywhere, still has a smoothed objective
//! `F(theta) = E[f(theta + sigma t)]`, `t` normal, with derivatives that are averages of values of `f`
//! (Fischer and Ritschel 2023, Wang et al. 2025). [`Objective`] samples them: gradient, Hessian, Hessian times a vector,
//! and the curvature `d^T H d` along one direction, whose variance does not grow with the number of parameters.
//! [`minimize`] uses them.
//!
//! What makes the estimates usable is what cancels: values are taken in groups ([`Stencil`]) that see the same noise, so
//! that constant parts (and linear ones, for Hessians) leave no trace. See [`Estimator`].
//!
//! - A loss smoothed as it is: [`SmoothedLoss`]. A loss of an image, with the loss or the image smoothed:
//!   [`RenderedLoss`]. A black box behind a function with known derivatives: [`GreyBox`].
//! - Estimates come with their variance and say when they saw nothing but a plateau ([`Estimate::informative`]).
//! - Everything is a function of the seed; results do not depend on the number of threads.
//!
//! ```
//! use photofit_optim::sampled::{Method, Settings, SmoothedLoss, minimize, serial};
//! // The number of quarter units by which a box misses its place: constant almost everywhere.
//! let miss = serial(|x: &[f64], _seed| {
//!     Ok::<_, std::convert::Infallible>(((x[0] - 0.7).abs() * 4.0).ceil() + ((x[1] + 0.3).abs() * 4.0).ceil())
//! });
//! let mut objective = SmoothedLoss::new(miss, 2)?;
//! let outcome = minimize(&mut objective, &[3.0, 2.0], &Method::l_bfgs(), &Settings::default())?;
//! assert!((outcome.theta[0] - 0.7).abs() < 0.1 && (outcome.theta[1] + 0.3).abs() < 0.1);
//! # Ok::<(), photofit_optim::sampled::SampledError<std::convert::Infallible>>(())
//! ```

mod black_box;
mod directional;
mod error;
mod estimate;
mod gradient;
mod grey_box;
mod hessian;
mod image;
pub mod kernel;
mod minimize;
mod noise;
mod objective;

pub use black_box::{Batch, BlackBox, Parallel, Serial, parallel, serial};
pub use error::SampledError;
pub use estimate::{Estimate, Estimator, Kernel, Stencil};
pub use grey_box::{GreyBox, WhiteBox};
pub use image::{ImageLoss, RenderedLoss, Renderer, Smoothing, SquaredError};
pub use minimize::{
    Advance, Annealing, Curve, Method, Outcome, Progress, Record, Settings, Stop, minimize, minimize_watched,
};
pub use objective::{Objective, SamplePoint, SmoothedLoss};

#[cfg(test)]
mod tests;
