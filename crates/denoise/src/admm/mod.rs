//! One over-relaxed ADMM for all convex models: total variation, Hessian and guided gradient under quadratic, absolute,
//! hybrid and one-sided Huber data terms.
//!
//! [`Problem`] says what is minimised, [`Admm`] does it step by step (Boyd et al. 2011). With scaled duals `b`, penalties `t`
//! and relaxation `a`, a step is
//!
//! ```text
//! u  = (t0 + (t1+t3) L + t2 L^2)^-1 ( t0(p-b0) - t1 div(w-b) + t2 H^T(v-d) - t3 div(t+g-e) )
//! p  = prox(a u + (1-a) p + b0)              w = S(a grad u + (1-a) w + b, alpha/t1)
//! v  = S(a H u + (1-a) v + d, beta/t2)       t = S(a (grad u - g) + (1-a) t + e, gamma/t3)
//! ```
//!
//! with the dual of each split increased by what its map took away, and `S(x, s) = x max(|x|-s, 0)/|x|`. Components at
//! the border pass `S` unchanged: natural boundaries. Each iteration is one pass over the rows for all splits at
//! once, and either one exact solve ([`crate::transform::StripSolver`]) or one sweep in the same pass ([`LinearStep`]).

mod energy;
mod exact;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;
mod penalties;
mod plan;
mod problem;
mod rows;
mod solver;
mod split;
mod stop;
mod survey;
mod sweep;

#[cfg(all(feature = "gpu", not(target_arch = "wasm32")))]
pub use gpu::solve_on;
#[cfg(feature = "gpu")]
pub use gpu::{DeviceAdmm, fetch_solution};
pub use penalties::{LinearStep, Penalties, contrast};
pub use plan::{AdmmPlan, ChannelPlan};
pub use problem::{Coupling, DataTerm, Guide, Problem, Weight};
pub use solver::Admm;
pub use stop::{Report, Stop};

#[cfg(test)]
pub(crate) mod tests;
