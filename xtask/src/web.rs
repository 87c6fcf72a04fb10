//! Compiles the crates that work on arrays, with their kernels, for browsers, and runs their twins in one.

mod browser;

use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, bail};

use crate::shell::run_cargo;

const TARGET: &str = "wasm32-unknown-unknown";

/// What needs no files.
const CRATES: [&str; 13] = [
    "photofit-scalar",
    "photofit-fft",
    "photofit-ktx2",
    "photofit-image",
    "photofit-texture",
    "photofit-sampling",
    "photofit-gpu",
    "photofit-geometry",
    "photofit-rays",
    "photofit-shading",
    "photofit-optim",
    "photofit-denoise",
    "photofit-raster",
];

/// Packages that have kernels behind a feature `gpu`.
const WITH_KERNELS: [&str; 6] = [
    "photofit-geometry",
    "photofit-texture",
    "photofit-shading",
    "photofit-optim",
    "photofit-denoise",
    "photofit-raster",
];

/// Checks the crates, and runs twins in a browser if asked; says that it does not where the target is not installed.
pub(crate) fn run(in_browser: bool) -> Result<()> {
    if !is_installed()? {
        println!("SKIPPED: crates for browsers: `rustup target add {TARGET}`");
        return Ok(());
    }
    let packages = CRATES.iter().flat_map(|name| ["-p", *name]);
    let features = WITH_KERNELS.map(|name| format!("{name}/gpu")).join(",");
    let args: Vec<&str> =
        ["check", "--target", TARGET, "--no-default-features"].into_iter().chain(packages).collect();
    run_cargo(&args)?;
    run_cargo(&[&args[..], &["--features", &features]].concat())?;
    if in_browser { browser::run() } else { Ok(()) }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_crate_with_kernels_is_compiled_with_them() {
        let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates");
        for name in CRATES {
            let file = crates.join(name.trim_start_matches("photofit-")).join("Cargo.toml");
            let manifest = std::fs::read_to_string(&file).expect("a manifest");
            let has_kernels = manifest.lines().any(|line| line.starts_with("gpu = ["));
            assert_eq!(has_kernels, WITH_KERNELS.contains(&name), "{name}");
        }
    }
}
