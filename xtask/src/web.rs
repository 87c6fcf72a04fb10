//! Compiles the crates that work on arrays, with their kernels, for browsers.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, bail};

use crate::shell::run_cargo;

const TARGET: &str = "wasm32-unknown-unknown";

/// What needs neither files nor a blocking wait for a device.
const CRATES: [&str; 10] = [
    "photofit-scalar",
    "photofit-ktx2",
    "photofit-image",
    "photofit-texture",
    "photofit-sampling",
    "photofit-geometry",
    "photofit-rays",
    "photofit-shading",
    "photofit-optim",
    "photofit-denoise",
];

/// Checks the crates; says that it does not where the target is not installed.
pub(crate) fn run() -> Result<()> {
    if !is_installed()? {
        println!("SKIPPED: crates for browsers: `rustup target add {TARGET}`");
        return Ok(());
    }
    let packages = CRATES.iter().flat_map(|name| ["-p", *name]);
    let args: Vec<&str> =
        ["check", "--target", TARGET, "--no-default-features"].into_iter().chain(packages).collect();
    run_cargo(&args)
}

/// Whether the target's standard library is there.
fn is_installed() -> Result<bool> {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = Command::new(&rustc).args(["--print", "target-libdir", "--target", TARGET]).output();
    let output = output.with_context(|| format!("{}: cannot start", rustc.display()))?;
    if !output.status.success() {
        bail!("{}: does not know the target {TARGET}", rustc.display());
    }
    Ok(Path::new(String::from_utf8_lossy(&output.stdout).trim()).is_dir())
}
