//! The registry of suites.

mod rays;

use anyhow::Result;

use crate::context::Context;

/// One suite.
pub(crate) struct Suite {
    pub(crate) name: &'static str,
    /// What is measured, one line.
    pub(crate) about: &'static str,
    pub(crate) run: fn(&mut Context) -> Result<()>,
}

/// All suites, in the order in which they run.
pub(crate) const SUITES: &[Suite] = &[Suite {
    name: "rays",
    about: "ray casting through the hierarchy, time against triangles",
    run: rays::run,
}];
