//! Clippy, rustdoc and licences, all without a warning; the features of the crates one by one.

use anyhow::Result;

use crate::shell::{is_installed, run_cargo, run_cargo_with};
use crate::tidy::metadata::Workspace;

/// Runs the linters; the first one that warns is an error.
pub(crate) fn run() -> Result<()> {
    run_cargo(&["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"])?;
    // `RUSTDOCFLAGS` leaves the compiled dependencies alone, `RUSTFLAGS` would rebuild them.
    run_cargo_with(&["doc", "--workspace", "--no-deps"], &[("RUSTDOCFLAGS", "-D warnings")])?;
    if is_installed("cargo-deny", &[]) {
        // Advisories come over the network and change from day to day: `cargo deny check advisories` by hand.
        run_cargo(&["deny", "check", "bans", "licenses", "sources"])
    } else {
        println!("SKIPPED: cargo deny check (licences, bans, sources): cargo-deny is not installed");
        Ok(())
    }
}

/// Clippy on each library with features (the facade among them): with none, and with each feature alone. What the
/// workspace joins by the features of all its members hides what is missing or unused in one crate alone.
pub(crate) fn features_one_by_one() -> Result<()> {
    for found in Workspace::read()?.crates {
        // Nobody builds the benchmarks for another program.
        if found.features.is_empty() || found.name == "photofit-bench" {
            continue;
        }
        let alone = ["clippy", "--quiet", "-p", &found.name, "--no-default-features"];
        let deny = ["--", "-D", "warnings"];
        run_cargo(&[&alone[..], &deny].concat())?;
        for feature in found.features.iter().filter(|f| *f != "default") {
            run_cargo(&[&alone[..], &["--features", feature], &deny].concat())?;
        }
    }
    Ok(())
}
