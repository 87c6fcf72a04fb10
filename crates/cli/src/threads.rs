//! `--threads`.

use anyhow::{Result, anyhow};

/// Sizes the pool that all crates share; all cores without a number.
///
/// # Errors
/// If the system refuses the threads.
pub(crate) fn set(threads: Option<u16>) -> Result<()> {
    let Some(n) = threads else { return Ok(()) };
    rayon::ThreadPoolBuilder::new()
        .num_threads(usize::from(n))
        .build_global()
        .map_err(|e| anyhow!("--threads {n}: {e}"))
}
