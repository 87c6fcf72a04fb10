//! Clippy, rustdoc, facade features and licences, all without a warning.

use anyhow::Result;

use crate::shell::{is_installed, run_cargo, run_cargo_with};
use crate::tidy::metadata::Workspace;

/// Runs the linters; the first one that warns is an error.
pub(crate) fn run() -> Result<()> {
    run_cargo(&["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"])?;
    // `RUSTDOCFLAGS` leaves the compiled dependencies alone, `RUSTFLAGS` would rebuild them.
    run_cargo_with(&["doc", "--workspace", "--no-deps"], &[("RUSTDOCFLAGS", "-D warnings")])?;
    facade_features()?;
    if is_installed("cargo-deny", &[]) {
        // Advisories come over the network and change from day to day: `cargo deny check advisories` by hand.
        run_cargo(&["deny", "check", "bans", "licenses", "sources"])
    } else {
        println!("SKIPPED: cargo deny check (licences, bans, sources): cargo-deny is not installed");
        Ok(())
    }
}

/// Checks the facade with no feature and with each feature alone.
fn facade_features() -> Result<()> {
    let workspace = Workspace::read()?;
    let features = workspace.features("photofit");
    if features.is_empty() {
        println!("the facade has no features to check");
        return Ok(());
    }
    run_cargo(&["check", "-p", "photofit", "--no-default-features"])?;
    for feature in features.iter().filter(|f| *f != "default") {
        run_cargo(&["check", "-p", "photofit", "--no-default-features", "--features", feature])?;
    }
    Ok(())
}
