//! Primal-dual methods: accelerated Chambolle-Pock for ROF, Beltrami, and second-order total generalised variation.
//!
//! They need nothing but differences of neighbours. For uniform ROF the accelerated method is the reference against
//! which [`crate::admm`] is timed; Beltrami and TGV2 are not in the reach of its one linear step.

mod beltrami;
mod certificate;
mod chambolle_pock;
mod layout;
mod saddle;
mod tgv;

pub use beltrami::{Beltrami, beltrami_energy};
pub use certificate::{Gap, rof_gap};
pub use chambolle_pock::ChambollePock;
pub use tgv::{Tgv2, tgv2_energy};

#[cfg(test)]
mod tests;
