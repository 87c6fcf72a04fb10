//! The registry of suites.

mod atlas;
mod decimate;
mod metrics;
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
pub(crate) const SUITES: &[Suite] = &[
    Suite { name: "metrics", about: "image metrics, time against size", run: metrics::run },
    Suite {
        name: "rays",
        about: "ray casting through the hierarchy, time against triangles",
        run: rays::run,
    },
    Suite {
        name: "decimate",
        about: "decimation to 3%, time and error against triangles",
        run: decimate::run,
    },
    Suite { name: "atlas", about: "unwrapping, time and stretch against triangles", run: atlas::run },
];
