//! Validates the kernels of all crates, without a device.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use crate::shell::run_cargo;

/// Declaration of a crate's kernels, and the test that parses and validates them.
const DECLARATION: &str = "pub const KERNELS: &[Kernel]";
const TEST: &str = "kernels_are_valid";

/// Runs the test of every crate that has kernels; a crate without the test is an error.
pub(crate) fn run() -> Result<()> {
    let mut found = 0;
    for folder in folders(Path::new("crates"))? {
        let (mut declares, mut tests) = (false, false);
        visit(&folder.join("src"), &mut |text| {
            declares |= text.contains(DECLARATION);
            tests |= text.contains(&format!("fn {TEST}()"));
        })?;
        if declares && !tests {
            bail!("{}: has kernels, but no test {TEST}", folder.display());
        }
        found += usize::from(declares);
    }
    if found == 0 {
        bail!("no crate has kernels: `{DECLARATION}` is nowhere in crates");
    }
    println!("{found} crates with kernels");
    // The features and so the artefacts of the test command.
    run_cargo(&["test", "--workspace", "--lib", "--quiet", TEST])
}

/// The folders in a folder, sorted.
fn folders(of: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(of).with_context(|| of.display().to_string())?;
    let mut out: Vec<PathBuf> = entries.filter_map(|e| e.ok().map(|e| e.path())).collect();
    out.retain(|p| p.is_dir());
    out.sort();
    Ok(out)
}

/// Shows the text of every Rust file below a folder.
fn visit(folder: &Path, see: &mut impl FnMut(&str)) -> Result<()> {
    for entry in std::fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let path = entry?.path();
        if path.is_dir() {
            visit(&path, see)?;
        } else if path.extension().is_some_and(|e| e == "rs") {
            see(&std::fs::read_to_string(&path).with_context(|| path.display().to_string())?);
        }
    }
    Ok(())
}
