//! Everything CI runs, in order.

use anyhow::Result;

use crate::{lint, shaders, tasks, tidy, web};

/// Tidy, lint, shaders, crates for browsers, then the test command of the README unless `no_test`.
pub(crate) fn run(no_test: bool) -> Result<()> {
    tidy::run()?;
    lint::run()?;
    shaders::run()?;
    web::run(false)?;
    if no_test { Ok(()) } else { tasks::test(false, false) }
}
